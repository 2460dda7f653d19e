"""``calibrary onboard``: make a draft entry, with reasons, from a folder of files that came with a new payload."""

from __future__ import annotations

import argparse
import shlex
import sys
from typing import TYPE_CHECKING, Final

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import where
from calibrary.cli.registry.changes import agreed, can_ask, screen_of_change
from calibrary.cli.shown import Shown
from calibrary.errors import UsageError
from calibrary.jobs.onboard import onboard

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.onboard.report import OnboardReport

EXIT_REFUSED: Final = 1
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


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note
    from calibrary.view import view_of

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
    if done.branches:
        _say(screen, view_of(done).lead, "bold")
    if arguments.json:
        print_json(done)
    return 0 if done.is_good and not is_other else EXIT_REFUSED


def _show(screen: Screen, done: OnboardReport, page: str) -> None:
    from calibrary.cli.terminal import show
    from calibrary.view import view_of

    _say(screen, f"wrote {page}")
    show(screen, view_of(done))


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

    screen.say(text, style=style or "")


COMMAND = Shown(
    onboard,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"folder": "DIR"},
    groups=GROUPS,
    spelled={"serves": "--for"},
    without=["ask", "write"],
    switches={
        "--yes -y": "write the draft without asking, and ask no other question",
        "--dry-run": "decide everything, and write only the page",
    },
)
