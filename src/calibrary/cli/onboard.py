"""``calibrary onboard``: make a draft entry, with reasons, from a folder of files that came with a new payload."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from calibrary.cli.calibrate.flags import number
from calibrary.cli.camera_flags import add_camera_flags, add_label_flag, camera_of
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.registry.asking import add_yes_flag, agreed, can_ask, deciding_screen
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.stated_flags import add_stated_flags, stated_of
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.text import Text

    from calibrary.api.onboarding import OnboardResult
    from calibrary.cli.console import Screen
    from calibrary.jobs.onboard.records import CameraDecision, Onboarding
    from calibrary.registry.git.writing import Written

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

EXIT_REFUSED: Final = 1
STYLES: Final = {"draft proposed": "bold green", "nothing new": "cyan", "refused": "bold red"}

DESCRIPTION = """\
Classify the files of a new payload (images, frames of a board, calibration files, in any sub-folders), identify its
cameras, compare every source of their K, and propose the best as a draft on a branch of the registry. The main
branch is not changed; a person approves.
"""
EXAMPLES = """\
examples:
  calibrary onboard payload/                                 asks for what it cannot know
  calibrary onboard payload/ --square-mm 40 --for unit --yes    for machines
  calibrary onboard payload/ --board charuco:8x5 --square-mm 30 --html report.html
  calibrary onboard payload/ --flight                        calibrate from the images of its flight too
  calibrary onboard payload/ --trust file                    if sources disagree and you know which is right

exit codes: 0 a draft is proposed, or nothing is new; 1 refused, and only the page is written; 2 an answer is missing
that only a person knows; 3 the folder cannot be read; 4 the registry.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="what came with the payload")
    asked = parser.add_argument_group("what only a person knows", "asked if it is needed and not given")
    asked.add_argument(
        "--square-mm",
        type=number(0.01, 10_000),
        metavar="MM",
        help="side of a square of the board in the frames",
    )
    asked.add_argument(
        "--for",
        dest="serves",
        choices=("unit", "model"),
        help="whether a measured K is valid for this unit only, or for every unit of its model",
    )
    asked.add_argument(
        "--trust",
        choices=("board", "flight", "file", "tags"),
        help="the source to trust if sources disagree and nothing else decides",
    )
    board = parser.add_argument_group("the board")
    board.add_argument(
        "--board",
        metavar="BOARD",
        help="the board, in inner corners: checkerboard:11x8 (default: a checkerboard whose size is found by trying)",
    )
    parser.add_argument(
        "--flight",
        action="store_true",
        help="also calibrate from the flight, for a camera with 8 images or more in one folder; this adds one "
        "estimate (needs calibrary[sfm]; a few minutes)",
    )
    board.add_argument("--marker-mm", type=number(0.01, 10_000), metavar="MM", help="side of a marker")
    parser.add_argument("--only", metavar="TEXT", help="only cameras with this in the name, such as M3T wide")
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_stated_flags(parser)
    add_label_flag(parser)
    parser.add_argument(
        "--workers", type=_count, default=0, metavar="N", help="processes that look at images"
    )
    add_camera_flags(parser)
    add_registry_flag(parser)
    add_yes_flag(parser, "write the draft without asking, and ask no other question")
    add_json_flag(parser)
    parser.add_argument(
        "--html",
        type=Path,
        metavar="FILE",
        help="page of the report (default: onboard-CAMERA.html, in this folder)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.pages import check_page_place, write_page
    from calibrary.cli.console import note

    if arguments.html is not None:
        check_page_place(arguments.html)
    screen = deciding_screen(arguments)
    result = _onboarded(arguments, note(arguments))
    done = result.onboarding
    page = arguments.html or Path(result.page_name)
    _show(screen, done)
    write_page(page, result.to_html())
    _say(screen, "")
    _say(screen, f"wrote {page}")
    if not done.outcomes:
        _unknown(arguments, done)
    elif done.drafts and agreed(arguments, _question(done)):
        _show_written(screen, done, result.write_drafts(arguments.reason))
    elif done.drafts:
        _say(screen, "nothing was written into the registry")
    elif not done.is_good and len(done.outcomes) > 1:
        _say(
            screen,
            "nothing was written into the registry, since one was refused; --only TEXT takes one camera",
        )
    _show_verdicts(screen, done)
    if arguments.json:
        print_json(result.to_dict(page=page.name))
    return 0 if done.is_good else EXIT_REFUSED


def _onboarded(arguments: argparse.Namespace, remarks: Screen) -> OnboardResult:
    from calibrary.api.onboarding import onboard

    if arguments.board is not None and arguments.square_mm is None:
        arguments.parser.error("--board goes with --square-mm MM, the side of its squares")
    with Bar(remarks, "looking at") as bar:
        return onboard(
            arguments.folder,
            opened(arguments),
            square_mm=arguments.square_mm or partial(_ask_square_mm, arguments),
            serves=arguments.serves or partial(_ask_serves, arguments),
            board=arguments.board,
            marker_mm=arguments.marker_mm,
            camera=partial(camera_of, arguments),
            image_size=arguments.image_size,
            trust=arguments.trust,
            flight=arguments.flight,
            only=arguments.only,
            stated=stated_of(arguments),
            label=arguments.label,
            workers=arguments.workers,
            progress=bar,
        )


def _ask_square_mm(arguments: argparse.Namespace, frames: int) -> float:
    shown = f"{frames} {'image shows' if frames == 1 else 'images show'} a calibration board"
    text = _asked(arguments, f"{shown}: the side of its squares in mm?", "--square-mm MM")
    try:
        side: float = number(0.01, 10_000)(text)
    except argparse.ArgumentTypeError as error:
        arguments.parser.error(f"--square-mm: {error}")
    return side


def _ask_serves(arguments: argparse.Namespace, camera: str) -> str:
    question = f"{camera} was measured: is its K this unit's only, or every one's of its model? [unit/model]"
    text = _asked(arguments, question, "--for unit or --for model").lower()
    if text not in {"unit", "model"}:
        arguments.parser.error(f"--for: {text!r:.20}, expected unit or model")
    return text


def _asked(arguments: argparse.Namespace, question: str, flag: str) -> str:
    """Ask the user; without a terminal end with a usage error that names the flag to use."""
    if arguments.yes or not can_ask():
        arguments.parser.error(f"{question} There is no terminal to ask on; say {flag}")
    sys.stderr.write(f"{question} ")
    sys.stderr.flush()
    return sys.stdin.readline().strip()


def _unknown(arguments: argparse.Namespace, done: Onboarding) -> None:
    """Show that no camera was identified: the payload does not contain its name, so the user must state it."""
    if done.cameras.nameless:
        arguments.parser.error(
            "nothing in it names make and model, by which an entry is found; say --make NAME --model NAME"
        )


def _show(screen: Screen, done: Onboarding) -> None:
    payload, skipped = done.payload, (*done.payload.others, *done.cameras.skipped)
    flown, frames, files = payload.images - len(payload.frames), len(payload.frames), len(payload.files)
    _say(
        screen,
        f"{flown} image{'s' * (flown != 1)}, {frames} frame{'s' * (frames != 1)} of a board, "
        f"{files} calibration file{'s' * (files != 1)}, {len(skipped)} skipped",
    )
    for item in skipped[:8]:
        _say(screen, f"  skipped {item.name}: {item.reason}", "dim")
    if len(skipped) > 8:
        _say(screen, f"  and {len(skipped) - 8} more, listed in the report", "dim")
    for one in done.outcomes:
        _show_camera(screen, one)


def _show_camera(screen: Screen, one: CameraDecision) -> None:
    from calibrary.api.onboarding import flight_hint
    from calibrary.cli.console import plain

    screen.say("")
    screen.say(f"[bold]{plain(str(one.camera.key))}[/]")
    if one.estimates:
        screen.show(_sources(one, screen.width - 2), indent=2)
    for what, solve in (("frames of a board", one.board), ("images of a flight", one.flight)):
        if solve is not None and solve.reason is not None:
            _say(screen, f"  the {what} give no K: {solve.reason}", "yellow")
    if (hint := flight_hint(one.flight_images)) is not None:
        _say(screen, f"  {hint}", "dim")
    for relative in one.relatives:
        found = relative.comparison
        numbers = found.numbers if found is not None else None
        text = found.verdict.value if found is not None else relative.reason or ""
        if numbers is not None:
            text += f", Δf/f {numbers.focal_change:+.3%}"
        _say(screen, f"  against {relative.id}: {text}", "dim")
    for finding in one.findings:
        _say(screen, f"  {finding}", "yellow")
    screen.say(f"  {plain(one.reason)}")
    if one.advice is not None:
        screen.say(f"  [cyan]next[/] {plain(one.advice)}")


def _show_verdicts(screen: Screen, done: Onboarding) -> None:
    """Show the verdict on each camera, at the end."""
    from calibrary.cli.console import plain

    _say(screen, "")
    for one in done.outcomes:
        screen.say(f"[{STYLES[one.decision.value]}]{one.decision.value}[/]: {plain(str(one.camera.key))}")


SOURCES = (
    Column(name="source", wraps=True),
    Column(name="grade", rank=3),
    Column(name="fx", rank=1, right=True),
    Column(name="fy", rank=4, right=True),
    Column(name="cx", rank=5, right=True),
    Column(name="cy", rank=5, right=True),
    Column(name="difference", rank=2, right=True),
    Column(name=""),
)


def _sources(one: CameraDecision, width: int) -> list[Text]:
    from calibrary.cli.console import plain

    rows = []
    comparison = one.comparison
    others = comparison.others if comparison is not None else ()
    for estimate in one.estimates:
        compared = next((other for other in others if other.estimate is estimate), None)
        K, stands = estimate.intrinsics, "[bold]proposed[/]"
        if comparison is None:
            stands = "[dim]no K[/]"
        elif compared is not None:
            colour = {"agrees": "green", "differs": "yellow", "disagrees": "red"}[compared.agreement.value]
            stands = f"[{colour}]{compared.agreement.value}[/]"
            stands = "[yellow]not believed[/]" if compared in comparison.overruled else stands
        elif comparison.dispute is not None:
            stands = "[yellow]in dispute[/]"
        rows.append(
            (
                f"{estimate.kind.value}: {plain(estimate.name)}",
                estimate.grade.value if estimate.grade is not None else "–",
                f"{K.fx:.1f}",
                f"{K.fy:.1f}",
                f"{K.cx:.1f}" if estimate.measured_centre else "–",
                f"{K.cy:.1f}" if estimate.measured_centre else "–",
                f"{compared.difference:+.2%}" if compared is not None else "",
                stands,
            )
        )
    return fitted(SOURCES, rows, width)


def _show_written(screen: Screen, done: Onboarding, written: Mapping[str, Written]) -> None:
    for branch, one in written.items():
        _say(
            screen,
            f"wrote {len(one.paths)} draft{'s' * (len(one.paths) != 1)} on the branch {branch}, {one.commit[:12]}",
        )
        for warning in one.warnings:
            _say(screen, f"note: {warning}", "yellow")
    for one_outcome in done.outcomes:
        entry = one_outcome.entry
        if entry is not None and one_outcome.decision.value == "draft proposed":
            # A draft lies in proposals/, at the path that the entry will have in cameras/.
            file = f"/{entry.id}.yaml"
            branch = next(
                name for name in written if any(path.endswith(file) for path in written[name].paths)
            )
            _say(screen, f"look at it: calibrary registry show {entry.id}@{branch}")


def _question(done: Onboarding) -> str:
    drafts = done.drafts
    what = drafts[0].id if len(drafts) == 1 else f"{len(drafts)} entries"
    return f"Write {what} as a draft on a branch?"


def _say(screen: Screen, text: str, style: str | None = None) -> None:
    from calibrary.cli.console import plain

    screen.say(plain(text), style=style or "")


def _count(text: str) -> int:
    if not text.isdecimal() or len(text) > 4 or int(text) > 256:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number of processes, 0 … 256")
    return int(text)
