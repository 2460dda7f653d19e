"""``calibrary calibrate board``: write a board to print in true size."""

from __future__ import annotations

import argparse
from typing import Any

from calibrary.cli.shown import Shown
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


def _said(done: tuple[Any, Any], arguments: argparse.Namespace) -> list[str]:
    board, page = done
    return [
        f"wrote {arguments.out}: {board.described} squares on {page.width_mm:g}×{page.height_mm:g} mm",
        f"print at 100 % and check that the ruler measures {page.ruler_mm:g} mm",
    ]


COMMAND = Shown(write_board, DESCRIPTION, EXAMPLES, positional={"board": "BOARD"}, said=_said, json=False)
