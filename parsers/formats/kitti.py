"""KITTI's calibration files: ``calib_cam_to_cam.txt`` of the raw recordings, ``calib.txt`` of the benchmarks.

In the format's own words::

    calib_time: 09-Jan-2012 13:57:47
    S_00: 1392 512                    size of the images as they were taken
    K_00: 984.2 0 690.0 0 980.8 233.2 0 0 1
    D_00: -0.3728 0.2037 0.0022 0.0014 -0.0723        k1 k2 p1 p2 k3
    R_00: … T_00: …
    S_rect_00: 1242 375               size after rectification
    R_rect_00: …
    P_rect_00: 721.5 0 609.6 0 0 721.5 172.9 0 0 0 1 0

The benchmarks' images are rectified, and their ``calib.txt`` has the projection matrices P0 … P3 alone, without
the size of the images. In a rectified camera's P, K is the left 3×3.

The pixel origin is not documented. It is read as OpenCV's, because the distortion model is OpenCV's.

Source: A. Geiger et al., "Vision meets robotics: the KITTI dataset", 2013, and the development kit's readme.
"""

from __future__ import annotations

import re

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.errors import InputError, ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.formats._text_rows import text_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3"),
    remarks=("the origin is not documented; OpenCV's was taken",),
)
IMAGES = Option(
    name="images",
    values=("raw", "rectified"),
    meaning="whether the images are as they were taken (K and D) or rectified (P_rect)",
)
MAX_BYTES = 256 * 1024
NOTE = "KITTI does not document its pixel origin; OpenCV's was taken"

_LINE = re.compile(r"(\w+):[ \t]*(.*)")
_RAW = re.compile(r"K_(\d\d)")
_PROJECTION = re.compile(r"P(\d)")


def sniff(content: Content) -> Sniff | None:
    """The line K_00, or the lines P0 and P1 with twelve numbers each."""
    text = content.text or ""
    if "P0:" not in text and "K_" not in text:
        return None
    names = {match[1]: len(match[2].split()) for line in content.lines if (match := _LINE.fullmatch(line))}
    raw = next((name for name in names if _RAW.fullmatch(name)), None)
    if raw is not None and {f"S_{raw[2:]}", f"D_{raw[2:]}"} <= names.keys():
        return Sniff(Sure.MAGIC, f"the lines S_{raw[2:]}, {raw} and D_{raw[2:]}")
    if names.get("P0") == names.get("P1") == 12:
        return Sniff(Sure.SHAPE, "the lines P0 and P1 with twelve numbers each")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the file, named by its number."""
    table = _Table(text_of(data, most=MAX_BYTES))
    rectified = context.option(IMAGES.name) == "rectified"
    raw = [match[1] for name in table.values if (match := _RAW.fullmatch(name))]
    if raw:
        cameras = [
            _rectified(f"P_rect_{n}", n, table, context) if rectified else _raw(n, table, context)
            for n in raw
        ]
    else:
        numbers = [match[1] for name in table.values if (match := _PROJECTION.fullmatch(name))]
        if not numbers:
            raise ParseError("there is neither a K_00 nor a P0")
        if context.option(IMAGES.name) == "raw":
            raise InputError(
                "the file knows the rectified images only; the raw ones are in calib_cam_to_cam.txt",
                source=context.name,
            )
        cameras = [_rectified(f"P{n}", n, table, context) for n in numbers]
    return cameras


class _Table:
    """The file's lines by name; only those that are asked for need be numbers."""

    def __init__(self, text: str) -> None:
        self.values: dict[str, str] = {}
        for number, line in enumerate(strict.lines(text), start=1):
            match = _LINE.fullmatch(line.strip())
            if match is None:
                if line.strip():
                    raise ParseError(
                        f"{strict.shown(line.strip())}, expected a name, a colon and numbers",
                        place=f"line {number}",
                    )
                continue
            if match[1] in self.values:
                raise ParseError("it is a duplicate key", place=match[1])
            self.values[match[1]] = match[2]

    @property
    def date(self) -> str | None:
        """When the cameras were calibrated, as the file writes it."""
        return self.values.get("calib_time")

    def numbers(self, name: str, count: int) -> tuple[float, ...]:
        if name not in self.values:
            raise ParseError(f"there is no {name}")
        return strict.numbers(self.values[name], count=count, place=name)

    def size(self, name: str) -> ImageSize:
        width, height = self.numbers(name, 2)
        return strict.image_size(width, height, place=name)


def _raw(number: str, table: _Table, context: ReadContext) -> Calibration:
    flat = table.numbers(f"K_{number}", 9)
    native = Native.of_matrix((flat[:3], flat[3:6], flat[6:]), place=f"K_{number}")
    distortion = lens(table.numbers(f"D_{number}", 5))
    notes = [NOTE]
    if f"P_rect_{number}" in table.values:
        notes.append("this is the camera of the raw images; --set images=rectified gives the rectified ones")
    K = CONVENTION.intrinsics(native, context.size(table.size(f"S_{number}")))
    return context.calibration(K, distortion, name=number, tag=f"K_{number}", date=table.date, notes=notes)


def _rectified(name: str, number: str, table: _Table, context: ReadContext) -> Calibration:
    fx, skew, cx, _, below, fy, cy, _, *last = table.numbers(name, 12)
    if below != 0 or last[:3] != [0, 0, 1]:
        raise ParseError("this is not a projection matrix of a rectified camera", place=name)
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew)
    stated = table.size(f"S_rect_{number}") if name.startswith("P_rect") else None
    K = CONVENTION.intrinsics(native, context.size(stated))
    return context.calibration(K, NoDistortion(), name=number, tag=name, date=table.date, notes=(NOTE,))


FORMAT = Format(
    name="kitti",
    title="KITTI calibration",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://www.cvlibs.net/datasets/kitti/raw_data.php",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    states=("date",),
    options=(IMAGES,),
)
