"""``calibrary convert``: convert calibration files to another program's format, and report what was lost."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.jobs.convert import convert

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.convert.run import ConvertedFile, ConvertReport

DESCRIPTION = "Write a calibration in another program's format, and report what was kept."
EXAMPLES = """\
examples:
  calibrary convert camera.xml camera.yml --to opencv
  calibrary convert K.npy cameras.txt --to colmap --image-size 5472x3648
  calibrary convert rig.xml one.yml --to opencv --camera 2
  calibrary convert camera.xml half.yml --to opencv --scale-to 2736x1824
  calibrary convert camera.xml part.yml --to opencv --crop 100,50,4000,3000
  calibrary convert report.txt lens.xml --to metashape --max-error-px 0.2
  calibrary convert camera.xml database.db --into all               into the cameras of a COLMAP database
  calibrary convert rigs/ "old/*.yaml" converted/ --to kalibr       many, each into a file of its own

The output is written only if it holds the calibration to 0.05 px anywhere in the image, or to
--max-error-px. The command names what the format cannot contain.

exit code 0: all were written; 1: the same, but a K is hardly a camera's, and --force was not given;
3: at least one was not written.
"""

EXIT_UNLIKELY = 1
EXIT_REFUSED = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, convert, positional={"sources": "IN", "output": "OUT"})
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    with Bar(note(arguments), "converting") as bar:
        done = call(convert, arguments, progress=bar)
    if arguments.json:
        print_json(done)
    elif len(done.files) == 1 and done.is_good:
        _show_one(out(arguments), done.files[0], arguments.output)
    else:
        _show_many(out(arguments), done, arguments.output)
    if not done.is_good:
        return EXIT_REFUSED
    return 0 if done.is_likely or arguments.force else EXIT_UNLIKELY


def _show_one(screen: Screen, done: ConvertedFile, place: str) -> None:
    from calibrary.cli.console import plain

    if done.into:
        cameras = f"camera{'s' if done.into[1:] else ''} {', '.join(map(str, done.into))}"
        screen.say(plain(f"wrote {cameras} of {place} ({done.format}); its images keep their cameras"))
        screen.say(
            plain(f"to put back what was there: sqlite3 {place} < {Path(place).parent / str(done.backup)}")
        )
    else:
        screen.say(plain(f"wrote {place} ({done.format})"))
    screen.say(plain(str(done)))
    if done.priors:
        grades = ", ".join(f"{grade.value} ({grade.meaning})" for grade in done.priors)
        screen.say(plain(f"not measured, to start an adjustment with: its K is a {grades}"))


def _show_many(screen: Screen, done: ConvertReport, folder: str) -> None:
    from calibrary.cli.console import plain
    from calibrary.cli.tables import Column, fitted

    columns = [Column(name="source"), Column(name="written"), Column(name="verdict", wraps=True)]
    rows = []
    for one in done.files:
        source = one.source + (f", camera {one.camera}" if one.camera is not None else "")
        prior = f"; not measured: a {', '.join(one.priors)}" if one.priors else ""
        rows.append([plain(source), plain(one.output or "—"), plain(str(one) + prior)])
    screen.show(fitted(columns, rows, screen.width))
    written = sum(one.output is not None for one in done.files)
    screen.say(plain(f"wrote {written} of {len(done.files)} into {folder}"))
