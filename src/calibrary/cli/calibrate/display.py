"""Terminal output of a calibration: the views, K with its uncertainty, the verdict with its reasons."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from rich.text import Text

from calibrary.calibration import Calibration, Quality
from calibrary.cli.calibrate.keeping import keep
from calibrary.cli.commands import print_json
from calibrary.cli.console import note, plain, printable
from calibrary.cli.registry.changes import screen_of_change
from calibrary.cli.tables import Column, facts, fitted
from calibrary.probability import two_digits

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.calibrate.report import BoardVerdict, CalibrateReport
    from calibrary.validation import Finding

EXIT_NOT_PASSED = 1
EXIT_UNWRITTEN = 3

STYLES: Final = {
    "pass": "bold green",
    "provisional": "bold yellow",
    "refuse": "bold red",
    "note": "dim",
    "warning": "yellow",
    "unproven": "yellow",
    "error": "red",
}
MOST_VIEWS: Final = 12
"""Most views listed of those that are used, the worst fits first; views that are not used are all listed. The page
has all views; a terminal of forty lines must show K together with the verdict below it."""


def finish(arguments: argparse.Namespace, report: CalibrateReport) -> int:
    """Show a calibration, and keep it as the flags say; returns the exit code that follows."""
    screen = screen_of_change(arguments)
    for remark in report.notes:
        note(arguments).say(f"[dim]note[/]: {plain(remark)}")
    _show(screen, report, correlations=arguments.correlations)
    show_files(screen, arguments, report.unwritten, report.dropped)
    kept = keep(arguments, screen, report.verdict, lambda: [report.entry])
    quality = report.calibration.quality or Quality()
    screen.say("")
    show_findings_of(screen, report.findings)
    show_uses(screen, report)
    show_outcome(
        screen,
        report.verdict,
        f"{plain(str(report.calibration.camera))}: "
        f"{quality.views} of {len(report.views) + len(report.skipped)} {report.shots} of {plain(report.target)}, "
        f"reprojection error (RMS) {quality.rms_px:.3f} px",
    )
    if arguments.json:
        print_json(report, indent=None)
    return exit_code(report.verdict, report.unwritten, kept=kept, is_good=report.is_good)


def show_uses(screen: Screen, report: CalibrateReport) -> None:
    """Show whether each use holds; measuring only if it was asked for."""
    for one in report.uses.shown(report.asked.use):
        style = STYLES["pass" if one.holds else "provisional"]
        said = str(one).removeprefix("yes").removeprefix("no")
        screen.say(f"  {one.words}: [{style}]{'yes' if one.holds else 'no'}[/]{plain(said)}")


def _show(screen: Screen, report: CalibrateReport, *, correlations: bool) -> None:
    """Show what the verdict is based on."""
    width = screen.width - 2
    screen.show(_views(report, width), indent=2)
    screen.say("")
    # A refused calibration shows no K; its numbers are in the report.
    if report.verdict != "refuse":
        screen.show(parameters(report.calibration, width), indent=2)
        if correlations and report.calibration.quality is not None:
            screen.say("")
            screen.show(_correlations(report.calibration.quality, width), indent=2)
        screen.say("")
    screen.show(facts([(name, printable(text)) for name, text in _facts(report)], width), indent=2)


def show_files(
    screen: Screen, arguments: argparse.Namespace, unwritten: str | None, dropped: Sequence[str] = ()
) -> None:
    """Show which of the files that the flags ask for were written, and why one was not."""
    if unwritten is not None:
        screen.say(f"not written: {plain(str(arguments.out))}: {plain(unwritten)}")
    for name in ("html", "keep_corners", "out"):
        path = getattr(arguments, name, None)
        if path is not None and not (name == "out" and unwritten is not None):
            screen.say(f"wrote {plain(str(path))}")
    if dropped:
        screen.say(f"the format has no place for: {plain(', '.join(dropped))}")


def show_outcome(screen: Screen, verdict: BoardVerdict, said: str) -> None:
    """Print the last line."""
    screen.say(f"[{STYLES[verdict]}]{verdict.word.upper()}[/]  {said}")


def exit_code(verdict: str, unwritten: str | None, *, kept: bool, is_good: bool | None = None) -> int:
    """The exit code of a verdict, of a file that could not be written, and of an entry that met an objection.

    Args:
        verdict: pass, provisional or refuse.
        unwritten: why a file was not written.
        kept: whether the registry did not object.
        is_good: whether the use that was asked for holds (default: whether K may be kept fixed).
    """
    if unwritten is not None and verdict != "refuse":
        return EXIT_UNWRITTEN
    good = verdict == "pass" if is_good is None else is_good
    return 0 if good and kept else EXIT_NOT_PASSED


def show_findings_of(screen: Screen, findings: Sequence[Finding]) -> None:
    """Show the reasons of a verdict, one paragraph each."""
    for finding in findings:
        said = str(finding).removeprefix(finding.rule)
        screen.say(f"  [{STYLES[finding.severity.value]}]{finding.rule}[/]{plain(said)}")


PARAMETERS: Final = (Column(name=""), *(Column(name=name, right=True) for name in ("value", "σ", "σ × κ")))
VIEWS: Final = (Column(name="view"), Column(name="RMS px", right=True), Column(name="", rank=1, wraps=True))


def parameters(calibration: Calibration, width: int) -> list[Text]:
    """Table of the parameters with their standard deviations: from the residuals, and times √(variance factor)."""
    quality = calibration.quality or Quality()
    wider = math.sqrt(quality.inflation)
    rows: list[tuple[str, ...]] = []
    K = calibration.intrinsics
    lens = calibration.distortion.shown if calibration.distortion is not None else {}
    values = {"fx": K.fx, "fy": K.fy, "cx": K.cx, "cy": K.cy} | lens
    for name, value in values.items():
        std = quality.std.get(name)
        if std is None and not value:
            continue
        digits = 6 if std is None or std <= 0 else min(9, max(2, 2 - math.floor(math.log10(std))))
        if std is None and value == int(value):
            digits = 0
        spread = ("–", "–") if std is None else (two_digits(std), two_digits(std * wider))
        rows.append((name, f"{value:.{digits}f}", *spread))
    return fitted(PARAMETERS, rows, width)


def _correlations(quality: Quality, width: int) -> list[Text]:
    """Lower triangle of the correlation matrix; a list of pairs if it is wider than the terminal."""
    if quality.covariance is None:
        return []
    names, R = quality.covariance.names, quality.covariance.correlation
    columns = [Column(name="correlations"), *(Column(name=name, right=True) for name in names[:-1])]
    rows = [
        [name, *(f"{R[row, at]:+.2f}" if at < row else "" for at in range(len(names) - 1))]
        for row, name in enumerate(names)
    ]
    if sum(max(len(column.name), 5) + 2 for column in columns) > width:
        columns = [Column(name="correlations"), Column(name="", wraps=True)]
        rows = [
            [name, "  ".join(f"{other}\u00a0{R[row, at]:+.2f}" for at, other in enumerate(names[:row]))]
            for row, name in enumerate(names)
        ]
    return fitted(columns, rows, width)


def _facts(report: CalibrateReport) -> Iterator[tuple[str, str]]:
    """The measurements that the verdict is based on, one line each."""
    seen, quality = report.geometry, report.calibration.quality
    if report.length_unit != "mm" and report.flown is None:
        yield (
            "scale",
            "unknown: the side of a square was not stated, so lengths are in squares (K does not need it)",
        )
    if report.date_origin is not None:
        yield "date", f"{report.calibration.provenance.date or 'unknown'}, {report.date_origin}"
    if report.candidates:
        least = min(one.criterion for one in report.candidates)
        tried = ", ".join(
            f"{one.model.value} {one.criterion - least:+.1f}" + (f" ({one.refused})" if one.refused else "")
            for one in report.candidates
        )
        yield "model", f"{report.model.value}; criterion against the best: {tried}"
    if quality is not None and quality.kappa2 is not None:
        yield (
            "variance factor",
            f"{quality.kappa2:.2f} between halves of the {report.shots}; to keep K fixed, up to "
            f"{report.limits.kappa2_fixed:g}",
        )
    if report.warp is not None:
        digits = 2 if report.length_unit == "mm" else 4
        across, down = (f"{lift:+.{digits}f} {report.length_unit}" for lift in report.warp.lift)
        found = "solved for" if report.warp.kept else "not taken"
        F = report.warp.f if report.warp.f is not None else math.inf
        yield "board warp", f"{across} across, {down} down (F = {F:.1f}), {found}"
    yield from _flown(report)
    if report.flown is None:
        yield (
            "tilt",
            f"normals spread {seen.tilt_spread_deg:.0f}°, farthest ÷ nearest corner {seen.depth_ratio:.2f}",
        )
    yield (
        "coverage",
        f"{seen.coverage.fraction:.0%} of the cells, {seen.coverage.reach:.0%} of the way to the corners",
    )
    proven = quality.proven if quality is not None else None
    if proven is not None:
        within = (
            f"{two_digits(proven.sigma_px)} px where it is proven, " if proven.sigma_px is not None else ""
        )
        yield (
            "uncertainty",
            f"{within}at most {two_digits(proven.edge_px)} px anywhere in the "
            + ("frame" if proven.circle_px is None else "image circle"),
        )


def _flown(report: CalibrateReport) -> Iterator[tuple[str, str]]:
    """The geometry of a flight."""
    flown = report.flown
    if flown is None:
        return
    seen = flown.geometry
    if flown.chosen is not None:
        yield "images", flown.chosen
    yield (
        "flight",
        f"highest ÷ lowest image {seen.height_ratio:.2f}, nine of ten look down within {seen.tilt_deg:.0f}°, headings "
        f"{seen.headings_deg:.0f}° apart, relief {seen.relief:.1%} of the flying height",
    )
    yield (
        "systematic",
        "a tenth of a pixel of systematic error, in images reduced to 1600 px, may move fx by "
        f"{seen.focal_by_px / 10:.1%}",
    )
    if flown.fx_held is not None:
        yield "principal point", f"held in the middle of the image: fx {flown.fx_held:.2f} px"
    for one in flown.nuisances:
        yield "nuisance", one.words
    if flown.control is not None:
        yield "ground control", flown.control.words


def _views(report: CalibrateReport, width: int) -> list[Text]:
    """Table of the frames: whether each is used, and the reason."""
    remarks = {remark.name: remark.message for remark in report.remarks}
    rows: list[tuple[str, str, str]] = []
    worst = sorted((view.rms_px or 0.0 for view in report.views if view.without is None), reverse=True)
    least = worst[MOST_VIEWS] if len(worst) > MOST_VIEWS else -1.0
    for view in report.views:
        if view.without is None:
            if view.rms_px is None or view.rms_px <= least:
                continue
            out = f"{len(view.corners_out)} {report.points} rejected" if view.corners_out else ""
            said = "; ".join(text for text in (out, remarks.get(view.name, "")) if text)
            rows.append((plain(view.name), f"{view.rms_px:.3f}", plain(said)))
        else:
            rms = f"{view.rms_px:.3f}" if view.rms_px is not None else "–"
            why = f"[yellow]{view.without.reason.value}[/]: {plain(view.without.message)}"
            rows.append((plain(view.name), rms, why))
    if len(worst) > MOST_VIEWS:
        rows.append((f"{len(worst) - MOST_VIEWS} more that fit better", f"≤ {least:.3f}", ""))
    for one in report.skipped:
        why = f"[red]{one.reason.value}[/]: {plain(one.message)}"
        rows.append((plain(one.name), "–", why))
    return fitted(VIEWS, rows, width)
