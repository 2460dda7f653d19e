"""Common wording of pages: counts, signs, sentences, tones of verdicts, shortened lists.

Text from files and tags is made safe to display; K and distortion have as many digits as their uncertainty justifies.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from calibrary.calibration import Calibration
from calibrary.validation import UNPROVEN_LEGEND, Severity
from calibrary.version import __version__
from calibrary.view import Block, Cell, Column, Table, Tone

LONGEST = 4_000
"""Most characters of one piece of text on a page."""

MOST_MARKS = 4
"""Most combining accents on one letter; more would cover adjacent lines."""


def visible(text: str, most: int = LONGEST) -> str:
    """The text with control, direction and other unprintable characters spelt out, cut to ``most`` characters.

    The template escapes HTML. Direction overrides would show a name backwards, and a lone surrogate (a byte of a file
    name that is not UTF-8) cannot be encoded at all.
    """
    if len(text) <= most and text.isascii() and text.isprintable():
        # Fast path: nearly all of the thousand texts of a page are plain.
        return text
    cut = len(text) > most
    shown: list[str] = []
    marks = 0
    for c in text[:most]:
        marks = marks + 1 if unicodedata.combining(c) else 0
        if marks > MOST_MARKS:
            continue
        if c.isprintable():
            shown.append(c)
        elif c.isspace():
            shown.append(" ")
        else:
            shown.append(f"\\x{ord(c):02x}" if ord(c) < 0x100 else f"\\u{ord(c):04x}")
    return "".join(shown) + (f"… ({len(text)} characters)" if cut else "")


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
    """The text with a full stop and a capital letter, unless it begins with a name, as of a camera or file."""
    is_name = any(sign in "0123456789/._" for sign in text.partition(" ")[0].rstrip(".:"))
    capital = text[:1] if is_name else text[:1].upper()
    return f"{capital}{text[1:]}{'' if text.endswith('.') else '.'}"


UNPROVEN: Final = sentence(UNPROVEN_LEGEND)


def known(*items: tuple[str, object]) -> tuple[tuple[str, str], ...]:
    """The items with a value, as text; the others are not shown."""
    return tuple((name, str(value)) for name, value in items if value is not None)


def several(names: Iterable[str]) -> str:
    """The first names and the number of the others; a dash for none."""
    every = [*names]
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return "; ".join(every[:MOST_NAMED]) + more or "–"


def made_by(source: str | None = None) -> str:
    """Footer of a page: the program, its version and the source."""
    return f"Made by calibrary {__version__}{f' {source}' if source else ''}."


COMMAND: Final = re.compile(r"\bcalibrary (registry \w+|diff|onboard|calibrate)\b")


def in_registry(registry: str, remedy: str) -> str:
    """A remedy with the flag that selects the registry in its commands."""
    return COMMAND.sub(rf"\g<0>{registry}", remedy)


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


def stds_of(calibration: Calibration) -> dict[str, float]:
    """The standard deviations that a calibration states, without the variance factor."""
    quality = calibration.quality
    if quality is None:
        return {}
    covariance = quality.covariance.std if quality.covariance is not None else {}
    return {**dict(quality.std), **covariance}


def rounded(value: float, std: float | None, unsure: str = ".6g") -> tuple[str, str]:
    """Format a value and its standard deviation to two significant digits of the latter.

    Args:
        value: of a parameter.
        std: its standard deviation, or None if unknown.
        unsure: format of the value if the standard deviation is unknown.
    """
    if std is None or not 0 < std < math.inf:
        return minus(format(value, unsure)), "–"
    decimals = min(12, max(0, 1 - math.floor(math.log10(std))))
    return minus(f"{value:.{decimals}f}"), f"{std:.{decimals}f}"


def intrinsics_items(calibration: Calibration) -> Iterator[tuple[str, str]]:
    """Yield fx, fy, cx, cy (px), a non-zero skew and the image size as (name, text)."""
    K, std = calibration.intrinsics, stds_of(calibration)
    for name in ("fx", "fy", "cx", "cy"):
        value, sigma = rounded(getattr(K, name), std.get(name), ".2f")
        yield name, f"{value} px" if sigma == "–" else f"{value} ± {sigma} px"
    if K.skew:
        yield "skew", minus(f"{K.skew:.4g} px")
    yield "image", "{} × {} px".format(*K.image_size)


def distortion_blocks(calibration: Calibration) -> Iterator[Block]:
    """Yield the distortion coefficients, or a sentence if there are none."""
    lens, std = calibration.distortion, stds_of(calibration)
    if lens is None:
        yield "The distortion is unknown (which is not the same as no distortion)."
    elif not lens.shown:
        yield "The image is free of distortion."
    else:
        columns = (Column("coefficient"), Column("value", numeric=True), Column("σ", numeric=True))
        known = any(name in std for name in lens.shown)
        rows = [(name, *rounded(value, std.get(name))) for name, value in lens.shown.items()]
        yield Table(
            caption=f"Distortion, {lens.model} model",
            columns=columns if known else columns[:2],
            rows=tuple(row if known else row[:2] for row in rows),
        )
