"""What pages say in the same way: counts, signs, sentences, verdicts' tones, lists that are cut."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from calibrary import __version__
from calibrary.pages.content import Block, Cell, Column, Table, Tone
from calibrary.validation import UNPROVEN_LEGEND, Severity

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
    """A number with the minus sign of print."""
    return text.replace("-", "−")


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"


UNPROVEN: Final = sentence(UNPROVEN_LEGEND)


def or_unknown(value: object) -> str:
    """What is known, or the word that it is not."""
    return "unknown" if value is None or value == "" else str(value)


def several(names: Iterable[str]) -> str:
    """The first names, and how many more there are; a dash for none."""
    every = [*names]
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return "; ".join(every[:MOST_NAMED]) + more or "–"


def made_by(source: str | None = None) -> str:
    """For a page's foot: the program and its version, and what it worked from."""
    return f"Made by calibrary {__version__}{f' {source}' if source else ''}."


def cut_table(
    caption: str, columns: Sequence[Column], rows: Sequence[Sequence[Cell]], *, most: int, rest: str
) -> Iterator[Block]:
    """A table of the first rows, and a line on how many more there are and where.

    Args:
        caption: what the rows are.
        columns: their heads.
        rows: all of them.
        most: how many are shown.
        rest: where the others are: "the JSON".
    """
    yield Table(caption=caption, columns=tuple(columns), rows=tuple(tuple(row) for row in rows[:most]))
    if len(rows) > most:
        yield f"{len(rows) - most} more are in {rest}."
