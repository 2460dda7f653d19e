"""``calibrary calibrate combine``: combine several calibrations of one camera, if they agree."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING

from calibrary.cli.calibrate.keeping import add_keeping_flags, check_keeping, keep
from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.jobs.combine import combine
from calibrary.probability import two_digits

if TYPE_CHECKING:
    from calibrary.jobs.combine.report import CombinationReport

DESCRIPTION = """\
Combine several calibrations of one camera into one, weighted by their covariances, if they agree.

FILE is a calibration file that contains a covariance, the JSON that calibrate --json printed, KEY[@REV] of an entry,
or the folder of a flight: its images, or its reconstruction by COLMAP, OpenSfM or ODM. Flights are solved together by
their observations: one lens, which may drift over the days, and poses, points and what else shifts the images of each
flight apart. Flights that are too weak alone may be good together.

Two cameras are never averaged: the command refuses files of two cameras, of another focus, image size or lens model,
and files that disagree by more than their noise. It states which files disagree, and by how many px. A calibration
that only another program states is provisional at most, because its σ was never tested with halves of its images.
"""
EXAMPLES = """\
examples:
  calibrary calibrate combine spring.json summer.json autumn.json --registry ../fleet --html combined.html
  calibrary calibrate combine flight1.json flight2.json --out camera.xml --to agisoft_xml
  calibrary calibrate combine spring/ summer/ autumn/ --registry ../fleet --html season.html
  calibrary calibrate combine metashape/cameras.xml --make DJI --model FC6310R --json

exit codes: 0 FIXED; 1 START or NONE, or an error of the registry's check; 3 unreadable input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(
        parser,
        combine,
        positional={"sources": "FILE"},
        without=("tool",),
        groups={
            "what is written": ("html", "out", "to"),
            "the registry": ("registry", "as_"),
        },
    )
    add_keeping_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.calibrate.display import (
        exit_code,
        parameters,
        show_files,
        show_findings_of,
        show_outcome,
    )
    from calibrary.cli.console import note, plain
    from calibrary.cli.registry.changes import screen_of_change
    from calibrary.cli.tables import Column, fitted

    check_keeping(arguments)
    with Bar(note(arguments), "flights:") as bar:
        report = call(combine, arguments, progress=bar)
    screen = screen_of_change(arguments)
    width = screen.width - 2
    columns = (
        Column(name="calibration"),
        Column(name="date", rank=2),
        *(Column(name=name, right=True) for name in ("fx px", "σ × κ", "from the others px", "p")),
    )
    screen.show(fitted(columns, list(_rows(report)), width), indent=2)
    if report.calibration is not None:
        screen.say("")
        screen.show(parameters(report.calibration, width), indent=2)
    show_files(screen, arguments, report.unwritten, report.dropped)
    kept = keep(arguments, screen, report.verdict, lambda: [report.entry])
    screen.say("")
    show_findings_of(screen, report.findings)
    number = len(report.sources)
    camera = f"{plain(str(report.calibration.camera))}: " if report.calibration is not None else ""
    said = f"{camera}{number} calibrations{' as one' if camera else ''}"
    show_outcome(screen, report.verdict, said if number > 1 else f"{camera}one calibration as it stands")
    if arguments.json:
        print_json(report, indent=None)
    return exit_code(report.verdict, report.unwritten, kept=kept)


def _rows(report: CombinationReport) -> Iterator[tuple[str, ...]]:
    from calibrary.cli.console import plain

    for one in report.sources:
        off = "–" if one.off_px is None else f"{two_digits(one.off_px)} ± {one.off_std_px or 0.0:.1g}"
        yield (
            plain(one.label),
            one.date or "–",
            f"{one.fx:.2f}",
            two_digits(one.fx_std) if one.fx_std is not None else "–",
            off,
            f"{one.p:.2g}" if one.p is not None else "–",
        )
