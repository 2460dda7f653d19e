"""``calibrary extract``: one valid K per camera from a flight's images."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibrary.cli.commands import add_table_flag, check_table_flag, write_table
from calibrary.cli.flags import call, help_group
from calibrary.cli.shown import Shown
from calibrary.errors import InputError
from calibrary.jobs.extract import extract
from calibrary.jobs.tables import cameras, images

if TYPE_CHECKING:
    from calibrary.jobs.extract.report import ExtractReport

DESCRIPTION = "Derive and validate one K per camera from a directory of images."
EXAMPLES = """\
examples:
  calibrary extract flight/                      one K per camera, from the images
  calibrary extract flight/ --recursive --json   the same for machines
  calibrary extract flight/ --sensor-width-mm 13.2 --sensor-height-mm 8.8
  calibrary extract web.jpg --camera FC6310      an image without EXIF, whose camera you know
  calibrary extract flight/ --registry ../fleet-registry --to colmap
  calibrary extract flight/ --to odm --task survey    a folder that ODM and WebODM process as it is
  calibrary extract flight/ --html flight.html   the same as a page
  calibrary extract flight/ --image-table images.parquet   the K of every image, for a data frame
  calibrary extract flight/ --verify             compare K with the pixels too
  calibrary extract s3://bucket/2024/            images in a bucket
  find . -name '*.JPG' | calibrary extract --from -

exit code 0: every image has a valid K; 1: at least one has none or cannot be read, or nothing could be handed off;
3: some were not read, because the processes that read them were killed; the report has the others.
Pictures that no camera took, such as a preview or a map, are skipped with a line and do not count.
"""

DOING = {
    "images": "reading images",
    "features": "finding features",
    "pairs": "matching pairs of images",
    "placed": "placing images",
}
SOURCE_DOCUMENT = "flags of the source document"
GROUPS = {
    "which images": ("recursive", "workers", "cluster"),
    "limits that K is checked against": ("policy", "verify"),
    "what is known of the cameras": ("sensor", "camera", "focal_mm", "registry", "locked", "fallback_camera"),
    "what is written": (
        *("to", "database", "task", "copy_images", "drop_distortion", "include_unproven"),
        *("html", "list_images", "dry_run"),
    ),
    SOURCE_DOCUMENT: (
        "sensor_width_mm",
        "sensor_height_mm",
        "max_focal_deviation_pct",
        "principal_point_tolerance",
        "fallback_k",
        "out",
        "strict_validation",
    ),
}
SPELLED = {
    # The source document's names, two of which ours are better than.
    "out": ("--out", "--output-matrix"),
    "principal_point_tolerance": ("--principal-point-tolerance", "--principal-point-tolerance-px"),
}


def _folders(arguments: argparse.Namespace) -> list[str]:
    """The images and folders to read in addition to a list."""
    named = [arguments.image_dir] if arguments.image_dir else arguments.images
    return named or ([] if arguments.list_file else ["./input/"])


@contextmanager
def _lines(arguments: argparse.Namespace) -> Iterator[Iterable[str] | None]:
    """The lines of --from."""
    if arguments.list_file is None:
        yield None
    elif arguments.list_file == "-":
        yield sys.stdin
    else:
        try:
            file = Path(arguments.list_file).open(encoding="utf-8", errors="surrogateescape")  # noqa: SIM115  below
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(f"cannot be read: {reason}", source=arguments.list_file) from None
        with file:
            yield file


class _Extract(Shown):
    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the flags, with the places of images that are no parameters and the second table."""
        images = parser.add_argument_group("which images")
        images.add_argument(
            "--from",
            dest="list_file",
            metavar="FILE",
            help="read the images, folders and URLs that FILE lists, one on each line; - is standard input",
        )
        super().add_arguments(parser)
        help_group(parser, SOURCE_DOCUMENT).add_argument(
            "--image-dir", metavar="DIR", help="same as DIR, as a flag (default: ./input/)"
        )
        parser.set_defaults(out="K_matrix.npy")
        add_table_flag(parser, "the cameras")
        add_table_flag(parser, "the images, each with the K of its camera", name="--image-table")

    def check(self, arguments: argparse.Namespace) -> None:
        check_table_flag(arguments)
        check_table_flag(arguments, name="image_table")
        if arguments.table == arguments.image_table == "-":
            arguments.parser.error("--table and --image-table are two tables: one of them into a file")
        if arguments.images and arguments.image_dir:
            arguments.parser.error("DIR and --image-dir are the same; give one of them")

    def done(self, arguments: argparse.Namespace, _: Any = None) -> ExtractReport:
        """Extract, and write the tables."""
        from calibrary.cli.console import note
        from calibrary.cli.progress import Bar

        wanted: dict[str, Any] = {"list_images": True} if arguments.image_table is not None else {}
        with _lines(arguments) as lines, Bar(note(arguments), "") as bar:
            result = call(
                extract,
                arguments,
                images=_folders(arguments),
                lines=lines,
                progress=lambda done, total, what: bar(done, total, DOING[what]),
                **wanted,
            )
        for place, table in ((arguments.table, cameras), (arguments.image_table, images)):
            if place == "-" or not arguments.dry_run:
                write_table(place, partial(table, result))
        return result

    def print_document(self, done: ExtractReport, arguments: argparse.Namespace) -> None:
        """Print the same bytes as in the report file, whatever the terminal's encoding."""
        from calibrary.cli.console import note
        from calibrary.jobs.extract.report import encode

        sys.stdout.flush()
        planned = done.outputs
        sys.stdout.buffer.write(planned.files[planned.report] if planned.report else encode(done))
        for warning in done.warnings:
            note(arguments).say(("note", "yellow"), f": {warning}")

    def show(self, done: ExtractReport, arguments: argparse.Namespace, **_: Any) -> None:
        super().show(done, arguments, files=True)

    def exit_code(self, done: ExtractReport, _: argparse.Namespace) -> int:
        return int(done.exit_code)


COMMAND = _Extract(
    extract,
    DESCRIPTION,
    EXAMPLES,
    positional={"images": "DIR"},
    groups=GROUPS,
    spelled=SPELLED,
    without=["lines"],
    bare={"locked": "calibrary.lock"},
    switches={"--explain": "show all evidence of each camera, and the fallbacks tried"},
)
