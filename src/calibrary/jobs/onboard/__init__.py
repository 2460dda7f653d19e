"""Decide on the cameras of a new payload: from a folder of mixed files to draft entries, with reasons.

>>> from calibrary.jobs.onboard import onboard
>>> camera = onboard("survey", registry="fleet", serves="model").cameras[0]
>>> camera.decision, camera.estimates[0].name
(<Decision.READY: 'ready, not written'>, 'drone-dji:DewarpData')
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from calibrary.arguments import File, Folder, Place, Stated, Text, Workers
from calibrary.errors import UsageError
from calibrary.known_camera import CameraKey
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.jobs.onboard.report import OnboardReport

__all__ = ["onboard"]


def onboard(
    folder: Folder,
    *,
    square_mm: Annotated[float, Meta(ge=0.01, le=10_000)] | None = None,
    serves: Literal["unit", "model"] | None = None,
    trust: Literal["board", "flight", "file", "tags"] | None = None,
    ask: Callable[[str, str], str] | None = None,
    board: Annotated[str, Meta(title="BOARD")] | None = None,
    marker_mm: Annotated[float, Meta(ge=0.01, le=10_000)] | None = None,
    flight: bool = False,
    only: Text | None = None,
    label: str | None = None,
    stated: Stated | None = None,
    camera: CameraKey | None = None,
    registry: Place | None = None,
    html: File | None = None,
    write: Callable[..., bool] | bool = False,
    digest: Annotated[str, Meta(title="HEX", min_length=8)] | None = None,
    reason: Text | None = None,
    workers: Workers = 0,
    progress: Progress | None = None,
) -> OnboardReport:
    """Classify the files of a new payload, identify its cameras, compare the sources of K and propose the best.

    Args:
        folder: what came with the payload: images, frames of a board, calibration files, in any sub-folders.
        square_mm: side of a square of the board in the frames.
        serves: whether a measured K is valid for this unit only, or for every unit of its model.
        trust: the source to trust if sources disagree and nothing else decides.
        ask: asks the user for ``square_mm`` and ``serves`` if they are needed; called with the question and the flag
            that would answer it.
        board: the board, in inner corners: checkerboard:11x8 (default: found by trying, unless of circles).
        marker_mm: side of a marker.
        flight: also calibrate from the flight, for a camera with 8 images or more in one folder; this adds one
            estimate (needs calibrary[sfm]; a few minutes).
        only: only cameras with this in the name, such as M3T wide.
        label: your name for the unit, as P4R-03; a KEY from then on. A K of the whole model gets no label.
        stated: date, tool and operator of calibrations that do not state them.
        camera: facts about the cameras that the payload does not state.
        registry: the registry; see calibrary registry --help for the default.
        html: page of the report (default: onboard-CAMERA.html, in this folder).
        write: write the drafts, each model's on a branch of its own; a function is called with the result so far and
            says whether.
        digest: write without asking, but only the cameras, entries and files of a dry run whose digest begins so.
        reason: why, for the history.
        workers: number of processes that read images; 0 chooses it.
        progress: called with (done, total, what): first for files that are classified, then for images searched for a
            board.

    Raises:
        UsageError: an answer is missing that only a person knows, nothing in the payload names a camera, or the digest
            is none.
        InputError: the folder cannot be read, or it contains nothing about a camera.
        RegistryError: the registry cannot be read, or not be written.
        MissingExtraError: the libraries for board detection or pages are not installed.
    """
    from calibrary.calib.board import parse_board
    from calibrary.extras import CALIBRATE, PAGES, SFM, require
    from calibrary.jobs.fleet import Fleet
    from calibrary.jobs.onboard.estimates import Serves
    from calibrary.jobs.onboard.report import Kind
    from calibrary.jobs.onboard.run import Onboarding, page_name, write_drafts
    from calibrary.jobs.onboard.told import told
    from calibrary.pages import check_page_place, write_page
    from calibrary.records import replace
    from calibrary.registry.proposals import SHORT_DIGEST

    if digest is not None and SHORT_DIGEST.match(digest.lower()) is None:
        raise UsageError(
            f"--digest {digest!r:.60}: expected at least 8 hexadecimal digits, as --dry-run prints them"
        )
    require([*PAGES, *([*CALIBRATE, *SFM] if flight else ())], "onboard --flight" if flight else "onboard")
    if board is not None and square_mm is None:
        raise UsageError("--board goes with --square-mm MM, the side of its squares")
    place, target = check_page_place(html), Fleet.named(registry).registry
    done = Onboarding(
        folder=Path(folder),
        registry=target,
        camera=camera or CameraKey(),
        stated=stated or Stated(),
        board=parse_board(board, square_mm, marker_mm) if board is not None else None,
        square_mm=square_mm,
        serves=Serves(serves) if serves is not None else None,
        ask=ask,
        trusted=Kind(trust) if trust is not None else None,
        flight=flight,
        label=label,
        workers=workers,
        progress=progress,
    ).run(only)
    place = place or Path(page_name(done))
    done = replace(done, page=place.name)
    write_page(place, told(done))
    is_wanted = write(done) if callable(write) else write or digest is not None
    if not is_wanted or not done.drafts or not done.is_as_seen(digest):
        return done
    done = write_drafts(done, target, reason)
    write_page(place, told(done))
    return done
