"""What a registry answers, each with its JSON form."""

from __future__ import annotations

from datetime import date
from functools import cached_property
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import RegistryError
from calibrary.interop.notebook import MOST_ROWS, html_rows, html_table
from calibrary.records import Json, to_json
from calibrary.registry import history_reports, stored
from calibrary.registry.entry import Entry, Status
from calibrary.registry.fields import FieldChange, entry_rows, entry_text
from calibrary.registry.history import Approval, EntryRevision, FieldOrigin, Recorded
from calibrary.registry.history_reports import blame_report, log_report
from calibrary.registry.query import Selection, short_ids
from calibrary.registry.resolution import RejectedEntry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry

if TYPE_CHECKING:
    from calibrary.jobs.exchange.resolve import Answer
    from calibrary.registry.checks.findings import Checked

__all__ = [
    "Blame",
    "CheckResult",
    "EntryListing",
    "FleetAnswer",
    "History",
    "ShownEntry",
    "entry_text",
]


class FleetAnswer(Struct, frozen=True, eq=False):
    """What a registry, or several, say of one camera.

    Attributes:
        answer: all of it, as the command line shows it.
        on: the day it is for.
    """

    answer: Answer
    on: date

    @property
    def registry(self) -> str:
        """That answers: its folder or address, "catalogue" for the one that ships."""
        return self.answer.layer.name

    @property
    def commit(self) -> str | None:
        """Of that registry, 40 hexadecimal digits; None for a plain folder and the catalogue."""
        return self.answer.layer.commit

    @property
    def camera(self) -> CameraKey:
        """The camera that was asked for, as far as it is known."""
        return self.answer.question.key

    @property
    def calibration(self) -> Calibration | None:
        """Its K and distortion at the camera's image size; None where no entry answers."""
        found = self.answer.resolution
        return found.calibration if found is not None else None

    @property
    def entry(self) -> Entry | None:
        """The entry that answers, as its file says it; None where the catalogue does."""
        return self.answer.entry

    @property
    def status(self) -> Status | None:
        """Whether the entry is approved or held."""
        return self.entry.status if self.entry is not None else None

    @property
    def reason(self) -> str | None:
        """Why this entry and no other."""
        found = self.answer.resolution
        return found.why if found is not None else None

    @property
    def disagreements(self) -> tuple[str, ...]:
        """What registries that are asked after that one say against its answer."""
        found = self.answer.resolution
        return found.disagreements if found is not None else ()

    @property
    def near(self) -> tuple[RejectedEntry, ...]:
        """Other entries of the same make and model, each with its ``path`` and ``reason``."""
        return self.answer.near

    def _repr_html_(self) -> str:
        """The answer and its K, as a notebook shows them."""
        found = self.calibration
        rows = [("entry", self.entry.id if self.entry is not None else self.registry if found else "none")]
        rows += [("status", self.status.value)] if self.status is not None else []
        rows += [("why", self.reason or "; ".join(f"{one.path}: {one.reason}" for one in self.near[:3]))]
        rows += [("disagrees", text) for text in self.disagreements]
        answer = html_table(f"{self.camera}, on {self.on}", rows)
        return answer + (found._repr_html_() if found is not None else "")

    def to_dict(self) -> dict[str, Json]:
        """The answer as plain data for JSON (schemas/resolution-1.schema.json)."""
        from calibrary.jobs.exchange.resolve import resolution_report

        return to_json(resolution_report(self.answer, on=self.on))


class EntryListing(Struct, frozen=True, eq=False, dict=True):
    """Entries of a registry, and what is wrong with those that cannot be read.

    Attributes:
        chosen: the entries, chosen and sorted, by their fields.
        unreadable: of entries that cannot be read.
        snapshot: of the registry.
    """

    chosen: Selection
    unreadable: tuple[RegistryError, ...]
    snapshot: Snapshot

    @cached_property
    def entries(self) -> tuple[StoredEntry, ...]:
        """The same as entries, which are read when they are first asked for."""
        return self.snapshot.stored(self.chosen.paths)

    def short_ids(self) -> list[str]:
        """KEYs of the entries, with the hashes of units as short as they may be."""
        every = (*self.snapshot.paths, *self.snapshot.proposed)
        return short_ids(self.chosen.paths, every)

    def _repr_html_(self) -> str:
        """The entries as a notebook shows them."""
        rows = []
        for short, row in zip(self.short_ids()[:MOST_ROWS], self.chosen.rows, strict=False):
            fx, said = row["intrinsics.fx"], (row.get("label"), short, row["status"], row["grade"])
            day = str(row.get("provenance.date", ""))[:10]
            rows.append((*(str(text or "") for text in said), f"{fx:.2f}", day))
        columns = ("label", "entry", "status", "grade", "fx px", "made on")
        return html_rows(columns, rows, many=len(self.chosen.rows))

    def to_dict(self) -> dict[str, Json]:
        """As plain data for JSON (schemas/entry-listing-1.schema.json)."""
        return to_json(stored.EntryListing.of(self.entries))


class ShownEntry(Struct, frozen=True, eq=False):
    """An entry as it is or was.

    Attributes:
        stored: the entry, with its path and commit.
        recorded: who put its calibration into the registry; None in a plain folder.
        approved: who approved it, and in which commits.
        against: KEY@REV of the state it is compared with, if any.
        changes: the fields that differ from that state.
    """

    stored: StoredEntry
    recorded: Recorded | None
    approved: tuple[Approval, ...] = ()
    against: str | None = None
    changes: tuple[FieldChange, ...] | None = None

    def rows(self) -> list[tuple[str, str]]:
        """Every field by its name, numbers to ten digits with their uncertainty."""
        return entry_rows(self.stored.entry, "{:.10g}".format)

    def _repr_html_(self) -> str:
        """Every field as a notebook shows it."""
        return html_table(self.stored.id, self.rows())

    def to_dict(self) -> dict[str, Json]:
        """As plain data for JSON (schemas/entry-listing-1.schema.json)."""
        shown = history_reports.ShownEntry(
            **self.stored.members,
            recorded=self.recorded,
            approved=self.approved,
            against=self.against,
            changes=self.changes,
        )
        return to_json(shown)


class History(Struct, frozen=True, eq=False):
    """The revisions of an entry, or of a whole registry where ``key`` is None, newest first."""

    key: str | None
    revisions: tuple[EntryRevision, ...]

    def to_dict(self) -> dict[str, Json]:
        """As plain data for JSON (schemas/registry-log-1.schema.json)."""
        return to_json(log_report(self.revisions, self.key))


class Blame(Struct, frozen=True, eq=False):
    """Which commit last changed each field of an entry."""

    id: str
    origins: tuple[FieldOrigin, ...]

    def to_dict(self) -> dict[str, Json]:
        """As plain data for JSON (schemas/registry-blame-1.schema.json)."""
        return to_json(blame_report(self.origins, self.id))


class CheckResult(Struct, frozen=True, eq=False):
    """What a check found.

    Attributes:
        checked: all of it, as the command line shows it.
        unsigned: the commits that are not signed by a listed person; None where that was not asked.
    """

    checked: Checked
    unsigned: tuple[str, ...] | None = None

    @property
    def is_good(self) -> bool:
        """Whether there is no error and no unsigned commit; there may be warnings."""
        return self.checked.report.is_good and not self.unsigned

    def with_signatures(self, unsigned: tuple[str, ...]) -> CheckResult:
        """The same, with the commits that are not signed by a listed person."""
        return CheckResult(self.checked, unsigned)

    def to_dict(self) -> dict[str, Json]:
        """As plain data for JSON (schemas/registry-check-1.schema.json)."""
        from calibrary.registry.checks.findings import document_of

        return to_json(document_of(self.checked, self.unsigned))
