"""RealityCapture's cameras: XMP beside the images, and its table."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, Distortion, MetashapeFrame, NoDistortion
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Unit
from calibrary.parsers.format import (
    Capacity,
    Format,
    Option,
    ReadContext,
    Sniff,
    Sure,
    UnknownLens,
    WriteContext,
)
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.parsers.xml import parse_xml
from calibrary.records import replace

if TYPE_CHECKING:
    from lxml.etree import _Element


COEFFICIENTS = ("k1", "k2", "k3", "k4", "t1", "t2")
CONVENTION = Convention(
    unit=Unit.LONGER_SIDE,
    origin=Origin.IMAGE_CENTRE,
    coefficients=COEFFICIENTS,
    remarks=("the focal length is 36 times that, FocalLength35mm", "the order of t1 and t2 is contested"),
)
NAMESPACE = "http://www.capturingreality.com/ns/xcr/"
FILM_WIDTH_MM = 36.0
FOCAL = "FocalLength35mm"
USED = {
    "none": (),
    "perspective": (),
    "brown3": ("k1", "k2", "k3"),
    "brown4": ("k1", "k2", "k3", "k4"),
    "brown3t2": ("k1", "k2", "k3", "t1", "t2"),
    "brown4t2": COEFFICIENTS,
}
"""The coefficients that each model applies; the file contains six numbers with every one of them."""
TANGENTIAL = Option(
    name="tangential",
    values=("opencv", "swapped"),
    meaning="whether t1 and t2 are OpenCV's p1 and p2, or p2 and p1",
)
MIDDLE = (
    "RealityCapture does not say from which middle U and V count; W/2, H/2 from the image's corner was taken"
)
SQUARE_PIXELS = "AspectRatio was read as fy / fx"
KEPT = ("CalibrationPrior", "CalibrationGroup", "DistortionGroup", "Version")
PREFIX = "realitycapture_xmp/"
XMP_MAX_BYTES = 1024 * 1024


def sniff_xmp(content: Content) -> Sniff | None:
    """An XMP packet with the vendor's namespace."""
    if content.xml_root in {"xmpmeta", "RDF"} and NAMESPACE in (content.text or ""):
        return Sniff(Sure.MAGIC, "it is an XMP packet with RealityCapture's namespace")
    return None


def read_xmp(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the sidecar."""
    fields = _fields(parse_xml(data, source=context.name, max_bytes=XMP_MAX_BYTES))

    def number(name: str, default: float | None = None) -> float:
        if name not in fields and default is None:
            raise ParseError(f"there is no xcr:{name}")
        return strict.number(fields[name], place=name) if name in fields else default or 0.0

    focal = number(FOCAL) / FILM_WIDTH_MM
    aspect = number("AspectRatio", 1.0)
    if number("Skew", 0.0):
        raise UnsupportedModelError(
            "Skew is not 0, and RealityCapture does not say in which unit; export without it"
        )
    distortion = _distortion(fields, context)
    size = context.size(None)
    native = Native(
        fx=focal, fy=focal * aspect, cx=number("PrincipalPointU", 0.0), cy=number("PrincipalPointV", 0.0)
    )
    return [
        context.calibration(
            CONVENTION.intrinsics(native, size),
            distortion,
            assumptions=(MIDDLE, *((SQUARE_PIXELS,) if aspect != 1 else ())),
            tool=f"RealityCapture, XMP version {fields['Version']}" if fields.get("Version") else None,
            grade=Grade.ADJUSTED,
            notes=(MIDDLE,),
            extras=tuple((PREFIX + name, fields[name]) for name in KEPT if name in fields),
        )
    ]


def _fields(root: _Element) -> Mapping[str, str]:
    """The vendor's fields of the one description that has a focal length, attributes and elements alike."""
    described = []
    for element in root.iter():
        fields: dict[str, str] = {}
        named = [(str(name), value) for name, value in element.attrib.items()]
        named += [(str(child.tag), child.text or "") for child in element]
        for name, value in named:
            space, _, local = name.rpartition("}")
            if not space.startswith("{" + NAMESPACE):
                continue
            if local in fields:
                raise ParseError("it is a duplicate key", place=local)
            fields[local] = str(value).strip()
        if FOCAL in fields:
            described.append(fields)
    if len(described) != 1:
        raise ParseError(
            f"{len(described)} descriptions hold xcr:{FOCAL}, expected one; export the metadata with the "
            "calibration in it"
        )
    return described[0]


def _distortion(fields: Mapping[str, str], context: ReadContext) -> Distortion | None:
    """The lens; None where the file has no word about it."""
    model = fields.get("DistortionModel")
    if model is None:
        return None
    if model not in USED:
        raise UnsupportedModelError(
            f"the DistortionModel {strict.shown(model)} has no counterpart here, expected one of {', '.join(USED)}; "
            "align the images with one of those",
            place="DistortionModel",
        )
    text = fields.get("DistortionCoeficients", fields.get("DistortionCoefficients"))
    if text is None:
        if USED[model]:
            raise ParseError(f"{model} has no coefficients", place="DistortionCoeficients")
        return NoDistortion()
    six = strict.numbers(text, count=len(COEFFICIENTS), place="DistortionCoeficients")
    c = {name: value if name in USED[model] else 0.0 for name, value in zip(COEFFICIENTS, six, strict=True)}
    return brown(c, context, place="DistortionCoeficients")


def brown(c: Mapping[str, float], context: ReadContext, *, place: str) -> Distortion:
    """RealityCapture's lens of k1 to k4, t1 and t2.

    Raises:
        UnsupportedModelError: t1 and t2 are not zero, and their order was not stated.
    """
    if not any(c.values()):
        return NoDistortion()
    p1, p2 = _tangential(c["t1"], c["t2"], context, place)
    if c["k4"]:
        return MetashapeFrame(k1=c["k1"], k2=c["k2"], k3=c["k3"], k4=c["k4"], p1=p2, p2=p1)
    return BrownConrady(k1=c["k1"], k2=c["k2"], p1=p1, p2=p2, k3=c["k3"])


def _tangential(t1: float, t2: float, context: ReadContext, place: str) -> tuple[float, float]:
    """OpenCV's p1 and p2, once the caller has said which is which."""
    if not (t1 or t2):
        return 0.0, 0.0
    order = context.option(TANGENTIAL.name)
    if order is None:
        raise UnsupportedModelError(
            "its tangential terms t1 and t2 are not zero, and readers disagree about their order; say it with "
            "--set tangential=opencv or tangential=swapped",
            place=place,
        )
    return (t1, t2) if order == "opencv" else (t2, t1)


XMP = Format(
    name="realitycapture_xmp",
    title="RealityCapture XMP sidecar",
    words="""\
RealityCapture (RealityScan) camera, the XMP sidecar of an image.

In the format's own words::

    <x:xmpmeta …> <rdf:RDF …>
      <rdf:Description xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#"
          xcr:DistortionModel="brown3" xcr:FocalLength35mm="24.3" xcr:Skew="0" xcr:AspectRatio="1"
          xcr:PrincipalPointU="-0.0022" xcr:PrincipalPointV="-0.0048" …>
        <xcr:DistortionCoeficients>k1 k2 k3 k4 t1 t2</xcr:DistortionCoeficients>

FocalLength35mm is 36 · f / max(W, H); PrincipalPointU and V are offsets from the middle of the image as fractions of
the same longer side, whose length the file does not state. Every field may be an attribute or an element, and the name
of the coefficients is misspelt by the program itself. brown3 uses k1 k2 k3, brown4 the r⁸ of k4 as well, brown3t2 and
brown4t2 add the tangential terms; the vendor's own templates and other readers disagree which of those two comes first.

Sources: RealityCapture help, "XMP metadata" and the camera mathematics of its export templates.
""",
    suffixes=(".xmp",),
    syntaxes=(Syntax.XML,),
    roots=("xmpmeta", "RDF"),
    reference="https://rshelp.capturingreality.com/en-US/tools/xmpalign.htm",
    convention=CONVENTION,
    sniff=sniff_xmp,
    read=read_xmp,
    needs_image_size=True,
    states=("tool",),
    options=(TANGENTIAL,),
    idle=("DistortionCoeficients",),
)


PLACE = ("f", "px", "py")
COLUMNS = ("name", *PLACE, *COEFFICIENTS)
CSV_MAX_BYTES = 8 * 1024 * 1024
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


def sniff_csv(content: Content) -> Sniff | None:
    """The heading's columns."""
    columns = _columns(content.first_line)
    if (
        content.first_line.startswith("#name,")
        and "f" in columns
        and ("px" in columns or "heading" in columns)
    ):
        return Sniff(Sure.MAGIC, f"the columns {content.first_line[:60]}")
    return None


def read_csv(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the images, by the name of its first image."""
    rows = [row for row in rows_of(data, most=context.at_most(CSV_MAX_BYTES)) if row.strip()]
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


CSV = Format(
    name="realitycapture_csv",
    title="RealityCapture and RealityScan camera parameters (CSV)",
    words="""\
RealityCapture's and RealityScan's "Internal/External camera parameters", one row of a CSV for each image.

In the format's own words::

    #name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2
    DJI_0085.JPG,44.58,138.82,6.82,170.3,85.1,-22.7,24.3,-0.0022,-0.0048,0.003,0.004,-0.0018,0,0,0

The numbers of the camera are those of the XMP sidecar (``realitycapture_xmp``): f is 36 · f / max(W, H), px and py are
offsets from the middle as fractions of the longer side, whose length the file does not state. Readers disagree about
the order of t1 and t2. The columns are a template that people change: name and f are needed, and a missing column is
zero. Brush and Postshot take such a file beside the images. Images whose numbers are the same are one camera.

The written file has no columns for poses, because a calibration has none.

Sources: RealityScan help, "Export Registration"; Brush, ``brush-dataset``, ``formats/reality_capture.rs``.
""",
    suffixes=(".csv",),
    syntaxes=(Syntax.TEXT,),
    reference="https://rshelp.capturingreality.com/en-US/tools/exportreg.htm",
    convention=CONVENTION,
    sniff=sniff_csv,
    read=read_csv,
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

FORMATS = (
    XMP,
    CSV,
)
