"""The entries that a calibration becomes in a registry: shown, asked for and written; for all its commands."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from calibrary.arguments import Terms
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import opened, where
from calibrary.cli.registry.changes import add_yes_flag, agreed, can_ask

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet import ChangedEntry, Entry


def add_keeping_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags on what terms the registry changes."""
    add_flags(parser, _terms, without=("valid_from", "valid_until"))
    add_yes_flag(parser, "write into the registry without asking")
    parser.add_argument("--dry-run", action="store_true", help="do everything but write into the registry")


def is_kept(arguments: argparse.Namespace) -> bool:
    """Whether the flags ask for a registry entry."""
    return arguments.registry is not None or getattr(arguments, "as_", None) is not None


def check_keeping(arguments: argparse.Namespace) -> None:
    """End with a usage error, before any work, if the registry could not be written as the flags say."""
    terms = call(_terms, arguments)
    if is_kept(arguments):
        if not arguments.yes and not arguments.dry_run and not can_ask():
            arguments.parser.error(
                "not a terminal, so nothing can be confirmed before the registry is written: give --yes"
            )
    elif terms != Terms():
        arguments.parser.error(
            "--approve, --reason, --force and --branch are of a registry: say --registry PATH or --as KEY"
        )


def keep(
    arguments: argparse.Namespace,
    screen: Screen,
    verdict: str,
    entries: Callable[[], Sequence[Entry]],
) -> bool:
    """Write the entries if the flags ask for it and verdict, check and user allow it.

    Returns:
        Whether there was no objection.
    """
    from calibrary.cli.registry.changes import show_findings, show_written

    if not is_kept(arguments):
        return True
    if verdict == "refuse":
        screen.say("what is refused becomes no entry; nothing was written into the registry")
        return False
    terms = call(_terms, arguments)
    change = opened(arguments).propose_entries(entries(), terms)
    found = change.report
    _show_entries(screen, found.entries)
    show_findings(screen, found.findings)
    if change.proposals.errors:
        screen.say("the check objects, so nothing was written into the registry")
        return False
    if not any(one.changes for one in found.entries):
        return True
    first, count = found.entries[0], len(found.entries)
    what = first.id if count == 1 else f"{count} entries"
    if arguments.dry_run or not agreed(arguments, f"Write {what}?"):
        screen.say("nothing was written into the registry")
        return True
    status, as_start = (
        first.status.value,
        " as a start: no solver keeps it fixed" if verdict != "pass" else "",
    )
    change.write()
    show_written(screen, change.report, "approved" if status == "approved" else "wrote", count)
    if count == 1 and status == "draft":
        screen.say(
            f"a proposal is not used yet; next: calibrary registry approve {what}{where(arguments)} --digest "
            f"{(first.digest or '')[:12]}"
        )
    if as_start:
        screen.say(f"it is used{as_start}")
    return True


def _show_entries(screen: Screen, entries: Sequence[ChangedEntry]) -> None:
    """Show each entry compared with the present one; all of a new one is shown already."""
    from calibrary.cli.console import plain
    from calibrary.cli.registry.changes import show_changes

    for one in entries:
        if not one.is_new:
            show_changes(screen, [one])
            continue
        screen.say(f"{plain(one.id)}  new")
        for warning in one.warnings:
            screen.say(f"  note: {plain(warning)}")


def _terms(terms: Terms | None = None) -> Terms:
    """On what terms the registry changes; as flags."""
    return terms or Terms()
