"""Tables that are complete at every terminal width.

Columns that do not fit are moved below their row, least important first, so that nothing is truncated and no
word is broken.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, NamedTuple

from msgspec import Struct

from calibrary.cli.words import Words, printable

if TYPE_CHECKING:
    from rich.text import Text

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
        below: whether its sentences stand below the row at every width, each on its own lines; the columns of such a
            table that do not fit are left out, so that a row takes one line without a sentence.
    """

    name: str
    rank: int = 0
    wraps: bool = False
    right: bool = False
    style: str = ""
    below: bool = False


class _Cell(NamedTuple):
    """A cell, or a line of cells. For speed with ten thousand rows only whole lines become rich's Text.

    Attributes:
        text: without markup.
        styles: as (start, end, style).
    """

    text: str = ""
    styles: tuple[tuple[int, int, str], ...] = ()

    @property
    def wide(self) -> int:
        """Width in a terminal's columns."""
        return _wide(self.text)

    def part(self, start: int, end: int) -> _Cell:
        """The text from ``start`` to before ``end``."""
        kept = ((max(a, start) - start, min(b, end) - start, style) for a, b, style in self.styles)
        return _Cell(self.text[start:end], tuple((a, b, style) for a, b, style in kept if a < b))

    def line(self) -> Text:
        """It as what rich prints."""
        from rich.text import Span, Text

        return Text(self.text, spans=[Span(*one) for one in self.styles])


_EMPTY = _Cell()


def fitted(
    columns: Sequence[Column], rows: Sequence[Sequence[Words]], width: int, *, header: bool = True
) -> list[Text]:
    """The lines of a table no wider than ``width``, unless a single word is wider.

    Args:
        columns: of the table, in order.
        rows: cells. A column without any content is omitted.
        width: of the terminal.
        header: whether to print the column names.
    """
    cells = [[_cell(cell, columns[i].style) for i, cell in enumerate(row)] for row in rows]
    kept = [i for i in range(len(columns)) if not columns[i].below and any(row[i].text for row in cells)]
    least = {i: _least(columns[i], [row[i] for row in cells], header=header) for i in kept}
    left_out = set[int]()
    while sum(least[i] + GAP for i in kept) - GAP > width:
        leaving = max(kept, key=lambda i: (columns[i].rank, i))
        if columns[leaving].rank == 0:
            break
        kept.remove(leaving)
        left_out.add(leaving)
    if not any(column.below for column in columns):
        left_out.clear()
    widths = _shared({i: least[i] for i in kept}, columns, cells, width)
    lines: list[_Cell] = []
    if header and any(columns[i].name for i in kept):
        lines += _row([_styled(columns[i].name, "bold") for i in kept], kept, columns, widths)
    for row in cells:
        beside = [
            row[i] if row[i].wide <= widths[i] or _longest(row[i]) <= widths[i] else _EMPTY for i in kept
        ]
        lines += _row(beside, kept, columns, widths)
        shown = left_out | {i for i, cell in zip(kept, beside, strict=True) if cell.text}
        lines += _stacked([(columns[i], row[i]) for i in range(len(columns)) if i not in shown], width)
    return [line.line() for line in lines]


def single_lines(
    columns: Sequence[Column], rows: Sequence[Sequence[Words]], width: int, *, styled: bool = True
) -> tuple[Sequence[Text | str], list[str]]:
    """The lines of a table with one line per row, and the names of the columns omitted to achieve this.

    Columns are omitted by descending rank until the table is no wider than ``width``; those of rank 0 are
    always kept, even if the lines become longer than ``width``. Without ``styled``, lines are plain text, which takes a
    hundred thousand rows a tenth of the time.
    """
    every = [[row[i] for row in rows] for i in range(len(columns))]
    texts = [[column.name, *map(_text, cells)] for column, cells in zip(columns, every, strict=True)]
    kept = [i for i in range(len(columns)) if any(texts[i][1:])]
    if not kept:
        return [""] * (1 + len(rows)), []
    widths = {i: max(map(len if "".join(texts[i]).isascii() else _wide, texts[i])) for i in kept}
    left_out = []
    while sum(widths[i] + GAP for i in kept) - GAP > width:
        leaving = max(kept, key=lambda i: (columns[i].rank, i))
        if columns[leaving].rank == 0:
            break
        kept.remove(leaving)
        left_out.append(columns[leaving].name)
    if not styled:
        padded = (_padded(texts[i], widths[i], right=columns[i].right) for i in kept)
        return [*map(str.rstrip, map((" " * GAP).join, zip(*padded, strict=True)))], left_out
    cells = (
        [_styled(columns[i].name, "bold"), *(_cell(one, columns[i].style) for one in every[i])] for i in kept
    )
    lines = (_one_line(row, kept, columns, widths) for row in zip(*cells, strict=True))
    return [line.part(0, len(line.text.rstrip())).line() for line in lines], left_out


def _text(cell: Words) -> str:
    return printable(cell if isinstance(cell, str) else cell[0])


def _padded(texts: Sequence[str], width: int, *, right: bool) -> Iterable[str]:
    if "".join(texts).isascii():
        return (text.rjust(width) for text in texts) if right else (text.ljust(width) for text in texts)
    spaces = [" " * (width - _wide(text)) for text in texts]
    return map("".join, zip(spaces, texts, strict=True) if right else zip(texts, spaces, strict=True))


def _wide(text: str) -> int:
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)


def facts(rows: Sequence[tuple[str, str]], width: int) -> list[Text]:
    """The lines of a two-column list of names and values."""
    from rich.text import Text

    from calibrary.cli.console import folded

    name_width = max((len(name) for name, _ in rows), default=0)
    lines: list[Text] = []
    for name, value in rows:
        indent = len(name) - len(name.lstrip(" "))
        label = Text(name[indent:].ljust(name_width + GAP - indent), "dim")
        hang = name_width + GAP - indent
        lines += folded(label + Text(printable(value)), width, indent=indent, hang=hang)
    return lines


def _cell(words: Words, style: str) -> _Cell:
    """A cell with its own style within that of its column."""
    if isinstance(words, str):
        return _styled(printable(words), style)
    text = printable(words[0])
    return _Cell(text, tuple((0, len(text), one) for one in (style, words[1]) if one and text))


def _styled(text: str, style: str) -> _Cell:
    return _Cell(text, ((0, len(text), style),) if style and text else ())


def _joined(parts: Iterable[_Cell]) -> _Cell:
    text, styles = "", []
    for part in parts:
        if part.styles:
            at = len(text)
            styles += [(at + start, at + end, style) for start, end, style in part.styles]
        text += part.text
    return _Cell(text, tuple(styles))


def _longest(cell: _Cell) -> int:
    return max(map(_wide, cell.text.split()), default=0)


def _least(column: Column, cells: Sequence[_Cell], *, header: bool) -> int:
    """Minimum width of a column: its longest word, or a readable width for sentences."""
    whole = max(cell.wide for cell in cells)
    if column.wraps:
        longest = max((word for word in map(_longest, cells) if word <= LONGEST_WORD), default=0)
        whole = max(longest, min(whole, READABLE))
    return max(whole, len(column.name) if header else 0)


def _shared(
    least: dict[int, int], columns: Sequence[Column], cells: Sequence[Sequence[_Cell]], width: int
) -> dict[int, int]:
    """Distribute the remaining width to the columns of sentences, to each as much as it can use."""
    widths = dict(least)
    left = width - sum(widths.values()) - GAP * (len(widths) - 1)
    wanting = [i for i in widths if columns[i].wraps]
    for at, i in enumerate(wanting):
        natural = max(row[i].wide for row in cells)
        more = min(max(0, left // (len(wanting) - at)), max(0, natural - widths[i]))
        widths[i] += more
        left -= more
    return widths


def _row(
    cells: Sequence[_Cell], kept: Sequence[int], columns: Sequence[Column], widths: dict[int, int]
) -> Iterator[_Cell]:
    """The lines of one row, as many as its longest wrapped cell needs; none if every column has moved below."""
    folds = [
        # Columns that do not wrap are as wide as their widest cell.
        list(_folded(cell, widths[i], hang=0)) if cell.wide > widths[i] else [cell]
        for i, cell in zip(kept, cells, strict=True)
    ]
    for parts in zip_longest(*folds, fillvalue=_EMPTY):
        yield _one_line(parts, kept, columns, widths)


def _one_line(
    cells: Sequence[_Cell], kept: Sequence[int], columns: Sequence[Column], widths: dict[int, int]
) -> _Cell:
    """One line, without the space that its last cell leaves."""
    parts: list[_Cell] = []
    wide = at = 0
    for i, cell in zip(kept, cells, strict=True):
        if cell.text:
            own = cell.wide
            lead = max(0, widths[i] - own) if columns[i].right else 0
            space = max(0, at + lead - wide)
            parts += (_Cell(" " * space), cell)
            wide += space + own
        at = max(at + widths[i], wide) + GAP
    return _joined(parts)


def _stacked(cells: Sequence[tuple[Column, _Cell]], width: int) -> Iterator[_Cell]:
    """The cells moved below the row: as many on a line as fit, longer ones on their own lines."""
    line: list[_Cell] = []
    wide = 0
    for column, cell in cells:
        if not cell.text:
            continue
        if column.below:
            if line:
                yield from _below(_joined(line), width)
                line, wide = [], 0
            yield from _below(cell, width)
            continue
        item = _joined([_styled(f"{column.name} ", "dim"), cell]) if column.name else cell
        own = item.wide
        if line and BELOW + wide + GAP + own > width:
            yield from _below(_joined(line), width)
            line, wide = [], 0
        if line:
            line.append(_Cell(" " * GAP))
            wide += GAP
        line.append(item)
        wide += own
    if line:
        yield from _below(_joined(line), width)


def _below(line: _Cell, width: int) -> Iterator[_Cell]:
    if BELOW + line.wide <= width:
        yield _joined([_Cell(" " * BELOW), line])
    else:
        yield from _folded(line, width, indent=BELOW)


def _folded(cell: _Cell, width: int, *, indent: int = 0, hang: int = 2) -> Iterator[_Cell]:
    """As :func:`calibrary.cli.console.folded`."""
    from calibrary.cli.console import cuts

    led = len(cell.text) - len(cell.text.lstrip(" "))
    text, indent = cell.text[led:], indent + led
    room = max(1, width - indent)
    for number, (start, end) in enumerate(cuts(text, room, max(1, room - hang))):
        stop = led + start + len(text[start:end].rstrip())
        yield _joined([_Cell(" " * (indent + (hang if number else 0))), cell.part(led + start, stop)])
