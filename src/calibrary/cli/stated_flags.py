"""Flags that state provenance of a calibration that its source lacks."""

from __future__ import annotations

import argparse
from datetime import date
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.arguments import Stated

__all__ = ["add_stated_flags", "stated_of"]


def add_stated_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--date --tool --operator``."""
    group = parser.add_argument_group(
        "how it was calibrated", "for what the source does not state; without them it stays unknown"
    )
    group.add_argument("--date", type=_day, metavar="YYYY-MM-DD", help="day of the calibration")
    group.add_argument("--tool", metavar="NAME", help="program that made the calibration")
    group.add_argument("--operator", metavar="NAME", help="person who made the calibration")


def stated_of(arguments: argparse.Namespace) -> Stated:
    """The stated provenance, from the flags of :func:`add_stated_flags`."""
    from calibrary.arguments import Stated

    return Stated(date=arguments.date, tool=arguments.tool, operator=arguments.operator)


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2019-03-05") from None
