"""The units of a registry as a table for a spreadsheet, and the import of changes to it."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from msgspec import Struct

from calibrary.atomic import write_files
from calibrary.errors import InputError
from calibrary.jobs.fleet.results import EntryListing
from calibrary.records import Json, to_json
from calibrary.registry.editing import UnitsImport, import_units, units_csv, units_report
from calibrary.registry.git.writing import Written
from calibrary.registry.proposals import save
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.spreadsheet import csv_text

__all__ = ["UnitsChange", "csv_text", "write_units"]

LARGEST_TABLE = 256 << 20
"""Bytes; a row has about 300."""


class UnitsChange(Struct, eq=False):
    """Changes made by a table; nothing is written before :meth:`write`.

    Attributes:
        registry: registry to write to.
        snapshot: state that the table was compared with.
        source: file of the table.
        found: entries to write, and the rows with errors.
        written: the commit, after writing.
    """

    registry: Registry
    snapshot: Snapshot
    source: Path
    found: UnitsImport
    written: Written | None = None

    @classmethod
    def of(cls, registry: Registry, file: Path) -> Self:
        """Read the changes from a table; see :func:`calibrary.registry.editing.import_units`."""
        try:
            with file.open("rb") as opened:
                data = opened.read(LARGEST_TABLE + 1)
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}", source=str(file)) from None
        if len(data) > LARGEST_TABLE:
            raise InputError(f"is larger than {LARGEST_TABLE >> 20} MiB", source=str(file))
        snapshot = registry.snapshot()
        return cls(registry, snapshot, file, import_units(snapshot, data, str(file)))

    def write(self, reason: str | None = None) -> Written:
        """Write the change as one commit.

        Raises:
            FileConflictError: an entry was changed since the table was read; nothing was written.
            RegistryError: there is nothing to write, or the registry cannot be written.
        """
        self.written = save(self.registry, self.found.proposals, reason=reason)
        return self.written

    def to_dict(self) -> dict[str, Json]:
        """Return the change as plain data for JSON (schemas/registry-units-1.schema.json)."""
        return to_json(units_report(self.snapshot, str(self.source), self.found, self.written))


def write_units(listing: EntryListing, out: Path, *, excel: bool) -> int:
    """Do the work of :meth:`calibrary.Fleet.export_units`."""
    if listing.unreadable:
        raise listing.unreadable[0]
    write_files({out: units_csv(listing.entries, excel=excel)})
    return len(listing.entries)
