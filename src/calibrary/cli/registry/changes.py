"""Changes of a registry on the command line: shown, asked for and written, by every command that makes one."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.registry import entries
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from rich.text import Text

    from calibrary.cli.console import Screen
    from calibrary.errors import ConflictError
    from calibrary.jobs.fleet import AddedSource, ChangedEntry, ChangeReport, Field, FieldChange
    from calibrary.jobs.fleet.changes import ProposedChange
    from calibrary.validation import Finding

EXIT_REFUSED = 1
EXIT_INPUT = 3
YES = {"--yes -y": "write without asking"}
"""The flag of a command that asks."""
FATES = {"new": "green", "changed": "yellow", "same": "dim", "left": "dim", "failed": "bold red"}


def decide(
    arguments: argparse.Namespace,
    change: ProposedChange,
    *,
    is_agreed: Callable[[argparse.Namespace, ProposedChange], bool] = lambda *_: True,
    remedy: str = "put the errors right first",
    as_table: bool = False,
) -> int:
    """Show a change, write it if the user agrees, and show the commit.

    Args:
        arguments: of the command.
        change: the change to show and write.
        is_agreed: asks whether to write it.
        remedy: what to do if the check reports errors.
        as_table: show the changes of all entries in one table; suits few fields of many entries.

    Returns:
        The exit code: 1 if the check reports an error, 3 if there were sources and none could be added.
    """
    from calibrary.cli.console import errors, note

    screen, proposals, found = screen_of_change(arguments), change.proposals, change.report
    _show(screen, change, as_table=as_table)
    for remark in found.remarks:
        note(arguments).say(remark)
    wrong = bool(proposals.errors or found.problems)
    if wrong:
        errors().say(f"nothing was written: {remedy}")
    elif proposals.due and is_agreed(arguments, change):
        _write(screen, change)
    elif proposals.due:
        screen.say("nothing was written")
    elif as_table:
        screen.say("nothing to change: the registry says all of it already")
    elif found.sources or not found.entries:
        why = "nothing is new" if found.sources else "no calibration files"
        screen.say(f"nothing was written: {why}")
    if arguments.json:
        print_json(change.to_dict())
    if found.sources and all(one.fate.value == "failed" for one in found.sources):
        return EXIT_INPUT
    return EXIT_REFUSED if wrong else 0


def _show(screen: Screen, change: ProposedChange, *, as_table: bool) -> None:
    """Show what would change, and what is wrong with it."""
    from calibrary.cli.console import errors

    found = change.report
    if found.sources:
        _show_sources(screen, found.sources)
    else:
        (_show_edits if as_table else show_changes)(screen, found.entries)
        _show_differences(screen, change)
    show_findings(screen, found.findings)
    for one in found.problems:
        place = f"line {one.line}" if one.line else "registry"
        errors().say((place, "red"), f" {one.entry}: {one.message}")


DONE = {
    "add": "proposed",
    "approve": "approved",
    "retire": "retired",
    "withdraw": "withdrew",
    "set": "changed",
}
"""What was done, by the actions of changes."""


def _write(screen: Screen, change: ProposedChange) -> None:
    from calibrary.cli.console import errors
    from calibrary.errors import ConflictError

    try:
        written = change.write()
    except ConflictError as error:
        _show_conflict(errors(), error)
        raise
    first = change.proposals.due[0]
    verb = "added" if first.action == "add" and first.after.is_usable else DONE[first.action]
    if written.missing:
        verb = f"{verb}, with others to follow,"
    show_written(screen, change.report, verb, len(change.proposals.due))


def can_ask() -> bool:
    """Whether there is a terminal to ask on."""
    return sys.stdin is not None and sys.stdin.isatty()


def screen_of_change(arguments: argparse.Namespace) -> Screen:
    """Console on which a change is shown: that of the results, or that of the question if ``--json`` mutes results."""
    from calibrary.cli.console import errors, out

    asks = arguments.json and not getattr(arguments, "yes", True) and can_ask()
    return errors() if asks else out(arguments)


def agreed(arguments: argparse.Namespace, question: str) -> bool:
    """Whether the user agrees. Without a terminal and without ``--yes`` the command ends with a usage error."""
    if arguments.yes:
        return True
    if not can_ask():
        arguments.parser.error(f"{question} There is no terminal to ask on; say --yes")
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in {"y", "yes"}


def _show_sources(screen: Screen, sources: Sequence[AddedSource]) -> None:
    """Show what becomes of each source in one line, and their number by fate."""
    for one in sources:
        if one.fate.value == "same" and one.reason is None:
            continue
        named = f" → {one.entry}" if one.entry is not None else ""
        why = f": {one.reason}" if one.reason is not None else ""
        screen.say((f"{one.fate.value:8}", FATES[one.fate.value]), f"{one.source}{named}{why}")
    counts = Counter(one.fate.value for one in sources)
    screen.say(", ".join(f"{counts[fate]} {fate}" for fate in FATES if counts[fate]))


def show_changes(screen: Screen, entries: Iterable[ChangedEntry]) -> None:
    """Show each entry with its fields, old and new."""
    for one in entries:
        what = "is there already, word for word" if not one.changes else "new" if one.is_new else "changed"
        screen.say((one.id, "bold"), f"  {what}")
        if one.changes:
            screen.show(change_table(one.changes, screen.width - 2, only_after=one.is_new), indent=2)
        for warning in one.warnings:
            screen.say("  ", ("note", "yellow"), f" {warning}")


EDITED = (
    Column(name="entry"),
    Column(name="field", style="dim"),
    Column(name="before", rank=1, wraps=True),
    Column(name="after", wraps=True),
)


def _show_edits(screen: Screen, entries: Sequence[ChangedEntry]) -> None:
    """Show changed fields of many entries, one row each."""
    rows = [
        (
            one.id,
            change.name,
            field_text(change.before),
            field_text(change.after),
        )
        for one in entries
        for change in one.changes
    ]
    if rows:
        screen.show(fitted(EDITED, rows, screen.width))
    for one in entries:
        for warning in one.warnings:
            screen.say(("note", "yellow"), f" {one.id}: {warning}")


CHANGED = (
    Column(name="field", style="dim"),
    Column(name="before", rank=1, wraps=True),
    Column(name="after", rank=1, wraps=True),
    Column(name="Δ", rank=2, right=True),
    Column(name="Δ / σ", rank=2, right=True),
)


def change_table(changes: Sequence[FieldChange], width: int, *, only_after: bool = False) -> list[Text]:
    """Table of the fields that differ, one row each, with Δ and, if both sides have a standard deviation, Δ/σ."""
    if only_after:
        new = [(change.name, field_text(change.after)) for change in changes]
        return fitted((CHANGED[0], CHANGED[2]), new, width, header=False)
    rows = [
        (
            change.name,
            field_text(change.before),
            field_text(change.after),
            f"{change.delta:+.6g}" if change.delta is not None else "",
            f"{change.z:+.1f}" if change.z is not None else "",
        )
        for change in changes
    ]
    return fitted(CHANGED, rows, width)


def _show_differences(screen: Screen, change: ProposedChange) -> None:
    """Show the effect of each change of a K, in pixels and on the ground."""
    from calibrary.jobs.diff.wording import length, percent, pixels

    names = {one.path: one.id for one in change.report.entries}
    for path, found in change.comparisons.items():
        id_, numbers = names[path], found.numbers
        if numbers is None:
            screen.say(f"{id_}: {'; '.join(found.reasons)}")
            continue
        seen, ground = numbers.projection, numbers.ground
        screen.say(
            (id_, "bold"),
            f"  {found.verdict.value}: {pixels(seen.rms_px)} rms, {pixels(seen.max_px)} at most "
            f"over the frame; image scale {percent(numbers.scale_change)}; from {ground.altitude_m:g} m "
            f"{length(ground.max_cm / 100)} on the ground, heights {length(ground.height_cm / 100, signed=True)}",
        )


def show_findings(screen: Screen, findings: Sequence[Finding]) -> None:
    """Show the findings of the check, one line each."""
    for finding in findings:
        style = "red" if finding.severity.value == "error" else "yellow"
        screen.say((finding.severity.value, style), f" {finding}")


def _show_conflict(screen: Screen, error: ConflictError) -> None:
    """Show, field by field, what another writer has changed in the meantime and what was to be written."""
    from calibrary.jobs.fleet.changes import conflict_changes

    for path, changes in conflict_changes(error).items():
        screen.say((path, "bold"), "  theirs, and what was to be written")
        screen.show(change_table(changes, screen.width - 2), indent=2)


def show_written(screen: Screen, written: ChangeReport, verb: str, number: int) -> None:
    """Show the commit in one line, and each warning."""
    screen.say(f"{verb} {entries(number)} in commit {(written.commit or '')[:12]}")
    for warning in written.warnings:
        screen.say(("note", "yellow"), f" {warning}")


def field_text(value: Field) -> str:
    """A field's value with all digits."""
    if value is None:
        return "–"
    return repr(value) if isinstance(value, float) else str(value)
