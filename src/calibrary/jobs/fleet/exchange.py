"""Export of whole registries: the implementation of ``Fleet``'s method."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from msgspec import Struct

from calibrary.jobs.exchange.export import Export, check_target, export
from calibrary.jobs.exchange.export import report_of as export_report
from calibrary.records import Json, to_json
from calibrary.registry.snapshot import Snapshot

__all__ = [
    "ExportResult",
    "exported",
]


class ExportResult(Struct, frozen=True, eq=False):
    """An export, and the commit it was made from."""

    export: Export
    commit: str | None

    def to_dict(self) -> dict[str, Json]:
        """Return the export as plain data for JSON (schemas/registry-export-1.schema.json)."""
        return to_json(export_report(self.export, self.commit))


def exported(
    snapshot: Snapshot, form: str, out: Path, statuses: Collection[str], max_error_px: float | None
) -> ExportResult:
    """Do the work of :meth:`calibrary.Fleet.export`."""
    check_target(form, out, max_error_px=max_error_px)
    stored = [one for one in snapshot.entries() if one.entry.status.value in statuses]
    return ExportResult(export(stored, form, out, max_error_px=max_error_px), snapshot.commit)
