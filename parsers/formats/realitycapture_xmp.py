"""RealityCapture (RealityScan) camera, the XMP sidecar of an image.

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
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, Distortion, MetashapeFrame, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Unit
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.xml import parse_xml

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
MAX_BYTES = 1024 * 1024


def sniff(content: Content) -> Sniff | None:
    """An XMP packet with the vendor's namespace."""
    if content.xml_root in {"xmpmeta", "RDF"} and NAMESPACE in (content.text or ""):
        return Sniff(Sure.MAGIC, "it is an XMP packet with RealityCapture's namespace")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the sidecar."""
    fields = _fields(parse_xml(data, source=context.name, max_bytes=MAX_BYTES))

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


FORMAT = Format(
    name="realitycapture_xmp",
    title="RealityCapture XMP sidecar",
    suffixes=(".xmp",),
    syntaxes=(Syntax.XML,),
    roots=("xmpmeta", "RDF"),
    reference="https://rshelp.capturingreality.com/en-US/tools/xmpalign.htm",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    states=("tool",),
    options=(TANGENTIAL,),
    idle=("DistortionCoeficients",),
)
