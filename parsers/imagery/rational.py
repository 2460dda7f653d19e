"""Numbers as returned by image libraries: ratios with a zero denominator, floats, several values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real

from calibrary.errors import BadRationalError

__all__ = ["as_number"]


def as_number(value: object, *, source: str | None = None, place: str | None = None) -> float:
    """Convert a ratio of any kind, a float, an int, or a sequence of equal ones to one finite number.

    Args:
        value: value of a tag from exifread or Pillow.
        source: the file, for messages.
        place: the tag, for messages.

    Raises:
        BadRationalError: the denominator is zero, or the value is not a finite number, or has several
            different ones.
    """

    def refuse(found: str) -> BadRationalError:
        return BadRationalError(f"found {found}; a finite number was expected", source=source, place=place)

    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        if not value:
            raise refuse("no value")
        if len(value) == 1:
            return as_number(value[0], source=source, place=place)
        numbers = {as_number(item, source=source, place=place) for item in value}
        if len(numbers) > 1:
            raise refuse(f"{len(value)} different values")
        return numbers.pop()
    if isinstance(value, bool) or not isinstance(value, Real):
        raise refuse(f"{type(value).__name__} {str(value)[:40]!r}")
    # Pillow's IFDRational and exifread's Ratio both keep 5/0, and convert it to NaN or raise an error.
    if getattr(value, "denominator", 1) == 0:
        raise refuse(f"{getattr(value, 'numerator', '')}/0")
    try:
        number = float(value)
    except OverflowError:
        raise refuse(f"{str(value)[:40]}") from None
    if not math.isfinite(number):
        raise refuse(str(number))
    return number
