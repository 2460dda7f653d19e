"""Terminal output of a combination: each calibration against the others, K with its uncertainty, the verdict."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from calibrary.cli.calibrate.solve_display import Display, parameters, show_findings_of
from calibrary.cli.console import plain
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from calibrary.jobs.combine.report import CombinationReport

__all__ = ["CombineDisplay"]

SOURCES: Final = (
    Column(name="calibration"),
    Column(name="date", rank=2),
    *(Column(name=name, right=True) for name in ("fx px", "σ × κ", "from the others px", "p")),
)


class CombineDisplay(Display):
    """Terminal output of one combination."""

    def sources(self, report: CombinationReport) -> None:
        """Show each calibration against all others, and the combined parameters."""
        width = self._screen.width - 2
        self._screen.show(fitted(SOURCES, list(_rows(report)), width), indent=2)
        if report.calibration is not None:
            self._screen.say("")
            self._screen.show(parameters(report.calibration, width), indent=2)

    def show_out(self, path: Path, losses: tuple[str, ...], *, refused: bool) -> None:
        """Show whether the file was written."""
        self.say(f"not written, since they are refused: {path}" if refused else f"wrote {path}")
        if losses:
            self.say(f"the format has no place for: {', '.join(losses)}")

    def conclusion(self, report: CombinationReport) -> None:
        """Show the verdict with its reasons, at the end."""
        self._screen.say("")
        show_findings_of(self._screen, report.findings)
        number = len(report.sources)
        camera = f"{plain(str(report.calibration.camera))}: " if report.calibration is not None else ""
        said = (
            f"{camera}{number} calibrations as one"
            if report.calibration is not None
            else f"{number} calibrations"
        )
        self.outcome(report.verdict, said if number > 1 else f"{camera}one calibration as it stands")


def _rows(report: CombinationReport) -> Iterator[tuple[str, ...]]:
    for one in report.sources:
        off = "–" if one.off_px is None else f"{one.off_px:.2g} ± {one.off_std_px or 0.0:.1g}"
        yield (
            plain(one.label),
            one.date or "–",
            f"{one.fx:.2f}",
            f"{one.fx_std:#.2g}" if one.fx_std is not None else "–",
            off,
            f"{one.p:.2g}" if one.p is not None else "–",
        )
