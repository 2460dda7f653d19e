"""Output streams of a command, and line wrapping, which a terminal alone gets.

Results go to standard output, progress and remarks to standard error. ``--json`` replaces the results by the
document, ``--table -`` by the table; ``--quiet`` suppresses remarks. Errors are always printed.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Iterator
from typing import NoReturn

from rich.cells import cell_len
from rich.console import Console, RenderableType
from rich.text import Text

from calibrary.cli.words import Words, printable

UNFOLDED = 10_000
"""Width where there is no terminal: grep finds a sentence, and the row of a table, in one line."""

NARROWEST = 40


class Screen(Console):
    """A rich console that wraps sentences between words and truncates nothing."""

    def at_most(self, columns: int) -> int:
        """The width, limited to what reads well on a terminal."""
        return min(self.width, columns) if self.is_terminal else self.width

    def say(self, *words: Words, style: str = "", indent: int = 0, hang: int = 2) -> None:
        """Print a paragraph.

        Args:
            words: text, with a style of its own where a pair says so; leading spaces indent the whole paragraph.
            style: of the whole paragraph.
            indent: columns before the first line.
            hang: additional columns before the other lines.
        """
        if not self.is_terminal:
            if not self.quiet:
                whole = "".join(printable(one if isinstance(one, str) else one[0]) for one in words)
                self.file.write(f"{' ' * indent}{whole.rstrip()}\n")
            return
        text = Text(style=style)
        for one in words:
            said, own = (one, "") if isinstance(one, str) else one
            text.append(printable(said), own)
        for line in folded(text, self.width, indent=indent, hang=hang):
            self.print(line, highlight=False, soft_wrap=True)

    def table(self, drawn: RenderableType) -> None:
        """Print what rich lays out, without the blanks with which it fills its lines."""
        with self.capture() as captured:
            self.print(drawn, highlight=False)
        if not self.quiet:
            self.file.write("".join(f"{line.rstrip()}\n" for line in captured.get().splitlines()))

    def show(self, lines: Iterable[Text | str], *, indent: int = 0) -> None:
        """Print the lines of a table."""
        if not self.is_terminal:
            # A pipe needs no styles; skipping them is faster for ten thousand rows.
            if not self.quiet:
                plains = (printable(line) if isinstance(line, str) else line.plain for line in lines)
                self.file.write("".join(f"{' ' * indent}{text}".rstrip() + "\n" for text in plains))
            return
        for line in lines:
            text = printable(line) if isinstance(line, str) else line
            self.print(Text(" " * indent) + text, highlight=False, soft_wrap=True)

    def verbatim(self, text: str, *, style: str = "") -> None:
        """Print lines unchanged, such as commands that the user copies."""
        self.print(Text(text, style), highlight=False, soft_wrap=True)

    def on_broken_pipe(self) -> NoReturn:
        """Re-raise, so that ``main`` handles it like every broken pipe."""
        raise BrokenPipeError


def out(arguments: argparse.Namespace | None = None) -> Screen:
    """Console for results."""
    given = vars(arguments) if arguments is not None else {}
    printed = given.get("json", False) or "-" in {given.get("table"), given.get("image_table")}
    return _screen(stderr=False, muted=printed)


def note(arguments: argparse.Namespace | None = None) -> Screen:
    """Console for progress and remarks."""
    return _screen(stderr=True, muted=getattr(arguments, "quiet", False))


def errors() -> Screen:
    """Console for errors and questions."""
    return _screen(stderr=True, muted=False)


def _screen(*, stderr: bool, muted: bool) -> Screen:
    screen = Screen(stderr=stderr, quiet=muted)
    screen.width = max(screen.width, NARROWEST) if screen.is_terminal else UNFOLDED
    return screen


def folded(text: Text, width: int, *, indent: int = 0, hang: int = 2) -> Iterator[Text]:
    """The lines of a wrapped paragraph; a word longer than a line gets its own line and is not broken."""
    led = len(text.plain) - len(text.plain.lstrip(" "))
    text, indent = text[led:], indent + led
    room = max(1, width - indent)
    for number, (start, end) in enumerate(cuts(text.plain, room, max(1, room - hang))):
        line = text[start:end] if end > start else Text()
        line.rstrip()
        yield Text(" " * (indent + (hang if number else 0))) + line


def cuts(text: str, first: int, further: int) -> Iterator[tuple[int, int]]:
    """Start and end of each line; spaces are kept except at line ends."""
    start = at = 0
    room = first
    for word_start, word_end in (word.span() for word in re.finditer("[^ ]+", text)):
        if word_start > start and cell_len(text[start:word_end].rstrip()) > room:
            yield start, at
            start, room = word_start, further
        at = word_end
    yield start, len(text)
