"""``calibrary registry pull``: fetch the commits of others and put the local ones on top."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.changes import field_text
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.registry.git.errors import Conflict, FileConflictError
    from calibrary.registry.git.remotes import Pulled

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

EXIT_REGISTRY = 4

DESCRIPTION = "Fetch the commits of others, and apply your own commits on top of them."
EXAMPLES = """\
examples:
  calibrary registry pull
  calibrary registry pull backup
  calibrary registry pull --theirs dji/fc6310r --ours sony/dsc-rx1rm2       if both changed an entry
  calibrary registry pull --theirs all

Your commits are repeated on top of theirs, entry by entry. Text is never merged, so no K is ever mixed from two. If
both sides changed an entry, nothing is changed until you have decided each of them (exit code 4).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "remote", nargs="?", metavar="REMOTE", help="a remote's name or address (default: origin)"
    )
    parser.add_argument(
        "--ours",
        action="append",
        default=[],
        metavar="KEY",
        help="entry that both sides changed and for which your version counts; or all",
    )
    parser.add_argument(
        "--theirs",
        action="append",
        default=[],
        metavar="KEY",
        help="entry that both sides changed and for which their version counts; or all",
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, note, out
    from calibrary.jobs.fleet.changes import FileConflictError, sync_report

    remarks, registry = note(arguments), opened(arguments)
    remote, noted = registry.remote_named(arguments.remote)
    show_noted(remarks, remote, noted)
    try:
        with remarks.status(f"pulling from {remote}"):
            pulled = registry.pull(remote, ours=arguments.ours, theirs=arguments.theirs)
    except FileConflictError as error:
        _show_conflicts(errors(), error)
        if arguments.json:
            print_json(sync_report(remote, None, None, error.conflicts))
        return EXIT_REGISTRY
    _show(out(arguments), remote, pulled)
    if arguments.json:
        print_json(sync_report(remote, pulled, None))
    return 0


def show_noted(screen: Screen, remote: str, noted: str | None) -> None:
    """Report that an address was saved as a remote."""
    from calibrary.cli.console import plain

    if noted is not None:
        screen.say(plain(f"{remote} is {noted} from now on"))


def _show(screen: Screen, remote: str, pulled: Pulled) -> None:
    from calibrary.cli.console import plain

    if pulled.before == pulled.commit:
        ahead = "" if pulled.commit == pulled.theirs else "; ours is ahead: calibrary registry push"
        line = f"{remote} has nothing new{ahead}"
    else:
        again = {0: "", 1: ", 1 commit of ours made again on top"}.get(
            pulled.replayed, f", {pulled.replayed} commits of ours made again on top"
        )
        line = f"at {pulled.commit[:12]} now{again}"
    screen.say(plain(line))
    for warning in pulled.warnings:
        screen.say(f"[yellow]note[/] {plain(warning)}")


def _show_conflicts(screen: Screen, error: FileConflictError) -> None:
    from calibrary.cli.console import plain
    from calibrary.jobs.fleet.changes import id_of

    count = len(error.conflicts)
    what = "an entry was" if count == 1 else f"{count} entries were"
    screen.say(f"calibrary: {what} changed on both sides; nothing was changed here")
    for conflict in error.conflicts:
        _show_conflict(screen, conflict)
    keys = " ".join(f"--theirs {id_of(conflict.path)}" for conflict in error.conflicts[:2])
    more = " …" if count > 2 else ""
    screen.say(
        plain(
            f"decide for each which is right: calibrary registry pull {keys}{more}, or --ours KEY to keep yours"
        )
    )


COLUMNS = (
    Column(name="field", style="dim"),
    Column(name="both had", rank=2, wraps=True),
    Column(name="ours", rank=1, wraps=True),
    Column(name="theirs", rank=1, wraps=True),
)


def _show_conflict(screen: Screen, conflict: Conflict) -> None:
    from calibrary.cli.console import plain
    from calibrary.jobs.fleet.changes import field_conflicts

    screen.say(f"[bold]{plain(conflict.path)}[/]")
    if conflict.ours is None or conflict.theirs is None:
        sides = (
            ("ours removed it", "theirs changed it")
            if conflict.ours is None
            else ("ours changed it", "theirs removed it")
        )
        screen.say(f"  {', '.join(sides)}")
        return
    rows = [
        (plain(one.name), *(plain(field_text(value)) for value in (one.base, one.ours, one.theirs)))
        for one in field_conflicts(conflict)
    ]
    screen.show(fitted(COLUMNS, rows, screen.width - 2), indent=2)
