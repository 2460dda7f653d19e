"""The rules of an audit."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Rule"]


class Rule(StrEnum):
    """Rule that a finding is about; the value is the name shown to the user."""

    NO_ENTRY = "no entry"
    DRAFT = "only proposed"
    RETIRED = "retired in use"
    EXPIRED = "expired in use"
    SEVERAL = "several entries"
    DRIFT = "K drifted"
    PIXELS = "pixels contradict K"
    STEP = "K changed with the firmware"
    TREND = "K drifts"
    UNSTEADY = "K differs between dates"
    BROKEN = "entry unreadable"
    NAMELESS = "no name"
    FIRMWARE = "firmware changed"
    SIZE = "image size changed"
    UNITS = "units differ"
    UNKNOWN_UNITS = "units unknown"
    OVER = "validity over"
    OLD = "calibrated long ago"
    UNDATED = "calibration date unknown"
    FUTURE = "calibration date in the future"
    TAGS = "tags disagree"
    WAITING = "another K proposed"
    NOT_FLOWN = "not flown"
