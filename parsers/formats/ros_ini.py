"""ROS camera calibration, the INI of ``camera_calibration_parsers``: Videre's, and the calibrator's ``ost.txt``.

In the format's own words::

    # oST version 5.0 parameters
    [image]

    width
    5472

    height
    3648

    [front]

    camera matrix
    3650.1 0 2736.2
    0 3649.8 1824.7
    0 0 1

    distortion
    -0.0125 0.0231 -0.0004 0.0008 -0.0172          k1 k2 p1 p2 k3, in rational_polynomial k4 k5 k6 as well

    rectification
    …
    projection
    …

No key names the distortion model; the count of coefficients does, and four leave it open. A calibrator of two
cameras writes one such text after the other. ROS 2 writes plumb_bob alone in this syntax and five decimals
of it.

Source: ROS ``camera_calibration_parsers``, ``parse_ini.cpp``; ``camera_calibration``, ``calibrator.py``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from msgspec import Struct, field

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Capacity, Format, Option, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._bound_extras import bound, unbound
from calibrary.parsers.formats._opencv_lens import COUNTS, lens
from calibrary.parsers.formats._text_rows import text_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    remarks=("R and P are of the rectified image and not read",),
)
DISTORTION = Option(
    name="distortion",
    values=("brown", "fisheye"),
    meaning="whether four coefficients are plumb_bob's k1 k2 p1 p2 or equidistant's k1 k2 k3 k4",
)
PREFIX = "ros_ini/"
MAX_BYTES = 256 * 1024
LABELS = {
    "width": (1,), "height": (1,), "translation": (3,), "rotation": (3,), "camera matrix": (9,),
    "distortion": COUNTS[1:], "rectification": (9,), "projection": (12,),
}  # fmt: skip
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

HEADING = "# oST version"
_PRINTED = re.compile(r"\s*(?:\(?['\"]?(?:self\.)?[DKRPT] ?=|None\s*$|(?:Left|Right):\s*$|\*{4})")
_SECTION = re.compile(r"\[\s*([^\[\]]*?)\s*\]")


class Section(Struct, frozen=True):
    """One camera's blocks of numbers by their labels, and its name."""

    name: str
    blocks: dict[str, tuple[float, ...]] = field(default_factory=dict)


def sniff(content: Content) -> Sniff | None:
    """The section [image] and the line "camera matrix"."""
    if "[image]" in content.lines and "camera matrix" in content.lines:
        return Sniff(Sure.MAGIC, "the section [image] and the line 'camera matrix'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the file, in order, each in the size that the [image] before it says."""
    sections = list(_sections(text_of(data, most=MAX_BYTES)))
    cameras = list(_cameras(sections))
    several = len(cameras) > 1
    return [_camera(section, size, context, several=several) for section, size in cameras]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The layout and the order that ROS's parsers take, with all digits."""
    [calibration] = calibrations
    K, distortion = calibration.intrinsics, calibration.distortion or NoDistortion()
    extras = {key.removeprefix(PREFIX): text for key, text in calibration.extras if key.startswith(PREFIX)}
    native = CONVENTION.native(K)
    camera = (native.fx, native.skew, native.cx, 0.0, native.fy, native.cy, 0.0, 0.0, 1.0)
    projection = (native.fx, native.skew, native.cx, 0.0, 0.0, native.fy, native.cy, 0.0, 0.0, 0.0, 1.0, 0.0)
    blocks: list[tuple[str, Sequence[float], int]] = [
        ("camera matrix", camera, 3),
        ("distortion", tuple(distortion.coefficients.values()) or (0.0,) * 5, 1),
    ]
    for label, trivial in (("rectification", IDENTITY), ("projection", projection)):
        kept = unbound(extras.get(label, ""), K, calibration.distortion)
        blocks.append((label, trivial if kept is None else strict.numbers(kept), 3))
    externals = [
        block
        for label in ("translation", "rotation")
        if label in extras
        for block in _block(label, strict.numbers(extras[label]), 1)
    ]
    name = extras.get("camera_name") or calibration.camera.sub_camera or "camera"
    lines = ["# oST version 5.0 parameters", "", "[image]", "", "width", str(K.image_size[0]), ""]
    lines += ["height", str(K.image_size[1]), "", *(["[externals]", "", *externals] if externals else [])]
    lines += [f"[{re.sub(r'[^!-~]|[][#;]', '_', name)}]", ""]
    lines += [line for label, values, rows in blocks for line in _block(label, values, rows)]
    return ("\n".join(lines) + "\n").encode()


def _sections(text: str) -> Iterator[Section]:
    section: Section | None = None
    label, numbers = "", list[float]()
    for number, line in enumerate([*_lines(text), "[end]"], start=1):
        place = f"line {number}"
        found = _SECTION.search(line)
        if found or line in LABELS:
            if section is not None and label:
                _keep(section, label, tuple(numbers))
            label, numbers = ("", []) if found else (line, [])
            if found:
                if section is not None:
                    yield section
                section = Section(found[1])
            elif section is None:
                raise ParseError("it is in no section", place=place)
        elif line:
            if not label:
                raise ParseError(f"{strict.shown(line)}, expected one of {', '.join(LABELS)}", place=place)
            numbers += strict.numbers(line, place=place)


def _lines(text: str) -> Iterator[str]:
    """Without comments.

    The calibrator prints D, K, R and P as Python lists before each camera, and people paste that along.
    """
    heading, mark, rest = text.partition(HEADING)
    if mark and "[image]" not in heading:
        text = mark + rest
    for line in strict.lines(text):
        yield "" if _PRINTED.match(line) else re.split("[#;]", line, maxsplit=1)[0].strip()


def _keep(section: Section, label: str, numbers: tuple[float, ...]) -> None:
    if label in section.blocks:
        raise ParseError("it is a duplicate key in one section", place=label)
    if len(numbers) not in LABELS[label]:
        wanted = " or ".join(map(str, LABELS[label]))
        raise ParseError(f"{len(numbers)} numbers, expected {wanted}", place=label)
    section.blocks[label] = numbers


def _cameras(sections: Sequence[Section]) -> Iterator[tuple[Section, ImageSize]]:
    """The sections that are cameras, each with the image size and the externals that come before it."""
    size: ImageSize | None = None
    externals: dict[str, tuple[float, ...]] = {}
    for section in sections:
        if section.name == "image":
            width, height = (_needed(section, label)[0] for label in ("width", "height"))
            size, externals = strict.image_size(width, height, place="image"), {}
        elif section.name == "externals":
            externals = section.blocks
        else:
            if size is None:
                raise ParseError("there is no [image] before it", place=section.name)
            yield Section(section.name, externals | section.blocks), size


def _needed(section: Section, label: str) -> tuple[float, ...]:
    if label not in section.blocks:
        raise ParseError(f"there is no {label!r}", place=section.name)
    return section.blocks[label]


def _camera(section: Section, size: ImageSize, context: ReadContext, *, several: bool) -> Calibration:
    matrix = _needed(section, "camera matrix")
    native = Native.of_matrix((matrix[:3], matrix[3:6], matrix[6:]), place="camera matrix")
    intrinsics = CONVENTION.intrinsics(native, context.size(size))
    distortion = _distortion(_needed(section, "distortion"), context)
    extras = [(PREFIX + "camera_name", section.name)]
    for label in ("translation", "rotation", "rectification", "projection"):
        if label in section.blocks:
            text = " ".join(map(repr, section.blocks[label]))
            is_bound = label in {"rectification", "projection"}
            extras.append((PREFIX + label, bound(text, intrinsics, distortion) if is_bound else text))
    note = f"skew of {native.skew:g} px was kept; ROS's image_geometry does not look at it"
    return context.calibration(
        intrinsics,
        distortion,
        name=section.name if several else None,
        tag=section.name,
        notes=(note,) if native.skew else (),
        extras=tuple(extras),
    )


def _distortion(values: tuple[float, ...], context: ReadContext) -> Distortion:
    asked = context.option(DISTORTION.name)
    if asked == "fisheye":
        if len(values) != 4:
            raise ParseError(f"{len(values)} coefficients of a fisheye, expected 4", place="distortion")
        return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))
    if len(values) == 4 and any(values) and asked is None:
        raise ParseError(
            "four coefficients are plumb_bob's k1 k2 p1 p2 or equidistant's k1 k2 k3 k4, and the file does "
            "not state which; say so with --set distortion=brown or distortion=fisheye",
            place="distortion",
        )
    return lens(values)


def _block(label: str, values: Sequence[float], rows: int) -> Iterator[str]:
    yield label
    columns = len(values) // rows
    for start in range(0, len(values), columns):
        yield " ".join(map(repr, values[start : start + columns]))
    yield ""


FORMAT = Format(
    name="ros_ini",
    title="ROS camera calibration INI (ost.txt)",
    suffixes=(".ini", ".txt"),
    syntaxes=(Syntax.TEXT,),
    reference="https://wiki.ros.org/camera_calibration_parsers",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady, Rational)),
    options=(DISTORTION,),
)
