"""``calibrary demo``: synthesise images of a flight with different cameras, to try calibrary on."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.flags import call
from calibrary.cli.shown import Shown
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.demo import demo

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrary.cli.console import Screen
    from calibrary.jobs.demo.flight import DemoImage

DESCRIPTION = "Write the synthetic flight of a mixed fleet and other folders to try the commands on."
EXAMPLES = """\
examples:
  calibrary demo .               write ./flight, ./survey, ./odd-camera and ./payload, and list the flight
  calibrary demo tryout --seed 3

The images are synthetic, some of those of the flight bad on purpose. The list states how each should be judged, and
why. The commands of the README can be typed in DIR.
"""


COLUMNS = (
    Column(name="file"),
    Column(name="camera", rank=3),
    Column(name="should be", rank=1),
    Column(name="fx px", rank=2, right=True),
    Column(name="reason", rank=4, wraps=True),
)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    folder = Path(arguments.folder)
    images = call(demo, arguments)
    screen = out(arguments)
    _show(screen, images)
    size_mb = sum((folder / image.name).stat().st_size for image in images) / 1e6
    screen.say(f"{len(images)} files, {size_mb:.1f} MB, in {folder / 'flight'!s}")
    screen.say("beside it, for the commands of the README: survey, odd-camera and payload")
    remarks = note(arguments)
    remarks.say("next:")
    remarks.verbatim(f"  calibrary extract {shlex.quote(str(folder / 'flight'))} --recursive")
    return 0


def _show(screen: Screen, images: Sequence[DemoImage]) -> None:
    """Show the images as a table; images of one camera that demonstrate the same case share a row."""
    from calibrary.records import replace

    styles = {"valid": "green", "unproven": "yellow", "rejected": "red"}
    stories: dict[DemoImage, list[str]] = {}
    for image in images:
        stories.setdefault(replace(image, name="", private=()), []).append(image.name)
    rows = [
        (
            names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more",
            image.camera,
            (str(image.outcome), styles.get(image.outcome.value, "magenta")),
            "–" if image.fx_px is None else f"{image.fx_px:.1f}",
            f"{image.story}: {image.reason}",
        )
        for image, names in stories.items()
    ]
    screen.show(fitted(COLUMNS, rows, screen.width))


COMMAND = Shown(demo, DESCRIPTION, EXAMPLES, run=run, positional={"folder": "DIR"}, json=False)
