"""``calibrary calibrate board``: write a board to print in true size."""

from __future__ import annotations

import argparse

from calibrary.cli.flags import add_flags, call
from calibrary.jobs.calibrate import write_board

DESCRIPTION = """\
Write a calibration board as PDF or SVG, true to the millimetre, with a ruler to check the print.

A board is PATTERN:COLUMNSxROWS, counted in inner corners: checkerboard:11x8 has 12×9 squares. Other patterns
are charuco:COLUMNSxROWS[:DICTIONARY], aprilgrid:COLUMNSxROWS (tags, as Kalibr places them), circles, and acircles:
staggered circles as OpenCV counts them, such as acircles:4x11, with --square-mm between rows.
"""
EXAMPLES = """\
examples:
  calibrary calibrate board checkerboard:11x8 --square-mm 40 --out board.pdf
  calibrary calibrate board charuco:8x5:5x5_100 --square-mm 30 --page a3 --out board.svg
  calibrary calibrate board aprilgrid:6x6 --square-mm 88 --page 600x600 --out tags.pdf

Print at 100 %, measure the ruler, and glue the sheet to something flat: 0.2 mm of bow over 400 mm moves the
focal length by more than a tenth of a per cent.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, write_board, positional={"board": "BOARD"})


def run(arguments: argparse.Namespace) -> int:
    """Run the command: write the board; returns the exit code."""
    from calibrary.cli.console import out, plain

    board, page = call(write_board, arguments)
    screen = out(arguments)
    screen.say(
        f"wrote {plain(str(arguments.out))}: {plain(board.described)} squares on "
        f"{page.width_mm:g}×{page.height_mm:g} mm"
    )
    screen.say(f"print at 100 % and check that the ruler measures {page.ruler_mm:g} mm")
    return 0
