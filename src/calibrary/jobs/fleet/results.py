"""Results of registry queries, each with its JSON form."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.interop.notebook import MOST_ROWS, html_rows, html_table
from calibrary.records import Json, to_json
from calibrary.registry import history, stored
from calibrary.registry.fields import FieldChange, entry_rows, entry_text
from calibrary.registry.history import (
    Approval,
    EntryRevision,
    FieldOrigin,
    Recorded,
    blame_report,
    log_report,
)
from calibrary.registry.query import Selection, short_ids
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry

if TYPE_CHECKING:
    from calibrary.registry.entry_checks import Checked

__all__ = [
    "Blame",
    "CheckResult",
    "EntryListing",
    "History",
    "ShownEntry",
    "entry_text",
]


class EntryListing(Struct, frozen=True, eq=False, dict=True):
    """Selected entries of a registry, and the errors of those that cannot be read.

    Attributes:
        chosen: rows of fields of the selected entries, sorted.
        unreadable: errors of entries that cannot be read.
        snapshot: state of the registry.
    """

    chosen: Selection
    unreadable: tuple[RegistryError, ...]
    snapshot: Snapshot

    @cached_property
    def entries(self) -> tuple[StoredEntry, ...]:
        """The selected entries as objects, read at first use."""
        return self.snapshot.stored(self.chosen.paths)

    def short_ids(self) -> list[str]:
        """Return the KEYs of the entries, with unit hashes as short as possible."""
        every = (*self.snapshot.paths, *self.snapshot.proposed)
        return short_ids(self.chosen.paths, every)

    def _repr_html_(self) -> str:
        """Return the entries as HTML, for notebooks."""
        rows = []
        for short, row in zip(self.short_ids()[:MOST_ROWS], self.chosen.rows, strict=False):
            fx, said = row["intrinsics.fx"], (row.get("label"), short, row["status"], row["grade"])
            day = str(row.get("provenance.date", ""))[:10]
            rows.append((*(str(text or "") for text in said), f"{fx:.2f}", day))
        columns = ("label", "entry", "status", "grade", "fx px", "made on")
        return html_rows(columns, rows, many=len(self.chosen.rows))

    def to_dict(self) -> dict[str, Json]:
        """Return the listing as plain data for JSON (schemas/entry-listing-1.schema.json)."""
        return to_json(stored.EntryListing.of(self.entries))


class ShownEntry(Struct, frozen=True, eq=False):
    """A current or earlier entry.

    Attributes:
        stored: the entry, with its path and commit.
        recorded: who added its calibration to the registry; None in a plain folder.
        approved: who approved it, and in which commits.
        against: KEY@REV of the state it is compared with, if any.
        changes: fields that differ from that state.
    """

    stored: StoredEntry
    recorded: Recorded | None
    approved: tuple[Approval, ...] = ()
    against: str | None = None
    changes: tuple[FieldChange, ...] | None = None

    def rows(self) -> list[tuple[str, str]]:
        """Return every field as (name, value), numbers with ten digits and their uncertainty."""
        return entry_rows(self.stored.entry, "{:.10g}".format)

    def _repr_html_(self) -> str:
        """Return every field as HTML, for notebooks."""
        return html_table(self.stored.id, self.rows())

    def to_dict(self) -> dict[str, Json]:
        """Return the entry as plain data for JSON (schemas/entry-listing-1.schema.json)."""
        shown = history.ShownEntry(
            **self.stored.members,
            recorded=self.recorded,
            approved=self.approved,
            against=self.against,
            changes=self.changes,
        )
        return to_json(shown)


class History(Struct, frozen=True, eq=False):
    """Revisions of an entry, or of the whole registry if ``key`` is None, newest first."""

    key: str | None
    revisions: tuple[EntryRevision, ...]

    def to_dict(self) -> dict[str, Json]:
        """Return the revisions as plain data for JSON (schemas/registry-log-1.schema.json)."""
        return to_json(log_report(self.revisions, self.key))


class Blame(Struct, frozen=True, eq=False):
    """The commit that last changed each field of an entry."""

    id: str
    origins: tuple[FieldOrigin, ...]

    def to_dict(self) -> dict[str, Json]:
        """Return the commits as plain data for JSON (schemas/registry-blame-1.schema.json)."""
        return to_json(blame_report(self.origins, self.id))


class CheckResult(Struct, frozen=True, eq=False):
    """Result of a registry check.

    Attributes:
        checked: complete result, as the command line shows it.
        unsigned: commits without a signature of a listed person; None if signatures were not checked.
    """

    checked: Checked
    unsigned: tuple[str, ...] | None = None

    @property
    def is_good(self) -> bool:
        """Whether there is no error and no unsigned commit; there may be warnings."""
        return self.checked.report.is_good and not self.unsigned

    def with_signatures(self, unsigned: tuple[str, ...]) -> CheckResult:
        """Return the result with the commits that have no signature of a listed person."""
        return CheckResult(self.checked, unsigned)

    def to_dict(self) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/registry-check-1.schema.json)."""
        from calibrary.registry.entry_checks import document_of  # noqa: PLC0415  the checks, which a listing does not need

        return to_json(document_of(self.checked, self.unsigned))
