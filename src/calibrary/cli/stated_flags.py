"""Flags that state provenance of a calibration that its source lacks."""

from __future__ import annotations

import argparse
from datetime import date
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.arguments import Stated

__all__ = ["add_stated_flags", "stated_of"]


def add_stated_flags(parser: argparse.ArgumentParser) -> None:
    """Add a flag for each field of the provenance that a user may state."""
    from calibrary.provenance import ABOUT, Provenance
    from calibrary.records.schema import descriptions

    group = parser.add_argument_group(
        "how it was calibrated", "for what the source does not state; without them it stays unknown"
    )
    for name, one in ABOUT.items():
        spelled, said = f"--{name.replace('_', '-')}", descriptions(Provenance)[name]
        if one.flag == "day":
            group.add_argument(spelled, dest=name, type=_day, metavar="YYYY-MM-DD", help=said)
        elif one.flag is not None:
            group.add_argument(spelled, dest=name, metavar="NAME", help=said)


def stated_of(arguments: argparse.Namespace) -> Stated:
    """The stated provenance, from the flags of :func:`add_stated_flags`."""
    from calibrary.arguments import Stated

    return Stated(**{name: getattr(arguments, name) for name in Stated.__struct_fields__})


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2019-03-05") from None
