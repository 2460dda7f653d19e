"""What was found, how bad it is, and the verdict that findings add up to."""

from __future__ import annotations

import math
from enum import StrEnum

from calibrary.errors import ValidationError
from calibrary.records import Json, Record

__all__ = ["UNPROVEN_LEGEND", "Finding", "Report", "Severity", "Verdict"]


class Severity(StrEnum):
    """What a finding does to the verdict, the mildest first: only the last two keep a K from being used."""

    PASS = "pass"  # noqa: S105  a word of the report, no password
    NOTE = "note"
    WARNING = "warning"
    UNPROVEN = "unproven"
    ERROR = "error"


UNPROVEN_LEGEND = "unproven: plausible, but not confirmed by a second source"
"""Explains the verdict, once in every report."""


class Verdict(StrEnum):
    """Whether a K may be used.

    Unproven: plausible, but not confirmed by a second source.
    """

    VALID = "valid"
    UNPROVEN = "unproven"
    REJECTED = "rejected"


class Finding(Record):
    """One rule, measured: what validation, the registry's check, an audit and a board calibration report.

    Attributes:
        rule: its name.
        severity: what the measurement means.
        camera: in words, where the findings are of several cameras.
        place: the entry or file, where the findings are of several.
        measured: the number, in the unit the message names; None where the rule measures none.
        limit: of that number.
        message: what was found and what was expected.
        remedy: what to do about it; None where there is nothing to do.
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
        # A rule that measured NaN fails, and JSON has no NaN.
        stated = {name: document[name] for name in ("measured", "limit")}
        finite = {name: value if _is_finite(value) else None for name, value in stated.items()}
        return document | finite


def _is_finite(value: Json) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


class Report(Record):
    """Every rule's finding, and the verdict they add up to.

    Attributes:
        policy: the name of the policy it was judged by.
        findings: of every rule.
    """

    policy: str
    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst finding decides."""
        severities = {finding.severity for finding in self.findings}
        if Severity.ERROR in severities:
            return Verdict.REJECTED
        return Verdict.UNPROVEN if Severity.UNPROVEN in severities else Verdict.VALID

    @property
    def failures(self) -> tuple[Finding, ...]:
        """What keeps the K from being valid, worst first."""
        errors = [f for f in self.findings if f.severity is Severity.ERROR]
        return (*errors, *(f for f in self.findings if f.severity is Severity.UNPROVEN))

    @property
    def remedy(self) -> str | None:
        """What to do first, None for a valid K. An unstated sensor size comes before its consequences."""
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
