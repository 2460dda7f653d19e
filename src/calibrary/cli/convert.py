"""``calibrary convert``: convert calibration files to another program's format, and report what was lost."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.reading import add_reading_flags, reading_of

if TYPE_CHECKING:
    from calibrary.api.conversion import Converted

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Write a calibration in another program's format, and report what was kept."
EXAMPLES = """\
examples:
  calibrary convert camera.xml camera.yml --to opencv_storage
  calibrary convert K.npy cameras.txt --to colmap_text --image-size 5472x3648
  calibrary convert rig.xml one.yml --to opencv_storage --camera 2
  calibrary convert report.txt lens.xml --to agisoft_xml --max-error-px 0.2
  calibrary convert camera.xml database.db --into all               into the cameras of a COLMAP database
  calibrary convert rigs/ "old/*.yaml" converted/ --to kalibr       many, each into a file of its own

The output is written only if it holds the calibration to 0.05 px anywhere in the image, or to
--max-error-px. The command names what the format cannot contain.

exit code 0: all were written; 3: at least one was not.
"""

EXIT_REFUSED = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "inputs", nargs="+", type=Path, metavar="IN", help="calibration files or images, folders, patterns"
    )
    parser.add_argument(
        "output", type=Path, metavar="OUT", help="file to write; a folder for more than one IN"
    )
    parser.add_argument("--to", metavar="FORMAT", help="the output's format (default: by OUT's name)")
    parser.add_argument("--camera", type=int, metavar="N", help="the Nth camera of a file with several")
    parser.add_argument(
        "--into",
        type=_numbers,
        metavar="N,N|all",
        help="cameras of a COLMAP database that get the calibration",
    )
    parser.add_argument(
        "--max-error-px",
        type=float,
        metavar="X",
        help="largest error a refit may leave anywhere in the image (default: 0.05)",
    )
    parser.add_argument(
        "--allow-prior",
        action="store_true",
        help="write a K that was not measured, such as another program's default",
    )
    parser.add_argument("--force", action="store_true", help="write a K that cannot belong to a camera")
    add_reading_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    [first, *others] = arguments.inputs
    is_pattern = "*" in str(first) and not first.exists()
    several = others or is_pattern or first.is_dir() or arguments.output.is_dir()
    return _many(arguments) if several else _one(arguments)


def _one(arguments: argparse.Namespace) -> int:
    from calibrary.api.conversion import convert
    from calibrary.cli.console import out, plain

    done = convert(
        arguments.inputs[0],
        arguments.output,
        to=arguments.to,
        reading=reading_of(arguments, camera=arguments.camera),
        max_error_px=arguments.max_error_px,
        allow_prior=arguments.allow_prior,
        force=arguments.force,
        into=arguments.into,
    )
    if arguments.json:
        print_json(done.report())
    else:
        screen = out(arguments)
        if done.into:
            cameras = f"camera{'s' if done.into[1:] else ''} {', '.join(map(str, done.into))}"
            screen.say(
                plain(f"wrote {cameras} of {done.output} ({done.format}); its images keep their cameras")
            )
            screen.say(plain(f"to put back what was there: sqlite3 {done.output} < {done.backup}"))
        else:
            screen.say(plain(f"wrote {done.output} ({done.format})"))
        screen.say(plain(str(done.verdict)))
        if done.priors:
            grades = ", ".join(dict.fromkeys(f"{grade.value} ({grade.meaning})" for grade in done.priors))
            screen.say(plain(f"not measured, to start an adjustment with: its K is a {grades}"))
    return 0


def _many(arguments: argparse.Namespace) -> int:
    from calibrary.api.conversion import conversion_report, convert_all
    from calibrary.cli.console import note
    from calibrary.errors import InputError

    if arguments.into is not None:
        raise InputError("--into takes one file; give one IN and the database")
    if arguments.to is None:
        raise InputError("several files are converted into one format; say which with --to FORMAT")
    with Bar(note(arguments), "converting") as bar:
        done = convert_all(
            arguments.inputs,
            arguments.output,
            to=arguments.to,
            reading=reading_of(arguments, camera=arguments.camera),
            max_error_px=arguments.max_error_px,
            allow_prior=arguments.allow_prior,
            force=arguments.force,
            progress=bar,
        )
    if arguments.json:
        print_json(conversion_report(done))
    else:
        _show_many(arguments, done)
    return EXIT_REFUSED if any(one.error is not None for one in done) or not done else 0


def _show_many(arguments: argparse.Namespace, done: Sequence[Converted]) -> None:
    from calibrary.cli.console import out, plain
    from calibrary.cli.tables import Column, fitted

    screen = out(arguments)
    columns = [Column(name="source"), Column(name="written"), Column(name="verdict", wraps=True)]
    rows = []
    for one in done:
        source = str(one.source) + (f", camera {one.camera}" if one.camera is not None else "")
        said = str(one.verdict) if one.verdict is not None else f"refused: {one.error}"
        prior = f"; not measured: a {', '.join(one.priors)}" if one.priors else ""
        rows.append([plain(source), plain(one.output.name if one.output else "—"), plain(said + prior)])
    screen.show(fitted(columns, rows, screen.width))
    written = sum(one.output is not None for one in done)
    screen.say(plain(f"wrote {written} of {len(done)} into {arguments.output}"))


def _numbers(text: str) -> tuple[int, ...] | str:
    if text == "all":
        return text
    parts = text.split(",")
    if not all(part.isdecimal() and len(part) < 11 for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r}: expected camera numbers such as 1,3, or all")
    return tuple(dict.fromkeys(map(int, parts)))
