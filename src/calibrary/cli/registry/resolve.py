"""``calibrary registry resolve``: show which entry applies to a camera, and why."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING

from calibrary.cli.camera_flags import add_camera_flags, camera_of
from calibrary.cli.flags import day
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_layers_flag

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.exchange.resolve import Answer, FleetAnswer
    from calibrary.registry.resolution import Resolution

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

EXIT_NONE = 4

DESCRIPTION = "Show the calibration that applies to an image or a camera, and the reason."
EXAMPLES = """\
examples:
  calibrary registry resolve flight/DJI_0001.JPG
  calibrary registry resolve dji/fc6310r --image-size 2736x1824
  calibrary registry resolve --make DJI --model FC6310R --serial 0V2LG3H0 --json
  calibrary registry resolve flight/DJI_0001.JPG --at 2026-05-01 --on 2026-05-01
  calibrary registry resolve flight/DJI_0001.JPG --registry fleet/ --registry https://cameras.example.com/

Only approved and held entries answer. The most specific one is used: of this unit, this firmware, this lens or focal
length, this sub-camera, this model. Its K is scaled, or cropped if the image is a centred part of the frame. Of several
registries the first that answers is used; the catalogue comes last. exit code 4: none answers, or several fit equally
well; they are named.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "what", nargs="?", metavar="IMAGE|KEY", help="image or KEY, if no flags state the camera"
    )
    add_camera_flags(parser)
    parser.add_argument(
        "--on",
        type=day,
        metavar="DATE",
        help="day for which the entry has to be valid (default: the day of the image, or else today)",
    )
    parser.add_argument("--at", metavar="REV", help="as the registry was at a commit, tag, branch or day")
    add_layers_flag(
        parser,
        "a folder, or the address of a published registry; if you give several, the first that answers is used; "
        "calibrary registry --help explains the default",
    )
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.calibration import CameraKey
    from calibrary.cli.console import errors, out, plain
    from calibrary.jobs.exchange.resolve import LayeredView

    stated = partial(camera_of, arguments)
    if arguments.what is None and stated(CameraKey()) == CameraKey():
        arguments.parser.error("say which camera: an image of it, its KEY, or --make and --model")
    registries = LayeredView.named(arguments.registry or (), at=arguments.at)
    found = registries.resolve(arguments.what, stated=stated, on=arguments.on)
    for warning in (*found.answer.layers.warnings, *found.disagreements):
        errors().say(f"[yellow]warning[/] {plain(warning)}")
    if arguments.json:
        print_json(found.to_dict())
    elif (resolution := found.answer.resolution) is not None:
        _show(out(arguments), found, resolution)
    if found.calibration is not None:
        return 0
    _show_none(errors(), found.answer)
    return EXIT_NONE


def _show(screen: Screen, found: FleetAnswer, resolution: Resolution) -> None:
    from calibrary.cli.console import printable
    from calibrary.cli.tables import facts

    entry, calibration = resolution.entry, resolution.calibration
    K, lens, made = calibration.intrinsics, calibration.distortion, calibration.provenance
    at = f" at {found.commit[:12]}" if found.commit is not None else ""
    status = entry.status.value if found.entry is not None else "of the type, not in any registry"
    rows = [
        ("camera", f"{found.camera}, by {found.answer.question.known_by}"),
        ("label", entry.label or ""),
        ("registry", found.registry),
        ("entry", f"{resolution.path}{at}, {status}"),
        ("reason", resolution.why.removeprefix(f"{resolution.path} ")),
        ("adapted", made.adaptation or "no, it is of this size"),
        *(("assumed", text) for text in made.assumptions),
        ("grade", calibration.grade.value),
        ("K", f"fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f} px"),
        ("of", f"{K.image_size[0]}×{K.image_size[1]} px"),
        ("distortion", lens.model if lens is not None else "unknown"),
        *((f"  {name}", f"{value:.8g}") for name, value in (lens.coefficients.items() if lens else ())),
        ("made from", made.tag or ""),
        (
            "overridden",
            f"it contradicts what is known of its camera: {entry.override}" if entry.override else "",
        ),
    ]
    near = [("near", printable(f"{item.path}: {item.reason}")) for item in found.near]
    shown = [(name, printable(value)) for name, value in rows if value]
    screen.show(facts([*shown, *near], screen.width))


def _show_none(screen: Screen, found: Answer) -> None:
    from calibrary.cli.console import plain

    key = found.question.key
    todo = (
        "'calibrary registry approve KEY' puts a draft to use; flags say what the image does not"
        if found.near
        else "the registry has no entry of this make and model; 'calibrary registry add FILE' puts one in"
    )
    screen.say(
        plain(f"calibrary: no approved entry applies to {key}, known by {found.question.known_by}; {todo}")
    )
    for item in found.near:
        screen.say(plain(f"  near: {item.path}: {item.reason}"))
