"""``calibrary registry sync``: fetch the commits of others, put the local ones on top, and send them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Final

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.registry import OfRegistry, opened
from calibrary.cli.registry.changes import field_text
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet import EntryConflict, SyncReport

EXIT_REGISTRY = 4

DESCRIPTION = (
    "Fetch the commits of others, put your own on top and send them: both sides have the same commits."
)
EXAMPLES = """\
examples:
  calibrary registry sync
  calibrary registry sync git@example.com:fleet.git      the first time: saved as origin
  calibrary registry sync --theirs dji/fc6310r --ours sony/dsc-rx1rm2       if both changed an entry
  calibrary registry sync --theirs all
  calibrary registry sync --propose                      as a branch for review, if main is protected

Your commits are repeated on top of theirs, file by file. Approvals and retirements are files of their own, which never
conflict. If both sides changed the file of an entry, nothing is changed until you have decided which stays (exit code
4). So it is if the remote was rewritten and lost commits that you have: --removed drop gives them up, --removed keep
makes them again. Commits of others are never overwritten. If yours cannot be sent, those that came stay, and the
command says why (exit code 4).
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    remarks, registry = note(arguments), opened(arguments)

    def told(text: str) -> None:
        remarks.say(text)

    from rich.markup import escape

    with remarks.status(escape(f"syncing with {arguments.remote or 'origin'}")):
        done = call(registry.sync, arguments, told=told)
    if done.branch is None:
        _show_exchanged(out(arguments), done)
    else:
        _show_proposed(out(arguments), done)
    if arguments.json:
        print_json(done)
    return 0 if done.is_good else EXIT_REGISTRY


SYNC: Final = {"--sync": "fetch the commits of others first, and send the own ones afterwards"}
"""The flag of a command that changes the registry between two exchanges."""


def between_syncs(arguments: argparse.Namespace, act: Callable[[argparse.Namespace], int]) -> int:
    """Change the registry, and exchange commits before and after it, if the user wants that; the exit code.

    What was written and cannot be sent stays here.
    """
    if not arguments.sync:
        return act(arguments)
    return _synced(arguments) or act(arguments) or _synced(arguments)


def _synced(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import out

    done = opened(arguments).sync()
    _show_exchanged(out(arguments), done)
    return 0 if done.is_good else EXIT_REGISTRY


def _show_exchanged(screen: Screen, done: SyncReport) -> None:
    """Show what came from the remote, and what it got."""
    _show_pulled(screen, done)
    _show_sent(screen, done)


def _show_pulled(screen: Screen, done: SyncReport) -> None:
    """Show what came from the remote, or the conflicts."""
    from calibrary.cli.console import errors

    if done.conflicts:
        _show_conflicts(errors(), done)
        return
    if done.withdrawn:
        _show_withdrawn(errors(), done)
        return
    if done.before == done.commit:
        line = f"{done.remote} has nothing new"
    else:
        again = {0: "", 1: ", 1 commit of ours made again on top"}.get(
            done.replayed, f", {done.replayed} commits of ours made again on top"
        )
        line = f"at {(done.commit or '')[:12]} now{again}"
    screen.say(line)
    for warning in done.warnings:
        screen.say(("note", "yellow"), f" {warning}")


def _show_sent(screen: Screen, done: SyncReport) -> None:
    """Show that both sides are the same, or why the remote got nothing."""
    from calibrary.cli.console import errors

    if done.unpushed is not None:
        errors().say(("not sent", "red"), f": {done.unpushed}")
    elif done.is_good:
        screen.say(f"{done.remote} and this registry are at {(done.commit or '')[:12]}")


def _show_proposed(screen: Screen, done: SyncReport) -> None:
    """Show the remote's branch with the commits, and where it is reviewed."""
    back = "; yours is at theirs again" if done.theirs is not None else ""
    screen.say(f"branch {done.branch} of {done.remote} has your commits{back}")
    where_to = done.address or f"open it for review on the host of {done.remote}"
    screen.say(f"next: {where_to}")
    for warning in done.warnings:
        screen.say(("note", "yellow"), f" {warning}")


def _show_withdrawn(screen: Screen, done: SyncReport) -> None:

    screen.say(f"calibrary: {done.remote} was rewritten; nothing was changed here. It no longer has")
    for one in done.withdrawn:
        screen.say(f"  {one.commit[:12]} {one.subject}")
    screen.say(
        "calibrary registry sync --removed drop gives them up here too, --removed keep makes them again"
    )


def _show_conflicts(screen: Screen, done: SyncReport) -> None:

    count = len(done.conflicts)
    what = "an entry was" if count == 1 else f"{count} entries were"
    screen.say(f"calibrary: {what} changed on both sides; nothing was changed here")
    for conflict in done.conflicts:
        _show_conflict(screen, conflict)
    keys = " ".join(f"--theirs {conflict.id}" for conflict in done.conflicts[:2])
    more = " …" if count > 2 else ""
    again = f"calibrary registry sync {keys}{more}"
    screen.say(f"decide for each which is right: {again}, or --ours KEY to keep yours")


COLUMNS = (
    Column(name="field", style="dim"),
    Column(name="both had", rank=2, wraps=True),
    Column(name="ours", rank=1, wraps=True),
    Column(name="theirs", rank=1, wraps=True),
)


def _show_conflict(screen: Screen, conflict: EntryConflict) -> None:

    screen.say((conflict.path, "bold"))
    if conflict.removed is not None:
        other = "theirs" if conflict.removed == "ours" else "ours"
        sides = {conflict.removed: "removed", other: "changed"}
        screen.say(f"  ours {sides['ours']} it, theirs {sides['theirs']} it")
        return
    rows = [
        (one.name, *(field_text(value) for value in (one.base, one.ours, one.theirs)))
        for one in conflict.fields
    ]
    screen.show(fitted(COLUMNS, rows, screen.width - 2), indent=2)


COMMAND = OfRegistry(
    Fleet.sync, DESCRIPTION, EXAMPLES, run=run, positional={"remote": "REMOTE"}, without=["told"]
)
