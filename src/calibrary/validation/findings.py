"""Findings, their severity, and the verdict that follows from them."""

from __future__ import annotations

import math
from enum import StrEnum

from calibrary.errors import ValidationError
from calibrary.records import Json, Record

__all__ = ["UNPROVEN_LEGEND", "Finding", "Report", "Severity", "Verdict"]


class Severity(StrEnum):
    """Effect of a finding on the verdict, mildest first; only the last two prevent the use of a K."""

    PASS = "pass"  # noqa: S105  a word of the report, not a password
    NOTE = "note"
    WARNING = "warning"
    UNPROVEN = "unproven"
    ERROR = "error"


UNPROVEN_LEGEND = "unproven: plausible, but not confirmed by a second source"
"""Explanation of the verdict, printed once in every report."""


class Verdict(StrEnum):
    """Whether a K may be used.

    Unproven: plausible, but not confirmed by a second source.

    >>> calibrary.extract("survey").cameras[0].verdict is calibrary.Verdict.VALID
    True
    """

    VALID = "valid"
    UNPROVEN = "unproven"
    REJECTED = "rejected"


class Finding(Record):
    """Result of one rule, as reported by validation, the registry check, an audit and a board calibration.

    Attributes:
        rule: name of the rule.
        severity: effect on the verdict.
        camera: camera in words, if the findings concern several cameras.
        place: entry or file, if the findings concern several.
        measured: measured value, in the unit that the message names; None if the rule measures none.
        limit: limit of the measured value.
        message: what was found and what was expected.
        remedy: what to do; None if there is nothing to do.
    """

    rule: str
    severity: Severity
    camera: str | None = None
    place: str | None = None
    measured: float | None = None
    limit: float | None = None
    message: str
    remedy: str | None = None

    def __str__(self) -> str:
        where = f"{self.place}: " if self.place else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{where}{self.rule}: {self.message}{remedy}"

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        # A rule that measured NaN fails; JSON cannot represent NaN.
        stated = {name: document[name] for name in ("measured", "limit")}
        finite = {name: value if _is_finite(value) else None for name, value in stated.items()}
        return document | finite


def _is_finite(value: Json) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


class Report(Record):
    """The findings of all rules, and the verdict that follows from them.

    Attributes:
        policy: name of the policy that was used.
        findings: of all rules.

    >>> report = calibrary.validate(calibrary.read("camera.xml"), calibrary.FLEET)
    >>> report.policy, report.verdict.value, report.failures
    ('fleet', 'valid', ())
    """

    policy: str
    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The verdict, determined by the most severe finding."""
        severities = {finding.severity for finding in self.findings}
        if Severity.ERROR in severities:
            return Verdict.REJECTED
        return Verdict.UNPROVEN if Severity.UNPROVEN in severities else Verdict.VALID

    @property
    def failures(self) -> tuple[Finding, ...]:
        """The findings that prevent a valid verdict, most severe first."""
        errors = [f for f in self.findings if f.severity is Severity.ERROR]
        return (*errors, *(f for f in self.findings if f.severity is Severity.UNPROVEN))

    @property
    def remedy(self) -> str | None:
        """What to do first, or None for a valid K. A missing sensor size precedes its consequences."""
        if not self.failures:
            return None
        unstated = next((f for f in self.findings if f.rule == "sensor-stated"), None)
        return (unstated or self.failures[0]).remedy

    def raise_for_failures(self) -> None:
        """Do nothing for a valid K.

        Raises:
            ValidationError: the K is rejected or unproven.
        """
        if self.failures:
            raise ValidationError("; ".join(str(finding) for finding in self.failures), self)
