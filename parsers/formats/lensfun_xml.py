"""lensfun's database: profiles of lens models, measured by users on one specimen.

In the format's own words::

    <lensdatabase version="1">
      <camera> <maker>DJI</maker> <model>FC9310</model> <mount>djiFC9310</mount> <cropfactor>2.73</cropfactor> </camera>
      <lens>
        <maker>DJI</maker> <model>FC9310 &amp; compatibles</model> <mount>djiFC9310</mount>
        <type>rectilinear</type> <cropfactor>2.73</cropfactor> <aspect-ratio>4:3</aspect-ratio>
        <calibration> <distortion model="ptlens" focal="8.8" a="0.02" b="-0.11" c="0.03"/> <tca …/> </calibration>
      </lens>
    </lensdatabase>

With ρ the radius in the image without distortion, in halves of the shorter side of the frame that was calibrated, the
radius in the image is::

    poly3    ρ·(1 − k1 + k1·ρ²)
    poly5    ρ·(1 + k1·ρ² + k2·ρ⁴)
    ptlens   ρ·(a·ρ³ + b·ρ² + c·ρ + 1 − a − b − c)
    acm      Adobe's polynomial k1 to k5, in units of the focal length

A ``fisheye`` has the angle in place of the radius. The constant term is lensfun's ``real-focal`` by ``focal``. The
crop factor is the diagonal of a 36×24 mm frame by the sensor's, which is all that a profile says of a pixel; so K is no
more than a prior, and the centre is not known. There is a camera for each lens and focal length; a lens of a mount that
one camera of the file has is that camera's, whose own crop factor then gives the size of a pixel. A lens that was
calibrated on several sensors has a camera for each. Other projections than these two have no counterpart here.

Sources: lensfun, ``docs/manual-main.txt`` and "Changes to the XML format"; ``libs/lensfun/mod-coord.cpp``.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize
from calibrary.distortion import Distortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential, Unit
from calibrary.parsers.document import accounted
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._lenses import lens, of_radius
from calibrary.parsers.xml import parse_xml
from calibrary.records import replace

if TYPE_CHECKING:
    from lxml.etree import _Element

CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.IMAGE_CENTRE,
    tangential=Tangential.NONE,
    coefficients=("k1", "k2", "a", "b", "c"),
    remarks=(
        "the polynomial is in halves of the shorter side of the calibrated frame, and its constant term multiplies the "
        "focal length",
        "the sensor's diagonal is that of a 36×24 mm frame by the crop factor",
    ),
)
ROOT = "lensdatabase"
PROFILE = "a profile of this kind of lens, a start for an adjustment, never the calibration of one camera"
ASSUMED = "the image shows the whole sensor, whose diagonal is that of 36×24 mm by the crop factor of "
OF_LENS, OF_BODY = "the camera on which the lens was calibrated", "the camera itself"
FULL_FRAME_MM = math.hypot(36.0, 24.0)
LONGEST = 100.0
"""Longest frame, as the ratio of its sides."""
LEFT_OUT = "left-out"
PROJECTIONS = ("rectilinear", "fisheye")
TERMS = ("a", "b", "c", "k1", "k2", "k3", "k4", "k5")
MODELS = ("none", "poly3", "poly5", "ptlens", "acm")
MOST = 10_000
"""Most lenses and focal lengths; lensfun's largest file has 1 300."""
# Without an internal subset it declares nothing, and the file that it names is not opened.
_DOCTYPE = re.compile(rb'<!DOCTYPE\s+lensdatabase\s+SYSTEM\s+"[^"<>]{0,100}"\s*>')


def sniff(content: Content) -> Sniff | None:
    """The root element, or the document type before it."""
    if ROOT in {content.xml_root, content.doctype}:
        return Sniff(Sure.MAGIC, "the XML root is <lensdatabase>")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every lens at every focal length, in order; those without a counterpart are left out, and counted.

    What one lens has on several sensors is told apart by their crop factor.
    """
    root = _lenses(data, context)
    size = context.size(None)
    bodies: dict[str, list[_Element]] = {}
    for body in root.iterfind("camera"):
        bodies.setdefault(_text(body, "mount"), []).append(body)
    rows = [
        (f"lens {at}, {row.get('focal')} mm", profile, calibration, row)
        for at, profile in enumerate(root.iterfind("lens"), start=1)
        for calibration in profile.iterfind("calibration")
        for row in calibration.iterfind("distortion")
    ]
    if not rows:
        raise ParseError("there is no lens with a distortion profile in it")
    if len(rows) > MOST:
        raise ParseError(f"{len(rows)} lenses and focal lengths; at most {MOST} are read")
    reasons = [reason for *_, row in rows if (reason := row.get(LEFT_OUT))]
    if len(reasons) == len(rows):
        raise UnsupportedModelError(f"none of its lenses has a counterpart here: {reasons[0]}")
    said = f"{len(reasons)} of {len(rows)} profiles are left out: {', '.join(sorted(set(reasons)))}"
    cameras = [
        _camera(found, bodies.get(_text(found[1], "mount"), []), size, context, (said,) if reasons else ())
        for found in rows
        if LEFT_OUT not in found[3].attrib
    ]
    crops: dict[CameraKey, set[str | None]] = {}
    for one in cameras:
        crops.setdefault(replace(one.camera, sub_camera=None), set()).add(one.camera.sub_camera)
    return [
        replace(one, camera=alone) if len(crops[alone := replace(one.camera, sub_camera=None)]) == 1 else one
        for one in cameras
    ]


@accounted
def _lenses(data: bytes, context: ReadContext) -> _Element:
    """The database without colours and brightness, and why a profile is left out in place of its numbers."""
    from lxml import etree

    root = parse_xml(_DOCTYPE.sub(b"", data, count=1), source=context.name)
    etree.strip_elements(root, "tca", "vignetting", with_tail=False)
    for row in root.iterfind("lens/calibration/distortion"):
        reason = _without_counterpart(row)
        if reason:
            row.attrib.clear()
            row.set(LEFT_OUT, reason)
    return root


def _without_counterpart(row: _Element) -> str | None:
    """Why a profile has no counterpart here; None if it has."""
    profile = next(row.iterancestors("lens"))
    kind, model = _text(profile, "type") or PROJECTIONS[0], row.get("model", "")
    if kind not in PROJECTIONS:
        return f"the projection {strict.shown(kind)}"
    if model not in MODELS or (model == "acm" and kind != PROJECTIONS[0]):
        return f"the model {strict.shown(model)} of a {kind} lens"
    return "a centre off the middle" if profile.find("center") is not None else None


def _camera(
    found: tuple[str, _Element, _Element, _Element],
    bodies: list[_Element],
    size: ImageSize,
    context: ReadContext,
    notes: tuple[str, ...],
) -> Calibration:
    place, profile, calibration, row = found

    def positive(text: str, name: str) -> float:
        value = strict.number(text, place=f"{place}, {name}")
        if not value > 0:
            raise ParseError(f"this is {value:g}, expected more than 0", place=f"{place}, {name}")
        return value

    crop = positive(calibration.get("cropfactor") or _text(profile, "cropfactor"), "cropfactor")
    ratio = calibration.get("aspect-ratio") or _text(profile, "aspect-ratio") or "3:2"
    long, _, short = ratio.partition(":")
    aspect = positive(long, "aspect-ratio") / positive(short or "1", "aspect-ratio")
    if not 1 / LONGEST <= aspect <= LONGEST:
        raise ParseError(
            f"this is {aspect:g}, expected at most {LONGEST:g}:1", place=f"{place}, aspect-ratio"
        )
    terms = {name: strict.number(row.get(name, "0"), place=f"{place}, {name}") for name in TERMS}
    constant, powers = _polynomial(row.get("model", ""), terms)
    positive(f"{constant!r}", "the factor of the focal length")
    focal = positive(row.get("focal", ""), "focal")
    stated = row.get("real-focal")
    real = focal * constant if stated is None else positive(stated, "real-focal")
    diagonal = FULL_FRAME_MM / crop
    unit = real / constant / (diagonal / math.hypot(aspect, 1.0) / 2.0)
    made = (
        _acm(terms)
        if row.get("model") == "acm"
        else of_radius(
            constant, powers, unit, is_fisheye=_text(profile, "type") == PROJECTIONS[1], place=place
        )
    )
    body = bodies[0] if len(bodies) == 1 else None
    own = "" if body is None else _text(body, "cropfactor")
    per_px = (FULL_FRAME_MM / positive(own, "cropfactor of the camera") if own else diagonal) / math.hypot(
        *size
    )
    name = _text(profile, "model")
    return Calibration(
        camera=CameraKey(
            make=_text(profile if body is None else body, "maker") or None,
            model=None if body is None else _text(body, "model") or None,
            sub_camera=f"crop {crop:g}",
            lens=name or None,
            focal_mm=focal,
            image_size=size,
        ),
        intrinsics=CONVENTION.intrinsics(
            Native(fx=real, fy=real, cx=0.0, cy=0.0),
            size,
            sensor_mm=(size[0] * per_px, size[1] * per_px),
            source=context.name,
        ),
        distortion=made,
        grade=Grade.PRIOR,
        provenance=context.provenance(tag=place, assumptions=(ASSUMED + (OF_BODY if own else OF_LENS),)),
        notes=(PROFILE, *notes),
    )


def _polynomial(model: str, terms: dict[str, float]) -> tuple[float, tuple[float, ...]]:
    """The constant term of the polynomial of ρ, and the others from ρ on."""
    a, b, c, k1, k2, *_ = terms.values()
    if model == "poly3":
        return 1.0 - k1, (0.0, k1)
    if model == "ptlens":
        return 1.0 - a - b - c, (c, b, a)
    return 1.0, (0.0, k1, 0.0, k2) if model == "poly5" else ()


def _acm(terms: dict[str, float]) -> Distortion:
    """Adobe's polynomial, whose terms are OpenCV's in another order."""
    *_, k1, k2, k3, p1, p2 = terms.values()
    return lens((k1, k2, p1, p2, k3))


def _text(element: _Element, tag: str) -> str:
    """The text of the first child of the name; empty without one."""
    return (element.findtext(tag) or "").strip()


FORMAT = Format(
    name="lensfun_xml",
    title="lensfun database (profiles of lens models)",
    suffixes=(".xml",),
    syntaxes=(Syntax.XML, Syntax.TEXT),
    roots=(ROOT,),
    reference="https://lensfun.github.io/manual/latest/dbformat.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    idle=("lens.model",),
)
