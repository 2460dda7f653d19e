"""What an audit finds: one thing each, what it is about, and what to do next."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = ["Finding", "Level", "Rule"]


class Level(StrEnum):
    """What a finding asks for; a note asks for nothing."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


class Rule(StrEnum):
    """What can be found; the value is what people read."""

    NO_ENTRY = "no entry"
    DRAFT = "draft in use"
    RETIRED = "retired in use"
    EXPIRED = "expired in use"
    SEVERAL = "several entries"
    DRIFT = "K drifted"
    BROKEN = "entry unreadable"
    NAMELESS = "no name"
    FIRMWARE = "firmware changed"
    SIZE = "image size changed"
    UNITS = "units differ"
    OVER = "validity over"
    OLD = "calibrated long ago"
    TAGS = "tags disagree"
    NOT_FLOWN = "not flown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that a keeper should know.

    Attributes:
        rule: which.
        level: how much it matters.
        camera: that flew, in words; None where it is of an entry that nobody flew.
        entry: its id; None where there is none.
        message: what was found and what was wanted.
        action: what to do next; None where nothing is to be done.
    """

    rule: Rule
    level: Level
    camera: str | None = None
    entry: str | None = None
    message: str
    action: str | None = None
