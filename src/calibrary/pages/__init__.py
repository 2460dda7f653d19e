"""HTML pages: a common style, no scripts by default, nothing loaded from the network.

A page consists of records; :func:`render_page` makes one HTML file from them. It escapes all text, limits its
length and spells out direction overrides, so text from files and tags can be passed unchanged. Each plot of
:mod:`calibrary.pages.plots` is a :class:`Figure`::

    from calibrary.pages import Badge, Column, KeyValues, Note, Page, Section, Table, Tone, render_page
    from calibrary.pages.plots import Axis, bars

    rms = Axis("rms reprojection error", "px")
    views = bars(values, labels=names, axis=rms, limit=0.5, caption="Views above the line were left out.")
    K = KeyValues((("fx", "3657.02 ± 0.40 px"), ("fy", "3650.44 ± 0.40 px")))
    table = Table(caption="Rules", columns=(Column("rule"), Column("found", numeric=True)), rows=(("tilt", "6°"),))
    note = Note(text="normals spread 6°", action="tilt the board by 20°", tone=Tone.BAD)
    parts = (Section(title="Verdict", blocks=(note, K, table)), Section(title="Views", blocks=(views,)))
    page = Page(title="Calibration of …", lead="…", sections=parts, made_by="…", badge=Badge("refused", Tone.BAD))
    html = render_page(page)
"""

from __future__ import annotations

import base64
import hashlib
import re
from enum import StrEnum
from functools import cache
from importlib import resources
from pathlib import Path
from typing import ClassVar, Final, TypeAlias

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError
from calibrary.extras import PAGES, require
from calibrary.pages.palette import style_rules

__all__ = [
    "Badge",
    "Block",
    "Bullets",
    "Cell",
    "Code",
    "Column",
    "Details",
    "Field",
    "Figure",
    "Form",
    "Frame",
    "KeyValues",
    "Link",
    "Note",
    "Page",
    "Running",
    "Section",
    "SideBySide",
    "Table",
    "Tone",
    "check_page_place",
    "render_page",
    "served_policy",
    "write_page",
]


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


def _text(cell: Cell) -> str:
    return cell if isinstance(cell, str) else cell.text


class Column(Struct, frozen=True):
    """A column of a table.

    Attributes:
        title: with the unit, if all cells have the same one: "fx (px)".
        numeric: whether the cells are numbers, aligned right.
    """

    title: str
    numeric: bool = False


class Table(Struct, frozen=True, kw_only=True):
    """A table; a phone shows the rows of a wide one as lists, and what is still too wide scrolls horizontally.

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

    @property
    def stacks(self) -> bool:
        """Whether a phone shows each row as a list, so that nothing is cut off: of sentences, or of wide rows."""
        if any(isinstance(cell, str) and len(cell) > SENTENCE for row in self.rows for cell in row[1:]):
            return True
        told = [
            [column.title, *map(_text, cells)]
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
    """

    kind: ClassVar[str] = "form"

    to: str
    button: str
    fields: tuple[Field, ...] = ()
    is_question: bool = False
    drops: str | None = None


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
        printed: whether it is in the one-page print; a reader can choose to print the whole page.
    """

    kind: ClassVar[str] = "section"

    title: str
    blocks: tuple[Block, ...]
    badge: Badge | None = None
    anchor: str | None = None
    printed: bool = True


class Frame(Struct, frozen=True, kw_only=True):
    """What a server puts around each of its pages.

    Attributes:
        ways: the pages that every page leads to.
        script: address of the script of all pages.
        token: proof in each form that it is from a page of this server.
    """

    ways: tuple[Link, ...]
    script: str
    token: str


Block: TypeAlias = (
    str
    | Badge
    | Link
    | Table
    | Figure
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


class Page(Struct, frozen=True, kw_only=True):
    """A whole page.

    Attributes:
        title: title of the page and of the browser window.
        lead: the result in one or two sentences.
        sections: the parts of the page.
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


def check_page_place(html: str | Path | None) -> Path | None:
    """Check before any work that a page can be written; returns its path, and None where no page is wanted.

    Raises:
        InputError: the name is not an .html, or its folder is not writable.
        MissingExtraError: the libraries that draw pages are not installed.
    """
    if html is None:
        return None
    require(PAGES, "a page")
    path = Path(html)
    if path.suffix.lower() not in {".html", ".htm"}:
        raise InputError("expected a name that ends in .html", source=str(path), place="--html")
    check_folder(path, place="--html")
    return path


def write_page(path: Path, page: Page) -> None:
    """Render a page and write it atomically.

    Raises:
        InputError: the file cannot be written.
    """
    write_files({path: render_page(page).encode()})


def render_page(page: Page, *, script: str | None = None, frame: Frame | None = None) -> str:
    """Render a page as HTML that loads nothing from the network and runs no script except ``script``.

    As a second barrier, the Content-Security-Policy in its head allows only this style sheet, this script and
    embedded pictures.

    Args:
        page: the content.
        script: JavaScript of calibrary, never from input; the page must also work without it.
        frame: what a server puts around it; the policy is then in the server's headers, by :func:`served_policy`.

    Raises:
        InputError: a figure's drawing is not an SVG.
        MissingExtraError: the libraries that render pages are not installed.
    """
    require(PAGES, "a page")
    from calibrary.pages.template import fill  # noqa: PLC0415  Jinja2, which a plain install leaves out

    style = _style()
    scripts = f" script-src {_digest(script)};" if script is not None else ""
    security = (
        f"default-src 'none'; style-src {_digest(style)};{scripts} img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )
    return fill(page, security=security, style=style, script=script, frame=frame)


def served_policy() -> str:
    """The Content-Security-Policy of a page with a frame: this style sheet, and of its server scripts and answers."""
    return (
        f"default-src 'none'; style-src {_digest(_style())}; script-src 'self'; connect-src 'self'; "
        "img-src 'self' data:; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )


def _digest(text: str) -> str:
    """The hash by which a Content-Security-Policy allows this text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _style() -> str:
    own = resources.files("calibrary.pages").joinpath("style.css").read_text(encoding="utf-8")
    return style_rules() + "\n" + own
