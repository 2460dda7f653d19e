"""Comparison of two calibrations of one camera."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from calibrary.api.files import Source, read
from calibrary.arguments import PolicyLike, Reading
from calibrary.calibration import Calibration
from calibrary.interop.notebook import html_table
from calibrary.jobs.diff import comparison as diff
from calibrary.jobs.diff.kinds import Structural
from calibrary.jobs.diff.report import diff_report
from calibrary.jobs.diff.wording import length, percent, pixels
from calibrary.jobs.exchange.argument import read_arguments
from calibrary.policy import FLEET
from calibrary.policy_file import policy_of
from calibrary.records import Json, to_json

__all__ = [
    "CompareResult",
    "compare",
    "compare_named",
    "length",
    "percent",
    "pixels",
]


class CompareResult(Struct, frozen=True, eq=False):
    """Difference between two calibrations.

    Attributes:
        comparison: complete result, as the command line shows it.
        labels: names of the two calibrations.
    """

    comparison: diff.Comparison
    labels: tuple[str, str] = ("a", "b")

    @property
    def verdict(self) -> diff.ChangeVerdict:
        """Identical, within noise, negligible, unresolved, a drift, or structural."""
        return self.comparison.verdict

    @property
    def alarm(self) -> bool:
        """Whether the change needs attention: it matters, and the measured uncertainty does not explain it."""
        return self.comparison.alarm

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for the verdict, in sentences."""
        return self.comparison.reasons

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limits of the comparison, in sentences: unknown parts of the image, a missing distortion."""
        return self.comparison.warnings

    @property
    def advice(self) -> str:
        """Which of the two to use and what to do, in one sentence."""
        return self.comparison.advice

    @property
    def structural(self) -> tuple[Structural, ...]:
        """Structural changes (a crop, swapped coefficients, half a pixel …), each with ``kind`` and ``reason``."""
        return self.comparison.structural

    @property
    def numbers(self) -> diff.Numbers | None:
        """Differences of parameters and pixels, and their significance; None if no scale or crop relates the two."""
        return self.comparison.numbers

    def _repr_html_(self) -> str:
        """Return the verdict, the reasons and the advice as HTML, for notebooks."""
        kinds = [("kind of change", one.kind.value) for one in self.structural]
        reasons = [("why" if number == 0 else "", text) for number, text in enumerate(self.reasons)]
        warnings = [("not known", text) for text in self.warnings]
        verdict = f"{self.verdict.value}{', needs attention' if self.alarm else ''}"
        rows = [("verdict", verdict), *kinds, *reasons, *warnings, ("what to do", self.advice)]
        return html_table(" and ".join(self.labels), rows)

    def to_html(self, *, altitude_m: float = 100.0) -> str:
        """Return the comparison as a page with maps of the difference; for ``altitude_m`` see :meth:`to_dict`."""
        from calibrary.jobs.diff.page import comparison_page
        from calibrary.pages import render_page

        return render_page(comparison_page(self.comparison, self.labels, altitude_m))

    def to_dict(self, *, labels: tuple[str, str] | None = None, altitude_m: float = 100.0) -> dict[str, Json]:
        """Return the comparison as plain data for JSON (schemas/diff-1.schema.json).

        Args:
            labels: names of the two calibrations, instead of ``self.labels``.
            altitude_m: height above ground in m, used to state the effect on a map.
        """
        return to_json(diff_report(self.comparison, labels or self.labels, altitude_m))


def compare(
    camera: Calibration | Source, other: Calibration | Source, *, policy: PolicyLike = FLEET
) -> CompareResult:
    """Compare a later calibration with an earlier one of the same camera.

    Args:
        camera: the earlier one, as a calibration or a file.
        other: the later one.
        policy: policy with the limits for an alarm: a policy, "fleet", "source" or a policy file.

    Raises:
        InputError: a file cannot be read, or a K is not in pixels.
        FrameError: no scale or crop relates the two images, and no cause is known.
        CalibrationError: the common field of view is too small.

    >>> change = calibrary.compare("camera.xml", "survey/DJI_0002.JPG")
    >>> change.verdict, change.alarm
    (<ChangeVerdict.IDENTICAL: 'identical'>, False)
    """
    return CompareResult(diff.compare(_calibration(camera), _calibration(other), policy_of(policy)))


def compare_named(
    first: str, second: str, reading: Reading, *, registry: Path | None = None, policy: PolicyLike = FLEET
) -> CompareResult:
    """Compare two files, images, or entries KEY[@REV] of a registry, as :func:`compare` does.

    Args:
        first: the earlier one.
        second: the later one; if a file states no image size, that of the other is used.
        reading: settings for the files.
        registry: folder of the registry; None for the default one.
        policy: as for :func:`compare`.

    Raises:
        RegistryError: neither a file nor an entry of that name exists.
    """
    a, b = read_arguments(first, second, reading, registry)
    return CompareResult(diff.compare(a.calibration, b.calibration, policy_of(policy)), (a.label, b.label))


def _calibration(given: Calibration | Source) -> Calibration:
    return given if isinstance(given, Calibration) else read(given)
