"""Onboarding of a new payload: from a folder of mixed files to a decision and draft entries for each camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from msgspec import Struct, field

from calibrary.arguments import CameraLike, Stated, overlay
from calibrary.calib.board import parse_board
from calibrary.calibration import ImageSize
from calibrary.errors import InputError
from calibrary.extras import CALIBRATE, PAGES, SFM, require
from calibrary.jobs.fleet import Fleet
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
    """Decisions about the cameras of a payload; nothing is written before :meth:`write_drafts`.

    Attributes:
        onboarding: complete result, as the command line shows it.
        written: commit on each branch, after the drafts are written.
    """

    onboarding: Onboarding
    written: Mapping[str, Written] = field(default_factory=dict)

    @property
    def is_good(self) -> bool:
        """Whether no camera is refused."""
        return self.onboarding.is_good

    @property
    def page_name(self) -> str:
        """Default file name of the page."""
        names = {branch_name(one.camera.key).removeprefix(BRANCHES) for one in self.onboarding.outcomes}
        return f"onboard-{names.pop() if len(names) == 1 else 'payload'}.html"

    def write_drafts(self, reason: str | None = None) -> Mapping[str, Written]:
        """Write the proposals, on one branch per camera model.

        Raises:
            RegistryError: the registry cannot be written.
        """
        self.written = write_drafts(self.onboarding, reason)
        return self.written

    def to_html(self) -> str:
        """Return the decisions and their reasons as a page."""
        from calibrary.jobs.onboard.page import onboard_page
        from calibrary.pages import render_page

        return render_page(onboard_page(self.onboarding))

    def to_dict(self, *, page: str | None = None) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/onboard-1.schema.json); ``page``: file name of the page."""
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
    """Classify the files of a new payload, identify its cameras, compare the sources of K and propose the best.

    Args:
        folder: images, images of a board and calibration files, in any sub-folders.
        registry: registry to propose to.
        square_mm: side of the board's squares in mm, or a function that asks for it, called with the number of board
            images.
        serves: "unit" or "model": whether a measured K applies to this unit only; or a function that asks for it,
            called with the camera's name.
        board: board type and number of inner corners; by default a checkerboard of a size found by trial.
        marker_mm: side of a marker in mm.
        camera: facts about the cameras that the payload does not state or states wrongly.
        image_size: (width, height) px of calibration files that do not state it.
        trust: "board", "flight", "file" or "tags": source to use if sources disagree and nothing else decides.
        only: part of the name of the cameras to process.
        stated: date, tool and operator of calibrations that do not state them.
        flight: also calibrate from flight images, if a folder has 8 or more of a camera; this takes minutes.
        label: name of the unit, "P4R-03"; a K that applies to the whole model gets no label.
        workers: number of processes; 0 chooses it automatically.
        progress: called with (done, total, what): first for files that are classified, then for images searched for a
            board.

    Raises:
        InputError: the folder cannot be read, it contains no camera files, or an answer is missing.
        RegistryError: the registry cannot be read.
        MissingExtraError: the libraries for board detection or pages are not installed.
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
    """Return a given value, or the answer of a function that asks for it.

    Raises:
        InputError: neither is given.
    """
    if given is None:
        raise InputError(f"{name} is needed and was not given: {question}")
    return given(question) if callable(given) else given
