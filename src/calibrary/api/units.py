"""The units of a registry as a table for a spreadsheet, and what was changed in it."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from msgspec import Struct

from calibrary.api.registry_results import EntryListing
from calibrary.atomic import write_files
from calibrary.errors import InputError
from calibrary.records import Json, to_json
from calibrary.registry.git.writing import Written
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.spreadsheet import csv_text
from calibrary.registry.units import UnitsImport, import_units, units_csv, units_report

__all__ = ["UnitsChange", "csv_text", "write_units"]

LARGEST_TABLE = 256 << 20
"""Bytes; a row has some three hundred."""


class UnitsChange(Struct, eq=False):
    """What a table changes; nothing is written before :meth:`write`.

    Attributes:
        registry: to write to.
        snapshot: that the table was compared with.
        source: the table's file.
        found: the entries as they would be written, and the rows that are wrong.
        written: the commit, once it is written.
    """

    registry: Registry
    snapshot: Snapshot
    source: Path
    found: UnitsImport
    written: Written | None = None

    @classmethod
    def of(cls, registry: Registry, file: Path) -> Self:
        """What a file says; see :func:`calibrary.registry.units.import_units`."""
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
        """Write it as one commit.

        Raises:
            FileConflictError: an entry was changed since; nothing was written.
            RegistryError: there is nothing to write, or it cannot be written.
        """
        self.written = self.registry.save(self.found.proposals, reason=reason)
        return self.written

    def to_dict(self) -> dict[str, Json]:
        """As plain data for JSON (schemas/registry-units-1.schema.json)."""
        return to_json(units_report(self.snapshot, str(self.source), self.found, self.written))


def write_units(listing: EntryListing, out: Path, *, excel: bool) -> int:
    """As :meth:`calibrary.Fleet.export_units`."""
    if listing.unreadable:
        raise listing.unreadable[0]
    write_files({out: units_csv(listing.entries, excel=excel)})
    return len(listing.entries)
