"""``calibrary registry import``: a folder of calibrations, or the catalogue of known cameras, as one commit."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.camera_flags import add_camera_flags, camera_of
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.reading import Answers, add_reading_flags
from calibrary.cli.registry.asking import add_yes_flag, agreed, deciding_screen
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.registry.progress import Bar
from calibrary.cli.stated_flags import add_stated_flags, stated_of

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.exchange.import_ import Import
    from calibrary.registry.registry import Registry

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

CATALOGUE = "catalogue"
EXIT_INPUT = 3

DESCRIPTION = "Take in a folder of calibration files of any format, or the catalogue of known cameras."
EXAMPLES = """\
examples:
  calibrary registry import catalogue                    every known camera whose K can be derived, as drafts
  calibrary registry import lab-results/ --yes           every calibration file below a folder
  calibrary registry import p4r/ --make DJI --model FC6310R --status approved

One commit, or none. Run again it changes nothing. Files that cannot be taken are told and hold up no other; exit
code 3: there were files, and none could be taken. Entries are drafts until they are approved.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "source", metavar="DIR|catalogue", help="a folder, or the word 'catalogue' (./catalogue is a folder)"
    )
    parser.add_argument(
        "--status",
        choices=("draft", "approved"),
        default="draft",
        help="of the new entries (default: draft); the catalogue's are always drafts",
    )
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_stated_flags(parser)
    add_camera_flags(parser, with_image_size=False)
    add_reading_flags(parser)
    add_registry_flag(parser)
    add_yes_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note
    from calibrary.cli.registry.changes import tell_written
    from calibrary.jobs.exchange.import_ import Fate, report_of, write_import

    registry, screen = opened(arguments), deciding_screen(arguments)
    found = _found(arguments, registry, note(arguments))
    _show(screen, found)
    written = None
    if found.due.items and agreed(arguments, f"Write {len(found.due.items)} entries as one commit?"):
        written = write_import(registry, found, reason=arguments.reason)
    if written is not None:
        tell_written(screen, written, "wrote", len(found.due.items))
    else:
        screen.say("nothing was written" + ("" if found.due.items else ": nothing is new"))
    if arguments.json:
        print_json(report_of(found, written.commit if written is not None else None))
    nothing_taken = found.count(Fate.FAILED) == len(found.items)
    return EXIT_INPUT if found.items and nothing_taken else 0


def _found(arguments: argparse.Namespace, registry: Registry, remarks: Screen) -> Import:
    from calibrary.calibration import CameraKey
    from calibrary.jobs.exchange.add import AddRequest, Stated
    from calibrary.jobs.exchange.argument import Reading
    from calibrary.jobs.exchange.import_ import import_catalogue, import_folder

    if arguments.source == CATALOGUE:
        if arguments.status != "draft":
            arguments.parser.error(
                "the catalogue's entries are drafts: 'calibrary registry approve KEY' decides on each"
            )
        if camera_of(arguments, CameraKey()) != CameraKey():
            arguments.parser.error(
                "the catalogue says which camera each entry is of; leave out --make and the like"
            )
        if stated_of(arguments) != Stated():
            arguments.parser.error(
                "the catalogue says where each entry is from; leave out --date and the like"
            )
        return import_catalogue(registry)
    answers = Answers.of(arguments)
    request = AddRequest(
        key=partial(camera_of, arguments),
        stated=stated_of(arguments),
        reason=arguments.reason,
        approve=arguments.status == "approved",
    )
    reading = Reading(format=answers.format, image_size=answers.image_size, options=answers.options)
    with Bar(remarks, "reading files") as bar:
        return import_folder(registry, Path(arguments.source), reading, request, progress=bar)


def _show(screen: Screen, found: Import) -> None:
    from calibrary.cli.console import plain
    from calibrary.jobs.exchange.import_ import Fate

    styles = {
        Fate.NEW: "green",
        Fate.CHANGED: "yellow",
        Fate.SAME: "dim",
        Fate.LEFT: "dim",
        Fate.FAILED: "bold red",
    }
    for item in found.items:
        if item.fate is Fate.SAME and item.reason is None:
            continue
        named = f" → {item.entry}" if item.entry is not None else ""
        why = f": {item.reason}" if item.reason is not None else ""
        said = plain(f"{item.source}{named}{why}")
        screen.say(f"[{styles[item.fate]}]{item.fate.value:8}[/]{said}")
    counts = ", ".join(f"{found.count(fate)} {fate.value}" for fate in Fate if found.count(fate))
    screen.say(counts or "no calibration files")
