"""Stereolabs' ZED factory calibration, ``SN*.conf``: both cameras at every resolution.

In the format's own words::

    [LEFT_CAM_FHD]
    fx=1068.5
    fy=1068.1
    cx=960.1
    cy=540.0
    k1=-0.0592                  older files: k1, k2, p1, p2, k3 here
    …
    [LEFT_DISTO]                newer files: k1, k2, p1, p2, k3, k4, k5, k6 for all resolutions
    …                           (k1, k2, k3, k4 alone: OpenCV's fisheye)
    [STEREO]
    Baseline=120.1

The numbers are of the images as they were taken, not of the rectified ones that the ZED SDK hands out. The file does
not state the size of the images; it follows from the name of the resolution.

Source: Stereolabs, ``zed-open-capture`` (reads them) and ``zed-opencv-calibration`` (writes them).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from msgspec import Struct, field

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import Distortion, KannalaBrandt
from calibrary.errors import InputError, ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._opencv_lens import smallest_lens
from calibrary.parsers.formats._text_rows import text_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    remarks=("coefficients are named, k4 to k6 divide", "k1 to k4 without p1 are a fisheye's"),
)
SIZES: dict[str, ImageSize] = {
    "2K": (2208, 1242),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "VGA": (672, 376),
    "FHD1200": (1920, 1200),
    "SVGA": (960, 600),
    "QHDPLUS": (3200, 1800),
    "4K": (3840, 2160),
}
"""What the names of the resolutions stand for, in px."""
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MAX_BYTES = 256 * 1024
NOTE = (
    "this is the camera of the raw images; those that the ZED SDK hands out are rectified and need another K"
)

_SECTION = re.compile(r"\[([^\]]*)\]")
_CAMERA = re.compile(r"(LEFT|RIGHT)_CAM_(\w+)", re.IGNORECASE)


class Section(Struct, frozen=True):
    """One section: its name as it is written, and its values by key."""

    name: str
    values: dict[str, str] = field(default_factory=dict)


def sniff(content: Content) -> Sniff | None:
    """A section [LEFT_CAM_…] or [RIGHT_CAM_…]."""
    for line in content.lines:
        match = _SECTION.fullmatch(line)
        if match and _CAMERA.fullmatch(match[1]):
            return Sniff(Sure.MAGIC, f"the section [{match[1]}]")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera at every resolution, in the file's order; with ``image_size`` those of that size alone."""
    sections = _sections(text_of(data, most=MAX_BYTES))
    found = [
        (section, match[1].upper(), SIZES.get(match[2].upper()))
        for section in sections.values()
        if (match := _CAMERA.fullmatch(section.name))
    ]
    if not found:
        raise ParseError("there is no section [LEFT_CAM_…]")
    unknown = [section.name for section, _, size in found if size is None]
    notes = [NOTE]
    if unknown:
        notes.append(f"{', '.join(unknown)} are left out: the size of their images is not known")
    known = [(section, side, size) for section, side, size in found if size is not None]
    wanted = [item for item in known if context.image_size in {None, item[2]}]
    if not wanted:
        sizes = (
            ", ".join(f"{w}×{h}" for w, h in dict.fromkeys(size for *_, size in known))
            or "none that is known"
        )
        raise InputError(
            f"it has no camera of the size asked for; its sizes are {sizes}", source=context.name
        )
    return [
        _camera(section, sections.get(f"{side}_DISTO"), size, context, tuple(notes))
        for section, side, size in wanted
    ]


def _camera(
    section: Section, shared: Section | None, size: ImageSize, context: ReadContext, notes: tuple[str, ...]
) -> Calibration:
    fx, fy, cx, cy = (_number(section, key) for key in ("fx", "fy", "cx", "cy"))
    lens_of = section if "k1" in section.values or shared is None else shared
    return context.calibration(
        CONVENTION.intrinsics(Native(fx=fx, fy=fy, cx=cx, cy=cy), size),
        _distortion(lens_of),
        name=section.name,
        tag=section.name,
        notes=notes,
    )


def _distortion(section: Section) -> Distortion:
    keys = section.values.keys()
    if "k4" in keys and not {"p1", "p2", "k5", "k6"} & keys:
        return KannalaBrandt(**{key: _number(section, key) for key in KannalaBrandt.names()})
    _number(section, "k1")
    values = [_number(section, key) if key in keys else 0.0 for key in COEFFICIENTS]
    return smallest_lens(values)


def _number(section: Section, key: str) -> float:
    place = f"[{section.name}] {key}"
    if key not in section.values:
        raise ParseError("it is not there", place=place)
    return strict.number(section.values[key], place=place)


def _sections(text: str) -> dict[str, Section]:
    """The sections by their names in upper case."""
    sections: dict[str, Section] = {}
    section: Section | None = None
    for number, line in _lines(text):
        match = _SECTION.fullmatch(line)
        if match:
            if match[1].upper() in sections:
                raise ParseError("it is a duplicate key", place=f"[{match[1]}]")
            section = sections[match[1].upper()] = Section(match[1])
            continue
        key, sign, value = (part.strip() for part in line.partition("="))
        if not sign or section is None:
            raise ParseError(f"{strict.shown(line)}, expected a section or key=value", place=f"line {number}")
        if key in section.values:
            raise ParseError("it is a duplicate key", place=f"[{section.name}] {key}")
        section.values[key] = value
    if section is not None:
        _refuse_part_of_a_lens(section)
    return sections


def _refuse_part_of_a_lens(last: Section) -> None:
    """What ends the file in the middle of its coefficients was cut short; as a rule [STEREO] follows."""
    keys = last.values.keys()
    if last.name.upper().endswith("_DISTO"):
        whole = "k6" in keys or ("k4" in keys and "p1" not in keys)
    else:
        whole = "k1" not in keys or "k3" in keys
    if not whole:
        raise ParseError(
            f"the file ends after {', '.join(keys) or 'its name'}, so it may be cut short; complete it",
            place=f"[{last.name}]",
        )


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines that say something, numbered."""
    for number, raw in enumerate(strict.lines(text), start=1):
        line = re.split("[#;]", raw, maxsplit=1)[0].strip()
        if line:
            yield number, line


FORMAT = Format(
    name="zed",
    title="Stereolabs ZED factory calibration",
    suffixes=(".conf", ".ini"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/stereolabs/zed-open-capture",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    idle=("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
)
