"""Verdicts on the comparison of two calibrations."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["ChangeVerdict"]


class ChangeVerdict(StrEnum):
    """Verdict of a comparison, best first."""

    IDENTICAL = "identical"
    NOISE = "within noise"
    NEGLIGIBLE = "negligible"
    UNRESOLVED = "unresolved"
    DRIFT = "drift"
    STRUCTURAL = "structural"
