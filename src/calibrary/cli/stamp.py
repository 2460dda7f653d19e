"""``calibrary stamp``: write a calibration into the metadata of image copies, in the tags that programs read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.reading import add_reading_flags, reading_of
from calibrary.cli.registry.place import add_layers_flag
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from calibrary.api.stamps import StampReport
    from calibrary.cli.console import Screen

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Write K and distortion into copies of JPEGs and TIFFs, as XMP tags that photogrammetry programs read. Pixels, "
    "EXIF and maker's notes stay as they are, byte for byte; the images themselves are never changed."
)
EXAMPLES = """\
examples:
  calibrary stamp flight/ --calibration camera.xml --out stamped
  calibrary stamp flight/ --from-registry --registry ../fleet      each image with the entry of its camera and day
  calibrary stamp a.jpg --calibration dji/fc6310r --registry ../fleet --dry-run
  calibrary stamp bands/*.tif --calibration rig.xml --camera 2 --tags camera

--tags camera: Pix4D's Camera: tags, in mm, with one focal length. --tags dji: drone-dji:DewarpData, in px. Without
--tags, all tags are written that hold the calibration to --max-error-px. If an image already has a calibration, the
copy gets the new one. The content of each copy is read back before it is written.

exit code 0: every image was stamped; 1: one was refused, because it is of another camera or size, or because the tags
do not hold the calibration; 3: one cannot be read.
"""

EXIT_REFUSED = 1
EXIT_UNREADABLE = 3
TAGS = ("camera", "dji")
MOST_ROWS = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("images", nargs="+", type=Path, metavar="IMAGE", help="images, or folders of them")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "--calibration", metavar="FILE|KEY", help="the camera's calibration file, or an entry of the registry"
    )
    source.add_argument(
        "--from-registry",
        action="store_true",
        help="use the registry's entry for the camera and the day of each image",
    )
    add_layers_flag(
        parser,
        "the fleet's registry, a folder or https:// address; of several, the first that answers is used",
    )
    parser.add_argument("--camera", type=int, metavar="N", help="the Nth camera of a file with several")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("stamped"),
        metavar="DIR",
        help="folder for the copies (default: ./stamped)",
    )
    parser.add_argument("--force", action="store_true", help="replace existing files")
    parser.add_argument("--dry-run", action="store_true", help="do everything except writing")
    parser.add_argument(
        "--tags", action="append", choices=TAGS, help="tags to write (default: all that hold the calibration)"
    )
    parser.add_argument(
        "--max-error-px",
        type=float,
        default=0.05,
        metavar="X",
        help="largest error of a projection that the tags may cause, anywhere in the image (default: 0.05)",
    )
    add_reading_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.stamps import stamp
    from calibrary.cli.console import note, out
    from calibrary.jobs.exchange.resolve import LayeredView

    places = arguments.registry or ()
    if not arguments.from_registry and len(places) > 1:
        arguments.parser.error("--registry: an entry is of one registry")
    arguments.registry = None
    reading = reading_of(arguments, camera=arguments.camera)
    with Bar(note(arguments), "stamping") as bar:
        done = stamp(
            arguments.images,
            arguments.calibration,
            arguments.out,
            registry=LayeredView.named(places) if arguments.from_registry else None,
            reading=reading,
            entry_of=Path(places[0]) if places else None,
            tags=arguments.tags or TAGS,
            max_error_px=arguments.max_error_px,
            force=arguments.force,
            dry_run=arguments.dry_run,
            progress=bar,
        )
    if arguments.json:
        print_json(done)
    else:
        _show(out(arguments), done, arguments.out)
    outcomes = {one.outcome for one in done.images}
    if "unreadable" in outcomes:
        return EXIT_UNREADABLE
    return EXIT_REFUSED if "refused" in outcomes else 0


COLUMNS = (Column(name="image"), Column(name="outcome", style="red"), Column(name="reason", wraps=True))


def _show(screen: Screen, done: StampReport, out: Path) -> None:
    """Show what was written, each note once, the images that were not stamped, and the count."""
    from calibrary.cli.console import plain

    made = [one for one in done.images if one.outcome == "stamped"]
    for used in dict.fromkeys((one.calibration, one.tags) for one in made):
        errors = [one.max_error_px or 0.0 for one in made if (one.calibration, one.tags) == used]
        exact = f"up to {max(errors):.2g} px off" if max(errors) else "exact"
        screen.say(f"{plain(str(used[0]))} in {_counted(len(errors))}, {exact}: {plain(', '.join(used[1]))}")
    for note in dict.fromkeys(note for one in made for note in one.notes):
        screen.say(f"  [yellow]note[/]: {plain(note)}")
    left = [one for one in done.images if one.outcome != "stamped"]
    rows = [(plain(one.file), one.outcome, plain(one.reason or "")) for one in left[:MOST_ROWS]]
    if rows:
        screen.show(fitted(COLUMNS, rows, screen.width))
    if len(left) > MOST_ROWS:
        screen.say(f"[dim]and {len(left) - MOST_ROWS} more; --json lists them all[/]")
    verb = "would be stamped" if done.dry_run else "stamped"
    screen.say(f"{len(made)} of {_counted(len(done.images))} {verb} into {plain(str(out))}")


def _counted(images: int) -> str:
    return f"{images} images" if images != 1 else "1 image"
