"""Adobe's lens correction profiles (``.lcp``): XMP with a lens model at several focal lengths, foci and apertures.

In the format's own words, each property as an attribute or as an element::

    <photoshop:CameraProfiles> <rdf:Seq> <rdf:li>
      <rdf:Description stCamera:Make="DJI" stCamera:Model="FC9310" stCamera:LensPrettyName="8.8 mm f/2.8"
          stCamera:ImageWidth="5472" stCamera:ImageLength="3648" stCamera:SensorFormatFactor="2.73"
          stCamera:FocalLength="8.8" stCamera:FocusDistance="1000" stCamera:ApertureValue="6">
        <stCamera:PerspectiveModel stCamera:Version="2" stCamera:FocalLengthX="0.67" stCamera:FocalLengthY="0.67"
            stCamera:ImageXCenter="0.5" stCamera:ImageYCenter="0.5" stCamera:RadialDistortParam1="-0.02" …>
      </rdf:Description>
    </rdf:li> … </rdf:Seq> </photoshop:CameraProfiles>

FocalLengthX and FocalLengthY are fractions of the image's longer side, ImageXCenter and ImageYCenter of its width and
height, or both of the longer side, as the report has them, if that alone is near the middle. Without FocalLengthX the
focal length is FocalLength by 36 mm through the SensorFormatFactor. The perspective model is OpenCV's k1 k2 p1 p2 k3
(RadialDistortParam1 to 3, TangentialDistortParam1 and 2), a ``FisheyeModel`` takes the angle θ to
θ + RadialDistortParam1·θ³ + RadialDistortParam2·θ⁵; a ScaleFactor multiplies the result. The models of colours and
brightness inside have properties of the same names and are not read. There is a camera for each focal length, focus
and aperture. A profile is of a kind of lens, so K is never more than a prior.

Sources: Adobe, "Adobe Camera Model", technical report, 2010; RawTherapee, ``rtengine/lcp.cc``, for the units.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize
from calibrary.distortion import Distortion, KannalaBrandt
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Unit
from calibrary.parsers.document import accounted
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._lenses import lens
from calibrary.parsers.formats.lensfun_xml import PROFILE
from calibrary.parsers.xml import parse_xml

if TYPE_CHECKING:
    from lxml.etree import _Element

CONVENTION = Convention(
    unit=Unit.LONGER_SIDE,
    origin=Origin.CORNER,
    coefficients=("RadialDistortParam1 to 3", "TangentialDistortParam1 and 2"),
    remarks=("the principal point is in fractions of the image's width in x and of its height in y",),
)
NAMESPACE = "http://ns.adobe.com/photoshop/1.0/camera-profile"
CAMERA = f"{{{NAMESPACE}}}"
DESCRIPTION = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}Description"
PERSPECTIVE, FISHEYE = f"{CAMERA}PerspectiveModel", f"{CAMERA}FisheyeModel"
ASIDE = ("ChromaticRedGreenModel", "ChromaticGreenModel", "ChromaticBlueGreenModel", "VignetteModel")
VERSIONS = (None, "2")
NOMINAL = "the focal length is the nominal one, by the crop factor; the profile states none of its own"
BY_LONGER = "ImageYCenter is a fraction of the longer side, as only so it is near the middle"
FULL_FRAME_MM = 36.0
MOST = 10_000


def sniff(content: Content) -> Sniff | None:
    """The profiles' namespace, with a model of a lens."""
    models = {"stCamera:PerspectiveModel", "stCamera:FisheyeModel"}
    tags = content.xml_tags
    if tags and (
        (NAMESPACE in (content.text or "") and not models.isdisjoint(tags)) or tags[0].startswith("stCamera:")
    ):
        return Sniff(Sure.MAGIC, "it is XMP with Adobe's camera-profile elements")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every focal length, focus and aperture, in order."""
    models = [model for model in _profiles(data, context).iter(PERSPECTIVE, FISHEYE) if _states_a_lens(model)]
    if len(models) > MOST:
        raise ParseError(f"{len(models)} models of a lens; at most {MOST} are read")
    if not models:
        raise ParseError("no profile has a RadialDistortParam1: it corrects colours and brightness alone")
    return [_camera(model, at, len(models), context) for at, model in enumerate(models, start=1)]


@accounted
def _profiles(data: bytes, context: ReadContext) -> _Element:
    """The packet without what it says of colours and brightness."""
    from lxml import etree

    root = parse_xml(data, source=context.name)
    etree.strip_elements(root, *(CAMERA + name for name in ASIDE), with_tail=False)
    return root


def _states_a_lens(model: _Element) -> bool:
    return _text(_inside(model), "RadialDistortParam1") is not None


def _camera(model: _Element, at: int, count: int, context: ReadContext) -> Calibration:
    inner, profile, place = _inside(model), model.getparent(), f"profile {at}"
    if profile is None:
        raise ParseError(
            "the model of a lens is the root, expected it inside the profile of a camera", place=place
        )

    def number(node: _Element, name: str, default: float | None = None) -> float:
        text = _text(node, name)
        if text is None and default is not None:
            return default
        if text is None:
            raise ParseError(f"there is no stCamera:{name}", place=place)
        return strict.number(text, place=f"{place}, {name}")

    version = _text(inner, "Version")
    if version not in VERSIONS:
        raise ParseError(f"its model is of version {strict.shown(str(version))}, expected 2", place=place)
    size = context.size(_size(profile, place))
    longer = max(size)
    scale = number(inner, "ScaleFactor", 1.0)
    focal_mm = number(profile, "FocalLength")
    nominal = _text(inner, "FocalLengthX") is None
    if nominal:
        fx = fy = focal_mm * number(profile, "SensorFormatFactor") / FULL_FRAME_MM
    else:
        fx, fy = number(inner, "FocalLengthX"), number(inner, "FocalLengthY")
    middle = number(inner, "ImageYCenter", 0.5)
    by_longer = abs(middle - size[1] / longer / 2) < abs(middle - 0.5)
    native = Native(
        fx=fx * scale,
        fy=fy * scale,
        cx=number(inner, "ImageXCenter", 0.5) * size[0] / longer,
        cy=middle if by_longer else middle * size[1] / longer,
    )
    k1, k2, k3 = (number(inner, f"RadialDistortParam{power}", 0.0) for power in (1, 2, 3))
    p1, p2 = (number(inner, f"TangentialDistortParam{which}", 0.0) for which in (1, 2))
    made: Distortion = lens((k1, k2, p1, p2, k3))
    if model.tag == FISHEYE:
        made = KannalaBrandt(k1=k1, k2=k2, k3=0.0, k4=0.0)
    focus, aperture = _text(profile, "FocusDistance"), _text(profile, "ApertureValue")
    state = ", ".join(
        f"{name} {text}"
        for name, text in (("focus", focus), ("aperture value", aperture))
        if text is not None
    )
    return Calibration(
        camera=CameraKey(
            make=_text(profile, "Make"),
            model=_text(profile, "Model"),
            sub_camera=state or None if count > 1 else None,
            lens=_text(profile, "LensPrettyName") or _text(profile, "Lens"),
            focal_mm=focal_mm,
            image_size=size,
        ),
        intrinsics=CONVENTION.intrinsics(native, size, source=context.name),
        distortion=made,
        grade=Grade.PRIOR,
        provenance=context.provenance(
            tag=place,
            focus=focus and f"{focus} m",
            assumptions=(*((NOMINAL,) if nominal else ()), *((BY_LONGER,) if by_longer else ())),
        ),
        notes=(PROFILE,),
    )


def _size(profile: _Element, place: str) -> ImageSize | None:
    width, height = _text(profile, "ImageWidth"), _text(profile, "ImageLength")
    if width is None or height is None:
        return None
    return strict.image_size(
        strict.number(width, place=place), strict.number(height, place=place), place=place
    )


def _inside(model: _Element) -> _Element:
    """The element with the model's properties."""
    inner = model.find(DESCRIPTION)
    return model if inner is None else inner


def _text(node: _Element, name: str) -> str | None:
    """A property of an element, its attribute or the text of its child; None without one or if it is blank."""
    text = node.get(CAMERA + name) or node.findtext(CAMERA + name)
    return (text or "").strip() or None


FORMAT = Format(
    name="adobe_lcp",
    title="Adobe lens correction profile",
    suffixes=(".lcp",),
    syntaxes=(Syntax.XML,),
    roots=("xmpmeta", "RDF"),
    reference="https://helpx.adobe.com/camera-raw/digital-negative.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    states=("focus",),
)
