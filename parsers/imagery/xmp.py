"""XMP: reading of the properties that concern the camera from packets.

XMP part 1 (ISO 16684-1) §7: RDF/XML with properties as attributes or elements of any number of
``rdf:Description``, simple, arrays (``rdf:Seq``, ``rdf:Bag``, ``rdf:Alt``) or structures in any of their
spellings.

The properties are a closed list: anything else (positions, times, RTK casters, owners) is never read from a file. In
XMP the prefix has no meaning, only the URI has, and makers spell theirs in several ways.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from calibrary.errors import ParseError
from calibrary.evidence.metadata import TagFault, XmpProperty
from calibrary.parsers.imagery.facts import clean_serial, clean_text
from calibrary.parsers.imagery.head import MAX_XMP_BYTES
from calibrary.parsers.xml import parse_xml

if TYPE_CHECKING:
    from lxml.etree import _Element

_PERSPECTIVE_AND_FISHEYE = (
    "BandName",
    "CentralWavelength",
    "RigName",
    "RigCameraIndex",
    "RigRelatives",
    "ModelType",
    "PrincipalPoint",
    "PerspectiveFocalLength",
    "PerspectiveFocalLengthUnits",
    "PerspectiveDistortion",
    "FisheyePolynomial",
    "FisheyeAffineMatrix",
    "FisheyeAffineSymmetric",
)

NAMESPACES: Final = {
    "drone-dji": ("http://www.dji.com/drone-dji/1.0/",),
    # As written by RedEdge, Altum and DJI, Sequoia, Parrot Disco, in this order.
    "Camera": (
        "http://pix4d.com/1.0",
        "http://pix4d.com/camera/1.0",
        "http://pix4d.com/camera/1.0/",
        "Camera/",
    ),
    "drone-skydio": ("https://www.skydio.com/drone-skydio/1.0/",),
    "sensefly": ("http://ns.sensefly.com/Camera/1.0/",),
    "MicaSense": ("http://micasense.com/MicaSense/1.0/",),
    "FLIR": ("http://ns.flir.com/xmp/1.0/",),
    "exif": ("http://ns.adobe.com/exif/1.0/",),
    "exifEX": ("http://cipa.jp/exif/1.0/",),
    "tiff": ("http://ns.adobe.com/tiff/1.0/",),
    "aux": ("http://ns.adobe.com/exif/1.0/aux/",),
    "crs": ("http://ns.adobe.com/camera-raw-settings/1.0/",),
    "GPano": ("http://ns.google.com/photos/1.0/panorama/",),
    "xmp": ("http://ns.adobe.com/xap/1.0/",),
    "xmpMM": ("http://ns.adobe.com/xap/1.0/mm/",),
}

_NAMES: Final = {
    "drone-dji": (
        "BandName",
        "CalibratedFocalLength",
        "CalibratedOpticalCenterX",
        "CalibratedOpticalCenterY",
        "CameraSource",
        "DewarpData",
        "DewarpDataK6",
        "DewarpFlag",
        "DroneModel",
        "ImageSource",
        "ProductName",
        "ShutterType",
    ),
    "Camera": _PERSPECTIVE_AND_FISHEYE,
    "drone-skydio": (
        "CalibratedFocalLength",
        "CalibratedFocalLength/X",
        "CalibratedFocalLength/Y",
        "CalibratedFocalLengthX",
        "CalibratedFocalLengthY",
        "CalibratedOpticalCenter",
        "CalibratedOpticalCenter/X",
        "CalibratedOpticalCenter/Y",
        "CalibratedOpticalCenterX",
        "CalibratedOpticalCenterY",
        "CameraSource",
        "DewarpData",
        "DewarpFlag",
        "ImageSource",
    ),
    "sensefly": _PERSPECTIVE_AND_FISHEYE,
    "MicaSense": ("BandName", "RigCameraIndex"),
    "FLIR": ("CameraHorizontalFOV", "CameraVerticalFOV", "FocalLength", "LensModel"),
    # Teledyne FLIR writes the fields of view here; the others survive a conversion that drops EXIF.
    "exif": (
        "CameraHorizontalFOV",
        "CameraVerticalFOV",
        "DigitalZoomRatio",
        "FocalLength",
        "FocalLengthIn35mmFilm",
        "FocalPlaneResolutionUnit",
        "FocalPlaneXResolution",
        "FocalPlaneYResolution",
        "PixelXDimension",
        "PixelYDimension",
    ),
    "exifEX": ("LensMake", "LensModel", "LensSpecification"),
    "tiff": ("Make", "Model", "Orientation"),
    "aux": ("DistortionCorrectionAlreadyApplied", "Lens", "LensID", "LensInfo"),
    "crs": (
        "AlreadyApplied",
        "CropAngle",
        "CropBottom",
        "CropLeft",
        "CropRight",
        "CropTop",
        "HasCrop",
        "HasSettings",
        "LensManualDistortionAmount",
        "LensProfileEnable",
        "LensProfileName",
        "PerspectiveUpright",
    ),
    "GPano": ("ProjectionType", "StitchingSoftware"),
    "xmp": ("CreatorTool",),
    "xmpMM": ("History/action", "History/parameters", "History/softwareAgent"),
}


class SerialRank(IntEnum):
    """How closely a serial number is associated with the camera; the highest rank counts.

    A drone may carry several cameras, and EXIF's BodySerialNumber is that of the drone or the camera, or
    truncated, depending on the model.
    """

    BODY = 0
    LENS = 1
    DRONE = 2
    CAMERA = 3


def _clark(schema: str, name: str) -> tuple[str, ...]:
    """A property's names in lxml's notation, one for each URI of its schema."""
    return tuple(f"{{{uri}}}{name}" for uri in NAMESPACES[schema])


PROPERTIES = MappingProxyType(
    {
        clark: (
            schema,
            top,
            frozenset(name.partition("/")[2] for name in names if name.partition("/")[0] == top),
        )
        for schema, names in _NAMES.items()
        for top in dict.fromkeys(name.partition("/")[0] for name in names)
        for clark in _clark(schema, top)
    }
)
"""(schema, local name, members to read; "" is the property itself), by name in lxml's notation."""

SERIALS = MappingProxyType(
    {
        clark: rank
        for rank, schema, name in (
            (SerialRank.CAMERA, "drone-dji", "CameraSerialNumber"),
            (SerialRank.CAMERA, "FLIR", "CameraSerialNumber"),
            (SerialRank.CAMERA, "Camera", "CameraSerialNumber"),
            (SerialRank.DRONE, "drone-dji", "DroneSerialNumber"),
            (SerialRank.DRONE, "drone-skydio", "VehicleId"),
            (SerialRank.LENS, "drone-dji", "LensSerialNumber"),
            (SerialRank.LENS, "exifEX", "LensSerialNumber"),
            (SerialRank.LENS, "aux", "LensSerialNumber"),
            (SerialRank.BODY, "exifEX", "BodySerialNumber"),
            (SerialRank.BODY, "aux", "SerialNumber"),
        )
        for clark in _clark(schema, name)
    }
)
"""Properties with serial numbers, of which only a hash is kept."""

SOFTWARE = frozenset(_clark("drone-skydio", "ReleaseKey") + _clark("tiff", "Software"))
(TIFF_MAKE,) = _clark("tiff", "Make")
(TIFF_MODEL,) = _clark("tiff", "Model")


MAX_VALUE = 2000
"""Most characters of a value; a DewarpDataK6 has two hundred."""
MAX_ITEMS = 200

_RDF = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
_DESCRIPTION, _ITEM, _VALUE, _RESOURCE = f"{_RDF}Description", f"{_RDF}li", f"{_RDF}value", f"{_RDF}resource"
_ARRAYS = frozenset({f"{_RDF}Seq", f"{_RDF}Bag", f"{_RDF}Alt"})
_TAKEN = frozenset({*PROPERTIES, *SERIALS, *SOFTWARE})
_SYNTAX = (_RDF, "{http://www.w3.org/XML/1998/namespace}")

MAX_REMEMBERED = 64 * 1024
"""Longest packet in bytes that is cached; one that fits into a JPEG segment is shorter."""
_READ = frozenset(clark.rpartition("}")[2].encode() for clark in (*_TAKEN, _ITEM, _VALUE, _RESOURCE)) | {
    part.encode() for *_, members in PROPERTIES.values() for member in members for part in member.split("/")
}
"""Local names of everything that is read, in any namespace."""
_CLOSING = re.compile(rb"""<\?xpacket end=["'][rw]["']\?>""")
_BRACKET = re.compile(rb"<\w|<|>")
_UP_TO_VALUE = re.compile(rb"\s(?!xml)[\w.-]+:([\w.-]+)=\Z")
_HARMLESS = bytes({*range(0x20, 0x7F)} - {*b"\"'<&"})

_Words: TypeAlias = tuple[tuple[str, tuple[tuple[str, str], ...]], ...]


class XmpWords(NamedTuple):
    """Unparsed camera properties of one image's packets; equal for all images of one camera.

    Attributes:
        properties: each as (name in lxml's notation, pairs of (member of the structure or "", text)).
        faults: packets that cannot be read.
    """

    properties: _Words = ()
    faults: tuple[TagFault, ...] = ()


@dataclass(slots=True)
class XmpFacts:
    """Facts from the packets of one image.

    Attributes:
        properties: by (schema, name), in document order; the first of a name counts.
        make, model, software: used if EXIF has none.
        serials: raw, by rank; must never be written anywhere.
        faults: unusable packets and properties.
    """

    properties: dict[tuple[str, str], XmpProperty] = field(default_factory=dict)
    make: str | None = None
    model: str | None = None
    software: str | None = None
    serials: dict[SerialRank, str] = field(default_factory=dict, repr=False)
    faults: list[TagFault] = field(default_factory=list)


def read_xmp(packets: Iterable[bytes], source: str) -> XmpWords:
    """Read an image's packets, main one first; a broken packet is a fault, the others are still read."""
    found: list[tuple[str, tuple[tuple[str, str], ...]]] = []
    faults: list[TagFault] = []
    for packet in packets:
        try:
            found += _read_packet(_trimmed(packet), source)
        except ParseError as error:
            reason = ", ".join(part for part in (error.message, error.place) if part)
            faults.append(TagFault("XMP", reason, "well-formed XMP"))
    return XmpWords(tuple(found), tuple(faults))


def _read_packet(packet: bytes, source: str) -> _Words:
    if len(packet) > MAX_REMEMBERED:
        return _parse(packet, source)
    return _parse_once(_without_unread(packet))


@lru_cache(maxsize=64)
def _parse_once(packet: bytes) -> _Words:
    return _parse(packet, "XMP")


def _parse(packet: bytes, source: str) -> _Words:
    found: list[tuple[str, tuple[tuple[str, str], ...]]] = []
    for rdf in parse_xml(packet, source=source, max_bytes=MAX_XMP_BYTES).iter(f"{_RDF}RDF"):
        for node in rdf:
            found += ((name, (("", str(text)),)) for name, text in node.items() if name in _TAKEN)
            found += ((child.tag, tuple(_values(child))) for child in node if child.tag in _TAKEN)
    return tuple(found)


def _without_unread(packet: bytes) -> bytes:
    """The packet without the values of attributes that are not read: dates, positions, angles.

    The result is the same for all images of a flight, so it is parsed only once. It contains the same camera
    properties, with the same faults in the same lines: a value is removed only if it cannot be a fault.
    """
    parts = packet.split(b'"')
    unread = _unread(b'"'.join(parts[::2]))
    if b"".join([parts[at] for at in unread]).translate(None, _HARMLESS):
        return packet
    for at in unread:
        parts[at] = b""
    return b'"'.join(parts)


@lru_cache(maxsize=64)
def _unread(around: bytes) -> tuple[int, ...]:
    """Indices of the parts of a packet, split at quotation marks, that are values of attributes that are not read.

    Args:
        around: every second part, that is those around the values, joined by quotation marks.
    """
    if b"'" in around or b"<!" in around:
        return ()  # otherwise a quotation mark inside a tag can only begin or end a value
    unread, in_tag = [], False
    for number, part in enumerate(around.split(b'"')[:-1]):
        for bracket in _BRACKET.findall(part):
            in_tag = len(bracket) == 2
        attribute = _UP_TO_VALUE.search(part)
        if in_tag and attribute is not None and attribute[1] not in _READ:
            unread.append(2 * number + 1)
    return tuple(unread)


def xmp_facts(said: XmpWords) -> XmpFacts:
    """Convert the properties of packets to facts."""
    facts = XmpFacts(faults=[*said.faults])
    for name, values in said.properties:
        _take(name, values, facts)
    return facts


def _trimmed(packet: bytes) -> bytes:
    """The packet from its first "<" to its last ">", because cameras pad with spaces, NUL and byte-order marks.

    The closing processing instruction, after some kilobytes of spaces, is removed as well.
    """
    start, end = packet.find(b"<"), packet.rfind(b">") + 1
    if packet[start + 1 : start + 2] == b"\0":
        return b"\xff\xfe" + packet[start : end + 1]
    if start > 0 and packet[start - 1] == 0:
        return b"\xfe\xff" + packet[start - 1 : end]
    packet = packet[max(start, 0) : end]
    closing = max(packet.rfind(b"<?xpacket"), 0)
    return packet[:closing].rstrip() if _CLOSING.fullmatch(packet, closing) else packet


def _take(clark: str, values: Iterable[tuple[str, str]], facts: XmpFacts) -> None:
    """Store one property's values, given as (member of the structure or "", text), in ``facts``."""
    members: dict[str, list[str]] = {}
    for member, text in values:
        stripped = " ".join(text.split())
        if stripped:
            members.setdefault(member, []).append(stripped)
    first = members.get("", [""])[0]
    if clark in SERIALS:
        if (serial := clean_serial(first)) is not None:
            facts.serials.setdefault(SERIALS[clark], serial)
        return
    if clark in SOFTWARE:
        facts.software = facts.software or clean_text(first)
        return
    if clark == TIFF_MAKE:
        facts.make = facts.make or clean_text(first)
    elif clark == TIFF_MODEL:
        facts.model = facts.model or clean_text(first)
    schema, name, wanted = PROPERTIES[clark]
    for member, texts in members.items():
        if member in wanted:
            _keep(XmpProperty(schema, f"{name}/{member}" if member else name, tuple(texts)), facts)


def _keep(item: XmpProperty, facts: XmpFacts) -> None:
    length = sum(map(len, item.values))
    if length > MAX_VALUE or len(item.values) > MAX_ITEMS:
        found = f"{len(item.values)} values of {length} characters"
        wanted = f"at most {MAX_ITEMS} values of {MAX_VALUE} characters"
        facts.faults.append(TagFault(f"XMP {item.schema}:{item.name}", found, wanted))
        return
    printable = tuple(
        text if text.isprintable() else "".join(filter(str.isprintable, text)) for text in item.values
    )
    facts.properties.setdefault((item.schema, item.name), XmpProperty(item.schema, item.name, printable))


def _values(element: _Element, member: str = "") -> Iterator[tuple[str, str]]:
    """Yield (member or "", text) of a property element or array item, in document order."""
    for name, text in element.items():
        if name in {_RESOURCE, _VALUE}:
            yield member, str(text)
        elif not str(name).startswith(_SYNTAX):
            yield _inside(member, str(name)), str(text)
    for child in element:
        if child.tag in _ARRAYS:
            for item in child.iterchildren(_ITEM):
                yield from _values(item, member)
        elif child.tag in {_DESCRIPTION, _VALUE}:
            yield from _values(child, member)
        else:
            yield from _values(child, _inside(member, str(child.tag)))
    if len(element) == 0 and element.text:
        yield member, element.text


def _inside(member: str, clark: str) -> str:
    local = clark.rpartition("}")[2]
    return f"{member}/{local}" if member else local
