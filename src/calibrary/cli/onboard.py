"""``calibrary onboard``: make a draft entry, with reasons, from a folder of files that came with a new payload."""

from __future__ import annotations

import argparse
import shlex
import sys
from typing import TYPE_CHECKING, Final

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import where
from calibrary.cli.registry.changes import add_yes_flag, agreed, can_ask, screen_of_change
from calibrary.cli.tables import Column, fitted
from calibrary.errors import UsageError
from calibrary.jobs.onboard import onboard

if TYPE_CHECKING:
    from rich.text import Text

    from calibrary.cli.console import Screen
    from calibrary.jobs.onboard.report import CameraDecision, OnboardReport

EXIT_REFUSED: Final = 1
STYLES: Final = {
    "ready, not written": "bold yellow",
    "draft proposed": "bold green",
    "nothing new": "cyan",
    "refused": "bold red",
}

STANDINGS: Final = {
    None: "dim",
    "proposed": "bold",
    "in dispute": "yellow",
    "not believed": "yellow",
    "agrees": "green",
    "differs": "yellow",
    "disagrees": "red",
}
GROUPS: Final = {
    "what only a person knows; asked if it is needed and not given": ("square_mm", "serves", "trust"),
    "the board": ("board", "marker_mm"),
}

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
  calibrary onboard payload/ --digest 5d0c82e16a3b           what --dry-run showed, or nothing if files changed since

exit codes: 0 a draft is proposed, or nothing is new; 1 refused, and only the page is written; 2 an answer is missing
that only a person knows; 3 the folder cannot be read; 4 the registry.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(
        parser,
        onboard,
        positional={"folder": "DIR"},
        groups=GROUPS,
        spelled={"serves": "--for"},
        without=["ask", "write"],
    )
    add_yes_flag(parser, "write the draft without asking, and ask no other question")
    parser.add_argument("--dry-run", action="store_true", help="decide everything, and write only the page")
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note

    screen = screen_of_change(arguments)

    def is_wanted(done: OnboardReport) -> bool:
        bar.stop()
        _show(screen, done, arguments.html or str(done.page))
        if not done.drafts or arguments.dry_run:
            return False
        return arguments.digest is not None or agreed(arguments, _question(done))

    def answer(question: str, _: str) -> str:
        # A bar that is drawn would take the words in brackets for its markup, and write over what is typed.
        bar.stop()
        sys.stderr.write(f"{question} ")
        sys.stderr.flush()
        return sys.stdin.readline().strip()

    with Bar(note(arguments), "looking at") as bar:
        asked = answer if can_ask() and not arguments.yes else None
        try:
            done = call(onboard, arguments, ask=asked, write=is_wanted, progress=bar)
        except UsageError as error:
            if error.place is None:
                raise
            command = f"calibrary {shlex.join(arguments.given)} {error.place}"
            raise UsageError(f"{error.message} Only a person knows that; say it: {command}") from None
    _show_written(screen, done, where(arguments))
    is_other = bool(done.drafts) and not done.is_as_seen(arguments.digest)
    if is_other:
        note(arguments).say("nothing was written: the files are not those that were looked at; look at these")
    _show_verdicts(screen, done)
    if arguments.json:
        print_json(done)
    return 0 if done.is_good and not is_other else EXIT_REFUSED


def _show(screen: Screen, done: OnboardReport, page: str) -> None:
    found = done.sorted
    _say(
        screen,
        f"{found.images} image{'s' * (found.images != 1)}, {found.board_frames} frame{'s' * (found.board_frames != 1)}"
        f" of a board, {found.calibration_files} calibration file{'s' * (found.calibration_files != 1)}, "
        f"{len(found.skipped)} skipped",
    )
    for item in found.skipped[:8]:
        _say(screen, f"  skipped {item.name}: {item.reason}", "dim")
    if len(found.skipped) > 8:
        _say(screen, f"  and {len(found.skipped) - 8} more, listed in the report", "dim")
    for one in done.cameras:
        _show_camera(screen, one, done.name_of(one.camera))
    _say(screen, "")
    _say(screen, f"wrote {page}")


def _show_camera(screen: Screen, one: CameraDecision, name: str) -> None:
    from calibrary.cli.console import plain

    screen.say("")
    screen.say(f"[bold]{plain(name)}[/]")
    if one.estimates:
        screen.show(_sources(one, screen.width - 2), indent=2)
    for what, solve in (("frames of a board", one.board), ("images of a flight", one.flight)):
        if solve is not None and solve.reason is not None:
            _say(screen, f"  the {what} give no K: {solve.reason}", "yellow")
    if one.hint is not None:
        _say(screen, f"  {one.hint}", "dim")
    for relative in one.relatives:
        text = relative.verdict.value if relative.verdict is not None else relative.reason or ""
        if relative.focal_change is not None:
            text += f", Δf/f {relative.focal_change:+.3%}"
        _say(screen, f"  against {relative.id}: {text}", "dim")
    for finding in one.check:
        _say(screen, f"  {finding}", "yellow")
    screen.say(f"  {plain(one.reason)}")
    if one.next is not None:
        screen.say(f"  [cyan]next[/] {plain(one.next)}")


def _show_verdicts(screen: Screen, done: OnboardReport) -> None:
    """Show the verdict on each camera, at the end."""
    from calibrary.cli.console import plain

    _say(screen, "")
    for one in done.cameras:
        screen.say(
            f"[{STYLES[one.decision.value]}]{one.decision.value}[/]: {plain(done.name_of(one.camera))}"
        )


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
    for estimate in one.estimates:
        K, standing = estimate.intrinsics, estimate.standing
        rows.append(
            (
                f"{estimate.kind.value}: {plain(estimate.name)}",
                estimate.grade.value if estimate.grade is not None else "–",
                f"{K.fx:.1f}",
                f"{K.fy:.1f}",
                f"{K.cx:.1f}" if estimate.measured_centre else "–",
                f"{K.cy:.1f}" if estimate.measured_centre else "–",
                f"{estimate.difference:+.2%}{estimate.of_what}" if estimate.difference is not None else "",
                f"[{STANDINGS[standing]}]{standing or 'no K'}[/]",
            )
        )
    return fitted(SOURCES, rows, width)


def _show_written(screen: Screen, done: OnboardReport, of_registry: str) -> None:
    """Show the branches; or that nothing was written, if something could have been."""
    drafts = [(one.entry, one.branch) for one in done.cameras if one.branch in done.branches]
    for branch, commit in done.branches.items():
        count = sum(of == branch for _, of in drafts)
        _say(screen, f"wrote {count} draft{'s' * (count != 1)} on the branch {branch}, {commit[:12]}")
    for warning in done.warnings:
        _say(screen, f"note: {warning}", "yellow")
    for entry, of in drafts:
        if entry is not None:
            _say(screen, f"look at it: calibrary registry show {entry.id}@{of}{of_registry}")
    for branch in done.branches:
        digests = "".join(
            f" --digest {entry.digest[:12]}"
            for entry, of in drafts
            if of == branch and entry and entry.digest
        )
        _say(screen, f"then: calibrary registry approve --from {branch}{of_registry}{digests}")
    if done.drafts and not done.branches:
        _say(screen, f"nothing was written into the registry; --digest {done.digest[:12]} writes this")
    elif not done.is_good and len(done.cameras) > 1:
        why = "since one was refused; --only TEXT takes one camera"
        _say(screen, f"nothing was written into the registry, {why}")


def _question(done: OnboardReport) -> str:
    drafts = done.drafts
    what = drafts[0].id if len(drafts) == 1 else f"{len(drafts)} entries"
    return f"Write {what} as a draft on a branch?"


def _say(screen: Screen, text: str, style: str | None = None) -> None:
    from calibrary.cli.console import plain

    screen.say(plain(text), style=style or "")
