"""What a page is made of: records that hold text, numbers already put into words, and plots."""

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
    """What a badge or a note means; each has its own shape, for those who see no colour."""

    GOOD = "good"
    CAUTION = "caution"
    BAD = "bad"
    NEUTRAL = "neutral"


class Badge(Struct, frozen=True):
    """One word of judgement: its shape and colour say the same once more."""

    kind: ClassVar[str] = "badge"

    text: str
    tone: Tone = Tone.NEUTRAL


class Link(Struct, frozen=True):
    """A way to another place of the page, or to a page or file beside it.

    Attributes:
        text: what is said of it; no two links of a page that lead elsewhere say the same.
        target: "#anchor", or a relative address.

    Raises:
        InputError: the target is an address in the network, or a script.
    """

    kind: ClassVar[str] = "link"

    text: str
    target: str

    def __post_init__(self) -> None:
        # A scheme, or the two slashes that stand for "the same scheme, another host".
        if re.match(r"[^/?#]*:|[/\\]{2}", self.target.strip()) or not self.target.isprintable():
            raise InputError(
                f"a page links to {self.target!r:.80}, expected a relative address or an #anchor"
            )


Cell: TypeAlias = str | Badge | Link


class Column(Struct, frozen=True):
    """A column of a table.

    Attributes:
        title: with the unit, where all its cells have one: "fx (px)".
        numeric: its cells are numbers and stand flush right.
    """

    title: str
    numeric: bool = False


class Table(Struct, frozen=True, kw_only=True):
    """Rows under column heads; what is wider than the screen scrolls in its own box.

    Attributes:
        caption: what the rows are.
        columns: their heads; the cells of the first name their rows.
        rows: as many cells each as there are columns.

    Raises:
        InputError: a row has not as many cells as there are columns.
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
        svg: the drawing; see :mod:`calibrary.pages.plots`. What is not a drawing in it is dropped.
        alt: what it shows, for those who do not see it: the kind of plot, its range, what stands out.
        caption: what to look for in it.
    """

    kind: ClassVar[str] = "figure"

    svg: str
    alt: str
    caption: str


class KeyValues(Struct, frozen=True):
    """Names and what they are: ("fx", "3657.02 px")."""

    kind: ClassVar[str] = "keyvalues"

    items: tuple[tuple[str, Cell], ...]


class Bullets(Struct, frozen=True):
    """A list of sentences."""

    kind: ClassVar[str] = "bullets"

    items: tuple[Cell, ...]


class Note(Struct, frozen=True, kw_only=True):
    """What must not be missed: why, and what to do.

    Attributes:
        text: what is the matter.
        action: the next step, None when there is none.
        tone: how bad it is.
    """

    kind: ClassVar[str] = "note"

    text: str
    action: str | None = None
    tone: Tone = Tone.NEUTRAL


class Code(Struct, frozen=True, kw_only=True):
    """Text for a machine, in its own box: a command, a file.

    Attributes:
        text: line breaks in it are kept.
        label: what it is, for those who hear the page.
    """

    kind: ClassVar[str] = "code"

    text: str
    label: str


class Details(Struct, frozen=True, kw_only=True):
    """What only some want to see, behind its summary; paper shows it too."""

    kind: ClassVar[str] = "details"

    summary: str
    blocks: tuple[Block, ...]


class SideBySide(Struct, frozen=True):
    """Blocks in columns where the screen is wide enough, one below the other where it is not."""

    kind: ClassVar[str] = "side"

    blocks: tuple[Block, ...]


class Section(Struct, frozen=True, kw_only=True):
    """A part of a page with a heading of its own.

    Attributes:
        title: of the heading; sections within sections get lower headings.
        blocks: a string is a paragraph.
        badge: beside the heading.
        anchor: how links name it; None for a number.
        printed: whether it is on the one-page print; a reader may ask for the whole page.
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
        title: of the page, and of the window.
        lead: what the page comes to, in a sentence or two.
        sections: its parts.
        badge: the verdict, beside the title.
        facts: what the page is of, below the lead: job, folder, date, operator.
        made_by: what made the page, and from what, at its foot.
        contents: whether a list of three parts or more stands above them; a page may have its own.
        refresh_s: seconds after which a browser reads the page again; None for a page that stays as it is.
    """

    title: str
    lead: str
    sections: tuple[Section, ...]
    badge: Badge | None = None
    facts: tuple[tuple[str, Cell], ...] = ()
    made_by: str
    contents: bool = True
    refresh_s: int | None = None
