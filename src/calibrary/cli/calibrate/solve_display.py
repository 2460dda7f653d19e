"""Terminal output of a calibration: the views, K with its uncertainty, the verdict with its reasons."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.text import Text

from calibrary.calibration import Calibration, Quality
from calibrary.cli.console import note, plain, printable
from calibrary.cli.registry.asking import deciding_screen
from calibrary.cli.registry.changes import show_changes, show_findings, show_written
from calibrary.cli.registry.place import where
from calibrary.cli.tables import Column, facts, fitted

if TYPE_CHECKING:
    from calibrary.calib.detection import Detections
    from calibrary.calib.result import CalibrationResult, Flown
    from calibrary.calib.verdict import BoardVerdict
    from calibrary.cli.console import Screen
    from calibrary.jobs.calibrate.outputs import Files
    from calibrary.registry.git.writing import Written
    from calibrary.registry.proposals import Proposal
    from calibrary.validation import Finding

__all__ = ["Display", "parameters", "show_findings_of"]

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


class Display:
    """Terminal output of one calibration."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._screen, self._remarks, self._where = (
            deciding_screen(arguments),
            note(arguments),
            where(arguments),
        )

    def say(self, text: str) -> None:
        """Print a sentence about the progress."""
        self._screen.say(plain(text))

    def show(self, result: CalibrationResult, collected: Detections, *, correlations: bool) -> None:
        """Show the results that the verdict is based on."""
        for remark in collected.notes:
            self._remarks.say(f"[dim]note[/]: {plain(remark)}")
        width = self._screen.width - 2
        self._screen.show(_views(result, collected, width), indent=2)
        self._screen.say("")
        # A refused calibration shows no K; its numbers are in the report.
        if result.verdict.value != "refuse":
            self._screen.show(parameters(result.calibration, width), indent=2)
            if correlations and result.calibration.quality is not None:
                self._screen.say("")
                self._screen.show(_correlations(result.calibration.quality, width), indent=2)
            self._screen.say("")
        self._screen.show(facts([(name, printable(text)) for name, text in _facts(result)], width), indent=2)

    def show_files(self, files: Files) -> None:
        """Show which files were written and which were not."""
        for path in files.held_back:
            self.say(f"not written, since the calibration is refused: {path}")
        for path in files.content:
            self.say(f"wrote {path}")
        if files.losses:
            self.say(f"the format has no place for: {', '.join(files.losses)}")

    def show_entry(self, proposal: Proposal, findings: Sequence[Finding]) -> None:
        """Show the entry compared with the current one; for a new entry everything is already shown."""
        if proposal.base is None:
            self.say(f"{proposal.entry.id}  new")
            for warning in proposal.warnings:
                self.say(f"  note: {warning}")
        else:
            show_changes(self._screen, [proposal])
        show_findings(self._screen, findings)

    def written(self, written: Written, proposal: Proposal, verdict: BoardVerdict) -> None:
        """Show the commit."""
        status = proposal.entry.status.value
        show_written(self._screen, written, "approved" if status == "approved" else "wrote", 1)
        if status != "draft":
            return
        if verdict.value == "pass":
            self.say(
                f"a proposal is not used yet; next: calibrary registry approve {proposal.entry.id}{self._where} "
                f"--digest {(proposal.digest or '')[:12]}"
            )
        else:
            self.say(
                f"a {verdict.value} calibration stays a draft: 'registry approve' refuses it; next: do what the "
                "reasons ask for and calibrate again"
            )

    def verdict(self, result: CalibrationResult, collected: Detections) -> None:
        """Show the verdict with its reasons, at the end."""
        outcome, quality = result.verdict, result.calibration.quality or Quality()
        board = collected.observations.board
        self._screen.say("")
        show_findings_of(self._screen, result.findings)
        self.outcome(
            outcome,
            f"{plain(str(result.calibration.camera))}: "
            f"{quality.views} of {len(result.views) + len(collected.rejected)} {result.shots} of {plain(str(board))}, "
            f"reprojection error (RMS) {quality.rms_px:.3f} px",
        )

    def outcome(self, verdict: BoardVerdict, said: str) -> None:
        """Print the last line."""
        self._screen.say(f"[{STYLES[verdict.value]}]{verdict.value.upper()}[/]  {said}")


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
    lens = calibration.distortion.coefficients if calibration.distortion is not None else {}
    values = {"fx": K.fx, "fy": K.fy, "cx": K.cx, "cy": K.cy} | lens
    for name, value in values.items():
        std = quality.std.get(name)
        if std is None and not value:
            continue
        digits = 6 if std is None or std <= 0 else min(9, max(2, 2 - math.floor(math.log10(std))))
        spread = ("–", "–") if std is None else (f"{std:#.2g}", f"{std * wider:#.2g}")
        rows.append((name, f"{value:.{digits}f}", *spread))
    return fitted(PARAMETERS, rows, width)


def _correlations(quality: Quality, width: int) -> list[Text]:
    """Lower triangle of the correlation matrix; a list of pairs if it is wider than the terminal."""
    if quality.covariance is None:
        return []
    names, C = quality.covariance.names, quality.covariance.matrix
    sigma = np.sqrt(np.diag(C))
    R = C / np.outer(sigma, sigma)
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


def _facts(result: CalibrationResult) -> Iterator[tuple[str, str]]:
    """The measurements that the verdict is based on, one line each."""
    evidence, seen, quality = result.evidence, result.evidence.geometry, result.calibration.quality
    if evidence.unit != "mm" and result.flown is None:
        yield (
            "scale",
            "unknown: the side of a square was not stated, so lengths are in squares (K does not need it)",
        )
    if result.date_origin is not None:
        yield "date", f"{result.calibration.provenance.date or 'unknown'}, {result.date_origin}"
    if result.candidates:
        least = min(one.criterion for one in result.candidates)
        tried = ", ".join(
            f"{one.model.value} {one.criterion - least:+.1f}" + (f" ({one.refused})" if one.refused else "")
            for one in result.candidates
        )
        yield "model", f"{result.model.value}; criterion against the best: {tried}"
    if quality is not None and quality.kappa2 is not None:
        limits = result.limits
        yield (
            "variance factor",
            f"{quality.kappa2:.2f} between halves of the {result.shots}; PASS up to {limits.kappa2_wanted:g}, refused "
            f"above {limits.kappa2_needed:g}",
        )
    if result.warp is not None:
        w0, w1 = result.warp.warp_mm
        found = "solved for" if evidence.is_warped else "not taken"
        yield (
            "board warp",
            f"{evidence.length(w0, '+')} across, {evidence.length(w1, '+')} down (F = {result.warp.f:.1f}), {found}",
        )
    if result.flown is not None:
        yield from _flown(result.flown)
    else:
        yield (
            "tilt",
            f"normals spread {seen.tilt_spread_deg:.0f}°, farthest ÷ nearest corner {seen.depth_ratio:.2f}",
        )
    yield (
        "coverage",
        f"{seen.coverage.fraction:.0%} of the cells, {seen.coverage.reach:.0%} of the way to the corners",
    )
    if evidence.edge_px is not None:
        yield "uncertainty", f"at most {evidence.edge_px:.2g} px anywhere in the frame"


def _flown(flown: Flown) -> Iterator[tuple[str, str]]:
    """The geometry of a flight."""
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
    if flown.control is not None:
        yield "ground control", flown.control.words


def _views(result: CalibrationResult, collected: Detections, width: int) -> list[Text]:
    """Table of the frames: whether each is used, and the reason."""
    remarks = {remark.name: remark.remark.text for remark in collected.remarks}
    rows: list[tuple[str, str, str]] = []
    worst = sorted(result.rms_by_view.values(), reverse=True)
    least = worst[MOST_VIEWS] if len(worst) > MOST_VIEWS else -1.0
    for view in result.views:
        if view.without is None:
            if view.rms_px is None or view.rms_px <= least:
                continue
            points = "corners" if result.flown is None else "points"
            out = f"{len(view.corners_out)} {points} rejected" if view.corners_out else ""
            said = "; ".join(text for text in (out, remarks.get(view.name, "")) if text)
            rows.append((plain(view.name), f"{view.rms_px:.3f}", plain(said)))
        else:
            rms = f"{view.rms_px:.3f}" if view.rms_px is not None else "–"
            why = f"[yellow]{view.without.reason.value}[/]: {plain(view.without.message)}"
            rows.append((plain(view.name), rms, why))
    if len(worst) > MOST_VIEWS:
        rows.append((f"{len(worst) - MOST_VIEWS} more that fit better", f"≤ {least:.3f}", ""))
    for one in collected.rejected:
        why = f"[red]{one.remark.reason.value}[/]: {plain(one.remark.text)}"
        rows.append((plain(one.name), "–", why))
    return fitted(VIEWS, rows, width)
