"""``calibrary stamp``: write a calibration into the metadata of image copies, in the tags that programs read."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.stamp import stamp
from calibrary.probability import two_digits

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.stamp.run import StampReport

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

If an image already has a calibration, the copy gets the new one. The content of each copy is read back before it is
written.

exit code 0: every image was stamped; 1: one was refused, because it is of another camera or size, or because the tags
do not hold the calibration; 3: one cannot be read.
"""

EXIT_REFUSED = 1
EXIT_UNREADABLE = 3
MOST_ROWS = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, stamp, positional={"images": "IMAGE"}, exclusive=[("calibration", "from_registry")])
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    with Bar(note(arguments), "stamping") as bar:
        done = call(stamp, arguments, progress=bar)
    if arguments.json:
        print_json(done)
    else:
        _show(out(arguments), done, arguments.out or "stamped")
    if any(one.outcome == "unreadable" for one in done.images):
        return EXIT_UNREADABLE
    return 0 if done.is_good else EXIT_REFUSED


COLUMNS = (Column(name="image"), Column(name="outcome", style="red"), Column(name="reason", wraps=True))


def _show(screen: Screen, done: StampReport, out: str) -> None:
    """Show what was written, each note once, the images that were not stamped, and the count."""
    from calibrary.cli.console import plain

    made = [one for one in done.images if one.outcome == "stamped"]
    for used in dict.fromkeys((one.calibration, one.tags) for one in made):
        errors = [one.max_error_px or 0.0 for one in made if (one.calibration, one.tags) == used]
        exact = f"up to {two_digits(max(errors))} px off" if max(errors) else "exact"
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
    screen.say(f"{len(made)} of {_counted(len(done.images))} {verb} into {plain(out)}")


def _counted(images: int) -> str:
    return f"{images} images" if images != 1 else "1 image"
