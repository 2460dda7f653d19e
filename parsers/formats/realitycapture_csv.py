"""RealityCapture's and RealityScan's "Internal/External camera parameters", one row of a CSV for each image.

In the format's own words::

    #name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2
    DJI_0085.JPG,44.58,138.82,6.82,170.3,85.1,-22.7,24.3,-0.0022,-0.0048,0.003,0.004,-0.0018,0,0,0

The numbers of the camera are those of the XMP sidecar (``realitycapture_xmp``): f is 36 · f / max(W, H), px and py are
offsets from the middle as fractions of the longer side, whose length the file does not state. Readers disagree about
the order of t1 and t2. The columns are a template that people change: name and f are needed, and a missing column is
zero. Brush and Postshot take such a file beside the images. Images whose numbers are the same are one camera.

The written file has no columns for poses, because a calibration has none.

Sources: RealityScan help, "Export Registration"; Brush, ``brush-dataset``, ``formats/reality_capture.rs``.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from typing import ClassVar

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Native
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.parsers.formats.realitycapture_xmp import (
    COEFFICIENTS,
    CONVENTION,
    FILM_WIDTH_MM,
    MIDDLE,
    TANGENTIAL,
    brown,
)
from calibrary.records import replace

PLACE = ("f", "px", "py")
COLUMNS = ("name", *PLACE, *COEFFICIENTS)
MAX_BYTES = 8 * 1024 * 1024
MAX_CAMERAS = 1_000_000


class RadialBrown(OpenCVDistortion):
    """What can be written without a word about the order of t1 and t2."""

    model: ClassVar[str] = "brown without tangential terms"

    k1: float
    k2: float
    k3: float

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown–Conrady with p1 = p2 = 0."""
        return (BrownConrady(**self.coefficients, p1=0.0, p2=0.0),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> RadialBrown | None:
        """Brown–Conrady without tangential terms; None for every other model."""
        if not isinstance(other, BrownConrady) or other.p1 or other.p2:
            return None
        return cls(k1=other.k1, k2=other.k2, k3=other.k3)


def sniff(content: Content) -> Sniff | None:
    """The heading's columns."""
    columns = _columns(content.first_line)
    if (
        content.first_line.startswith("#name,")
        and "f" in columns
        and ("px" in columns or "heading" in columns)
    ):
        return Sniff(Sure.MAGIC, f"the columns {content.first_line[:60]}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the images, by the name of its first image."""
    rows = [row for row in rows_of(data, most=context.at_most(MAX_BYTES)) if row.strip()]
    columns = _columns(rows[0]) if rows else ()
    if "name" not in columns or "f" not in columns or len(set(columns)) != len(columns):
        raise ParseError("the first line has no columns name and f, or one of them twice")
    # Rows without a pose are not images of a scene: each is there for its camera.
    merged = "x" in columns
    names: dict[tuple[int, tuple[float, ...]], str] = {}
    for index, fields in enumerate(csv.reader(rows[1:]), start=2):
        if len(fields) != len(columns):
            raise ParseError(f"{len(fields)} fields, expected {len(columns)}", place=f"line {index}")
        named = dict(zip(columns, fields, strict=True))
        numbers = tuple(
            strict.number(named[key], place=f"line {index}, {key}") if key in named else 0.0
            for key in (*PLACE, *COEFFICIENTS)
        )
        names.setdefault((0 if merged else index, numbers), named["name"])
        if len(names) > MAX_CAMERAS:
            raise ParseError(f"there are over {MAX_CAMERAS} cameras")
    several = len(names) > 1
    return [_camera(numbers, name, context, several=several) for (_, numbers), name in names.items()]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """A row for each camera, by its name or the tag it had."""
    lines = [f"#{','.join(COLUMNS)}"]
    for index, item in enumerate(calibrations, start=1):
        native = CONVENTION.native(item.intrinsics)
        lens = (item.distortion or NoDistortion()).coefficients
        numbers = [
            native.fx * FILM_WIDTH_MM,
            native.cx,
            native.cy,
            *(lens.get(name, 0.0) for name in COEFFICIENTS),
        ]
        name = item.camera.sub_camera or f"camera{index}"
        kept = "".join("_" if c in ',"#' or not c.isprintable() else c for c in name)
        lines.append(",".join([kept, *map(repr, numbers)]))
    return "".join(f"{line}\n" for line in lines).encode()


def _columns(line: str) -> tuple[str, ...]:
    return tuple(name.strip().lower() for name in line.lstrip("#").split(","))


def _camera(numbers: Sequence[float], name: str, context: ReadContext, *, several: bool) -> Calibration:
    f, px, py, *terms = numbers
    lens = brown(dict(zip(COEFFICIENTS, terms, strict=True)), context, place="t1, t2")
    focal = f / FILM_WIDTH_MM
    native = Native(fx=focal, fy=focal, cx=px, cy=py)
    item = camera(
        context,
        CONVENTION,
        native,
        None,
        lens,
        name=name if several else None,
        tag=name or None,
        assumptions=(MIDDLE,),
    )
    return replace(item, grade=Grade.ADJUSTED)


FORMAT = Format(
    name="realitycapture_csv",
    title="RealityCapture and RealityScan camera parameters (CSV)",
    suffixes=(".csv",),
    syntaxes=(Syntax.TEXT,),
    reference="https://rshelp.capturingreality.com/en-US/tools/exportreg.htm",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, RadialBrown),
        two_focals=False,
        several_cameras=True,
        unknown_lens=UnknownLens.FREE,
    ),
    needs_image_size=True,
    options=(TANGENTIAL,),
)
