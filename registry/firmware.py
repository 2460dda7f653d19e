"""Firmware ranges: version numbers are compared numerically, and only if they are comparable."""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import Annotated, Self, TypeAlias

from calibrary.errors import InputError
from calibrary.known_camera import match_key
from calibrary.records import Meta, Record

_VERSION = re.compile(r"(.*?)(\d{1,18}(?:\.\d{1,18})*)", re.DOTALL)
_WORDS = re.compile(r"\b(?:firmware|version|ver|v)\b[ .]*")

Version: TypeAlias = Annotated[str, Meta(min_length=1, max_length=1000)]


class FirmwareRange(Record):
    """A range of firmware versions, both ends included, as the camera writes them.

    Attributes:
        min: first version; None for no lower limit.
        max: last version; None for no upper limit.

    Raises:
        InputError: no end is stated, the ends are not comparable, or max is before min.
    """

    min: Version | None = None
    max: Version | None = None

    def __post_init__(self) -> None:
        if self.min is None and self.max is None:
            raise InputError("a firmware range without min and max, expected at least one of them")
        for name in ("min", "max"):
            text = getattr(self, name)
            if text is not None:
                _parsed(text)
        if self.min is not None and self.max is not None and compare(self.min, self.max) > 0:
            raise InputError(f"firmware from {self.min} to {self.max}, expected min before max")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a range of firmware versions, both ends included: "MIN..MAX", "MIN..", "..MAX" or one version.

        Raises:
            InputError: the text is not a range.
        """
        first, dots, last = text.partition("..")
        low, high = (end.strip(" .") or None for end in ((first, last) if dots else (first, first)))
        return cls(min=low, max=high)

    def __str__(self) -> str:
        if self.min == self.max:
            return f"firmware {self.min}"
        if self.max is None:
            return f"firmware from {self.min} on"
        return f"firmware up to {self.max}" if self.min is None else f"firmware {self.min} … {self.max}"

    def holds(self, firmware: str) -> bool:
        """Return whether a firmware is in the range.

        Raises:
            InputError: it is not a version number comparable with those of the range.
        """
        if self.min is not None and compare(firmware, self.min) < 0:
            return False
        return self.max is None or compare(firmware, self.max) <= 0

    def covers(self, version: str) -> bool:
        """Return whether a version, or one that begins with it, is in the range.

        Raises:
            InputError: it is not a version number comparable with those of the range.
        """
        return self.holds(version) or any(
            end is not None and begins_with(end, version) for end in (self.min, self.max)
        )

    def overlaps(self, other: FirmwareRange) -> bool:
        """Return whether two ranges have a firmware in common.

        Raises:
            InputError: their versions are not comparable.
        """
        # Open ends are not compared, so check here that the two are of the same kind.
        compare(self.min or self.max or "", other.min or other.max or "")
        return _starts_by(self.min, other.max) and _starts_by(other.min, self.max)


def compare(a: str, b: str) -> int:
    """Compare two versions number by number ("1.9" is before "01.10.0000"); return -1, 0 or 1.

    Raises:
        InputError: one is not a version, or their prefixes differ.
    """
    (kind_a, numbers_a), (kind_b, numbers_b) = _parsed(a), _parsed(b)
    if kind_a != kind_b:
        raise InputError(f"firmware {a!r:.60} cannot be compared with {b!r:.60}")
    for one, other in zip_longest(numbers_a, numbers_b, fillvalue=0):
        if one != other:
            return -1 if one < other else 1
    return 0


def begins_with(firmware: str, version: str) -> bool:
    """Return whether a firmware is a version or begins with it, number by number: v01.09.1691 is a 1.9.

    Raises:
        InputError: one is not a version, or their prefixes differ.
    """
    if compare(firmware, version) == 0:
        return True
    numbers, asked = _parsed(firmware)[1], _parsed(version)[1]
    return numbers[: len(asked)] == asked


def _starts_by(start: str | None, end: str | None) -> bool:
    return start is None or end is None or compare(start, end) <= 0


def _parsed(text: str) -> tuple[str, tuple[int, ...]]:
    """Return the prefix ("ilce-7rm4"; "v" and "firmware version" are ignored) and the numbers of a version."""
    found = _VERSION.fullmatch(match_key(text)[:200])
    if found is None:
        raise InputError(
            f"firmware {text!r:.60} is not a version number, expected one such as 01.00.0128 or v10.00.12.07"
        )
    kind = _WORDS.sub("", found[1]).strip(" .")
    return kind, tuple(int(number) for number in found[2].split("."))
