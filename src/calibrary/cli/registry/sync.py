"""``calibrary registry sync``: pull, then push; and how a pull and a push are shown."""

from __future__ import annotations

import argparse
from functools import partial
from types import MethodType
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import add_registry_flag, opened
from calibrary.cli.registry.changes import field_text
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet import EntryConflict, SyncReport

EXIT_REGISTRY = 4

DESCRIPTION = "Pull, then push: afterwards both sides have the same commits."
EXAMPLES = """\
examples:
  calibrary registry sync
  calibrary registry sync git@example.com:fleet.git      the first time: saved as origin
  calibrary registry sync --theirs all                   if both changed an entry

If both sides changed an entry, nothing is pulled or pushed until you have decided each of them. If the push fails, the
commits that were pulled stay, and the command says why (exit code 4).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    declare(parser, Fleet.sync)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return synced(arguments, "syncing with", Fleet.sync, [partial(show_pulled, command="sync"), show_pushed])


def declare(parser: argparse.ArgumentParser, job: Callable[..., SyncReport]) -> None:
    """Declare the arguments of a command that exchanges commits with a remote."""
    add_flags(parser, job, positional={"remote": "REMOTE"}, without=["told"])
    add_registry_flag(parser)
    add_json_flag(parser)


def synced(
    arguments: argparse.Namespace,
    doing: str,
    job: Callable[..., SyncReport],
    show: list[Callable[[Screen, SyncReport], None]],
) -> int:
    """Exchange commits with a remote and show the result; returns the exit code.

    Args:
        arguments: of the command.
        doing: what is shown while it takes its time.
        job: a method of the registry.
        show: what to show of the result.
    """
    from calibrary.cli.console import note, out, plain

    remarks, registry = note(arguments), opened(arguments)

    def told(text: str) -> None:
        remarks.say(plain(text))

    with remarks.status(f"{doing} {plain(arguments.remote or 'origin')}"):
        done = call(MethodType(job, registry), arguments, told=told)
    for part in show:
        part(out(arguments), done)
    if arguments.json:
        print_json(done)
    return 0 if done.is_good else EXIT_REGISTRY


def show_pulled(screen: Screen, done: SyncReport, *, command: str = "pull") -> None:
    """Show what came from the remote, or the conflicts."""
    from calibrary.cli.console import errors, plain

    if done.conflicts:
        _show_conflicts(errors(), done, command)
        return
    if done.withdrawn:
        _show_withdrawn(errors(), done, command)
        return
    if done.before == done.commit:
        ahead = "" if done.commit == done.theirs else "; ours is ahead: calibrary registry push"
        line = f"{done.remote} has nothing new{ahead}"
    else:
        again = {0: "", 1: ", 1 commit of ours made again on top"}.get(
            done.replayed, f", {done.replayed} commits of ours made again on top"
        )
        line = f"at {(done.commit or '')[:12]} now{again}"
    screen.say(plain(line))
    for warning in done.warnings:
        screen.say(f"[yellow]note[/] {plain(warning)}")


def show_pushed(screen: Screen, done: SyncReport) -> None:
    """Show what the remote got, or why it got nothing."""
    from calibrary.cli.console import errors, plain

    if done.withdrawn and done.unpushed is None:
        _show_withdrawn(errors(), done, "pull")
    elif done.branch is not None:
        back = "; yours is at theirs again" if done.theirs is not None else ""
        screen.say(plain(f"branch {done.branch} of {done.remote} has your commits{back}"))
        where_to = done.address or f"open it for review on the host of {done.remote}"
        screen.say(plain(f"next: {where_to}"))
        for warning in done.warnings:
            screen.say(f"[yellow]note[/] {plain(warning)}")
    elif done.unpushed is not None:
        errors().say(f"[red]not pushed[/]: {plain(done.unpushed)}")
    else:
        screen.say(plain(f"{done.remote} and this registry are at {(done.commit or '')[:12]}"))


def _show_withdrawn(screen: Screen, done: SyncReport, command: str) -> None:
    from calibrary.cli.console import plain

    screen.say(plain(f"calibrary: {done.remote} was rewritten; nothing was changed here. It no longer has"))
    for one in done.withdrawn:
        screen.say(plain(f"  {one.commit[:12]} {one.subject}"))
    screen.say(
        f"calibrary registry {command} --removed drop gives them up here too, --removed keep makes them again"
    )


def _show_conflicts(screen: Screen, done: SyncReport, command: str) -> None:
    from calibrary.cli.console import plain

    count = len(done.conflicts)
    what = "an entry was" if count == 1 else f"{count} entries were"
    screen.say(f"calibrary: {what} changed on both sides; nothing was changed here")
    for conflict in done.conflicts:
        _show_conflict(screen, conflict)
    keys = " ".join(f"--theirs {conflict.id}" for conflict in done.conflicts[:2])
    more = " …" if count > 2 else ""
    again = f"calibrary registry {command} {keys}{more}"
    screen.say(plain(f"decide for each which is right: {again}, or --ours KEY to keep yours"))


COLUMNS = (
    Column(name="field", style="dim"),
    Column(name="both had", rank=2, wraps=True),
    Column(name="ours", rank=1, wraps=True),
    Column(name="theirs", rank=1, wraps=True),
)


def _show_conflict(screen: Screen, conflict: EntryConflict) -> None:
    from calibrary.cli.console import plain

    screen.say(f"[bold]{plain(conflict.path)}[/]")
    if conflict.removed is not None:
        other = "theirs" if conflict.removed == "ours" else "ours"
        sides = {conflict.removed: "removed", other: "changed"}
        screen.say(f"  ours {sides['ours']} it, theirs {sides['theirs']} it")
        return
    rows = [
        (plain(one.name), *(plain(field_text(value)) for value in (one.base, one.ours, one.theirs)))
        for one in conflict.fields
    ]
    screen.show(fitted(COLUMNS, rows, screen.width - 2), indent=2)
