"""CSV for spreadsheets: no cell is written as a formula; European and American forms of Excel are read."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from msgspec import Struct

from calibrary.errors import InputError

FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters that make a spreadsheet treat a cell as a formula (OWASP, "CSV Injection")."""
ESCAPED: Final = (*FORMULA, "'")
"""First characters before which a ' is added; reading removes only the first one."""
DELIMITERS: Final = (",", ";", "\t")


class Sheet(Struct, frozen=True, kw_only=True):
    """A table that was read.

    Attributes:
        columns: column names, as written.
        rows: line number and cells by column of each row.
        encoding: encoding of the file.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[int, Mapping[str, str]], ...]
    encoding: str


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV.

    Args:
        columns: column names.
        rows: texts, numbers, tuples of texts, and None for an empty cell.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, tuple):
        return _cell(" ".join(map(str, value)))
    if isinstance(value, float):
        return repr(value)
    text = f"'{value}" if isinstance(value, str) and value.startswith(ESCAPED) else str(value)
    # The csv module does not quote a carriage return, which readers take for the end of a row.
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_sheet(data: bytes, source: str) -> Sheet:
    """Read a table from a CSV file; the first row contains the column names.

    Raises:
        InputError: it is not text, has no columns or a duplicate one, or a row has more cells than there are columns.
    """
    text, encoding = _decoded(data, source)
    first, _, rest = text.partition("\n")
    skipped = 0
    stated = first.strip().lower()
    if stated.startswith("sep=") and len(stated) == len("sep=,"):
        text, delimiter, skipped = rest, first.strip()[-1], 1
    else:
        delimiter = max(DELIMITERS, key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        columns = tuple(name.strip() for name in next(reader, []))
        if not any(columns):
            raise InputError("is empty, expected a row with the names of the columns", source=source)
        if twice := sorted({name for name in columns if name and columns.count(name) > 1}):
            raise InputError(f"names the column {twice[0]!r:.40} more than once", source=source)
        rows = []
        at = skipped + reader.line_num + 1
        for cells in reader:
            line, at = at, skipped + reader.line_num + 1
            if not any(cell.strip() for cell in cells):
                continue
            if any(cell.strip() for cell in cells[len(columns) :]):
                message = f"has {len(cells)} cells, and there are {len(columns)} columns"
                raise InputError(message, source=source, place=f"line {line}")
            padded = [*cells, *[""] * (len(columns) - len(cells))]
            named = {name: _plain(cell) for name, cell in zip(columns, padded, strict=False) if name}
            rows.append((line, named))
    except csv.Error as error:
        raise InputError(f"is not CSV: {error}", source=source) from None
    return Sheet(columns=columns, rows=tuple(rows), encoding=encoding)


def _decoded(data: bytes, source: str) -> tuple[str, str]:
    # Excel's format "CSV", unlike "CSV UTF-8", uses the encoding of the local Windows version.
    is_wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    encodings = ["utf-16"] if is_wide else ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text, encoding
    raise InputError("is not text, expected CSV", source=source)


def _plain(cell: str) -> str:
    text = cell.replace("\r\n", "\n").replace("\r", "\n").strip(" ")
    return text[1:] if text.startswith("'") and text[1:].startswith(ESCAPED) else text


def same_number(one: str, other: str) -> bool:
    """Return whether two cells have the same text or number; spreadsheets drop zeros and use decimal commas."""
    if one.strip() == other.strip():
        return True
    try:
        a, b = (float(text.strip().replace(",", ".")) for text in (one, other))
    except ValueError:
        return False
    # Spreadsheets keep 15 digits.
    return abs(a - b) <= 1e-12 * max(abs(a), abs(b))
