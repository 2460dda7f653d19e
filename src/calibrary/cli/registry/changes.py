"""How the commands that write a registry tell what they change: a table for people, a document for machines."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from calibrary.records import to_json

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from calibrary.registry.fields import Field, FieldChange
    from calibrary.registry.git.errors import FileConflictError
    from calibrary.registry.git.writing import Written
    from calibrary.registry.proposals import Proposal, Proposals
    from calibrary.registry.registry import Registry
    from calibrary.validation import Finding

__all__ = [
    "change_table",
    "print_document",
    "show_changes",
    "show_conflict",
    "show_findings",
    "tell_written",
]


def show_changes(console: Console, proposals: Iterable[Proposal]) -> None:
    """Each entry with its fields, old and new."""
    from calibrary.cli.console import plain

    for one in proposals:
        what = "is there already, word for word" if not one.changes else "new" if one.is_new else "changed"
        console.print(f"[bold]{plain(one.entry.id)}[/]  {what}", highlight=False, soft_wrap=True)
        if one.changes:
            console.print(change_table(one.changes, only_after=one.is_new))
        for warning in one.warnings:
            console.print(f"  [yellow]note[/] {plain(warning)}", highlight=False, soft_wrap=True)


def change_table(changes: Sequence[FieldChange], *, only_after: bool = False) -> Table:
    """The fields that differ, one a row, with Δ and, where both sides know their spread, Δ/σ."""
    from rich.table import Table

    from calibrary.cli.console import plain

    table = Table(box=None, padding=(0, 2, 0, 2), show_header=not only_after)
    table.add_column("field", style="dim")
    if not only_after:
        table.add_column("before", overflow="fold")
    table.add_column("after", overflow="fold")
    if not only_after:
        table.add_column("Δ", justify="right")
        table.add_column("Δ / σ", justify="right")
    for change in changes:
        after = plain(_text(change.after))
        if only_after:
            table.add_row(plain(change.name), after)
            continue
        delta = f"{change.delta:+.6g}" if change.delta is not None else ""
        z = f"{change.z:+.1f}" if change.z is not None else ""
        table.add_row(plain(change.name), plain(_text(change.before)), after, delta, z)
    return table


def show_findings(console: Console, findings: Sequence[Finding]) -> None:
    """What the check says, one line each."""
    from calibrary.cli.console import plain

    for finding in findings:
        style = "red" if finding.severity.value == "error" else "yellow"
        said = plain(str(finding))
        console.print(f"[{style}]{finding.severity.value}[/] {said}", highlight=False, soft_wrap=True)


def show_conflict(console: Console, error: FileConflictError) -> None:
    """What somebody else has written meanwhile, field by field against what was to be written."""
    from calibrary.cli.console import plain
    from calibrary.errors import InputError
    from calibrary.registry.entry_yaml import parse_entry
    from calibrary.registry.fields import differences

    for conflict in error.conflicts:
        if conflict.theirs is None or conflict.ours is None:
            continue
        try:
            theirs, ours = (
                parse_entry(data, conflict.path, require_digest=False)
                for data in (conflict.theirs, conflict.ours)
            )
        except InputError:
            continue
        console.print(
            f"[bold]{plain(conflict.path)}[/]  theirs, and what was to be written",
            highlight=False,
            soft_wrap=True,
        )
        console.print(change_table(differences(theirs, ours)))


def tell_written(console: Console, written: Written, verb: str, number: int) -> None:
    """One line of what was committed, and each warning."""
    from calibrary.cli.console import plain

    entries = "1 entry" if number == 1 else f"{number} entries"
    console.print(f"{verb} {entries} in commit {written.commit[:12]}", highlight=False, soft_wrap=True)
    for warning in written.warnings:
        console.print(f"[yellow]note[/] {plain(warning)}", highlight=False, soft_wrap=True)


def print_document(registry: Registry, proposals: Proposals, written: Written | None) -> None:
    """What was written, or would have been, on standard output (schemas/registry-change-1.schema.json)."""
    from calibrary.registry.fields import change_json

    document = {
        "schema": "calibrary/registry-change-1",
        "registry": str(registry.repo.path),
        "commit": written.commit if written is not None else None,
        "entries": [
            {
                "id": one.entry.id,
                "path": one.entry.path,
                "status": one.entry.status.value,
                "status_before": one.current.status.value if one.current is not None else None,
                "changes": [change_json(change) for change in one.changes],
                "remarks": list(one.warnings),
            }
            for one in proposals.items
        ],
        "findings": [to_json(finding) for finding in proposals.findings],
        "warnings": list(written.warnings) if written is not None else [],
    }
    sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=True, allow_nan=False) + "\n")


def _text(value: Field) -> str:
    if value is None:
        return "–"
    return repr(value) if isinstance(value, float) else str(value)
