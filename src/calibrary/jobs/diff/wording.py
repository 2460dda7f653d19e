"""Formatting of differences for users: 58 cm instead of 5.8e+01 cm, 0 px instead of 1e-13 px."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

SMALLEST_PX: Final = 5e-4
SMALLEST_M: Final = 5e-5
SMALLEST_SHARE: Final = 5e-6
RAREST: Final = 1e-4
MOST_NAMES: Final = 16


def pixels(value: float) -> str:
    """Format pixels to two digits, or whole pixels from ten on."""
    if not math.isfinite(value):
        return "unknown"
    return f"{_digits(value) if abs(value) >= SMALLEST_PX else '0'} px"


def length(metres: float, *, signed: bool = False) -> str:
    """Format a length on the ground in mm, cm or m."""
    if not math.isfinite(metres):
        return "unknown"
    sign = "+" if signed and metres > 0 else ""
    if abs(metres) < SMALLEST_M:
        return "0 cm"
    if abs(metres) < 0.00995:
        return f"{sign}{_digits(1000 * metres)} mm"
    if abs(metres) < 0.995:
        return f"{sign}{_digits(100 * metres)} cm"
    return f"{sign}{_digits(metres)} m"


def percent(share: float) -> str:
    """Format a fraction as a signed percentage."""
    if not math.isfinite(share):
        return "unknown"
    return "0%" if abs(share) < SMALLEST_SHARE else f"{share:+.3%}" if abs(share) < 0.01 else f"{share:+.1%}"


def chance(p: float) -> str:
    """Format a probability."""
    if p >= 0.01:
        return f"{p:.0%}"
    return f"{p:.2g}" if p >= RAREST else "less than 1 in 10000"


def listed(names: Sequence[str]) -> str:
    """Join names as in a sentence: "fx, fy and k1"."""
    if len(names) > MOST_NAMES:
        names = [*names[:MOST_NAMES], f"{len(names) - MOST_NAMES} more"]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def frame_size(image_size: tuple[int, int]) -> str:
    """Format width × height."""
    return "{}×{}".format(*image_size)


def _digits(value: float) -> str:
    magnitude = abs(value)
    if magnitude >= 9.95:
        return f"{value:.0f}"
    rounded = float(f"{magnitude:.1e}")
    decimals = min(3, max(0, 1 - math.floor(math.log10(rounded))))
    return f"{value:.{decimals}f}"
