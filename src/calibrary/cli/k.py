"""``calibrary k``: print the K of one image, calibration file or camera."""

from __future__ import annotations

import argparse
import sys

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.jobs.k import k

DESCRIPTION = "Print the nine numbers of one K."
EXAMPLES = """\
examples:
  calibrary k survey/DJI_0001.JPG                 of an image, as 'extract' judges it
  calibrary k camera.xml --npy K.npy              of a calibration file, also for numpy.load
  calibrary k dji/fc6310r                         of the registry's entry, or of the catalogue

K counts from the outer corner of the top-left pixel, whose centre is (0.5, 0.5). exit code 0: the K may be used;
1: it may not, or the numbers are a seed to start a self-calibration with. Standard error says which, and why.
"""

EXIT_NOT_TO_USE = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, k, positional={"what": "IMAGE|FILE|KEY"})
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, plain

    found = call(k, arguments)
    if arguments.json:
        print_json(found)
    else:
        rows = found.intrinsics.rows
        sys.stdout.write("".join("{} {} {}\n".format(*row) for row in rows))
    named = "" if found.calibration is not None else "a seed, no K: "
    errors().say(plain(f"calibrary: {named}{found.why}"))
    return 0 if found.is_usable else EXIT_NOT_TO_USE
