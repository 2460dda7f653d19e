"""The parts of a page: records with text, formatted numbers and plots."""

from __future__ import annotations

import re
from enum import StrEnum
from typing import ClassVar, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError

__all__ = [
    "Badge",
    "Block",
    "Bullets",
    "Cell",
    "Code",
    "Column",
    "Details",
    "Figure",
    "KeyValues",
    "Link",
    "Note",
    "Page",
    "Section",
    "SideBySide",
    "Table",
    "Tone",
]


class Tone(StrEnum):
    """Meaning of a badge or note; each tone has its own shape for readers who cannot distinguish colours."""

    GOOD = "good"
    CAUTION = "caution"
    BAD = "bad"
    NEUTRAL = "neutral"


class Badge(Struct, frozen=True):
    """A verdict in one word; shape and colour repeat it."""

    kind: ClassVar[str] = "badge"

    text: str
    tone: Tone = Tone.NEUTRAL


class Link(Struct, frozen=True):
    """A link within the page, or to a page or file next to it.

    Attributes:
        text: link text; links of a page with different targets have different texts.
        target: "#anchor", or a relative address.

    Raises:
        InputError: the target is a network address or a script.
    """

    kind: ClassVar[str] = "link"

    text: str
    target: str

    def __post_init__(self) -> None:
        # A scheme, or the two slashes that mean "same scheme, another host".
        if re.match(r"[^/?#]*:|[/\\]{2}", self.target.strip()) or not self.target.isprintable():
            raise InputError(
                f"a page links to {self.target!r:.80}, expected a relative address or an #anchor"
            )


Cell: TypeAlias = str | Badge | Link


class Column(Struct, frozen=True):
    """A column of a table.

    Attributes:
        title: with the unit, if all cells have the same one: "fx (px)".
        numeric: whether the cells are numbers, aligned right.
    """

    title: str
    numeric: bool = False


class Table(Struct, frozen=True, kw_only=True):
    """A table; if it is wider than the screen, it scrolls horizontally.

    To add a column to a page, add its :class:`Column` and its cell, in the same order; both stand in the page's module.

    Attributes:
        caption: what the rows are.
        columns: column heads; the cells of the first column name their rows.
        rows: one cell per column in each row.

    Raises:
        InputError: the number of cells in a row differs from the number of columns.
    """

    kind: ClassVar[str] = "table"

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(
                    f"the table {self.caption!r:.60} has {len(self.columns)} columns and a row of {len(row)} cells"
                )


class Figure(Struct, frozen=True, kw_only=True):
    """A plot.

    Attributes:
        svg: the drawing; see :mod:`calibrary.pages.plots`. Elements that are not graphics are removed.
        alt: text alternative for screen readers: kind of plot, range, notable values.
        caption: what to look for.
    """

    kind: ClassVar[str] = "figure"

    svg: str
    alt: str
    caption: str


class KeyValues(Struct, frozen=True):
    """List of names with their values: ("fx", "3657.02 px")."""

    kind: ClassVar[str] = "keyvalues"

    items: tuple[tuple[str, Cell], ...]


class Bullets(Struct, frozen=True):
    """A list of sentences."""

    kind: ClassVar[str] = "bullets"

    items: tuple[Cell, ...]


class Note(Struct, frozen=True, kw_only=True):
    """A highlighted note: the problem and what to do.

    Attributes:
        text: the problem.
        action: the next step, None if there is none.
        tone: how serious it is.
    """

    kind: ClassVar[str] = "note"

    text: str
    action: str | None = None
    tone: Tone = Tone.NEUTRAL


class Code(Struct, frozen=True, kw_only=True):
    """A block of code: a command, a file.

    Attributes:
        text: line breaks are kept.
        label: what it is, for screen readers.
    """

    kind: ClassVar[str] = "code"

    text: str
    label: str


class Details(Struct, frozen=True, kw_only=True):
    """Blocks that are collapsed behind a summary; printed in full."""

    kind: ClassVar[str] = "details"

    summary: str
    blocks: tuple[Block, ...]


class SideBySide(Struct, frozen=True):
    """Blocks in columns if the screen is wide enough, otherwise one below the other."""

    kind: ClassVar[str] = "side"

    blocks: tuple[Block, ...]


class Section(Struct, frozen=True, kw_only=True):
    """A part of a page with its own heading.

    Attributes:
        title: text of the heading; nested sections get lower heading levels.
        blocks: the content; a string is a paragraph.
        badge: next to the heading.
        anchor: name that links use; None for a generated number.
        printed: whether it is in the one-page print; a reader can choose to print the whole page.
    """

    kind: ClassVar[str] = "section"

    title: str
    blocks: tuple[Block, ...]
    badge: Badge | None = None
    anchor: str | None = None
    printed: bool = True


Block: TypeAlias = (
    str | Badge | Link | Table | Figure | KeyValues | Bullets | Note | Code | Details | SideBySide | Section
)


class Page(Struct, frozen=True, kw_only=True):
    """A whole page.

    Attributes:
        title: title of the page and of the browser window.
        lead: the result in one or two sentences.
        sections: the parts of the page.
        badge: the verdict, next to the title.
        facts: what the page is about, below the lead: job, folder, date, operator.
        made_by: footer: the program that made the page, and its source.
        contents: whether a table of contents precedes three sections or more; False if the page has its own.
        refresh_s: seconds after which a browser reloads the page; None for a page that does not change.
    """

    title: str
    lead: str
    sections: tuple[Section, ...]
    badge: Badge | None = None
    facts: tuple[tuple[str, Cell], ...] = ()
    made_by: str
    contents: bool = True
    refresh_s: int | None = None
