"""Audit, import and export of whole registries: the implementation of ``Fleet``'s methods."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import date
from pathlib import Path

from msgspec import Struct

from calibrary.arguments import Reading
from calibrary.interop.notebook import html_rows
from calibrary.jobs.audit.answers import named
from calibrary.jobs.audit.report import report_of as audit_report
from calibrary.jobs.audit.run import LEVELS, Audit, Request, audit
from calibrary.jobs.exchange.add import AddRequest, Stated
from calibrary.jobs.exchange.export import Export, check_target, export
from calibrary.jobs.exchange.export import report_of as export_report
from calibrary.jobs.exchange.import_ import Import, write_import
from calibrary.jobs.exchange.import_ import report_of as import_report
from calibrary.progress import Progress
from calibrary.records import Json, to_json
from calibrary.registry.git.writing import Written
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding

__all__ = [
    "LEVELS",
    "AddRequest",
    "AuditResult",
    "ExportResult",
    "ImportResult",
    "Reading",
    "Stated",
    "audited",
    "exported",
    "named",
]


class AuditResult(Struct, frozen=True, eq=False):
    """Result of comparing a registry with recent flights.

    Attributes:
        audit: complete result, as the command line shows it.
    """

    audit: Audit

    @property
    def is_clean(self) -> bool:
        """Whether no finding needs attention; there may be notes."""
        return self.audit.is_clean

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings, most severe first."""
        return self.audit.findings

    def to_html(self) -> str:
        """Return the audit as a page."""
        from calibrary.jobs.audit.page import audit_page  # noqa: PLC0415  only who wants a page
        from calibrary.pages import render_page  # noqa: PLC0415  as above

        return render_page(audit_page(self.audit))

    def _repr_html_(self) -> str:
        """Return the units that flew, most urgent first, as HTML, for notebooks."""
        rows = [
            (
                unit.name,
                str(unit.images),
                unit.level.value if unit.level is not None else "clean",
                unit.findings[0].message if unit.findings else "",
                unit.next or "",
            )
            for unit in self.audit.units
        ]
        columns = ("unit", "images", "gravest", "finding", "what to do")
        return html_rows(columns, rows, title=f"{len(self.findings)} findings")

    def to_dict(self) -> dict[str, Json]:
        """Return the audit as plain data for JSON (schemas/registry-audit-1.schema.json)."""
        return to_json(audit_report(self.audit))


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


def audited(
    snapshot: Snapshot,
    folders: Sequence[str | Path],
    *,
    since: date | None,
    stale_months: int,
    workers: int,
    verify: bool,
    verify_minutes: float,
    progress: Progress | None,
) -> AuditResult:
    """Do the work of :meth:`calibrary.Fleet.audit`."""
    request = Request(
        folders=tuple(map(Path, folders)),
        snapshot=snapshot,
        today=date.today(),
        since=since,
        stale_months=stale_months,
        workers=workers,
        verify=verify,
        minutes=verify_minutes,
        progress=progress,
    )
    return AuditResult(audit(request))


def exported(
    snapshot: Snapshot, form: str, out: Path, statuses: Collection[str], max_error_px: float | None
) -> ExportResult:
    """Do the work of :meth:`calibrary.Fleet.export`."""
    check_target(form, out, max_error_px=max_error_px)
    stored = [one for one in snapshot.entries() if one.entry.status.value in statuses]
    return ExportResult(export(stored, form, out, max_error_px=max_error_px), snapshot.commit)
