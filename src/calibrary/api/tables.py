"""Results of commands as tables for spreadsheets and data frames."""

from __future__ import annotations

from calibrary.api.images import ExtractResult
from calibrary.jobs.extract.report import report_of as extract_report
from calibrary.jobs.tables import rows
from calibrary.jobs.tables.table import Table, check_table_place
from calibrary.registry.query import EntryListing

__all__ = [
    "Table",
    "cameras",
    "check_table_place",
    "entries",
    "images",
]


def cameras(result: ExtractResult) -> Table:
    """Return the cameras of an ``extract`` result, one row each.

    >>> from calibrary.api import tables
    >>> table = tables.cameras(calibrary.extract("survey"))
    >>> [(row["model"], row["verdict"], row["fx_px"]) for row in table.rows]
    [('FC6310R', 'valid', 3659.5)]
    """
    return rows.camera_table(extract_report(result.extraction, {}))


def images(result: ExtractResult) -> Table:
    """Return the images of an ``extract`` result, one row each with the K of its camera; only those that it lists."""
    return rows.image_table(extract_report(result.extraction, {}))


def entries(listing: EntryListing) -> Table:
    """Return entries of a registry, one row each: the listing's columns, or those of a table of cameras."""
    return rows.entry_table(listing.entries, listing.chosen.rows, listing.columns)
