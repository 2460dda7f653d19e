"""Boards: a folder that is watched while frames arrive, frames that are solved, and the result proposed.

It is ``calibrary calibrate watch`` and ``calibrary calibrate``. The solve is a dry run that keeps the corners; once a
person confirms it, the same is solved from these corners and becomes a proposal.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec

from calibrary.errors import InputError
from calibrary.jobs.calibrate import write_board
from calibrary.jobs.calibrate.report import CalibrateReport
from calibrary.jobs.calibrate.told import told
from calibrary.jobs.calibrate_watch.session import WatchedFrame, WatchStatus
from calibrary.jobs.calibrate_watch.told import told as watched
from calibrary.jobs.desk.flights import Drop
from calibrary.jobs.desk.running import (
    DRY,
    REPORT,
    SAME,
    again_form,
    desk_page,
    files_form,
    flags,
    how,
    place_of,
    proposal_form,
    stated,
    without_result,
)
from calibrary.jobs.desk.work import Job
from calibrary.records import from_json, replace
from calibrary.validation import Use
from calibrary.view import (
    Badge,
    Block,
    Code,
    Field,
    Form,
    Link,
    Note,
    Section,
    Tone,
    View,
)

AGAIN: Final = Link("Other boards", "/boards")
CORNERS: Final = "corners.json"
BOARD: Final = Field(
    name="board", label="Board", hint="in inner corners: checkerboard:11x8, charuco:8x5, aprilgrid:6x6 …"
)
SQUARE: Final = Field(name="square-mm", label="Side of a square (mm)")
CAMERA: Final = (
    Field(name="make", label="Make, if the frames do not say"),
    Field(name="model", label="Model, if the frames do not say"),
    Field(name="focus", label="How the lens was focused", hint="such as: locked at infinity"),
)
ASKED: Final = (replace(BOARD, label="Board, if it is no checkerboard"), SQUARE, *CAMERA)
"""Under the names of the command's flags."""


def questions() -> View:
    """Make the page that asks for frames."""
    place = Field(name="place", label="Folder", hint="its whole path on this machine")
    whole = Field(name="whole", type="hidden", value="yes")
    frames = replace(place, label="Or their folder")
    return desk_page(
        title="Calibrate from a board",
        lead="K and distortion from frames of a board, with how far to trust them; written once you confirm it.",
        sections=(
            Section(
                title="Frames that you have",
                blocks=(files_form("/boards", "Solve these frames", frames, whole, *ASKED),),
            ),
            Section(
                title="While you photograph",
                blocks=(
                    "The folder in which frames arrive is watched: what each frame adds, what is covered, which pose "
                    "to take next, and whether it passes.",
                    Form(
                        to="/boards/watch",
                        button="Watch this folder",
                        fields=(replace(place, required=True), replace(BOARD, required=True), SQUARE),
                        is_aside=True,
                    ),
                ),
            ),
            Section(
                title="A board to print",
                blocks=(
                    "True to the millimetre, with a ruler to check the print. Glue it to glass.",
                    Form(
                        to="/boards/print",
                        button="Make the PDF",
                        fields=(
                            replace(BOARD, value="checkerboard:11x8", required=True),
                            replace(SQUARE, value="25", required=True),
                        ),
                        is_question=True,
                        is_aside=True,
                    ),
                ),
            ),
        ),
    )


def printed(folder: Path, asked: Mapping[str, str]) -> Path:
    """The PDF of a board in a folder.

    Raises:
        InputError: the side of a square is no number, or there is no such board.
        MissingExtraError: OpenCV is not installed.
    """
    try:
        square_mm = float(asked.get("square-mm", ""))
    except ValueError:
        raise InputError(
            f"{asked.get('square-mm', '')!r:.40} is no length, expected the side of a square in mm"
        ) from None
    board = asked.get("board", "")
    path = folder / f"{re.sub('[^0-9A-Za-z]+', '-', board)}.pdf"
    write_board(board, path, square_mm=square_mm)
    return path


def command(registry: Path, folder: Path, asked: Mapping[str, str]) -> tuple[list[str], str]:
    """The command that solves frames and writes nothing into the registry, and its title.

    Raises:
        InputError: the path is not a whole one.
    """
    place = place_of(asked.get("place", ""))
    words = ["calibrate", place, "--registry", str(registry), "--html", str(folder / REPORT)]
    words += ["--corners", str(folder / CORNERS), "--json", DRY]
    return [*words, *flags(asked, ASKED)], f"Board in {place}"


def watching(_: Path, __: Path, asked: Mapping[str, str]) -> tuple[list[str], str]:
    """The command that watches a folder, and its title.

    Raises:
        InputError: the path is not a whole one, or no board is named.
    """
    place = place_of(asked.get("place", ""))
    if not asked.get("board"):
        raise InputError("expected the board, in inner corners, such as checkerboard:11x8")
    return ["calibrate", "watch", place, "--json", *flags(asked, ASKED)], f"Watching {place}"


def proposing(job: Job, _: Path, asked: Mapping[str, str]) -> list[str]:
    """The command that does what a dry run showed, from its corners."""
    registry = job.words[job.words.index("--registry") + 1]
    words = [
        "calibrate",
        "--from",
        str(job.folder / CORNERS),
        "--registry",
        registry,
        *flags(stated(job), CAMERA),
    ]
    return [*words, "--yes", *([f"--reason={asked['reason']}"] if asked.get("reason") else [])]


def so_far(job: Job) -> tuple[Section, ...]:
    """What a watched folder gave so far; nothing of another command."""
    if "watch" not in job.words[:2]:
        return ()
    statuses = [from_json(WatchStatus, msgspec.json.decode(one)) for one in job.documents]
    if not statuses:
        return (Section(title="So far", blocks=("No frame has arrived yet.",)),)
    frames: dict[str, WatchedFrame] = {}
    for status in statuses:
        for frame in status.new:
            frames.pop(frame.name, None)
            frames[frame.name] = frame
    page = watched(statuses[-1], [*frames.values()])
    verdict = Section(title="Verdict", badge=page.badge, blocks=(page.lead,))
    return (verdict, *page.sections)


def solved(job: Job, address: str, drop: Drop | None) -> View:
    """Make the page of frames that were watched, solved or proposed.

    Args:
        job: the command.
        address: of this page.
        drop: the frames, if they were dropped.
    """
    if "watch" in job.words[:2]:
        return _watched(job)
    if "--yes" in job.words:
        return _proposed(job)
    found = job.documents
    if job.is_cancelled or not found:
        form = again_form(job, address, "/boards", "Solve again", ASKED, is_dropped=drop is not None)
        again = Section(title="Answer what the frames do not say", blocks=(form,))
        return without_result(job, again=AGAIN, more=again)
    done = from_json(CalibrateReport, msgspec.json.decode(found[-1]))
    view = told(done)
    return replace(
        view,
        title=f"{job.title}: {done.calibration.camera}",
        sections=(
            *(one for one in view.sections if one.printed),
            Section(title="Propose", blocks=tuple(_next(done, address))),
            Section(title="To take along", blocks=(*_files(address), *how(job, again=AGAIN))),
        ),
        contents=False,
    )


def _files(address: str) -> Iterator[Block]:
    yield Link("The whole report: every view, every plot", f"{address}/{REPORT}")
    yield Link("Everything as a zip: report and corners", f"{address}/all.zip")


def _next(done: CalibrateReport, address: str) -> Iterator[Block]:
    if done.verdict is Use.NONE:
        yield "What is refused becomes no entry."
        return
    yield "It becomes a proposal, in your name. What is in use stays in use."
    yield proposal_form(address)


def _watched(job: Job) -> View:
    found = so_far(job)
    if job.code not in {0, 1} and not job.is_cancelled and not job.documents:
        return without_result(job, again=AGAIN)
    hidden = {"place": job.words[2], **stated(job)}
    form = Form(
        to="/boards",
        button="Solve these frames",
        fields=(
            *(Field(name=name, type="hidden", value=value) for name, value in hidden.items()),
            *CAMERA,
        ),
    )
    return desk_page(
        title=job.title,
        lead="It passes: no more frames are needed."
        if job.code == 0
        else "Stopped; the frames are kept where they are.",
        sections=(Section(title="Now", blocks=(form, *how(job, again=AGAIN))), *found),
    )


def _proposed(job: Job) -> View:
    """What came of a confirmed proposal, as the command says it: the check of the registry may object."""
    good = "nothing was written" not in job.text and job.code in {0, 1} and not job.is_cancelled
    text = (
        "It is proposed, and not used until it is approved." if good else "Nothing was proposed; this is why:"
    )
    return desk_page(
        title=job.title,
        badge=Badge("proposed", Tone.GOOD) if good else Badge("not proposed", Tone.BAD),
        lead="Solved again from the corners that were found, and checked against the registry.",
        sections=(
            Section(
                title="The proposal",
                blocks=(
                    Note(text=text, tone=Tone.GOOD if good else Tone.BAD),
                    Code(text=job.text, label="What the command said"),
                    Link("Review it", "/review"),
                    AGAIN,
                    Code(text=job.command, label=SAME),
                ),
            ),
        ),
    )
