"""Whether a K may reach a solver: a policy's limits, every rule measured, a verdict.

No rule stops another and a NaN fails. Two policies ship: ``source`` holds every camera to one band of focal
lengths; ``fleet`` knows that most UAV cameras lie outside it, and judges a known camera by what is known of it,
and an unknown one by the sources in its images that confirm or contradict each other.
"""

from __future__ import annotations

from calibrary.validation.circumstances import Circumstances, Expected, NamedFocal
from calibrary.validation.findings import UNPROVEN_LEGEND, Finding, Report, Severity, Verdict
from calibrary.validation.rules import group_spread, lacks_confirmation, validate

__all__ = [
    "UNPROVEN_LEGEND",
    "Circumstances",
    "Expected",
    "Finding",
    "NamedFocal",
    "Report",
    "Severity",
    "Verdict",
    "group_spread",
    "lacks_confirmation",
    "validate",
]
