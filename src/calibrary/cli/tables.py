"""Tables that are complete at every terminal width.

Columns that do not fit are moved below their row, least important first, so that nothing is truncated and no
word is broken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

from msgspec import Struct

if TYPE_CHECKING:
    from rich.text import Text

__all__ = ["Column", "facts", "fitted", "single_lines"]

_Cell: TypeAlias = tuple[str, tuple[tuple[int, int, str], ...]]
"""A cell's text, and its styles as (start, end, style)."""

GAP = 2
BELOW = 4
"""Indent of the lines below a row."""

READABLE = 24
"""Width that every column of sentences gets before any of them gets more."""

LONGEST_WORD = 40
"""Longest word that sets the width of a column of sentences; a longer one, such as a hash, does not."""


class Column(Struct, frozen=True, kw_only=True):
    """A column of a table.

    Attributes:
        name: heading, and label below a row.
        rank: 0 stays in the row at every width; of the others the highest is moved first.
        wraps: whether it contains sentences, which may be wrapped between words.
        right: whether it is aligned right, as for numbers.
        style: of its cells.
    """

    name: str
    rank: int = 0
    wraps: bool = False
    right: bool = False
    style: str = ""


def fitted(
    columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int, *, header: bool = True
) -> list[Text]:
    """The lines of a table no wider than ``width``, unless a single word is wider.

    Args:
        columns: of the table, in order.
        rows: cells in rich's markup. A column without any content is omitted.
        width: of the terminal.
        header: whether to print the column names.
    """
    from rich.text import Text

    cells = [[_cell(cell, columns[i].style) for i, cell in enumerate(row)] for row in rows]
    kept = [i for i in range(len(columns)) if any(row[i].plain for row in cells)]
    least = {i: _least(columns[i], [row[i] for row in cells], header=header) for i in kept}
    while sum(least[i] + GAP for i in kept) - GAP > width:
        leaving = max(kept, key=lambda i: (columns[i].rank, i))
        if columns[leaving].rank == 0:
            break
        kept.remove(leaving)
    widths = _shared({i: least[i] for i in kept}, columns, cells, width)
    lines: list[Text] = []
    if header and any(columns[i].name for i in kept):
        lines += _row([Text(columns[i].name, "bold") for i in kept], kept, columns, widths)
    for row in cells:
        beside = [
            row[i] if row[i].cell_len <= widths[i] or _longest(row[i]) <= widths[i] else Text("")
            for i in kept
        ]
        lines += _row(beside, kept, columns, widths)
        shown = {i for i, cell in zip(kept, beside, strict=True) if cell.plain}
        lines += _stacked([(columns[i], row[i]) for i in range(len(columns)) if i not in shown], width)
    return lines


def single_lines(
    columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int
) -> tuple[list[Text], list[str]]:
    """The lines of a table with one line per row, and the names of the columns omitted to achieve this.

    Columns are omitted by descending rank until the table is no wider than ``width``; those of rank 0 are
    always kept, even if the lines become longer than ``width``. Cells are in rich's markup.
    """
    from rich.text import Span, Text

    # For speed with ten thousand rows a line is built as a string and converted to rich's Text once.
    cells = [
        [_with_styles(cell, column.style) for cell, column in zip(row, columns, strict=True)] for row in rows
    ]
    kept = [i for i in range(len(columns)) if any(row[i][0] for row in cells)]
    widths = {i: max(_wide(columns[i].name), *(_wide(row[i][0]) for row in cells)) for i in kept}
    left_out = []
    while sum(widths[i] + GAP for i in kept) - GAP > width:
        leaving = max(kept, key=lambda i: (columns[i].rank, i))
        if columns[leaving].rank == 0:
            break
        kept.remove(leaving)
        left_out.append(columns[leaving].name)
    lines = []
    header: list[_Cell] = [(column.name, ((0, len(column.name), "bold"),)) for column in columns]
    for row in (header, *cells):
        line, spans = "", []
        for i in kept:
            cell, styles = row[i]
            padding = " " * (widths[i] - _wide(cell))
            line += (" " * GAP if i != kept[0] else "") + (padding if columns[i].right else "")
            spans += [Span(len(line) + start, len(line) + end, style) for start, end, style in styles]
            line += cell if columns[i].right else cell + padding
        lines.append(Text(line.rstrip(), spans=spans))
    return lines, left_out


def _with_styles(markup: str, style: str) -> _Cell:
    """A cell's text and styles, parsed from rich's markup."""
    text, styles = _read_markup(markup) if "[" in markup or "\\" in markup else (markup, ())
    return text, ((0, len(text), style), *styles) if style else styles


@lru_cache(maxsize=256)
def _read_markup(markup: str) -> _Cell:
    from rich.text import Text

    text = Text.from_markup(markup, emoji=False)
    return text.plain, tuple((span.start, span.end, str(span.style)) for span in text.spans)


def _wide(text: str) -> int:
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)


def facts(rows: Sequence[tuple[str, str]], width: int) -> list[Text]:
    """The lines of a two-column list of names and values; both are text without markup."""
    from rich.text import Text

    from calibrary.cli.console import folded

    name_width = max((len(name) for name, _ in rows), default=0)
    lines: list[Text] = []
    for name, value in rows:
        indent = len(name) - len(name.lstrip(" "))
        label = Text(name[indent:].ljust(name_width + GAP - indent), "dim")
        hang = name_width + GAP - indent
        lines += folded(label + Text(value), width, indent=indent, hang=hang)
    return lines


def _cell(markup: str, style: str) -> Text:
    from rich.text import Text

    # Parsing markup takes most of the time, and most cells have none.
    has_markup = "[" in markup or "\\" in markup
    return Text.from_markup(markup, style=style, emoji=False) if has_markup else Text(markup, style)


def _longest(cell: Text) -> int:
    from rich.cells import cell_len

    return max((cell_len(word) for word in cell.plain.split()), default=0)


def _least(column: Column, cells: Sequence[Text], *, header: bool) -> int:
    """Minimum width of a column: its longest word, or a readable width for sentences."""
    whole = max(cell.cell_len for cell in cells)
    if column.wraps:
        longest = max((word for word in map(_longest, cells) if word <= LONGEST_WORD), default=0)
        whole = max(longest, min(whole, READABLE))
    return max(whole, len(column.name) if header else 0)


def _shared(
    least: dict[int, int], columns: Sequence[Column], cells: Sequence[Sequence[Text]], width: int
) -> dict[int, int]:
    """Distribute the remaining width to the columns of sentences, to each as much as it can use."""
    widths = dict(least)
    left = width - sum(widths.values()) - GAP * (len(widths) - 1)
    wanting = [i for i in widths if columns[i].wraps]
    for at, i in enumerate(wanting):
        natural = max(row[i].cell_len for row in cells)
        more = min(max(0, left // (len(wanting) - at)), max(0, natural - widths[i]))
        widths[i] += more
        left -= more
    return widths


def _row(
    cells: Sequence[Text], kept: Sequence[int], columns: Sequence[Column], widths: dict[int, int]
) -> Iterator[Text]:
    """The lines of one row, as many as its longest wrapped cell needs."""
    from itertools import zip_longest

    from rich.text import Text

    from calibrary.cli.console import folded

    folds = [
        list(folded(cell, widths[i], hang=0)) if columns[i].wraps and cell.cell_len > widths[i] else [cell]
        for i, cell in zip(kept, cells, strict=True)
    ]
    for parts in zip_longest(*folds):
        line, at = Text(), 0
        for i, part in zip(kept, parts, strict=True):
            cell = part if part is not None else Text()
            lead = max(0, widths[i] - cell.cell_len) if columns[i].right else 0
            if cell.plain:
                line.append(" " * max(0, at + lead - line.cell_len)).append_text(cell)
            at = max(at + widths[i], line.cell_len) + GAP
        yield line


def _stacked(cells: Sequence[tuple[Column, Text]], width: int) -> Iterator[Text]:
    """The cells moved below the row: as many on a line as fit, longer ones on their own lines."""
    from rich.text import Text

    line = Text()
    for column, cell in cells:
        if not cell.plain:
            continue
        item = Text.assemble((f"{column.name} ", "dim"), cell) if column.name else cell
        if line and BELOW + line.cell_len + GAP + item.cell_len > width:
            yield from _below(line, width)
            line = Text()
        line = line.append(" " * GAP).append_text(item) if line else item.copy()
    if line:
        yield from _below(line, width)


def _below(line: Text, width: int) -> Iterator[Text]:
    from calibrary.cli.console import folded

    if BELOW + line.cell_len <= width:
        line.pad_left(BELOW)
        yield line
    else:
        yield from folded(line, width, indent=BELOW)
