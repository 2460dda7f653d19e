"""Import and export of whole registries: the implementation of ``Fleet``'s methods."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from msgspec import Struct

from calibrary.arguments import Reading
from calibrary.jobs.exchange.add import AddRequest
from calibrary.jobs.exchange.export import Export, check_target, export
from calibrary.jobs.exchange.export import report_of as export_report
from calibrary.jobs.exchange.import_ import Import, write_import
from calibrary.jobs.exchange.import_ import report_of as import_report
from calibrary.records import Json, to_json
from calibrary.registry.git.writing import Written
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot

__all__ = [
    "AddRequest",
    "ExportResult",
    "ImportResult",
    "Reading",
    "exported",
]


class ExportResult(Struct, frozen=True, eq=False):
    """An export, and the commit it was made from."""

    export: Export
    commit: str | None

    def to_dict(self) -> dict[str, Json]:
        """Return the export as plain data for JSON (schemas/registry-export-1.schema.json)."""
        return to_json(export_report(self.export, self.commit))


class ImportResult(Struct, eq=False):
    """Calibrations to import; nothing is written before :meth:`write`."""

    registry: Registry
    found: Import
    written: Written | None = None

    def write(self, reason: str | None = None) -> Written | None:
        """Write the entries to import as one commit; return None if there are none.

        Raises:
            RegistryError: the registry cannot be written.
        """
        self.written = write_import(self.registry, self.found, reason=reason)
        return self.written

    def to_dict(self) -> dict[str, Json]:
        """Return the import as plain data for JSON (schemas/registry-import-1.schema.json)."""
        return to_json(import_report(self.found, self.written.commit if self.written is not None else None))


def exported(
    snapshot: Snapshot, form: str, out: Path, statuses: Collection[str], max_error_px: float | None
) -> ExportResult:
    """Do the work of :meth:`calibrary.Fleet.export`."""
    check_target(form, out, max_error_px=max_error_px)
    stored = [one for one in snapshot.entries() if one.entry.status.value in statuses]
    return ExportResult(export(stored, form, out, max_error_px=max_error_px), snapshot.commit)
