"""The vocabulary of keyed calibration sheets: what a key means, and in which unit its number stands.

One table (:data:`TERMS`) holds every spelling. A key is compared without case, blanks, dots, hyphens and
underscores, once its unit has been taken off: "Focal Length [mm]", "focal_length_mm" and "focalLength(mm)" are
one key. Nothing has a unit by default where two are in use.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from calibrary.errors import ParseError
from calibrary.parsers import text as strict

__all__ = ["COEFFICIENTS", "MODELS", "TERMS", "Kind", "Value", "looks_like_a_lens_term", "term", "value"]


class Kind(Enum):
    """What sort of value a key has."""

    LENGTH = "a number of px, mm or µm"
    SIZE = "two numbers, width x height"
    NUMBER = "a number without a unit"
    TEXT = "text"


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """One line's value, understood as far as its key allows.

    Attributes:
        key: as the file spells it.
        text: the value as it stands, without comment and quotes.
        unit: "px", "mm", "um", the file's own word where that is none of them, None where it says none.
        numbers: the one or two numbers of it; none for text.
    """

    key: str
    text: str
    unit: str | None = None
    numbers: tuple[float, ...] = ()


_TABLE: tuple[tuple[str, Kind, str], ...] = (
    ("f", Kind.LENGTH, "f focal focal_length calibrated_focal_length camera_constant principal_distance cfl"),
    ("fx", Kind.LENGTH, "fx focal_x focal_length_x f_x"),
    ("fy", Kind.LENGTH, "fy focal_y focal_length_y f_y"),
    ("cx", Kind.LENGTH, "cx principal_point_x pp_x ppx principal_x c_x"),
    ("cy", Kind.LENGTH, "cy principal_point_y pp_y ppy principal_y c_y"),
    ("offset_x", Kind.LENGTH, "principal_point_offset_x pp_offset_x cx_offset ppa_x ppo_x x_ppa"),
    ("offset_y", Kind.LENGTH, "principal_point_offset_y pp_offset_y cy_offset ppa_y ppo_y y_ppa"),
    ("skew", Kind.LENGTH, "skew"),
    ("pitch", Kind.LENGTH, "pixel_pitch pixel_size pitch pixel_spacing"),
    ("pitch_x", Kind.LENGTH, "pixel_pitch_x pixel_size_x pixel_width"),
    ("pitch_y", Kind.LENGTH, "pixel_pitch_y pixel_size_y pixel_height"),
    ("sensor_width", Kind.LENGTH, "sensor_width format_width"),
    ("sensor_height", Kind.LENGTH, "sensor_height format_height"),
    ("sensor", Kind.SIZE, "sensor_size sensor sensor_dimensions sensor_format"),
    ("width", Kind.LENGTH, "image_width width columns cols number_of_columns"),
    ("height", Kind.LENGTH, "image_height height rows number_of_rows"),
    ("size", Kind.SIZE, "image_size resolution image_dimensions frame_size"),
    ("origin", Kind.TEXT, "principal_point_origin pixel_origin origin"),
    ("y_axis", Kind.TEXT, "y_axis"),
    ("model", Kind.TEXT, "distortion_model lens_model distortion"),
    ("make", Kind.TEXT, "make manufacturer camera_make"),
    ("camera", Kind.TEXT, "model camera_model camera camera_name"),
    ("lens", Kind.TEXT, "lens lens_name"),
    ("sub_camera", Kind.TEXT, "sub_camera"),
    ("firmware", Kind.TEXT, "firmware firmware_version"),
    ("capture_mode", Kind.TEXT, "capture_mode"),
    ("grade", Kind.TEXT, "grade"),
    ("cameras", Kind.NUMBER, "cameras number_of_cameras"),
    ("rms", Kind.LENGTH, "rms reprojection_error rms_reprojection_error rms_error"),
    ("points", Kind.NUMBER, "points number_of_points"),
    ("views", Kind.NUMBER, "views number_of_views images number_of_images"),
)

COEFFICIENTS = (
    "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "p3", "p4", "s1", "s2", "s3", "s4", "tau_x", "tau_y",
)  # fmt: skip

MODELS: Mapping[str, str] = MappingProxyType(
    {
        spelling: model
        for model, spellings in (
            ("none", "none no nodistortion"),
            ("brown", "brown brownconrady opencv plumbbob radtan"),
            ("rational", "rational rationalpolynomial fullopencv"),
            ("thin-prism", "thinprism"),
            ("tilted", "tilted"),
            ("kannala-brandt", "kannalabrandt kannalabrandt4 equidistant fisheye opencvfisheye kb4"),
            ("metashape", "metashape agisoft"),
        )
        for spelling in spellings.split()
    }
)
"""The library's name of a distortion model by what files call it, without case and punctuation."""

_UNITS = {
    "px": "px", "pix": "px", "pixel": "px", "pixels": "px",
    "mm": "mm", "millimetre": "mm", "millimetres": "mm", "millimeter": "mm", "millimeters": "mm",
    "um": "um", "µm": "um", "μm": "um", "micron": "um", "microns": "um", "micrometre": "um", "micrometer": "um",
}  # fmt: skip
_BRACKETED = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*")
_TRAILING_UNIT = re.compile(r"(.*?[\w)])[\s_-](px|pix|pixels?|mm|um|µm|μm|microns?)", re.IGNORECASE)
_NUMBER = r"[+-]?[\d.,]++(?:[eE][+-]?\d+)?+"
_NUMBER_UNIT = re.compile(rf"({_NUMBER})\s*([^\W\d_][^\s]{{0,20}})", re.ASCII)
_SIDE = rf"([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*({'|'.join(sorted(_UNITS, key=len, reverse=True))})?"
_SIZE = re.compile(rf"{_SIDE}(?:\s*[x×*,;]\s*|\s+){_SIDE}", re.IGNORECASE)
_LENS_TERM = re.compile(
    r"(?:[kpsbart]|kc|kr|tau)_?\d+|.*(?:distort|radial|tangent|decentr|affin|shear|skew).*"
)
LONGEST_KEY = 120


def _plain(key: str) -> str:
    return re.sub(r"[^a-z0-9]", "", key.lower())


TERMS: Mapping[str, tuple[str, Kind]] = MappingProxyType(
    {_plain(spelling): (name, kind) for name, kind, spellings in _TABLE for spelling in spellings.split()}
    | {_plain(name): (name, Kind.NUMBER) for name in COEFFICIENTS}
)
"""Every known spelling, without case and punctuation: what it names, and the kind of its value."""


def term(key: str) -> tuple[str, Kind, str | None] | None:
    """What a key names, the kind of its value and its unit if it says one; None for an unknown key."""
    if len(key) > LONGEST_KEY:
        return None
    bracketed = _BRACKETED.fullmatch(key)
    if bracketed is not None:
        # A unit nobody knows is kept, so that it is refused where it matters and not passed over.
        name, unit = bracketed[1], _UNITS.get(bracketed[2].strip().lower(), bracketed[2].strip() or None)
    else:
        trailing = _TRAILING_UNIT.fullmatch(key)
        name, unit = (trailing[1], _UNITS[trailing[2].lower()]) if trailing else (key, None)
    found = TERMS.get(_plain(name))
    return None if found is None else (*found, unit)


def value(key: str, text: str, *, source: str) -> Value:
    """What a line of a known key says.

    Raises:
        ParseError: a number is none, or the key and the value give two units.
    """
    known = term(key)
    assert known is not None  # noqa: S101  asked only for known keys
    _, kind, unit = known
    if kind is Kind.TEXT:
        return Value(key=key, text=text)
    if kind is Kind.SIZE:
        return _size(key, text, unit, source=source)
    found = _NUMBER_UNIT.fullmatch(text)
    if found is None:
        return Value(key=key, text=text, unit=unit, numbers=(strict.number(text, source=source, place=key),))
    unit = _agreed(unit, found[2], key=key, source=source)
    return Value(key=key, text=text, unit=unit, numbers=(strict.number(found[1], source=source, place=key),))


def looks_like_a_lens_term(key: str) -> bool:
    """Whether an unknown key is named as lens coefficients are, so that passing it over would lose it."""
    return len(key) <= LONGEST_KEY and _LENS_TERM.fullmatch(key.strip().lower()) is not None


def _size(key: str, text: str, unit: str | None, *, source: str) -> Value:
    """Such as "5472 x 3648" or "13.2 mm x 8.8 mm"."""
    found = _SIZE.fullmatch(text)
    if found is None:
        raise ParseError(f"{strict.shown(text)} is no size, wanted width x height", source=source, place=key)
    for said in (found[2], found[4]):
        if said is not None:
            unit = _agreed(unit, said, key=key, source=source)
    sides = tuple(strict.number(side, source=source, place=key) for side in (found[1], found[3]))
    return Value(key=key, text=text, unit=unit, numbers=sides)


def _agreed(unit: str | None, said: str, *, key: str, source: str) -> str:
    """The unit that key and value give, a known one in its one spelling."""
    said = _UNITS.get(said.lower(), said)
    if unit not in (None, said):
        raise ParseError(f"it is said to be in {unit} and in {said}", source=source, place=key)
    return said
