"""Terminal output of a rig: each camera's K, the relative poses with their spread, the verdict with its reasons."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from rich.text import Text

from calibrary.calibration import Quality
from calibrary.cli.calibrate.solve_display import STYLES
from calibrary.cli.console import note, plain, printable
from calibrary.cli.registry.asking import deciding_screen
from calibrary.cli.registry.changes import show_changes, show_findings, show_written
from calibrary.cli.tables import Column, facts, fitted

if TYPE_CHECKING:
    from calibrary.api.rigs import CalibrateRigResult
    from calibrary.jobs.calibrate.outputs import Files
    from calibrary.jobs.calibrate_rig.report import PoseDifference
    from calibrary.jobs.fleet.changes import ProposedChange
    from calibrary.registry.git.writing import Written
    from calibrary.rig import RigPose

__all__ = ["RigDisplay"]

CAMERAS: Final = (
    Column(name="camera"),
    *(Column(name=name, right=True) for name in ("fx ± σ·κ", "cx ± σ·κ", "cy ± σ·κ", "RMS px", "views")),
    Column(name="verdict", rank=1, wraps=True),
)
POSES: Final = (
    Column(name=""),
    *(Column(name=name, right=True) for name in ("rotation °", "± °", "translation mm", "± mm")),
)


class RigDisplay:
    """Terminal output of one rig calibration."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._screen, self._remarks = deciding_screen(arguments), note(arguments)

    def say(self, text: str) -> None:
        """Print a sentence about the progress."""
        self._screen.say(plain(text))

    def show(self, done: CalibrateRigResult) -> None:
        """Show the results that the verdict is based on."""
        for remark in done.collected.notes:
            self._remarks.say(f"[dim]note[/]: {plain(remark)}")
        width = self._screen.width - 2
        self._screen.show(_cameras(done, width), indent=2)
        for name, pose in done.poses.items():
            self._screen.say("")
            self._screen.say(f"  {plain(name)} before {plain(done.result.reference)}")
            self._screen.show(_pose(pose, width - 2), indent=4)
        self._screen.say("")
        self._screen.show(facts([(name, printable(text)) for name, text in _facts(done)], width), indent=2)

    def show_files(self, files: Files) -> None:
        """Show which files were written and which were not."""
        for path in files.held_back:
            self.say(f"not written, since the rig is refused: {path}")
        for path in files.content:
            self.say(f"wrote {path}")

    def show_entries(self, change: ProposedChange) -> None:
        """Show the new entries compared with the current ones."""
        for proposal in change.proposals.items:
            if proposal.base is None:
                self.say(f"{proposal.entry.id}  new")
        show_changes(self._screen, [one for one in change.proposals.items if one.base is not None])
        show_findings(self._screen, change.proposals.findings)

    def written(self, written: Written, count: int) -> None:
        """Show the commit."""
        show_written(self._screen, written, "wrote", count)

    def verdict(self, done: CalibrateRigResult) -> None:
        """Show the verdict with its reasons, at the end."""
        self._screen.say("")
        for finding in done.findings:
            said = str(finding).removeprefix(finding.rule)
            self._screen.say(f"  [{STYLES[finding.severity.value]}]{finding.rule}[/]{plain(said)}")
        outcome = done.verdict.value
        self._screen.say(
            f"[{STYLES[outcome]}]{outcome.upper()}[/]  rig of {len(done.result.cameras)} cameras, "
            f"{len(done.result.shots)} shots that two or more share, paired {plain(done.collected.how)}"
        )


def _cameras(done: CalibrateRigResult, width: int) -> list[Text]:
    rows: list[tuple[str, ...]] = []
    for name, one in done.result.cameras.items():
        K, quality = one.calibration.intrinsics, one.calibration.quality or Quality()
        wider = math.sqrt(quality.inflation)
        values = [
            f"{getattr(K, key):.2f} ± {quality.std.get(key, math.nan) * wider:.2g}"
            for key in ("fx", "cx", "cy")
        ]
        reasons = ", ".join(f.rule for f in one.findings if f.severity.value != "note")
        verdict = f"[{STYLES[one.verdict.value]}]{one.verdict.value}[/]" + (f": {reasons}" if reasons else "")
        rows.append((plain(name), *values, f"{quality.rms_px:.3f}", str(quality.views), verdict))
    return fitted(CAMERAS, rows, width)


def _pose(pose: RigPose, width: int) -> list[Text]:
    turn, shift = pose.rotation_std_deg, pose.translation_std_mm
    rows = [
        (
            axis,
            f"{pose.rotation_deg[at]:+.4f}",
            f"{turn[at]:.4f}" if turn is not None else "–",
            f"{pose.translation_mm[at]:+.3f}",
            f"{shift[at]:.3f}" if shift is not None else "–",
        )
        for at, axis in enumerate("xyz")
    ]
    spread = f"{pose.baseline_std_mm:.3f}" if pose.baseline_std_mm is not None else "–"
    rows.append(("in all", f"{pose.angle_deg:.4f}", "", f"{pose.baseline_mm:.3f}", spread))
    return fitted(POSES, rows, width)


def _facts(done: CalibrateRigResult) -> Iterator[tuple[str, str]]:
    evidence, report = done.result.evidence, done.report
    for name, (near, far) in (evidence.cross_px or {}).items():
        sigmas = " and ".join(
            f"{value:.2g} px {where}"
            for value, where in ((near, "at the boards' distance"), (far, "far away"))
            if value
        )
        yield (
            f"{name} predicted",
            f"from the reference camera's pixels with a σ of {sigmas or 'nothing in common'}",
        )
    if evidence.kappa2 is not None:
        yield "variance factor", f"{evidence.kappa2:.2f} of the poses, between halves of the shots"
    if evidence.excess_px is not None:
        yield "one pose for all", f"adds {evidence.excess_px:.3f} px to the residuals"
    yield from _beside("metadata state", report.stated)
    yield from _beside("compared", report.compared)


def _beside(what: str, found: Sequence[PoseDifference]) -> Iterator[tuple[str, str]]:
    for one in found:
        shift = f", {one.translation_mm:.2f} mm away" if one.translation_mm is not None else ""
        yield f"{what}", f"{one.camera} turned by {one.rotation_deg:.3f}°{shift}"
