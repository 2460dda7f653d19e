"""``calibrary registry import``: import a folder of calibrations, or the catalogue, as one commit."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING

from calibrary.cli.camera_flags import add_camera_flags, camera_of
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.reading import add_reading_flags, reading_of
from calibrary.cli.registry.asking import add_yes_flag, agreed, deciding_screen
from calibrary.cli.registry.deciding import add_force_flag, force_of
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.stated_flags import add_stated_flags, stated_of

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.exchange.import_ import Import
    from calibrary.jobs.fleet.exchange import ImportResult

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

CATALOGUE = "catalogue"
EXIT_INPUT = 3
STYLES = {"new": "green", "changed": "yellow", "same": "dim", "left": "dim", "failed": "bold red"}

DESCRIPTION = "Import a folder of calibration files of any format, or the catalogue of known cameras."
EXAMPLES = """\
examples:
  calibrary registry import catalogue                    every known camera with a K that can be derived, as drafts
  calibrary registry import lab-results/ --yes           every calibration file below a folder
  calibrary registry import p4r/ --make DJI --model FC6310R --status approved

The import is one commit, or none. A second run changes nothing. A file that cannot be imported is reported and does
not stop the others; exit code 3: there were files, and none could be imported. Entries are drafts until they are
approved.
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
        help="status of the new entries (default: draft); entries from the catalogue are always drafts",
    )
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_force_flag(parser)
    add_stated_flags(parser)
    add_camera_flags(parser, with_image_size=False)
    add_reading_flags(parser)
    add_registry_flag(parser)
    add_yes_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note
    from calibrary.cli.registry.changes import show_written

    screen = deciding_screen(arguments)
    result = _found(arguments, note(arguments))
    found = result.found
    _show(screen, found)
    due = len(found.due.items)
    written = None
    if due and agreed(arguments, f"Write {due} entries as one commit?"):
        written = result.write(arguments.reason)
    if written is not None:
        show_written(screen, written, "wrote", due)
    else:
        screen.say("nothing was written" + ("" if due else ": nothing is new"))
    if arguments.json:
        print_json(result.to_dict())
    nothing_imported = all(item.fate.value == "failed" for item in found.items)
    return EXIT_INPUT if found.items and nothing_imported else 0


def _found(arguments: argparse.Namespace, remarks: Screen) -> ImportResult:
    from calibrary.arguments import Stated
    from calibrary.calibration import CameraKey

    registry, camera, stated = opened(arguments), partial(camera_of, arguments), stated_of(arguments)
    if arguments.source == CATALOGUE:
        if arguments.status != "draft":
            arguments.parser.error(
                "the catalogue's entries are drafts: 'calibrary registry approve KEY' decides on each"
            )
        if camera(CameraKey()) != CameraKey():
            arguments.parser.error(
                "the catalogue says which camera each entry is of; leave out --make and the like"
            )
        if stated != Stated():
            arguments.parser.error(
                "the catalogue says where each entry is from; leave out --date and the like"
            )
        if arguments.force:
            arguments.parser.error("the catalogue's entries contradict nothing; leave out --force")
        return registry.import_catalogue()
    with Bar(remarks, "reading") as bar:
        return registry.import_folder(
            arguments.source,
            reading=reading_of(arguments),
            camera=camera,
            stated=stated,
            reason=arguments.reason,
            approve=arguments.status == "approved",
            force=force_of(arguments),
            progress=bar,
        )


def _show(screen: Screen, found: Import) -> None:
    from collections import Counter

    from calibrary.cli.console import plain

    for item in found.items:
        if item.fate.value == "same" and item.reason is None:
            continue
        named = f" → {item.entry}" if item.entry is not None else ""
        why = f": {item.reason}" if item.reason is not None else ""
        said = plain(f"{item.source}{named}{why}")
        screen.say(f"[{STYLES[item.fate.value]}]{item.fate.value:8}[/]{said}")
    fates = Counter(item.fate.value for item in found.items)
    counts = ", ".join(f"{fates[fate]} {fate}" for fate in STYLES if fates[fate])
    screen.say(counts or "no calibration files")
