"""What a comparison of two calibrations comes to."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["ChangeVerdict"]


class ChangeVerdict(StrEnum):
    """What a comparison comes to, best first."""

    IDENTICAL = "identical"
    NOISE = "within noise"
    NEGLIGIBLE = "negligible"
    UNRESOLVED = "unresolved"
    DRIFT = "drift"
    STRUCTURAL = "structural"
