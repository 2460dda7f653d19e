"""``calibrary inspect``: what a calibration file or an image is, why we think so, and what it says."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.reading import Answers, add_reading_flags
from calibrary.errors import CalibraryError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibrary.calibration import Calibration
    from calibrary.cli.console import Screen

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Tell what a calibration file or image is, why we think so, and what it says."
EXAMPLES = """\
examples:
  calibrary inspect camera.xml                          what it is, K, distortion, conventions
  calibrary inspect flight/DJI_0001.JPG                 what an image says of its camera
  calibrary inspect K.npy --image-size 5472x3648
  calibrary inspect handed-over/ --json                 every file of a folder, for machines

exit code 0: every file was read; 3: at least one was not.
"""

EXIT_UNREADABLE = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="files or folders")
    add_reading_flags(parser)
    add_json_flag(parser)


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


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out

    paths = list(_files(arguments.files))
    inspected = list(_inspect_all(paths, arguments))
    if arguments.json:
        _print_json(inspected, alone=len(arguments.files) == 1 and not arguments.files[0].is_dir())
    else:
        screen = out(arguments)
        for one in inspected:
            _show(screen, one)
    return EXIT_UNREADABLE if any(one.error is not None for one in inspected) else 0


def _files(given: Sequence[Path]) -> Iterator[Path]:
    from calibrary.jobs.extract.gather import find_files

    for path in given:
        if path.is_dir():
            yield from find_files(path, recursive=True)
        else:
            yield path


def _inspect_all(paths: Sequence[Path], arguments: argparse.Namespace) -> Iterator[Inspected]:
    from rich.progress import track

    from calibrary.cli.console import note

    answers, remarks = Answers.of(arguments), note(arguments)
    quiet = len(paths) < 2 or not remarks.is_terminal or remarks.quiet
    for path in track(paths, "inspecting", console=remarks, transient=True, disable=quiet):
        yield _inspect(path, answers)


def _inspect(path: Path, answers: Answers) -> Inspected:
    from calibrary.records import replace

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
    from msgspec.structs import asdict

    from calibrary.jobs.inspect.report import InspectedFile, InspectFilesReport, InspectReport

    files = [
        InspectedFile(
            file=one.path.name,
            format=one.format,
            why=one.why,
            conventions=one.sentences,
            calibrations=one.calibrations,
            warnings=one.warnings,
            error=one.error,
        )
        for one in inspected
    ]
    print_json(InspectReport(**asdict(files[0])) if alone else InspectFilesReport(files=tuple(files)))


def _show(screen: Screen, one: Inspected) -> None:
    from calibrary.cli.console import plain

    screen.say(f"[bold]{plain(str(one.path))}[/]")
    if one.error is not None:
        screen.say(f"  [red]not read[/]: {plain(one.error)}")
        screen.say("")
        return
    why = f": {plain(one.why)}" if one.why else ""
    screen.say(f"  {plain(one.title or '')}{why}")
    for calibration in one.calibrations:
        _show_calibration(screen, calibration)
    for sentence in one.sentences:
        screen.say(f"  [dim]{plain(sentence)}[/]")
    for warning in one.warnings:
        screen.say(f"  [yellow]{plain(warning)}[/]")
    screen.say("")


def _show_calibration(screen: Screen, calibration: Calibration) -> None:
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
        screen.say(line)
