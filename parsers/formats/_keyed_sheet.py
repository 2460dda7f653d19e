"""Parsing of a text of keys and values: the meaning of each key, and its numbers with their unit."""

from __future__ import annotations

import re

from msgspec import Struct, field

from calibrary.distortion import Rational
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.format import STATED
from calibrary.parsers.formats._text_rows import text_of
from calibrary.records import replace

MAX_BYTES = 256 * 1024
"""Longest file, about a hundred pages."""
LONGEST_ROW = 2000

CAMERA = ("make", "model", "sub_camera", "lens", "firmware", "capture_mode")
COEFFICIENTS = Rational.names()
SPELLINGS = {
    **{name: name for name in (*CAMERA, *STATED, *COEFFICIENTS, "skew", "y_axis", "grade", "points")},
    "f": "f focal_length calibrated_focal_length camera_constant principal_distance",
    "fx": "fx focal_length_x",
    "fy": "fy focal_length_y",
    "cx": "cx principal_point_x ppx",
    "cy": "cy principal_point_y ppy",
    "pitch": "pixel_pitch pixel_size",
    "sensor": "sensor sensor_size sensor_width",
    "size": "size image-size resolution",
    "width": "width image_width columns",
    "height": "height image_height rows",
    "origin": "origin principal_point_origin",
    "distortion": "distortion distortion_model lens_model",
    "make": "make manufacturer",
    "model": "model camera camera_model",
    "date": "date calibration_date calibrated_on",
    "tool": "tool software",
    "operator": "operator calibrated_by laboratory",
    "rms": "rms reprojection_error rms_error",
    "views": "views number_of_views number_of_images",
}
"""Spellings of the known keys by meaning. Case, spaces and punctuation are ignored."""
TERMS = {re.sub("[^a-z0-9]", "", word): name for name, words in SPELLINGS.items() for word in words.split()}
NUMBERS = frozenset(
    {"f", "fx", "fy", "cx", "cy", "skew", "pitch", "width", "height", "rms", "points", "views", *COEFFICIENTS}
)
PAIRS = frozenset({"size", "sensor"})
UNITS = {
    "pixel": "px",
    "pixels": "px",
    "um": "um",
    "µm": "um",
    "μm": "um",
    "micron": "um",
    "px": "px",
    "mm": "mm",
}
MM = {"mm": 1.0, "um": 1e-3}

_ROW = re.compile(r"([^\W\d][^=:]{0,119}?)\s*[=:]\s*(\S.*)")
SEPARATOR = re.compile(r"(?:#|;|//|%).*|\[[^\[\]]{1,80}\]|")
COMMENT = re.compile(r"\s(?:#|;|//|%).*")
_KEY_WITH_UNIT = re.compile(
    r"(.*?)\s*[\[(]([^\[\]()]{1,20})[\])]|(.*[\w)])[\s_-](px|pixels?|mm|um|µm|μm)", re.IGNORECASE
)
_VALUE = re.compile(
    r"([+-]?[\d.,]++(?:e[+-]?\d+)?+|nan|inf)\s*([^\W\d_]{1,20})?"
    r"(?:(?:(?<=\d)|\s)\s*[x×*]\s*([+-]?[\d.,]++)\s*([^\W\d_]{1,20})?)?",
    re.IGNORECASE,
)


class Entry(Struct, frozen=True):
    """One known line: its key as written, its text, its numbers, and their unit if one is stated."""

    key: str
    text: str
    numbers: tuple[float, ...] = ()
    unit: str | None = None


class Sheet(Struct):
    """A parsed sheet: the entries by meaning, and the lines with an unknown key."""

    entries: dict[str, Entry] = field(default_factory=dict)
    rest: list[tuple[str, str]] = field(default_factory=list)

    def __contains__(self, name: str) -> bool:
        return name in self.entries

    def text(self, name: str) -> str | None:
        return self.entries[name].text if name in self.entries else None

    def mm(self, name: str) -> tuple[float, ...]:
        """The positive lengths in mm of an entry that must state its unit."""
        entry = self.entries[name]
        if entry.unit not in MM or not min(entry.numbers) > 0:
            raise ParseError("expected a positive length with its unit, mm or µm", place=entry.key)
        return tuple(number * MM[entry.unit] for number in entry.numbers)


def taken_apart(data: bytes) -> Sheet:
    sheet = Sheet()
    text = text_of(data, most=MAX_BYTES)
    for number, raw in enumerate(strict.lines(text), start=1):
        row = raw.strip()
        if SEPARATOR.fullmatch(row):
            continue
        found = matched(row)
        if found is None:
            raise ParseError(
                f"{strict.shown(row)} is neither key = value nor key: value", place=f"line {number}"
            )
        key, value = found[1], COMMENT.sub("", found[2]).strip()
        name, unit = term(key)
        if name is None:
            sheet.rest.append((key, value))
        elif name in sheet:
            raise ParseError(
                f"it means the same as {strict.shown(sheet.entries[name].key)}; expected one", place=key
            )
        else:
            sheet.entries[name] = _entry(name, Entry(key, value, unit=unit))
    return sheet


def _entry(name: str, entry: Entry) -> Entry:
    """The entry with its numbers, if its key has numbers, and the unit stated by key or value."""
    if name not in NUMBERS | PAIRS:
        return entry
    found = _VALUE.fullmatch(entry.text)
    if found is None or (found[3] is None and name == "size") or (found[3] is not None and name in NUMBERS):
        wanted = "width x height" if name in PAIRS else "a number"
        raise ParseError(f"{strict.shown(entry.text)} is not {wanted}", place=entry.key)
    unit = entry.unit
    for word in (found[2], found[4]):
        stated = UNITS.get(word.lower(), word) if word else unit
        if unit not in (None, stated):
            raise ParseError(f"it is stated in {unit} and in {stated}", place=entry.key)
        unit = stated
    texts = (found[1], found[3])
    numbers = tuple(strict.number(part, place=entry.key) for part in texts if part)
    return replace(entry, numbers=numbers, unit=unit)


def matched(row: str) -> re.Match[str] | None:
    return _ROW.fullmatch(row) if len(row) <= LONGEST_ROW else None


def term(key: str) -> tuple[str | None, str | None]:
    """The meaning of a key and the unit in it; an unknown unit in brackets is kept and refused where it matters."""
    found = _KEY_WITH_UNIT.fullmatch(key)
    name, unit = (found[1] or found[3], found[2] or found[4]) if found else (key, None)
    return TERMS.get(re.sub("[^a-z0-9]", "", name.lower())), unit and UNITS.get(unit.lower(), unit)
