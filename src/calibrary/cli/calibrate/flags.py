"""Flags shared by the subcommands of ``calibrary calibrate``: board, files, registry, provenance, solving."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from datetime import date
from pathlib import Path

from calibrary.cli.registry.asking import add_yes_flag

__all__ = [
    "LENS_MODELS",
    "add_board_flags",
    "add_file_flags",
    "add_provenance_flags",
    "add_registry_flags",
    "add_size_flags",
    "add_solving_flags",
    "day",
    "number",
    "process_count",
]

LENS_MODELS = (
    "auto",
    "k1k2",
    "k1k2k3",
    "k1k2p1p2",
    "brown",
    "rational",
    "fisheye",
    "double_sphere",
    "mei",
)


def add_size_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--square-mm`` and ``--marker-mm``."""
    parser.add_argument(
        "--square-mm",
        type=number(0.01, 10_000),
        required=True,
        metavar="MM",
        help="side of a square; for circles the distance of centres, for an aprilgrid from tag to tag",
    )
    parser.add_argument(
        "--marker-mm",
        type=number(0.01, 10_000),
        metavar="MM",
        help="side of a marker, diameter of a circle (default: 3/4, 1/1.3 or 1/2 of the square)",
    )


def add_board_flags(parser: argparse.ArgumentParser, square: str) -> None:
    """Add the flags that describe the board; ``square`` is the help text for the side of a square."""
    board = parser.add_argument_group("the board")
    board.add_argument(
        "--board",
        metavar="BOARD",
        help="the board, in inner corners: checkerboard:11x8 (default: a checkerboard whose size is found by trying)",
    )
    board.add_argument("--square-mm", type=number(0.01, 10_000), metavar="MM", help=square)
    board.add_argument(
        "--marker-mm", type=number(0.01, 10_000), metavar="MM", help="side of a marker, diameter of a circle"
    )


def add_file_flags(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the flags of the files that every calibration can write."""
    outputs = parser.add_argument_group("what is written")
    outputs.add_argument(
        "--report", "--html", type=Path, metavar="FILE", help="a page with every number and plot, .html"
    )
    outputs.add_argument("--out", type=Path, metavar="FILE", help="K and distortion as a calibration file")
    outputs.add_argument("--to", metavar="FORMAT", help="format of --out (default: by its suffix)")
    outputs.add_argument("--correlations", action="store_true", help="also show correlated parameters")
    return outputs


def add_registry_flags(
    parser: argparse.ArgumentParser, what: str = "put the calibration into this registry, as a draft"
) -> argparse._ArgumentGroup:
    """Add the flags that put a calibration into a registry."""
    keeping = parser.add_argument_group("the registry")
    keeping.add_argument("--registry", type=Path, metavar="PATH", help=what)
    keeping.add_argument("--approve", action="store_true", help="approve it at once, if it passes")
    keeping.add_argument("--reason", metavar="TEXT", help="why, for the history")
    keeping.add_argument("--override-held", action="store_true", help="replace an entry that a person pinned")
    add_yes_flag(parser, "write into the registry without asking")
    return keeping


def add_provenance_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of the calibration's date and operator."""
    stated = parser.add_argument_group("where it is from")
    stated.add_argument(
        "--date",
        type=day,
        metavar="DATE",
        help="day of the calibration, as 2025-03-04 (default: the day of the images; without one, today for a board "
        "and unknown for a flight)",
    )
    stated.add_argument("--operator", metavar="NAME", help="who made the calibration (default: not stated)")


def add_solving_flags(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the flags of corner detection and solving."""
    solving = parser.add_argument_group("how to solve")
    solving.add_argument(
        "--lens-model",
        choices=LENS_MODELS,
        default="auto",
        help="distortion model (default: auto, chosen by the corners)",
    )
    solving.add_argument("--no-warp", action="store_true", help="assume that the board is flat")
    solving.add_argument("--focus", metavar="TEXT", help='how the lens was focused: "locked at infinity"')
    solving.add_argument(
        "--workers", type=process_count, default=0, metavar="N", help="processes that find the board"
    )
    return solving


def day(text: str) -> date:
    """Argument type: a date that is not in the future."""
    try:
        found = date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2025-03-04") from None
    if found > date.today():
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day that is not in the future")
    return found


def number(low: float, high: float) -> Callable[[str], float]:
    """Argument type: a number from ``low`` to ``high``."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: expected a number from {low:g} to {high:g}")
        return value

    return parse


def process_count(text: str) -> int:
    """Argument type: a number of processes."""
    if not text.isdecimal() or len(text) > 4 or int(text) > 256:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number of processes, 0 … 256")
    return int(text)
