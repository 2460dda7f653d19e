"""What a result shows, said once: sentences, tables, values and plots, for every medium.

:func:`told` of a job's result gives a :class:`View`. A page shows all of it, a terminal what does not fold; a notebook
and a log show the same columns in the same order. Text is text: each renderer escapes it, limits it and spells out
direction overrides, so that text from files and tags can be passed unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from importlib import import_module
from typing import Any, ClassVar, Final, Self, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError

SENTENCE: Final = 40
"""Characters from which a cell of a table is shown as a sentence."""
PHONE, GAP = 46, 2
"""Characters that a row of a table has room for on a phone, and those between two columns."""
MOST_STACKED: Final = 12
"""Columns of a row that is read as a list; a list of a whole registry is searched, and shows its first columns."""


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


def text_of(cell: Cell) -> str:
    """The words of a cell."""
    return cell if isinstance(cell, str) else cell.text


class Column(Struct, frozen=True):
    """A column of a table.

    Attributes:
        title: with the unit, if all cells have the same one: "fx (px)".
        cell: makes the cell of a row's subject, for :meth:`Table.of`.
        numeric: whether the cells are numbers, aligned right.
        rank: in a terminal, 0 stays in the row at every width; of the others the highest is moved below it first.
        below: in a terminal, the sign before its sentences, which stand below the row at every width; None if they
            stand in it.
    """

    title: str
    cell: Callable[[Any], Cell] | None = None
    numeric: bool = False
    rank: int = 0
    below: str | None = None


class Table(Struct, frozen=True, kw_only=True):
    """A table; a phone shows the rows of a wide one as lists, and what is still too wide scrolls horizontally.

    Attributes:
        caption: what the rows are.
        columns: column heads; the cells of the first column name their rows.
        rows: one cell per column in each row; empty where nothing is to be said.

    Raises:
        InputError: the number of cells in a row differs from the number of columns.
    """

    kind: ClassVar[str] = "table"

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]

    @classmethod
    def of(cls, caption: str, subjects: Iterable[object], columns: Sequence[Column]) -> Self:
        """A table with a row for each subject; a column in which no subject has anything is left out."""
        rows = [
            [one.cell(subject) if one.cell is not None else "" for one in columns] for subject in subjects
        ]
        kept = [i for i in range(len(columns)) if any(row[i] for row in rows)]
        return cls(
            caption=caption,
            columns=tuple(columns[i] for i in kept),
            rows=tuple(tuple(row[i] for i in kept) for row in rows),
        )

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(
                    f"the table {self.caption!r:.60} has {len(self.columns)} columns and a row of {len(row)} cells"
                )

    @property
    def stacks(self) -> bool:
        """Whether a phone shows each row as a list, so that nothing is cut off: of sentences, or of wide rows."""
        if any(isinstance(cell, str) and len(cell) > SENTENCE for row in self.rows for cell in row[1:]):
            return True
        told = [
            [column.title, *map(text_of, cells)]
            for column, *cells in zip(self.columns, *self.rows, strict=True)
        ]
        wide = sum(GAP + max(map(len, texts)) for texts in told)
        return wide > PHONE and len(self.columns) <= MOST_STACKED


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


class Plots(Struct, frozen=True):
    """Plots that stand side by side; drawn where they are shown, which a terminal does not do."""

    kind: ClassVar[str] = "plots"

    draw: Callable[[], Iterable[Figure]]


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


class Field(Struct, frozen=True, kw_only=True):
    """One input of a form.

    Attributes:
        name: under which it is sent.
        label: what is asked for.
        type: of the HTML input: text, date, file, checkbox, hidden, password.
        value: as it is at first; of a checkbox, what is sent if it is ticked.
        hint: a sentence below the label.
        required: whether the form is not sent without it.
        several: of a file, whether there may be several.
        choices: (value, text) of each choice, in place of an input.
    """

    name: str
    label: str = ""
    type: str = "text"
    value: str = ""
    hint: str = ""
    required: bool = False
    several: bool = False
    choices: tuple[tuple[str, str], ...] = ()


class Form(Struct, frozen=True, kw_only=True):
    """A form of a page that a server gives; a page that is a file has none.

    Attributes:
        to: address that it is sent to.
        button: what the button does.
        fields: its inputs.
        is_question: whether it only asks, so that its answer has an address that can be sent on.
        drops: address that dropped files are read by, where the page's script reads them; None if they are sent whole.
        is_aside: whether it is not what the page is for; of the others the first has the page's one strong button.
    """

    kind: ClassVar[str] = "form"

    to: str
    button: str
    fields: tuple[Field, ...] = ()
    is_question: bool = False
    drops: str | None = None
    is_aside: bool = False


class Running(Struct, frozen=True, kw_only=True):
    """Progress of work on a server, which the page's script asks for until it is over.

    Attributes:
        state: address of the progress.
        done, total: how far it is; a total of 0 is unknown.
        what: what is counted.
    """

    kind: ClassVar[str] = "running"

    state: str
    done: int
    total: int
    what: str


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
        printed: whether it is the answer, which a terminal shows and one sheet of paper holds; the rest is shown on
            the page, and where a reader asks for all of it.
    """

    kind: ClassVar[str] = "section"

    title: str
    blocks: tuple[Block, ...]
    badge: Badge | None = None
    anchor: str | None = None
    printed: bool = True


Block: TypeAlias = (
    str
    | Badge
    | Link
    | Table
    | Figure
    | Plots
    | KeyValues
    | Bullets
    | Note
    | Code
    | Details
    | SideBySide
    | Section
    | Form
    | Running
)


class View(Struct, frozen=True, kw_only=True):
    """All that a result shows.

    Attributes:
        title: title of the page and of the browser window.
        lead: the result in one or two sentences; the last line in a terminal.
        sections: the parts of it, what needs attention first.
        badge: the verdict, next to the title.
        facts: what the page is about, below the lead: folder, days, date.
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


def view_of(result: object, package: str | None = None, **how: Any) -> View:
    """Describe a job's result by ``told``, which stands in the package of the result's record, or in the one named."""
    package = package or type(result).__module__.rpartition(".")[0]
    view: View = import_module(f"{package}.told").told(result, **how)
    return view
