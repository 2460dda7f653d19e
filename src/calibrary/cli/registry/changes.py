"""Display of changes, shared by the commands that write to a registry."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from rich.text import Text

    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet.changes import ProposedChange
    from calibrary.registry.fields import Field, FieldChange
    from calibrary.registry.git.errors import FileConflictError
    from calibrary.registry.git.writing import Written
    from calibrary.registry.proposals import Proposal
    from calibrary.validation import Finding

__all__ = [
    "change_table",
    "field_text",
    "show_changes",
    "show_conflict",
    "show_differences",
    "show_edits",
    "show_findings",
    "show_written",
]


def show_changes(screen: Screen, proposals: Iterable[Proposal]) -> None:
    """Show each entry with its fields, old and new."""
    from calibrary.cli.console import plain

    for one in proposals:
        what = "is there already, word for word" if not one.changes else "new" if one.is_new else "changed"
        screen.say(f"[bold]{plain(one.entry.id)}[/]  {what}")
        if one.changes:
            screen.show(change_table(one.changes, screen.width - 2, only_after=one.is_new), indent=2)
        for warning in one.warnings:
            screen.say(f"  [yellow]note[/] {plain(warning)}")


EDITED = (
    Column(name="entry"),
    Column(name="field", style="dim"),
    Column(name="before", rank=1, wraps=True),
    Column(name="after", wraps=True),
)


def show_edits(screen: Screen, proposals: Iterable[Proposal]) -> None:
    """Show changed fields of many entries, one row each."""
    from calibrary.cli.console import plain

    proposals = [*proposals]
    rows = [
        (
            plain(one.entry.id),
            change.name,
            plain(field_text(change.before)),
            plain(field_text(change.after)),
        )
        for one in proposals
        for change in one.changes
    ]
    if rows:
        screen.show(fitted(EDITED, rows, screen.width))
    for one in proposals:
        for warning in one.warnings:
            screen.say(f"[yellow]note[/] {plain(one.entry.id)}: {plain(warning)}")


CHANGED = (
    Column(name="field", style="dim"),
    Column(name="before", rank=1, wraps=True),
    Column(name="after", rank=1, wraps=True),
    Column(name="Δ", rank=2, right=True),
    Column(name="Δ / σ", rank=2, right=True),
)


def change_table(changes: Sequence[FieldChange], width: int, *, only_after: bool = False) -> list[Text]:
    """Table of the fields that differ, one row each, with Δ and, if both sides have a standard deviation, Δ/σ."""
    from calibrary.cli.console import plain

    if only_after:
        new = [(plain(change.name), plain(field_text(change.after))) for change in changes]
        return fitted((CHANGED[0], CHANGED[2]), new, width, header=False)
    rows = [
        (
            plain(change.name),
            plain(field_text(change.before)),
            plain(field_text(change.after)),
            f"{change.delta:+.6g}" if change.delta is not None else "",
            f"{change.z:+.1f}" if change.z is not None else "",
        )
        for change in changes
    ]
    return fitted(CHANGED, rows, width)


def show_differences(screen: Screen, change: ProposedChange) -> None:
    """Show the effect of each change of a K, in pixels and on the ground."""
    from calibrary.cli.console import plain
    from calibrary.jobs.diff.wording import length, percent, pixels

    for id_, found in change.comparisons().items():
        numbers = found.numbers
        if numbers is None:
            screen.say(f"{plain(id_)}: {plain('; '.join(found.reasons))}")
            continue
        seen, ground = numbers.projection, numbers.ground
        screen.say(
            f"[bold]{plain(id_)}[/]  {found.verdict.value}: {pixels(seen.rms_px)} rms, {pixels(seen.max_px)} at most "
            f"over the frame; image scale {percent(numbers.scale_change)}; from {ground.altitude_m:g} m "
            f"{length(ground.max_cm / 100)} on the ground, heights {length(ground.height_cm / 100, signed=True)}"
        )


def show_findings(screen: Screen, findings: Sequence[Finding]) -> None:
    """Show the findings of the check, one line each."""
    from calibrary.cli.console import plain

    for finding in findings:
        style = "red" if finding.severity.value == "error" else "yellow"
        said = plain(str(finding))
        screen.say(f"[{style}]{finding.severity.value}[/] {said}")


def show_conflict(screen: Screen, error: FileConflictError) -> None:
    """Show, field by field, what another writer has changed in the meantime and what was to be written."""
    from calibrary.cli.console import plain
    from calibrary.jobs.fleet.changes import conflict_changes

    for path, changes in conflict_changes(error.conflicts).items():
        screen.say(f"[bold]{plain(path)}[/]  theirs, and what was to be written")
        screen.show(change_table(changes, screen.width - 2), indent=2)


def show_written(screen: Screen, written: Written, verb: str, number: int) -> None:
    """Show the commit in one line, and each warning."""
    from calibrary.cli.console import plain

    entries = "1 entry" if number == 1 else f"{number} entries"
    screen.say(f"{verb} {entries} in commit {written.commit[:12]}")
    for warning in written.warnings:
        screen.say(f"[yellow]note[/] {plain(warning)}")


def field_text(value: Field) -> str:
    """A field's value with all digits."""
    if value is None:
        return "–"
    return repr(value) if isinstance(value, float) else str(value)
