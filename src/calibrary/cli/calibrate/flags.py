"""The flags that say which board, the same for every word."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from datetime import date

__all__ = ["add_size_flags", "day", "number"]


def add_size_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--square-mm`` and ``--marker-mm``."""
    parser.add_argument(
        "--square-mm",
        type=number(0.01, 10_000),
        required=True,
        metavar="MM",
        help="side of a square; of circles the distance of their centres, of an aprilgrid from tag to tag",
    )
    parser.add_argument(
        "--marker-mm",
        type=number(0.01, 10_000),
        metavar="MM",
        help="side of a marker, diameter of a circle (default: 3/4, 1/1.3 or 1/2 of the square)",
    )


def day(text: str) -> date:
    """An argument's type: a day that is not in the future."""
    try:
        found = date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2025-03-04") from None
    if found > date.today():
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day that is not in the future")
    return found


def number(low: float, high: float) -> Callable[[str], float]:
    """An argument's type: a number from ``low`` to ``high``."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: expected a number from {low:g} to {high:g}")
        return value

    return parse
