"""``calibrary inspect``: what a calibration file or an image is, why we think so, and what it says."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.reading import Answers, add_reading_flags
from calibrary.errors import CalibraryError
from calibrary.records import replace

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import Console

    from calibrary.calibration import Calibration
    from calibrary.records import Json

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary inspect camera.xml                          what it is, K, distortion, conventions
  calibrary inspect flight/DJI_0001.JPG                 what an image says of its camera
  calibrary inspect K.npy --image-size 5472x3648
  calibrary inspect handed-over/ --json                 every file of a folder, for machines

exit code 0: every file was read; 3: at least one was not.
"""

EXIT_UNREADABLE = 3


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "inspect",
        help="tell what a calibration file or image is and what it says",
        description="Tell what a calibration file or image is, why we think so, and what it says.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="files or folders")
    add_reading_flags(parser)
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    parser.set_defaults(run=_run)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspected:
    """One file and what came of it."""

    path: Path
    format: str | None = None
    title: str | None = None
    why: str | None = None
    sentences: tuple[str, ...] = ()
    calibrations: tuple[Calibration, ...] = ()
    warnings: tuple[str, ...] = ()
    error: str | None = None


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import make_console

    answers = Answers.of(arguments)
    paths = list(_files(arguments.files))
    inspected = list(_inspect_all(paths, answers))
    if arguments.json:
        _print_json(inspected, alone=len(arguments.files) == 1 and not arguments.files[0].is_dir())
    else:
        console = make_console(stderr=False)
        for one in inspected:
            _show(console, one)
    return EXIT_UNREADABLE if any(one.error is not None for one in inspected) else 0


def _files(given: Sequence[Path]) -> Iterator[Path]:
    from calibrary.jobs.extract.gather import find_files

    for path in given:
        if path.is_dir():
            yield from find_files(path, recursive=True)
        else:
            yield path


def _inspect_all(paths: Sequence[Path], answers: Answers) -> Iterator[Inspected]:
    from rich.progress import track

    from calibrary.cli.console import make_console

    console = make_console(stderr=True)
    quiet = len(paths) < 2 or not console.is_terminal
    for path in track(paths, "inspecting", console=console, transient=True, disable=quiet):
        yield _inspect(path, answers)


def _inspect(path: Path, answers: Answers) -> Inspected:
    try:
        return replace(_described(path, answers), calibrations=tuple(answers.read(path)))
    except CalibraryError as error:
        return Inspected(path=path, error=str(error))


def _described(path: Path, answers: Answers) -> Inspected:
    """What the file is and how it counts."""
    from calibrary import parsers
    from calibrary.parsers.discovery import format_named
    from calibrary.parsers.image_names import is_image
    from calibrary.parsers.images import image_evidence

    if answers.format is None and is_image(path):
        evidence = image_evidence(path)
        warnings = [f"{dropped.tag} is not believed: {dropped.reason}" for dropped in evidence.dropped]
        warnings += [f"{c.other.tag} disagrees by {c.difference:+.1%}: {c.cause}" for c in evidence.conflicts]
        return Inspected(path=path, format="image", title="an image's metadata", warnings=tuple(warnings))
    if answers.format is not None:
        record, why = format_named(answers.format), "you said so"
    else:
        identity = parsers.identify(path)
        record, why = identity.format, identity.sniff.why
    sentences = record.convention.sentences() if record.convention is not None else ()
    return Inspected(path=path, format=record.name, title=record.title, why=why, sentences=sentences)


def _print_json(inspected: Sequence[Inspected], *, alone: bool) -> None:
    documents = [_json(one) for one in inspected]
    told: dict[str, Json] = documents[0] if alone else {"files": list(documents)}
    document: dict[str, Json] = {"schema": "calibrary/inspect-1", **told}
    text = json.dumps(document, indent=2, ensure_ascii=True, allow_nan=False)
    sys.stdout.write(f"{text}\n")


def _json(one: Inspected) -> dict[str, Json]:
    from calibrary.records import to_json

    return {
        "file": one.path.name,
        "format": one.format,
        "why": one.why,
        "conventions": list(one.sentences),
        "calibrations": [to_json(calibration) for calibration in one.calibrations],
        "warnings": list(one.warnings),
        "error": one.error,
    }


def _show(console: Console, one: Inspected) -> None:
    from calibrary.cli.console import plain

    console.print(f"[bold]{plain(str(one.path))}[/]", highlight=False, soft_wrap=True)
    if one.error is not None:
        console.print(f"  [red]not read[/]: {plain(one.error)}\n", highlight=False, soft_wrap=True)
        return
    why = f": {plain(one.why)}" if one.why else ""
    console.print(f"  {plain(one.title or '')}{why}", highlight=False, soft_wrap=True)
    for calibration in one.calibrations:
        _show_calibration(console, calibration)
    for sentence in one.sentences:
        console.print(f"  [dim]{plain(sentence)}[/]", highlight=False, soft_wrap=True)
    for warning in one.warnings:
        console.print(f"  [yellow]{plain(warning)}[/]", highlight=False, soft_wrap=True)
    console.print()


def _show_calibration(console: Console, calibration: Calibration) -> None:
    from calibrary.cli.console import plain

    K, distortion = calibration.intrinsics, calibration.distortion
    lines = [
        f"  [cyan]{plain(str(calibration.camera))}[/]  {calibration.grade.value}",
        f"    fx {K.fx:.4f}  fy {K.fy:.4f}  cx {K.cx:.4f}  cy {K.cy:.4f}"
        + (f"  skew {K.skew:.6g}" if K.skew else "")
        + f"  in {K.image_size[0]}×{K.image_size[1]} px from the outer corner",
    ]
    if distortion is None:
        lines.append("    distortion unknown")
    else:
        coefficients = "  ".join(f"{name} {value:.8g}" for name, value in distortion.coefficients.items())
        lines.append(f"    distortion {distortion.model}  {coefficients}")
    if calibration.quality is not None and calibration.quality.rms_px is not None:
        lines.append(f"    rms {calibration.quality.rms_px:.4g} px")
    lines += [f"    assumed: {plain(text)}" for text in calibration.provenance.assumptions]
    lines += [f"    note: {plain(text)}" for text in calibration.notes]
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)
