"""A folder of whatever came with a new payload in; a decision for each camera, and drafts, out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from msgspec import Struct, field

from calibrary.api.fleet import Fleet
from calibrary.api.stated import CameraLike, overlay
from calibrary.calib.board import parse_board
from calibrary.calibration import ImageSize
from calibrary.errors import InputError
from calibrary.extras import CALIBRATE, PAGES, SFM, require
from calibrary.jobs.exchange.add import Stated
from calibrary.jobs.onboard.estimates import Kind
from calibrary.jobs.onboard.flight import flight_hint
from calibrary.jobs.onboard.proposal import Serves
from calibrary.jobs.onboard.records import Onboarding, Questions, Request
from calibrary.jobs.onboard.report import report_of
from calibrary.jobs.onboard.run import BRANCHES, branch_name, write_drafts
from calibrary.jobs.onboard.run import onboard as run
from calibrary.progress import Progress
from calibrary.records import Json, to_json
from calibrary.registry.git.writing import Written

__all__ = ["OnboardResult", "flight_hint", "onboard"]


Q = TypeVar("Q")
A = TypeVar("A")


class OnboardResult(Struct, eq=False):
    """What a payload says of its cameras; nothing is written before :meth:`write_drafts`.

    Attributes:
        onboarding: all of it, as the command line shows it.
        written: the commit on each branch, once drafts are written.
    """

    onboarding: Onboarding
    written: Mapping[str, Written] = field(default_factory=dict)

    @property
    def is_good(self) -> bool:
        """Whether no camera is refused."""
        return self.onboarding.is_good

    @property
    def page_name(self) -> str:
        """A name for its page."""
        names = {branch_name(one.camera.key).removeprefix(BRANCHES) for one in self.onboarding.outcomes}
        return f"onboard-{names.pop() if len(names) == 1 else 'payload'}.html"

    def write_drafts(self, reason: str | None = None) -> Mapping[str, Written]:
        """Write what is proposed, on a branch for each model.

        Raises:
            RegistryError: it cannot be written.
        """
        self.written = write_drafts(self.onboarding, reason)
        return self.written

    def to_html(self) -> str:
        """The decisions and their reasons as a page."""
        from calibrary.jobs.onboard.page import onboard_page
        from calibrary.pages import render_page

        return render_page(onboard_page(self.onboarding))

    def to_dict(self, *, page: str | None = None) -> dict[str, Json]:
        """As plain data for JSON (schemas/onboard-1.schema.json); ``page`` is its page's name."""
        return to_json(report_of(self.onboarding, self.written, page or self.page_name))


def onboard(
    folder: str | Path,
    registry: Fleet,
    *,
    square_mm: float | Callable[[int], float] | None = None,
    serves: str | Callable[[str], str] | None = None,
    board: str | None = None,
    marker_mm: float | None = None,
    camera: CameraLike | None = None,
    image_size: ImageSize | None = None,
    trust: str | None = None,
    only: str | None = None,
    stated: Stated | None = None,
    flight: bool = False,
    label: str | None = None,
    workers: int = 0,
    progress: Progress | None = None,
) -> OnboardResult:
    """Sort what came with a new payload, identify its cameras, compare the sources of K and propose the best.

    Args:
        folder: images, frames of a board and calibration files, in sub-folders as they are.
        registry: to propose to.
        square_mm: side of the board's squares, or a function from the number of frames that asks for it.
        serves: "unit" or "model": whether a measured K is of this unit only; or a function from the camera's name
            that asks for it.
        board: which one, in inner corners; a checkerboard whose size is found by trying when not given.
        marker_mm: side of a marker.
        camera: what the payload does not say of its cameras, or says wrong.
        image_size: of calibration files that do not say theirs.
        trust: "board", "flight", "file" or "tags": the source to trust where sources disagree and nothing else decides.
        only: a part of the name of the cameras that are meant.
        stated: date, tool and operator of calibrations that do not say them.
        flight: calibrate from the images of a flight too, where 8 or more of one folder are of a camera: minutes.
        label: what the unit is called, "P4R-03"; a K that serves the whole model gets none.
        workers: processes; 0 decides by itself.
        progress: called with (done, in all, what): files that are sorted, then frames that are searched.

    Raises:
        InputError: the folder cannot be read, there is nothing of a camera in it, or an answer is missing.
        RegistryError: the registry cannot be read.
        MissingExtraError: what finds boards or draws the page is not installed.
    """
    require([*CALIBRATE, *PAGES, *(SFM if flight else ())], "onboard --flight" if flight else "onboard")
    if board is not None and not isinstance(square_mm, int | float):
        raise InputError("a board needs square_mm, the side of its squares")
    request = Request(
        folder=Path(folder),
        registry=registry.registry,
        questions=Questions(
            square_mm=lambda frames: _answer(square_mm, frames, "square_mm"),
            serves=lambda name: Serves(_answer(serves, name, "serves")),
            stated=Serves(serves) if isinstance(serves, str) else None,
        ),
        said=overlay(camera),
        image_size=image_size,
        board=parse_board(board, square_mm, marker_mm)
        if board is not None and isinstance(square_mm, int | float)
        else None,
        trusted=Kind(trust) if trust is not None else None,
        only=only,
        stated=stated or Stated(),
        flight=flight,
        label=label,
        workers=workers,
        progress=progress,
    )
    return OnboardResult(run(request))


def _answer(given: A | Callable[[Q], A] | None, question: Q, name: str) -> A:
    """What is given, or what a person answers.

    Raises:
        InputError: neither.
    """
    if given is None:
        raise InputError(f"{name} is needed and was not given: {question}")
    return given(question) if callable(given) else given
