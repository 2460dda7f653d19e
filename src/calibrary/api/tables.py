"""What commands show, as tables for spreadsheets and data frames."""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.api.exchange import AuditResult
from calibrary.api.images import ExtractResult
from calibrary.api.registry_results import EntryListing
from calibrary.jobs.audit.report import report_of as audit_report
from calibrary.jobs.extract.report import report_of as extract_report
from calibrary.jobs.inspect.run import Inspected
from calibrary.jobs.tables import rows
from calibrary.jobs.tables.table import Table, check_table_place
from calibrary.known_camera import KnownCamera

__all__ = [
    "Table",
    "audited_cameras",
    "cameras",
    "catalogue",
    "check_table_place",
    "entries",
    "files",
    "images",
]


def cameras(result: ExtractResult) -> Table:
    """The cameras of ``extract``, a row each.

    >>> from calibrary.api import tables
    >>> table = tables.cameras(calibrary.extract("survey"))
    >>> [(row["model"], row["verdict"], row["fx_px"]) for row in table.rows]
    [('FC6310R', 'valid', 3659.5)]
    """
    return rows.camera_table(extract_report(result.extraction, {}))


def images(result: ExtractResult) -> Table:
    """The images of ``extract``, a row each with the K of its camera; of very many only those that it names."""
    return rows.image_table(extract_report(result.extraction, {}))


def entries(listing: EntryListing, columns: Sequence[str] | None = None) -> Table:
    """Entries of a registry, a row each.

    Args:
        listing: of :meth:`calibrary.Fleet.listing`.
        columns: fields to show, as :meth:`~calibrary.registry.query.Selection.columns` finds them; None for all that a
            table of cameras has.
    """
    return rows.entry_table(listing.entries, listing.chosen.rows, columns)


def files(inspected: Sequence[Inspected]) -> Table:
    """The calibrations that ``inspect`` found in files."""
    return rows.file_table(inspected)


def audited_cameras(result: AuditResult) -> Table:
    """What flew, by ``audit``, and the entry for it."""
    return rows.audit_table(audit_report(result.audit))


def catalogue(known: Sequence[KnownCamera]) -> Table:
    """Known cameras."""
    return rows.catalogue_table(known)
