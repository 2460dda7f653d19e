"""``calibrary registry resolve``: show which entry applies to a camera, and why."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.jobs.resolve import resolve

if TYPE_CHECKING:
    from calibrary.calibration import Calibration, Intrinsics
    from calibrary.cli.console import Screen
    from calibrary.jobs.resolve.run import FleetAnswer

EXIT_NONE = 4
EXIT_NOT_TO_USE = 1

DESCRIPTION = "Show the calibration that applies to an image or a camera, and the reason."
EXAMPLES = """\
examples:
  calibrary registry resolve flight/DJI_0001.JPG
  calibrary registry resolve dji/fc6310r --image-size 2736x1824
  calibrary registry resolve --make DJI --model FC6310R --serial 0V2LG3H0 --json
  calibrary registry resolve flight/DJI_0001.JPG --at 2026-05-01 --on 2026-05-01
  calibrary registry resolve flight/DJI_0001.JPG --registry fleet/ --registry https://cameras.example.com/

Only approved entries answer. The most specific one is used: of this unit, this firmware, this lens or focal
length, this sub-camera, this model. At another image size than its own, its K is of the image only as far as something
tells how the image came from its frame: scaled, or a part of it. Of several registries the first that answers is used;
the catalogue comes last. exit code 1: the image contradicts its K, or nothing tells how it came from the frame; every K
that is possible is shown. exit code 4: none answers, or several fit equally well; they are named.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, resolve, positional={"what": "IMAGE|KEY"}, without=["history"])
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, out, plain

    found = call(resolve, arguments, history=arguments.json)
    for warning in (*found.warnings, *found.disagreements):
        errors().say(f"[yellow]warning[/] {plain(warning)}")
    if arguments.json:
        print_json(found)
    elif found.path is not None:
        _show(out(arguments), found)
    if found.path is None:
        _show_none(errors(), found)
        return EXIT_NONE
    if found.calibration is None:
        errors().say(plain(f"calibrary: this K may not be used: {found.use_reason}"))
    if found.remedy is not None:
        errors().say(plain(f"  to do: {found.remedy}"))
    return 0 if found.calibration is not None else EXIT_NOT_TO_USE


def _show(screen: Screen, found: FleetAnswer) -> None:
    from calibrary.cli.console import printable
    from calibrary.cli.tables import facts

    entry, path, why = found.entry, found.path or "", found.why or ""
    at = f" at {found.commit[:12]}" if found.commit is not None else ""
    status = entry.status.value if entry is not None else "of the type, not in any registry"
    override = entry.override if entry is not None else None
    rows = [
        ("camera", f"{found.camera}, by {found.known_by}"),
        ("label", (entry.label if entry is not None else None) or ""),
        ("registry", found.registry),
        ("entry", f"{path}{at}, {status}"),
        ("reason", why.removeprefix(f"{path} ")),
        *(_described(found.calibration) if found.calibration is not None else ()),
        ("use", f"{found.use}: {found.use_reason}"),
        *(
            ("possible K", f"{_numbers(one.intrinsics)}  {'; '.join(one.steps) or 'of this size'}")
            for one in found.possible
        ),
        ("overridden", f"it contradicts what is known of its camera: {override}" if override else ""),
    ]
    near = [("near", printable(f"{item.path}: {item.reason}")) for item in found.near]
    shown = [(name, printable(value)) for name, value in rows if value]
    screen.show(facts([*shown, *near], screen.width))


def _described(calibration: Calibration) -> list[tuple[str, str]]:
    K, lens, made = calibration.intrinsics, calibration.distortion, calibration.provenance
    return [
        ("adapted", made.adaptation or "no, it is of this size"),
        *(("assumed", text) for text in made.assumptions),
        ("grade", calibration.grade.value),
        ("K", _numbers(K)),
        ("of", f"{K.image_size[0]}×{K.image_size[1]} px"),
        ("distortion", lens.model if lens is not None else "unknown"),
        *((f"  {name}", f"{value:.8g}") for name, value in (lens.shown.items() if lens else ())),
        ("made from", made.tag or ""),
    ]


def _numbers(K: Intrinsics) -> str:
    return f"fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f} px"


def _show_none(screen: Screen, found: FleetAnswer) -> None:
    from calibrary.cli.console import plain

    todo = (
        "'calibrary registry approve KEY' puts a draft to use; flags say what the image does not"
        if found.near
        else "the registry has no entry of this make and model; 'calibrary registry add FILE' puts one in"
    )
    screen.say(
        plain(f"calibrary: no approved entry applies to {found.camera}, known by {found.known_by}; {todo}")
    )
    for item in found.near:
        screen.say(plain(f"  near: {item.path}: {item.reason}"))
