"""Conversion of EXIF values to facts: positive lengths, integer sizes, clean names; anything else is a fault.

In CIPA DC-008, 0 means "unknown" for the 35 mm focal length and "not used" for the digital zoom. Any other
zero, a zero denominator, a negative length or several different values are faults.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import TypeVar

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.errors import BadRationalError
from calibrary.evidence.metadata import FocalPlaneUnit, TagFault
from calibrary.parsers.imagery.exif import TAG_NAMES, ExifTag, ExifValues
from calibrary.parsers.imagery.head import MAX_SIDE

N = TypeVar("N", int, float)

SMALLEST, LARGEST = 1 / 0xFFFFFFFF, float(0xFFFFFFFF)
"""Range of an EXIF rational; text copies of EXIF (in GDAL's metadata and XMP) could contain 1e308."""

MAX_TEXT = 200
"""Most characters of a name; longer than any known make, model or firmware name (a Parrot release has 60)."""

_UNITS = {
    2: FocalPlaneUnit.INCH,
    3: FocalPlaneUnit.CENTIMETRE,
    4: FocalPlaneUnit.MILLIMETRE,
    5: FocalPlaneUnit.MICROMETRE,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExifFacts:
    """Facts from EXIF, as in :class:`~calibrary.evidence.metadata.ImageMetadata`, but with raw serial numbers.

    Attributes:
        lens_serial, body_serial: must never be written anywhere.
    """

    make: str | None = None
    model: str | None = None
    software: str | None = None
    lens: str | None = None
    orientation: int | None = None
    exif_size: ImageSize | None = None
    focal_mm: float | None = None
    focal_35mm: float | None = None
    digital_zoom: float | None = None
    focal_plane_resolution: tuple[float, float] | None = None
    focal_plane_unit: FocalPlaneUnit | None = None
    lens_serial: str | None = field(default=None, repr=False)
    body_serial: str | None = field(default=None, repr=False)
    faults: tuple[TagFault, ...] = ()


def exif_facts(values: ExifValues, faults: Iterable[TagFault] = ()) -> ExifFacts:
    """Convert ``values`` to facts; ``faults`` are already known and come first."""
    numbers = _Numbers(values, list(faults))
    unit = numbers.whole(ExifTag.FOCAL_PLANE_UNIT, min(_UNITS), max(_UNITS))
    width = numbers.whole(ExifTag.PIXEL_X, 1, MAX_SIDE)
    height = numbers.whole(ExifTag.PIXEL_Y, 1, MAX_SIDE)
    across = numbers.positive(ExifTag.FOCAL_PLANE_X)
    down = numbers.positive(ExifTag.FOCAL_PLANE_Y)
    return ExifFacts(
        make=_text(values, ExifTag.MAKE),
        model=_text(values, ExifTag.MODEL),
        software=_text(values, ExifTag.SOFTWARE),
        lens=_text(values, ExifTag.LENS_MODEL),
        orientation=numbers.whole(ExifTag.ORIENTATION, 1, 8),
        exif_size=numbers.pair((width, ExifTag.PIXEL_X), (height, ExifTag.PIXEL_Y)),
        focal_mm=numbers.positive(ExifTag.FOCAL_LENGTH),
        focal_35mm=numbers.positive(ExifTag.FOCAL_LENGTH_35MM, zero_is_unknown=True),
        digital_zoom=numbers.positive(ExifTag.DIGITAL_ZOOM, zero_is_unknown=True, undefined_is_unknown=True),
        focal_plane_resolution=numbers.pair((across, ExifTag.FOCAL_PLANE_X), (down, ExifTag.FOCAL_PLANE_Y)),
        focal_plane_unit=_UNITS[unit] if unit is not None else None,
        lens_serial=clean_serial(_text(values, ExifTag.LENS_SERIAL)),
        body_serial=clean_serial(_text(values, ExifTag.BODY_SERIAL))
        or clean_serial(_text(values, ExifTag.DNG_SERIAL)),
        faults=tuple(numbers.faults),
    )


def _text(values: ExifValues, tag: int) -> str | None:
    value = values.get(tag)
    return clean_text(value) if isinstance(value, str | bytes) else None


class _Numbers(Struct, frozen=True):
    """Access to the numbers in ``values``; invalid ones are added to ``faults``."""

    values: ExifValues
    faults: list[TagFault]

    def positive(
        self, tag: int, *, zero_is_unknown: bool = False, undefined_is_unknown: bool = False
    ) -> float | None:
        """A positive number; 0 or x/0 is not a fault if it means "unknown" in the standard."""
        if tag not in self.values:
            return None
        number = self._finite(tag)
        if number is not None and SMALLEST <= number <= LARGEST:
            return number
        if not (undefined_is_unknown if number is None else zero_is_unknown and number == 0):
            too_far = number is not None and number > 0
            self._refuse(tag, "a number that EXIF can hold" if too_far else "a number above 0")
        return None

    def whole(self, tag: int, least: int, most: int) -> int | None:
        """An integer from ``least`` to ``most``."""
        if tag not in self.values:
            return None
        number = self._finite(tag)
        if number is not None and least <= number <= most and number.is_integer():
            return int(number)
        self._refuse(tag, f"a whole number from {least} to {most}")
        return None

    def pair(self, first: tuple[N | None, int], second: tuple[N | None, int]) -> tuple[N, N] | None:
        """A pair of values, each given as (value, tag), or None; if only one is present, the missing one is a fault."""
        (a, _), (b, _) = first, second
        if a is not None and b is not None:
            return a, b
        named = {fault.tag for fault in self.faults}
        for (value, tag), (other, _) in ((first, second), (second, first)):
            name = f"EXIF {TAG_NAMES[tag]}"
            if value is None and other is not None and name not in named:
                self.faults.append(TagFault(name, "no such tag", "both of the pair"))
        return None

    def _finite(self, tag: int) -> float | None:
        try:
            return as_number(self.values[tag])
        except BadRationalError:
            return None

    def _refuse(self, tag: int, wanted: str) -> None:
        value = self.values[tag]
        items = value if isinstance(value, list | tuple) else [value]
        found = clean_text(", ".join(map(_as_written, items))) or "no value"
        self.faults.append(TagFault(f"EXIF {TAG_NAMES[tag]}", found, wanted))


def _as_written(value: object) -> str:
    """A value for a message; a ratio as written in the file, such as 5/0."""
    denominator = getattr(value, "denominator", 1)
    return str(value) if denominator == 1 else f"{getattr(value, 'numerator', '')}/{denominator}"


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


def clean_text(raw: str | bytes) -> str | None:
    """A name without padding and unprintable characters; None if nothing is left."""
    text = raw if isinstance(raw, str) else _decode(raw)
    words = " ".join(text.partition("\0")[0].split())
    if not words.isprintable():
        words = "".join(filter(str.isprintable, words))
    return words[:MAX_TEXT].strip() or None


def clean_serial(raw: str | bytes | None) -> str | None:
    """A serial number; None for values that mean none: "", "0", "000000"."""
    text = clean_text(raw) if raw is not None else None
    if text is None or not any(character.isalnum() and character != "0" for character in text):
        return None
    return text


def _decode(raw: bytes) -> str:
    raw = raw.partition(b"\0")[0]
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")
