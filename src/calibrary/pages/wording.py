"""Common wording of pages: counts, signs, sentences, tones of verdicts, shortened lists."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from calibrary.pages.content import Block, Cell, Column, Table, Tone
from calibrary.validation import UNPROVEN_LEGEND, Severity
from calibrary.version import __version__

__all__ = [
    "SEVERITIES",
    "UNPROVEN",
    "count",
    "cut_table",
    "made_by",
    "minus",
    "or_unknown",
    "sentence",
    "several",
]

SEVERITIES: Final = {
    Severity.PASS: Tone.GOOD,
    Severity.NOTE: Tone.NEUTRAL,
    Severity.WARNING: Tone.CAUTION,
    Severity.UNPROVEN: Tone.CAUTION,
    Severity.ERROR: Tone.BAD,
}

MOST_NAMED: Final = 6


def count(number: int, one: str, more: str | None = None) -> str:
    """A number with its noun: 1 image, 2 images, 2 entries."""
    return f"{number} {one if number == 1 else more or one + 's'}"


def minus(text: str) -> str:
    """A number with a typographic minus sign."""
    return text.replace("-", "−")


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"


UNPROVEN: Final = sentence(UNPROVEN_LEGEND)


def or_unknown(value: object) -> str:
    """The value as text; "unknown" for None or empty text."""
    return "unknown" if value is None or value == "" else str(value)


def several(names: Iterable[str]) -> str:
    """The first names and the number of the others; a dash for none."""
    every = [*names]
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return "; ".join(every[:MOST_NAMED]) + more or "–"


def made_by(source: str | None = None) -> str:
    """Footer of a page: the program, its version and the source."""
    return f"Made by calibrary {__version__}{f' {source}' if source else ''}."


def cut_table(
    caption: str, columns: Sequence[Column], rows: Sequence[Sequence[Cell]], *, most: int, rest: str
) -> Iterator[Block]:
    """Table of the first rows, and a sentence that states how many more there are and where.

    Args:
        caption: what the rows are.
        columns: column heads.
        rows: all rows.
        most: number of rows shown.
        rest: where the other rows are, such as "the JSON".
    """
    yield Table(caption=caption, columns=tuple(columns), rows=tuple(tuple(row) for row in rows[:most]))
    if len(rows) > most:
        yield f"{len(rows) - most} more are in {rest}."
