"""A table and the two files it is written as: CSV, and Parquet, which keeps the types of the columns."""

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
    """Rows by column name; the columns are those of all rows, in the order in which they first come.

    Attributes:
        rows: a name that a row lacks is an empty cell of it.
    """

    rows: Sequence[Mapping[str, Cell]]

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The names."""
        return tuple(dict.fromkeys(name for row in self.rows for name in row))

    def to_dict(self) -> dict[str, list[Cell]]:
        """The columns by name, as ``pandas.DataFrame`` and ``polars.DataFrame`` take them."""
        return {name: [row.get(name) for row in self.rows] for name in self.columns}

    def to_csv(self) -> str:
        """The table as UTF-8 text: commas, decimal points, every digit; no cell is a formula to a spreadsheet."""
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
        """Write the table as the file's suffix says; a file that is there is replaced whole.

        Raises:
            InputError: the suffix is neither .csv nor .parquet, or the file cannot be written.
            MissingExtraError: pyarrow is not installed, for .parquet.
        """
        check_table_place(path)
        data = self.to_parquet() if path.suffix.lower() == ".parquet" else self.to_csv().encode()
        write_files({path: data})

    def _repr_html_(self) -> str:
        """The first rows, as a notebook shows them."""
        shown = [[_shown(row.get(name)) for name in self.columns] for row in self.rows[:MOST_ROWS]]
        return html_rows(self.columns, shown, many=len(self.rows))


def check_table_place(path: Path) -> None:
    """Find out, before any work is done for it, whether a table can be written.

    Raises:
        InputError: the suffix is neither .csv nor .parquet, or the folder may not be written to.
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
    """The type of a column: the same in every table where the name has a unit, whatever is in it."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    if name in COUNTS:
        return pa.int64()
    if MEASURES.fullmatch(name):
        return pa.float64()
    simple = {frozenset({bool}): pa.bool_(), frozenset({int}): pa.int64()}
    return simple.get(frozenset(kinds)) or (pa.float64() if kinds and kinds <= {int, float} else pa.string())


def _shown(value: Cell) -> str:
    return "" if value is None else f"{value:.7g}" if isinstance(value, float) else str(value)
