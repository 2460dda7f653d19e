"""``calibrary registry resolve``: the calibration that applies to a camera, and its use, in one line."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.shown import Shown
from calibrary.jobs.resolve import resolve

if TYPE_CHECKING:
    from calibrary.calibration import Intrinsics
    from calibrary.cli.console import Screen
    from calibrary.jobs.resolve.run import FleetAnswer

EXIT_NONE = 4
EXIT_NOT_TO_USE = 1

DESCRIPTION = (
    "Print the K that applies to an image or a camera, and what a solver may do with it, in one line."
)
EXAMPLES = """\
examples:
  calibrary registry resolve flight/DJI_0001.JPG
  calibrary registry resolve dji/fc6310r --image-size 2736x1824
  calibrary registry resolve --make DJI --model FC6310R --serial 0V2LG3H0 --json
  calibrary registry resolve flight/DJI_0001.JPG --at 2026-05-01 --on 2026-05-01
  calibrary registry resolve flight/DJI_0001.JPG --registry fleet/ --registry https://cameras.example.com/

The line has the use (fixed, start or none), the entry, and K at the camera's image size; 'registry show IMAGE' tells
why. Only approved entries answer. The most specific one is used: of this unit, this firmware, this lens or focal
length, this sub-camera, this model. At another image size than its own, its K is of the image only as far as something
tells how the image came from its frame: scaled, or a part of it. Of several registries the first that answers is used;
the catalogue comes last. exit code 1: the image contradicts its K, or nothing tells how it came from the frame; every K
that is possible is shown. exit code 4: none answers, or several fit equally well; they are named.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, out

    found = call(resolve, arguments, history=arguments.json)
    for warning in (*found.warnings, *found.disagreements):
        errors().say(("warning", "yellow"), f" {warning}")
    if arguments.json:
        print_json(found)
    elif found.path is not None:
        K = f"  {numbers(found.calibration.intrinsics)}" if found.calibration is not None else ""
        out(arguments).show([f"{found.use}  {found.path}{K}"])
    if found.path is None:
        _show_none(errors(), found)
    elif found.calibration is None:
        errors().say(f"calibrary: this K may not be used: {found.use_reason}")
    for one in found.possible:
        errors().say(f"  possible: {numbers(one.intrinsics)}  {'; '.join(one.steps) or 'of this size'}")
    if found.path is not None and found.remedy is not None:
        errors().say(f"  to do: {found.remedy}")
    return exit_code(found)


def exit_code(found: FleetAnswer) -> int:
    """The exit code that follows from an answer."""
    if found.path is None:
        return EXIT_NONE
    return 0 if found.calibration is not None else EXIT_NOT_TO_USE


def numbers(K: Intrinsics) -> str:
    """K in px, and the image size that it is of."""
    W, H = K.image_size
    return f"fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f} px  {W}×{H}"


def _show_none(screen: Screen, found: FleetAnswer) -> None:

    todo = (
        "'calibrary registry approve KEY' puts a draft to use; flags say what the image does not"
        if found.near
        else "the registry has no entry of this make and model; 'calibrary registry add FILE' puts one in"
    )
    screen.say(f"calibrary: no approved entry applies to {found.camera}, known by {found.known_by}; {todo}")
    for item in found.near:
        screen.say(f"  near: {item.path}: {item.reason}")


COMMAND = Shown(
    resolve, DESCRIPTION, EXAMPLES, run=run, positional={"what": "IMAGE|KEY"}, without=["history"]
)
