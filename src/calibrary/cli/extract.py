"""``calibrary extract``: one valid K per camera from a flight's images."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, add_table_flag, check_table_flag, write_table
from calibrary.cli.registry.place import add_layers_flag
from calibrary.errors import InputError

if TYPE_CHECKING:
    from calibrary.api.images import ExtractResult
    from calibrary.policy import Policy

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Derive and validate one K per camera from a directory of images."
EXAMPLES = """\
examples:
  calibrary extract flight/                      one K per camera, from the images
  calibrary extract flight/ --recursive --json   the same for machines
  calibrary extract flight/ --sensor-width-mm 13.2 --sensor-height-mm 8.8
  calibrary extract flight/ --registry ../fleet-registry --hand-off colmap
  calibrary extract flight/ --hand-off odm --task survey    a folder that ODM and WebODM process as it is
  calibrary extract flight/ --html flight.html   the same as a page
  calibrary extract flight/ --image-table images.parquet   the K of every image, for a data frame
  calibrary extract flight/ --verify             compare K with the pixels too
  calibrary extract s3://bucket/2024/ --resume parts   images in a bucket; continue where it stopped
  find . -name '*.JPG' | calibrary extract --from -

exit code 0: every image has a valid K; 1: at least one has none or cannot be read, or nothing could be handed off;
3: some were not read, because the processes that read them were killed; the report has the others.
Pictures that no camera took, such as a preview or a map, are skipped with a line and do not count.
"""


IMAGE_DIR = "".join(("./", "input/"))
"""Built at run time, so that ``is`` distinguishes the default from the same text typed by the user."""


class _Given(float):
    """A number typed by the user, as opposed to the default."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    _add_image_flags(parser)
    _add_limit_flags(parser)
    _add_knowledge_flags(parser)
    _add_output_flags(parser)
    add_json_flag(parser)
    add_table_flag(parser, "the cameras")
    add_table_flag(parser, "the images, each with the K of its camera", name="--image-table")


def _add_image_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of the input. Eight flags, here and below, have the source document's names and defaults."""
    images = parser.add_argument_group("which images")
    images.add_argument(
        "folder",
        nargs="?",
        metavar="DIR",
        help="folder of images, zip or tar file, or URL (https://, s3://, gs://, az://, …) (default: ./input/)",
    )
    images.add_argument(
        "--from",
        dest="list_file",
        metavar="FILE",
        help="read the images, folders and URLs that FILE lists, one on each line; - is standard input",
    )
    images.add_argument("--image-dir", default=IMAGE_DIR, metavar="DIR", help="same as DIR, as a flag")
    images.add_argument("--recursive", action="store_true", help="include sub-folders")
    images.add_argument(
        "--workers",
        type=_count,
        default=0,
        metavar="N",
        help="number of processes that read images (default for large flights: one for each core)",
    )
    images.add_argument(
        "--resume",
        metavar="DIR",
        help="store what is read in DIR; if you run the same command again, it reads only what is missing there",
    )
    cluster = images.add_mutually_exclusive_group()
    cluster.add_argument(
        "--scheduler", metavar="URL", help="read with the workers of this Dask scheduler, as tcp://host:8786"
    )
    cluster.add_argument(
        "--cluster", metavar="local:N", help="read with N workers of a Dask cluster on this machine"
    )


def _add_limit_flags(parser: argparse.ArgumentParser) -> None:
    limits = parser.add_argument_group("limits that K is checked against")
    limits.add_argument(
        "--policy",
        default="fleet",
        metavar="{fleet,source}|FILE",
        help="'fleet' knows real UAV cameras, 'source' requires fx within 0.8 … 1.5 W of every camera; or your own "
        "YAML file (default: fleet)",
    )
    limits.add_argument(
        "--max-focal-deviation-pct",
        type=_per_cent,
        default=15.0,
        metavar="PCT",
        help="largest |fx − fy| / max(fx, fy) in per cent (default: 15.0)",
    )
    limits.add_argument(
        "--principal-point-tolerance-px",
        type=_fraction,
        default=0.05,
        metavar="FRACTION",
        help="largest offset of the principal point from the middle, as a FRACTION of the side, despite the name of "
        "the flag (default: 0.05)",
    )
    limits.add_argument(
        "--principal-point-tolerance",
        type=_fraction,
        metavar="FRACTION",
        help="same as --principal-point-tolerance-px, under a clearer name",
    )
    limits.add_argument(
        "--verify",
        action="store_true",
        help="also compare K with the pixels of a dozen images of each camera; the answer is agrees, contradicts or "
        "cannot tell (needs calibrary[sfm]; up to a minute for each camera)",
    )
    limits.add_argument(
        "--strict-validation", action="store_true", help="stop at the first broken rule and write nothing"
    )


def _add_knowledge_flags(parser: argparse.ArgumentParser) -> None:
    known = parser.add_argument_group("what is known of the cameras")
    known.add_argument(
        "--sensor-width-mm",
        type=_millimetres,
        default=13.2,
        metavar="MM",
        help="physical sensor width, for a folder with one camera (default: that of the camera if it is known or its "
        "images state one; otherwise 13.2, marked as assumed)",
    )
    known.add_argument(
        "--sensor-height-mm",
        type=_millimetres,
        default=8.8,
        metavar="MM",
        help="physical sensor height (default: as for the width, 8.8)",
    )
    add_layers_flag(
        known,
        "the registry of the fleet: a git repository, bare or checked out, as committed; folder:PATH for files "
        "without git; or the https:// address of a published registry; or none. calibrary registry --help explains "
        "the default; if you give several, the first that "
        "answers is used",
    )
    known.add_argument(
        "--locked",
        nargs="?",
        type=Path,
        const=Path("calibrary.lock"),
        metavar="LOCKFILE",
        help="use only the entries of the registry that LOCKFILE pins, as they were then; an error if that state is "
        "lost (default LOCKFILE: calibrary.lock)",
    )
    known.add_argument(
        "--fallback-k", metavar="FILE", help="a calibrated K (.npy) to use if the images yield none"
    )


def _add_output_flags(parser: argparse.ArgumentParser) -> None:
    written = parser.add_argument_group("what is written")
    written.add_argument(
        "--output-matrix",
        default="K_matrix.npy",
        metavar="FILE",
        help="file for a valid K; with several cameras, each file name contains the name of the camera; a K that is "
        "not valid has 'unproven' or 'seed' in the name (default: K_matrix.npy)",
    )
    written.add_argument(
        "--hand-off",
        choices=["colmap", "opensfm", "odm", "opencv", "metashape", "pix4d", "realityscan", "none"],
        default="none",
        help="also write the files that this solver needs, for cameras with a valid K (default: none)",
    )
    written.add_argument(
        "--database",
        type=Path,
        metavar="FILE",
        help="with --hand-off colmap: also write the cameras into this COLMAP database, which has the images; an SQL "
        "file keeps the old cameras",
    )
    written.add_argument(
        "--task",
        type=Path,
        metavar="DIR",
        help="with --hand-off odm or opensfm: make a folder DIR that the program can process as it is, with the "
        "images as hard links, the cameras and the options",
    )
    written.add_argument(
        "--copy-images", action="store_true", help="with --task: copy the images, do not link"
    )
    written.add_argument("--html", type=Path, metavar="FILE", help="also write the report as a page")
    written.add_argument("--job", metavar="NAME", help="with --html: the job, at the top of the page")
    written.add_argument(
        "--operator", metavar="NAME", help="with --html: the operator, at the top of the page"
    )
    written.add_argument(
        "--list-images",
        action="store_true",
        help="name every image in the report; without it, the report of more than 10 000 images names only a few, "
        "unless a solver needs them all",
    )
    written.add_argument("--dry-run", action="store_true", help="judge everything and write nothing")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.processes import ready_to_read

    _check_flags(arguments)
    if arguments.scheduler is None and arguments.cluster is None:
        ready_to_read(arguments.workers)
    from calibrary.api.images import check_place, check_task_place, extract, write_outputs
    from calibrary.api.pages import check_page_place
    from calibrary.cli.console import note, out
    from calibrary.cli.extract_display import Display

    matrix = Path(arguments.output_matrix)
    check_place(matrix)
    if arguments.html is not None:
        check_page_place(arguments.html)
    if arguments.task is not None:
        check_task_place(arguments.task)
    with _lines(arguments) as lines, Display(out(arguments), note(arguments)) as display:
        result = extract(
            _given(arguments),
            lines=lines,
            sensor_mm=_sensor(arguments),
            policy=_policy(arguments),
            fallback_k=arguments.fallback_k or None,
            registry=arguments.registry,
            locked=arguments.locked,
            recursive=arguments.recursive,
            workers=arguments.workers,
            strict_validation=arguments.strict_validation,
            verify=arguments.verify,
            resume=arguments.resume,
            scheduler=arguments.scheduler,
            cluster=arguments.cluster,
            list_images=arguments.list_images
            or arguments.hand_off != "none"
            or arguments.image_table is not None,
            days=arguments.html is not None,
            progress=display.progress,
        )
    outputs = result.outputs(
        matrix,
        hand_off=arguments.hand_off,
        page=arguments.html,
        database=arguments.database,
        task=arguments.task,
        copy_images=arguments.copy_images,
        job=arguments.job,
        operator=arguments.operator,
    )
    if not arguments.dry_run:
        write_outputs(outputs)
    _write_tables(arguments, result)
    if arguments.json:
        # The same bytes as in the report file, whatever the terminal's encoding.
        sys.stdout.flush()
        sys.stdout.buffer.write(outputs.report)
    display.show(result.extraction, outputs, solver=arguments.hand_off, dry_run=arguments.dry_run)
    return outputs.exit_code


def _check_flags(arguments: argparse.Namespace) -> None:
    """End with a usage error for flags that need another flag, and for tables that cannot be written."""
    if arguments.database is not None and arguments.hand_off != "colmap":
        arguments.parser.error("--database is for --hand-off colmap")
    if arguments.task is not None and arguments.hand_off not in {"odm", "opensfm"}:
        arguments.parser.error("--task is for --hand-off odm and --hand-off opensfm")
    if arguments.copy_images and arguments.task is None:
        arguments.parser.error("--copy-images is for --task DIR")
    if arguments.html is None and (arguments.job is not None or arguments.operator is not None):
        arguments.parser.error("--job and --operator are for --html")
    check_table_flag(arguments)
    check_table_flag(arguments, name="image_table")
    if arguments.table == arguments.image_table == "-":
        arguments.parser.error("--table and --image-table are two tables: one of them into a file")


def _write_tables(arguments: argparse.Namespace, result: ExtractResult) -> None:
    """Write the requested tables; to files only if this is not a dry run."""
    if arguments.table is None and arguments.image_table is None:
        return
    from calibrary.api.tables import cameras, images

    for place, table in ((arguments.table, cameras), (arguments.image_table, images)):
        if place == "-" or not arguments.dry_run:
            write_table(place, partial(table, result))


def _given(arguments: argparse.Namespace) -> list[str]:
    """The images and folders to read in addition to a list."""
    if arguments.folder is not None and arguments.image_dir is not IMAGE_DIR:
        arguments.parser.error("DIR and --image-dir are the same; give one of them")
    if arguments.folder is not None:
        return [arguments.folder]
    return [] if arguments.list_file and arguments.image_dir is IMAGE_DIR else [arguments.image_dir]


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


def _sensor(arguments: argparse.Namespace) -> tuple[float | None, float | None]:
    width, height = arguments.sensor_width_mm, arguments.sensor_height_mm
    return (
        float(width) if isinstance(width, _Given) else None,
        float(height) if isinstance(height, _Given) else None,
    )


def _policy(arguments: argparse.Namespace) -> Policy:
    """The named policy, with the limits given by flags in place of its own."""
    from calibrary.api.images import policy_of
    from calibrary.records import replace

    policy = policy_of(arguments.policy)
    if isinstance(arguments.max_focal_deviation_pct, _Given):
        policy = replace(policy, focal_symmetry_max=arguments.max_focal_deviation_pct / 100.0)
    tolerance = arguments.principal_point_tolerance
    if tolerance is None:
        tolerance = arguments.principal_point_tolerance_px
    if isinstance(tolerance, _Given):
        policy = replace(policy, principal_point_drift_max=float(tolerance))
    return policy


def _millimetres(text: str) -> _Given:
    return _between(text, 0.1, 1000.0, "a positive number of millimetres")


def _per_cent(text: str) -> _Given:
    return _between(text, 0.0, 100.0, "per cent, 0 … 100")


def _fraction(text: str) -> _Given:
    return _between(text, 0.0, 1.0, "a fraction of the side, 0 … 1")


def _between(text: str, low: float, high: float, wanted: str) -> _Given:
    try:
        value = _Given(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number, expected {wanted}") from None
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text} is out of range, expected {wanted}")
    return value


def _count(text: str) -> int:
    if not text.isdecimal() or not 0 <= int(text) <= 256:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number of processes, 0 … 256")
    return int(text)
