"""Conversion of a calibration to the XMP tags that cameras use.

``Camera:`` is Pix4D's description (https://support.pix4d.com/hc/en-us/articles/360016450032): ModelType,
PrincipalPoint "cx,cy" in mm from the upper left, PerspectiveFocalLength in mm, PerspectiveDistortion
"R1,R2,R3,T1,T2", which are Brown's k1, k2, k3, p1, p2; PerspectiveFocalLengthUnits is MicaSense's. It has one focal
length for both axes. ``drone-dji:DewarpData`` is "date;fx,fy,cx,cy,k1,k2,p1,p2,k3" in px, the principal point
relative to the image centre; ``DewarpDataK6`` appends k4, k5, k6.

Merging of properties into an XMP packet; the rest stays unchanged, and its length too if the padding suffices.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Set
from typing import TYPE_CHECKING, Final

import numpy as np
from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Rational
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.fit import accepted_with, adapt, compare
from calibrary.parsers.format import Capacity, Fit, UnknownLens
from calibrary.parsers.imagery.head import MAX_XMP_BYTES
from calibrary.parsers.imagery.xmp import NAMESPACES
from calibrary.parsers.xml import parse_xml
from calibrary.records import replace
from calibrary.synthetic import packet as empty_packet

if TYPE_CHECKING:
    from lxml.etree import _Element

PIX4D: Final = "http://pix4d.com/camera/1.0"
DJI: Final = "http://www.dji.com/drone-dji/1.0/"

_DEWARP: Final = ("DewarpData", "DewarpDataK6")
_CAMERA: Final = (
    "ModelType",
    "PrincipalPoint",
    "PerspectiveFocalLength",
    "PerspectiveFocalLengthUnits",
    "PerspectiveDistortion",
    "FisheyePolynomial",
    "FisheyeAffineMatrix",
    "FisheyeAffineSymmetric",
)
REMOVED: Final = frozenset(
    f"{{{uri}}}{name}"
    for schema, names in (("drone-dji", _DEWARP), ("Camera", _CAMERA), ("sensefly", _CAMERA))
    for uri in NAMESPACES[schema]
    for name in names
)
"""Tags of an existing calibration, which are removed: two calibrations in one image would contradict each other."""
WORDS: Final = frozenset({b":DewarpData", b":PerspectiveFocalLength", b":FisheyeAffineMatrix"})

_DJI_HOLDS: Final = Capacity(models=(BrownConrady, Rational), unknown_lens=UnknownLens.NEVER)
_CAMERA_HOLDS: Final = Capacity(models=(BrownConrady,), unknown_lens=UnknownLens.STATED)


class Tags(Struct, frozen=True, kw_only=True):
    """Tags to be written into an image.

    Attributes:
        properties: by prefix, namespace and name.
        fit: how exactly they represent the calibration.
    """

    properties: Properties
    fit: Fit


def dji_tags(calibration: Calibration, *, max_error_px: float) -> Tags:
    """Make ``drone-dji:DewarpData`` or ``DewarpDataK6``.

    Raises:
        UnsupportedModelError: the tags do not represent the calibration to ``max_error_px``.
    """
    held = adapt(calibration, _DJI_HOLDS, max_error_px=max_error_px)
    K, lens = held.intrinsics, held.distortion
    width, height = K.image_size
    is_rational = isinstance(lens, Rational)
    order = ("k1", "k2", "p1", "p2", "k3", *(("k4", "k5", "k6") if is_rational else ()))
    terms = lens.coefficients if lens is not None else {}
    values = (K.fx, K.fy, K.cx - width / 2, K.cy - height / 2, *(terms[name] for name in order))
    day = calibration.provenance.date or ""
    name = _DEWARP[is_rational]
    return Tags(
        properties={("drone-dji", DJI, name): f"{day};{_number_list(*values)}"},
        fit=compare(calibration, held),
    )


def camera_tags(
    calibration: Calibration, px_per_mm: tuple[float, float] | None, *, max_error_px: float
) -> Tags:
    """Make the tags of Pix4D's perspective camera.

    Args:
        calibration: at the image size that the tags refer to.
        px_per_mm: at that image size, as readers use it to convert mm to px; None if unknown.
        max_error_px: largest allowed error anywhere in the image.

    Raises:
        UnsupportedModelError: the tags do not represent the calibration to ``max_error_px``.
    """
    if px_per_mm is None:
        raise UnsupportedModelError(
            "they count in mm, and neither the image (EXIF FocalPlaneXResolution) nor the catalogue states its pixel "
            "pitch"
        )
    held = adapt(calibration, _CAMERA_HOLDS, max_error_px=max_error_px)
    x, y = px_per_mm
    focal_mm = (held.intrinsics.fx / x + held.intrinsics.fy / y) / 2
    K = replace(held.intrinsics, fx=focal_mm * x, fy=focal_mm * y)
    fit = compare(calibration, replace(held, intrinsics=K))
    if fit.max_px > max_error_px:
        raise UnsupportedModelError(
            f"they have one focal length in mm, and fx / fy is not that of square pixels: projections are off by up "
            f"to {fit.max_px:.3g} px{accepted_with(fit.max_px)}"
        )
    texts: dict[str, str] = {
        "ModelType": "perspective",
        "PerspectiveFocalLength": _number_list(focal_mm),
        "PerspectiveFocalLengthUnits": "mm",
        "PrincipalPoint": _number_list(K.cx / x, K.cy / y),
    }
    if held.distortion is not None:
        terms = held.distortion.coefficients
        texts["PerspectiveDistortion"] = _number_list(
            *(terms[name] for name in ("k1", "k2", "k3", "p1", "p2"))
        )
    return Tags(properties={("Camera", PIX4D, name): text for name, text in texts.items()}, fit=fit)


def _number_list(*values: float) -> str:
    """Numbers with all digits and without an exponent, which not all readers of these tags accept."""
    return ",".join(np.format_float_positional(value + 0.0, trim="0") for value in values)


Properties = Mapping[tuple[str, str, str], str]
"""Texts by (prefix, namespace, local name). Programs find ``Camera:…`` by its prefix, so the prefix is kept."""

_RDF: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_DESCRIPTION, _ABOUT = f"{{{_RDF}}}Description", f"{{{_RDF}}}about"
_PROLOG: Final = re.compile(rb"(?>\xef\xbb\xbf|\s|\0|<\?(?>.*?\?>)|<!--(?>.*?-->))*+", re.DOTALL)
_PADDING: Final = re.compile(rb"[ \t\r\n\0]*")


def merged(packet: bytes | None, removed: Set[str], added: Properties, *, source: str) -> bytes:
    """Remove properties from a packet and add others.

    Args:
        packet: of the image; None if it has none.
        removed: names in lxml's notation, removed from every description.
        added: added as attributes of a new description.
        source: name of the image, for messages.

    Raises:
        ParseError: the packet is not UTF-8 or not well-formed XMP.
    """
    packet = packet if packet is not None else empty_packet(())
    start = _PROLOG.match(packet).end()  # type: ignore[union-attr]  # it matches nothing too
    end = packet.find(b">", packet.rfind(b"</")) + 1
    if b"\0" in packet[start:end] or end <= start:
        raise ParseError("its XMP is not UTF-8, as XMP in images has to be", source=source)
    root = parse_xml(packet[start:end], source=source, max_bytes=MAX_XMP_BYTES, whole=True)
    rdf = next(root.iter(f"{{{_RDF}}}RDF"), None)
    if rdf is None:
        raise ParseError("its XMP has no rdf:RDF", source=source)
    about = ""
    for node in list(rdf.iterchildren("*")):
        about = about or node.get(_ABOUT, "")
        _strip(node, removed)
    if added:
        _add(rdf, about, added)
    return _within(packet, start, end, _text(root))


def _strip(node: _Element, removed: Set[str]) -> None:
    for name in removed & {str(name) for name in node.attrib}:
        del node.attrib[name]
    for child in list(node.iterchildren("*")):
        if child.tag in removed:
            node.remove(child)


def _add(rdf: _Element, about: str, added: Properties) -> None:
    from lxml import etree

    # If two namespaces have one prefix, Adobe's toolkit and Exiv2 rename one: the image's own is kept.
    bound = {prefix: namespace for node in rdf.iter("*") for prefix, namespace in node.nsmap.items()}
    names = {key: bound.get(key[0], key[1]) for key in added}
    node = etree.SubElement(rdf, _DESCRIPTION, nsmap={key[0]: namespace for key, namespace in names.items()})
    node.set(_ABOUT, about)
    for key, namespace in names.items():
        node.set(f"{{{namespace}}}{key[2]}", added[key])
    node.tail = "\n "


def _text(root: _Element) -> bytes:
    from lxml import etree

    return etree.tostring(root, encoding="utf-8", xml_declaration=False, with_tail=False)


def _within(packet: bytes, start: int, end: int, body: bytes) -> bytes:
    """The packet with another body; the padding before its end compensates the difference in length."""
    head, tail = packet[:start], packet[end:]
    padding = _PADDING.match(tail).end()  # type: ignore[union-attr]  # it matches nothing too
    if padding == len(tail):
        return head + body + tail
    room = max(padding + (end - start) - len(body), 1)
    return (
        head
        + body
        + (tail[:room] if room <= padding else b" " * (room - padding) + tail[:padding])
        + tail[padding:]
    )
