"""Tables of people: read as Excel and LibreOffice write them anywhere in Europe and America."""

from __future__ import annotations

import pytest

from calibrary.errors import InputError
from calibrary.registry.spreadsheet import csv_text, read_sheet, same_number

ROWS = ((2, {"label": "a", "fx": "1,5"}), (3, {"label": "b;c", "fx": ""}))


@pytest.mark.parametrize(
    "text",
    [
        'label,fx\na,"1,5"\nb;c,\n',
        'label;fx\r\na;1,5\r\n"b;c";\r\n',
        "label\tfx\na\t1,5\nb;c\n",
    ],
)
def test_the_separator_is_the_one_that_the_first_row_has_most_of(text: str) -> None:
    assert read_sheet(text.encode(), "t.csv").rows == ROWS


@pytest.mark.parametrize("line", ["sep=|", "SEP=|\r"])
def test_a_line_of_excel_states_the_separator_and_is_counted_as_a_line(line: str) -> None:
    sheet = read_sheet(f"{line}\nlabel|fx\na|1,5\n".encode(), "t.csv")
    assert sheet.columns == ("label", "fx")
    assert sheet.rows == ((3, {"label": "a", "fx": "1,5"}),)


def test_a_column_may_be_named_like_excels_line() -> None:
    assert read_sheet(b"sep=arator,fx\n1,2\n", "t.csv").columns == ("sep=arator", "fx")


def test_a_row_is_told_by_the_line_on_which_it_begins() -> None:
    sheet = read_sheet(b'label,fx\n"two\nlines",1\n\n,\nlast,2\n', "t.csv")
    assert [line for line, _ in sheet.rows] == [2, 6]
    with pytest.raises(InputError, match=r"line 3.*3 cells.*2 columns"):
        read_sheet(b"label,fx\na,1\nb,2,3\n", "t.csv")


def test_empty_cells_beyond_the_columns_are_no_cells() -> None:
    assert read_sheet(b"label,fx\na,1,,\n", "t.csv").rows == ((2, {"label": "a", "fx": "1"}),)


@pytest.mark.parametrize("data", [b"", b"\n", b",,\n1,2,3\n", b"fx,label,fx\n", b"a\0b\n"])
def test_what_has_no_columns_or_one_twice_or_is_no_text_is_refused(data: bytes) -> None:
    with pytest.raises(InputError, match=r"t\.csv"):
        read_sheet(data, "t.csv")


@pytest.mark.parametrize(
    ("encoding", "named"),
    [("utf-8", "utf-8-sig"), ("utf-8-sig", "utf-8-sig"), ("cp1252", "cp1252"), ("utf-16", "utf-16")],
)
def test_the_encodings_of_excel_are_told_apart(encoding: str, named: str) -> None:
    sheet = read_sheet("Gerät\nSüd\n".encode(encoding), "t.csv")
    assert (sheet.columns, sheet.rows, sheet.encoding) == (("Gerät",), ((2, {"Gerät": "Süd"}),), named)


@pytest.mark.parametrize("cell", ["=1+1", "+1", "-1", "@x", "'", "'=1", "a,b;c", 'a "b"', "two\nlines"])
def test_a_cell_that_was_written_is_read_as_it_was_and_is_no_formula(cell: str) -> None:
    text = csv_text(("label",), [(cell,)])
    [(_, row)] = read_sheet(text.encode(), "t.csv").rows
    assert row == {"label": cell}
    assert not text.splitlines()[1].strip('"').startswith(("=", "+", "-", "@"))


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("P4R", " P4R ", True),
        ("P4R", "P4S", False),
        ("3661.250", "3661,25", True),
        ("-1e-17", "-0.00000000000000001", True),
        ("0.3", "0.30000000000000004", True),
        ("3661.25", "3661.2500001", False),
        ("1e-14", "2e-14", False),
        ("0", "1e-300", False),
        ("1", "x", False),
    ],
)
def test_cells_are_the_same_number_when_a_spreadsheet_would_write_either(
    one: str, other: str, *, same: bool
) -> None:
    assert same_number(one, other) is same
