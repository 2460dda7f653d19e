"""What a result shows, in a terminal: the same columns, words and order as on its page, without the plots.

What is not the answer itself, and what a page folds, is shown where all is asked for. The verdict comes last, nearest
to the prompt.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from rich.text import Text

from calibrary.cli.console import Screen
from calibrary.cli.tables import Column, facts, fitted
from calibrary.cli.words import Words, printable
from calibrary.view import (
    SENTENCE,
    Badge,
    Block,
    Bullets,
    Cell,
    Code,
    Details,
    Figure,
    Form,
    KeyValues,
    Link,
    Note,
    Plots,
    Running,
    Section,
    SideBySide,
    Table,
    Tone,
    View,
    text_of,
)

STYLES: Final = {
    Tone.GOOD: "bold green",
    Tone.CAUTION: "bold yellow",
    Tone.BAD: "bold red",
    Tone.NEUTRAL: "bold",
}
INDENT: Final = 2
WIDEST: Final = 110
"""Widest line; longer lines of text are hard to read."""
MOST_ITEMS: Final = 12
"""Most items of a list of sentences."""


def show(screen: Screen, view: View, *, whole: bool = False) -> None:
    """Show a view, the answer last.

    Args:
        screen: of the results.
        view: what is to be shown.
        whole: also what is not the answer itself, and what a page folds.
    """
    if screen.quiet:
        return
    shown = _Shown(screen, whole=whole)
    for number, section in enumerate(one for one in view.sections if shown.shows(one)):
        if number or section.badge is not None:
            shown.heading(section, 0)
        shown.blocks(section.blocks, 0)
    if shown.has_begun:
        screen.say("")
    screen.say(view.lead, style=STYLES[view.badge.tone] if view.badge is not None else "bold")


class _Shown:
    """A view on a screen; arguments as of :func:`show`."""

    def __init__(self, screen: Screen, *, whole: bool) -> None:
        self._screen, self._whole = screen, whole
        self.has_begun = False

    def shows(self, block: Block) -> bool:
        """Whether anything of a block is shown; a browser alone shows plots and forms, and follows links."""
        match block:
            case Section():
                return (block.printed or self._whole) and any(map(self.shows, block.blocks))
            case Details():
                return self._whole
            case _:
                return not isinstance(block, Plots | Figure | Link | Form | Running)

    def heading(self, section: Section, indent: int) -> None:
        """Show the heading of a section."""
        badge = ("  ", _cell(section.badge)) if section.badge is not None else ()
        if self.has_begun:
            self._screen.say("")
        self.has_begun = True
        self._screen.say((section.title, "bold"), *badge, indent=indent)

    def blocks(self, blocks: Iterable[Block], indent: int) -> None:
        """Show blocks."""
        for block in filter(self.shows, blocks):
            self.has_begun = self.has_begun or not isinstance(block, Section | SideBySide)
            match block:
                case SideBySide():
                    self.blocks(block.blocks, indent)
                case Section():
                    self.heading(block, indent)
                    self.blocks(block.blocks, indent + INDENT)
                case Details():
                    self._screen.say((block.summary, "dim"), indent=indent)
                    self.blocks(block.blocks, indent + INDENT)
                case str() | Badge() | Note() | Bullets():
                    for line in _sentences(block):
                        self._screen.say(line, indent=indent)
                case Table() | KeyValues() | Code():
                    self._lines(block, indent)

    def _lines(self, block: Table | KeyValues | Code, indent: int) -> None:
        screen, width = self._screen, self._screen.at_most(WIDEST) - indent
        match block:
            case Table():
                if self._whole:
                    screen.say((block.caption, "dim"), indent=indent)
                screen.show(_table(block, width), indent=indent)
            case KeyValues():
                rows = [(name, text_of(cell)) for name, cell in block.items]
                screen.show(facts(rows, width), indent=indent)
            case Code():
                for line in block.text.splitlines():
                    screen.verbatim(f"{' ' * (indent + INDENT)}{printable(line)}", style="dim")


def _sentences(block: str | Badge | Note | Bullets) -> Iterator[Words]:
    """The lines of a block."""
    match block:
        case Note():
            yield block.text, STYLES[block.tone].removeprefix("bold ")
            if block.action is not None:
                yield f"→ {block.action}", "bold"
        case Bullets():
            yield from (f"- {text_of(item)}" for item in block.items[:MOST_ITEMS])
            if (more := len(block.items) - MOST_ITEMS) > 0:
                yield f"- … and {more} more"
        case _:
            yield _cell(block)


def _table(table: Table, width: int) -> list[Text]:
    columns = [
        Column(
            name=one.title,
            rank=one.rank,
            wraps=not one.numeric and any(len(text_of(row[at])) > SENTENCE for row in table.rows),
            right=one.numeric,
            below=one.below is not None,
        )
        for at, one in enumerate(table.columns)
    ]
    rows = [
        [
            f"{one.below}{text_of(cell)}" if one.below and cell else _cell(cell)
            for one, cell in zip(table.columns, row, strict=True)
        ]
        for row in table.rows
    ]
    return fitted(columns, rows, width)


def _cell(cell: Cell) -> Words:
    if isinstance(cell, Badge):
        return cell.text, STYLES[cell.tone]
    return text_of(cell)
