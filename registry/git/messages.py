"""Commit messages: a line for people, then trailers for programs, as ``git interpret-trailers`` reads them."""

from __future__ import annotations

import re
from collections.abc import Sequence

__all__ = ["Trailers", "compose", "subject_of", "trailers_of"]

Trailers = Sequence[tuple[str, str]]

TRAILER = re.compile(r"(?P<key>[A-Za-z][A-Za-z0-9-]*): (?P<value>.*)")
LONGEST_SUBJECT = 100
LONGEST_VALUE = 500


def compose(subject: str, *, body: str = "", trailers: Trailers = ()) -> str:
    """A message: what a value holds of line breaks and control characters becomes blanks."""
    first = _line(subject, LONGEST_SUBJECT) or "Change the registry"
    paragraphs = [first]
    if body.strip():
        paragraphs.append("\n".join(_line(line, LONGEST_VALUE) for line in body.strip().splitlines()))
    lines = [f"{key}: {text}" for key, value in trailers if (text := _line(value, LONGEST_VALUE))]
    if lines:
        paragraphs.append("\n".join(lines))
    return "\n\n".join(paragraphs) + "\n"


def subject_of(message: str) -> str:
    """The first line."""
    return message.strip().partition("\n")[0]


def trailers_of(message: str) -> tuple[tuple[str, str], ...]:
    """The trailers of a message: its last paragraph, if there is another before it and every line is one."""
    paragraphs = [part for part in re.split(r"\n[ \t]*\n", message.strip()) if part.strip()]
    if len(paragraphs) < 2:
        return ()
    found = [TRAILER.fullmatch(line) for line in paragraphs[-1].splitlines()]
    pairs = tuple((match["key"], match["value"].strip()) for match in found if match)
    return pairs if len(pairs) == len(found) else ()


def _line(text: str, longest: int) -> str:
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    folded = " ".join(printable.split())
    return folded if len(folded) <= longest else f"{folded[: longest - 1]}…"
