"""Results as tables for spreadsheets and data frames.

>>> from calibrary.jobs import tables
>>> table = tables.cameras(calibrary.extract("survey"))
>>> [(row["model"], row["verdict"], row["fx_px"]) for row in table.rows]
[('FC6310R', 'valid', 3659.5)]
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.catalogue import CatalogueListing
    from calibrary.jobs.audit.report import AuditReport
    from calibrary.jobs.extract.report import ExtractReport
    from calibrary.jobs.inspect.run import InspectFilesReport
    from calibrary.jobs.tables.rows import Table
    from calibrary.registry.query import EntryListing

__all__ = ["cameras", "catalogue", "entries", "files", "flown", "images"]


def cameras(result: ExtractReport) -> Table:
    """Return the cameras of an ``extract`` result, one row each."""
    from calibrary.jobs.tables.rows import camera_table

    return camera_table(result)


def images(result: ExtractReport) -> Table:
    """Return the images of an ``extract`` result, one row each with the K of its camera; only those that it lists."""
    from calibrary.jobs.tables.rows import image_table

    return image_table(result)


def entries(listing: EntryListing) -> Table:
    """Return entries of a registry, one row each: the listing's columns, or those of a table of cameras."""
    from calibrary.jobs.tables.rows import entry_table

    return entry_table(listing.entries, listing.chosen.rows, listing.columns)


def files(result: InspectFilesReport) -> Table:
    """Return the calibrations of an ``inspect`` result, one row each, and the files that were not read."""
    from calibrary.jobs.tables.rows import file_table

    return file_table(result.files)


def flown(report: AuditReport) -> Table:
    """Make a table of the units and firmware versions that flew, with the registry's entry for each."""
    from calibrary.jobs.tables.rows import audit_table

    return audit_table(report)


def catalogue(listing: CatalogueListing) -> Table:
    """Make a table of the known cameras; several spellings of a Model are in one cell."""
    from calibrary.jobs.tables.rows import catalogue_table

    return catalogue_table(listing.cameras)
