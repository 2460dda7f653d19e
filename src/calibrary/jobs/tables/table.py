"""A table that can be written as CSV or as Parquet, which keeps the column types."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError
from calibrary.extras import TABLES, require
from calibrary.interop.notebook import MOST_ROWS, html_rows
from calibrary.registry.spreadsheet import csv_text

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Cell", "Table", "check_table_place"]

Cell: TypeAlias = str | int | float | bool | None

COUNTS: Final = frozenset({"width_px", "height_px", "images"})
MEASURES: Final = re.compile(r".*_(?:px|mm|um|share)|fx_over_width")


class Table(Struct, frozen=True, dict=True):
    """A table of rows by column name; its columns are those of all rows, in order of first occurrence.

    Attributes:
        rows: the rows; a missing column name is an empty cell.
    """

    rows: Sequence[Mapping[str, Cell]]

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The column names."""
        return tuple(dict.fromkeys(name for row in self.rows for name in row))

    def to_dict(self) -> dict[str, list[Cell]]:
        """The columns by name, as accepted by ``pandas.DataFrame`` and ``polars.DataFrame``."""
        return {name: [row.get(name) for row in self.rows] for name in self.columns}

    def to_csv(self) -> str:
        """The table as CSV text with commas, decimal points and all digits; no cell is a formula in a spreadsheet."""
        return csv_text(self.columns, ([row.get(name) for name in self.columns] for row in self.rows))

    def to_parquet(self) -> bytes:
        """The table as a Parquet file.

        Raises:
            MissingExtraError: pyarrow is not installed.
        """
        require(TABLES, "a Parquet table")
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = self.to_dict()
        arrays = {name: pa.array(values, _type_of(name, values)) for name, values in columns.items()}
        origin = {"pixel_origin": "outer corner of the top-left pixel"}
        file = io.BytesIO()
        pq.write_table(pa.table(arrays).replace_schema_metadata(origin), file)
        return file.getvalue()

    def write(self, path: Path) -> None:
        """Write the table in the format of the file's suffix; an existing file is replaced atomically.

        Raises:
            InputError: the suffix is neither .csv nor .parquet, or the file cannot be written.
            MissingExtraError: pyarrow is not installed, for .parquet.
        """
        check_table_place(path)
        data = self.to_parquet() if path.suffix.lower() == ".parquet" else self.to_csv().encode()
        write_files({path: data})

    def _repr_html_(self) -> str:
        """HTML of the first rows, for notebooks."""
        shown = [[_cell_text(row.get(name)) for name in self.columns] for row in self.rows[:MOST_ROWS]]
        return html_rows(self.columns, shown, many=len(self.rows))


def check_table_place(path: Path) -> None:
    """Check before any work is done that a table can be written.

    Raises:
        InputError: the suffix is neither .csv nor .parquet, or the folder is not writable.
        MissingExtraError: pyarrow is not installed, for .parquet.
    """
    if path.suffix.lower() not in {".csv", ".parquet"}:
        raise InputError(
            "expected a name that ends in .csv or .parquet, or - for CSV on standard output", source=str(path)
        )
    if path.suffix.lower() == ".parquet":
        require(TABLES, "a Parquet table")
    check_folder(path)


def _type_of(name: str, values: Iterable[Cell]) -> pa.DataType:
    """Type of a column; if the name has a unit, the type is the same in every table."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    if name in COUNTS:
        return pa.int64()
    if MEASURES.fullmatch(name):
        return pa.float64()
    simple = {frozenset({bool}): pa.bool_(), frozenset({int}): pa.int64()}
    return simple.get(frozenset(kinds)) or (pa.float64() if kinds and kinds <= {int, float} else pa.string())


def _cell_text(value: Cell) -> str:
    return "" if value is None else f"{value:.7g}" if isinstance(value, float) else str(value)
