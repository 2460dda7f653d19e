"""Validation of K before it reaches a solver: all rules are evaluated against a policy's limits, giving a verdict.

Every rule is evaluated, even if another fails, and NaN fails every rule. Two policies are shipped: ``source``
requires fx / W of every camera to be in one range; ``fleet`` compares a known camera with its expected fx,
because most UAV cameras are outside that range, and judges an unknown camera by whether the sources in its
images confirm or contradict each other.
"""

from __future__ import annotations

from calibrary.validation.findings import UNPROVEN_LEGEND, Finding, Report, Severity, Verdict
from calibrary.validation.rules import (
    Expected,
    NamedFocal,
    ValidationContext,
    group_spread,
    lacks_confirmation,
    name_sensor,
    validate,
)

__all__ = [
    "UNPROVEN_LEGEND",
    "Expected",
    "Finding",
    "NamedFocal",
    "Report",
    "Severity",
    "ValidationContext",
    "Verdict",
    "group_spread",
    "lacks_confirmation",
    "name_sensor",
    "validate",
]
