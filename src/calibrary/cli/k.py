"""``calibrary k``: print the K of one image, calibration file or camera."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from calibrary.cli.shown import Shown
from calibrary.jobs.k import k

if TYPE_CHECKING:
    from calibrary.jobs.k.run import OneK

DESCRIPTION = "Print the nine numbers of one K."
EXAMPLES = """\
examples:
  calibrary k survey/DJI_0001.JPG                 of an image, as 'extract' judges it
  calibrary k camera.xml --npy K.npy              of a calibration file, also for numpy.load
  calibrary k dji/fc6310r                         of the registry's entry, or of the catalogue

K counts from the outer corner of the top-left pixel, whose centre is (0.5, 0.5). exit code 0: the K may be used;
1: it may not, or the numbers are a seed to start a self-calibration with. Standard error says which, and why.
"""


class _K(Shown):
    def show(self, done: OneK, arguments: argparse.Namespace, **_: Any) -> None:  # noqa: ARG002  as of Shown
        """Print three lines of three numbers for programs, and what they are for people."""
        from calibrary.cli.console import errors

        sys.stdout.write("".join("{} {} {}\n".format(*row) for row in done.intrinsics.rows))
        errors().say(f"calibrary: {'' if done.calibration is not None else 'a seed, no K: '}{done.why}")


COMMAND = _K(k, DESCRIPTION, EXAMPLES, positional={"what": "IMAGE|FILE|KEY"}, exits={"is_usable": 1})
