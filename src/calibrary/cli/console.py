"""Which stream a command's words go to, and how they are folded.

Results go to standard output, progress and remarks to standard error. With ``--json`` the document takes the place
of the results, with ``--table -`` the table; with ``--quiet`` there are no remarks. Errors are always said.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator
from typing import NoReturn

from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.text import Text

__all__ = ["Screen", "errors", "folded", "note", "out", "plain", "printable"]

PIPED_WIDTH = 80
NARROWEST = 40


class Screen(Console):
    """A rich console that folds sentences between words and cuts nothing off."""

    def say(self, text: str, *, style: str = "", indent: int = 0, hang: int = 2) -> None:
        """Print a paragraph in rich's markup.

        Args:
            text: with what comes from files and tags made :func:`plain`; spaces before it indent all of it.
            style: of the whole paragraph.
            indent: columns before its first line.
            hang: further columns before the others.
        """
        for line in folded(
            Text.from_markup(text, style=style, emoji=False), self.width, indent=indent, hang=hang
        ):
            self.print(line, highlight=False, soft_wrap=True)

    def show(self, lines: Iterable[Text], *, indent: int = 0) -> None:
        """Print the lines of a table."""
        if not self.is_terminal:
            # Ten thousand rows into a pipe need no styles.
            if not self.quiet:
                self.file.write("".join(f"{' ' * indent}{line.plain}\n" for line in lines))
            return
        for line in lines:
            self.print(Text(" " * indent) + line, highlight=False, soft_wrap=True)

    def verbatim(self, text: str, *, style: str = "") -> None:
        """Print lines that are to be copied, such as commands, as they are."""
        self.print(Text(text, style), highlight=False, soft_wrap=True)

    def on_broken_pipe(self) -> NoReturn:
        """Leave it to the command line as a whole, which ends as it does on every broken pipe."""
        raise BrokenPipeError


def out(arguments: argparse.Namespace | None = None) -> Screen:
    """The console of results."""
    given = vars(arguments) if arguments is not None else {}
    printed = given.get("json", False) or "-" in {given.get("table"), given.get("image_table")}
    return _screen(stderr=False, muted=printed)


def note(arguments: argparse.Namespace | None = None) -> Screen:
    """The console of progress and remarks."""
    return _screen(stderr=True, muted=getattr(arguments, "quiet", False))


def errors() -> Screen:
    """The console of what is wrong, and of questions."""
    return _screen(stderr=True, muted=False)


def _screen(*, stderr: bool, muted: bool) -> Screen:
    """Without a terminal the width is COLUMNS or 80, whatever terminal another stream may have."""
    screen = Screen(stderr=stderr, quiet=muted)
    if not screen.is_terminal:
        columns = os.environ.get("COLUMNS", "")
        screen.width = int(columns) if columns.isdecimal() and len(columns) < 6 else PIPED_WIDTH
    screen.width = max(screen.width, NARROWEST)
    return screen


def folded(text: Text, width: int, *, indent: int = 0, hang: int = 2) -> Iterator[Text]:
    """A paragraph's lines; a word longer than a line keeps its own line and is not broken."""
    led = len(text.plain) - len(text.plain.lstrip(" "))
    text, indent = text[led:], indent + led
    room = max(1, width - indent)
    for number, (start, end) in enumerate(_cuts(text.plain, room, max(1, room - hang))):
        line = text[start:end] if end > start else Text()
        line.rstrip()
        yield Text(" " * (indent + (hang if number else 0))) + line


def _cuts(text: str, first: int, further: int) -> Iterator[tuple[int, int]]:
    """Where each line begins and ends: spaces of the text are kept but at the ends of lines."""
    start = at = 0
    room = first
    for word_start, word_end in _words(text):
        if word_start > start and cell_len(text[start:word_end].rstrip()) > room:
            yield start, at
            start, room = word_start, further
        at = word_end
    yield start, len(text)


def _words(text: str) -> Iterator[tuple[int, int]]:
    at = 0
    while at < len(text):
        while at < len(text) and text[at] == " ":
            at += 1
        begin = at
        while at < len(text) and text[at] != " ":
            at += 1
        if at > begin:
            yield begin, at


def printable(text: str) -> str:
    """Text from a file or a tag without control characters, which a terminal would obey."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)


def plain(text: str) -> str:
    """The same without markup, for strings in which rich looks for it."""
    text = printable(text)
    return escape(text) if "[" in text or "\\" in text else text
