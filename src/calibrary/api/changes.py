"""Two calibrations of one camera, compared."""

from __future__ import annotations

from dataclasses import dataclass

from calibrary.api.files import Source, read
from calibrary.api.limits import PolicyLike, policy_of
from calibrary.calibration import Calibration
from calibrary.jobs.diff import comparison as diff
from calibrary.jobs.diff.report import diff_report
from calibrary.jobs.diff.structure import Structural
from calibrary.policy import FLEET
from calibrary.records import Json, to_json

__all__ = ["CompareResult", "compare"]


@dataclass(frozen=True, slots=True, eq=False)
class CompareResult:
    """What lies between two calibrations.

    Attributes:
        comparison: all of it, as the command line shows it.
    """

    comparison: diff.Comparison

    @property
    def verdict(self) -> diff.ChangeVerdict:
        """Identical, within noise, significant but negligible, a drift, or structural."""
        return self.comparison.verdict

    @property
    def alarm(self) -> bool:
        """Whether it needs attention: a drift, or a change of kind other than a resize."""
        return self.comparison.alarm

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why, in sentences."""
        return self.comparison.reasons

    @property
    def structural(self) -> tuple[Structural, ...]:
        """Changes of kind, such as a crop, a swap of coefficients, half a pixel; each has ``kind`` and ``reason``."""
        return self.comparison.structural

    @property
    def numbers(self) -> diff.Numbers | None:
        """Parameters, pixels and significance; None where no scale and no crop brings both to one frame."""
        return self.comparison.numbers

    def to_dict(self, *, labels: tuple[str, str] = ("a", "b"), altitude_m: float = 100.0) -> dict[str, Json]:
        """The change as plain data for JSON (schemas/diff-1.schema.json).

        Args:
            labels: what to call the two.
            altitude_m: height above ground, for what the change does to a map.
        """
        return to_json(diff_report(self.comparison, labels, altitude_m))


def compare(
    camera: Calibration | Source, other: Calibration | Source, *, policy: PolicyLike = FLEET
) -> CompareResult:
    """Compare a later calibration with an earlier one of the same camera.

    Args:
        camera: the earlier, as a calibration or a file.
        other: the later.
        policy: whose limits make an alarm: a policy, "fleet", "source" or a policy file.

    Raises:
        InputError: a file cannot be read.
        FrameError: no scale and no crop brings the two to one frame, and no cause is known for that.
        CalibrationError: they see too little in common.

    >>> change = calibrary.compare("camera.xml", "survey/DJI_0002.JPG")
    >>> change.verdict, change.alarm
    (<ChangeVerdict.IDENTICAL: 'identical'>, False)
    """
    return CompareResult(diff.compare(_calibration(camera), _calibration(other), policy_of(policy)))


def _calibration(given: Calibration | Source) -> Calibration:
    return given if isinstance(given, Calibration) else read(given)
