"""XMP packets in every spelling that cameras use.

RDF lets one fact be written in several ways, and vendors use all of them: DJI attributes of one
rdf:Description, MicaSense elements in three of them, Skydio structures, MicaSense rdf:Seq, and at least four
namespace URIs behind the prefix ``Camera``. ISO 16684-1; extended XMP and JPEG's segments are of Adobe's XMP
specification, part 3, section 1.1.3.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

from calibrary.errors import InputError


@dataclass(frozen=True, slots=True)
class Namespace:
    """A prefix and the URI it stands for; any two may be paired."""

    prefix: str
    uri: str


CAMERA_RAW = Namespace("crs", "http://ns.adobe.com/camera-raw-settings/1.0/")
DC = Namespace("dc", "http://purl.org/dc/elements/1.1/")
DLS = Namespace("DLS", "http://micasense.com/DLS/1.0/")
DRONE_DJI = Namespace("drone-dji", "http://www.dji.com/drone-dji/1.0/")
DRONE_SKYDIO = Namespace("drone-skydio", "https://www.skydio.com/drone-skydio/1.0/")
EXIF = Namespace("exif", "http://ns.adobe.com/exif/1.0/")
MICASENSE = Namespace("MicaSense", "http://micasense.com/MicaSense/1.0/")
PIX4D_1 = Namespace("Camera", "http://pix4d.com/1.0")
PIX4D_CAMERA = Namespace("Camera", "http://pix4d.com/camera/1.0")
PIX4D_CAMERA_SLASH = Namespace("Camera", "http://pix4d.com/camera/1.0/")
TIFF = Namespace("tiff", "http://ns.adobe.com/tiff/1.0/")
XMP = Namespace("xmp", "http://ns.adobe.com/xap/1.0/")
_NOTE = Namespace("xmpNote", "http://ns.adobe.com/xmp/note/")
_RDF = Namespace("rdf", "http://www.w3.org/1999/02/22-rdf-syntax-ns#")
_META = Namespace("x", "adobe:ns:meta/")


class ListKind(StrEnum):
    """RDF's three containers."""

    SEQ = "Seq"
    BAG = "Bag"
    ALT = "Alt"


class StructForm(StrEnum):
    """RDF's three spellings of a structure."""

    RESOURCE = 'rdf:parseType="Resource"'
    DESCRIPTION = "a nested rdf:Description"
    INLINE = "attributes of the property's element"


@dataclass(frozen=True, slots=True, kw_only=True)
class XmpText:
    """A simple property, as an attribute of its rdf:Description or as an element in it."""

    namespace: Namespace
    name: str
    text: str
    as_attribute: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class XmpList:
    """A list of texts."""

    namespace: Namespace
    name: str
    texts: tuple[str, ...]
    kind: ListKind = ListKind.SEQ


@dataclass(frozen=True, slots=True, kw_only=True)
class XmpStruct:
    """A structure of named texts, such as X and Y."""

    namespace: Namespace
    name: str
    members: tuple[tuple[str, str], ...]
    form: StructForm = StructForm.RESOURCE


XmpItem: TypeAlias = XmpText | XmpList | XmpStruct


def attributes(namespace: Namespace, /, **texts: str) -> tuple[XmpItem, ...]:
    """Simple properties in attribute form, as DJI writes them."""
    return tuple(XmpText(namespace=namespace, name=name, text=text) for name, text in texts.items())


def elements(namespace: Namespace, /, **texts: str | tuple[str, ...]) -> tuple[XmpItem, ...]:
    """Simple properties in element form, and rdf:Seq for those of several texts, as MicaSense writes them."""
    return tuple(
        XmpText(namespace=namespace, name=name, text=text, as_attribute=False)
        if isinstance(text, str)
        else XmpList(namespace=namespace, name=name, texts=text)
        for name, text in texts.items()
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class XmpDescription:
    """One rdf:Description with the namespaces its items need."""

    items: tuple[XmpItem, ...]
    about: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class XmpPacket:
    """A whole packet.

    Attributes:
        descriptions: in document order.
        toolkit: x:xmptk, the program that claims to have written it.
        wrapped: whether it stands between the ``<?xpacket?>`` instructions.
        length: total bytes, filled up with blanks before the end as cameras do; None for no padding.
        extended: what goes to extended XMP, where there is any.
        extended_guid: the GUID under which the main packet announces it, where that is a lie.
    """

    descriptions: tuple[XmpDescription, ...]
    toolkit: str | None = None
    wrapped: bool = True
    length: int | None = None
    extended: tuple[XmpDescription, ...] = field(default=())
    extended_guid: str | None = None

    def encode(self) -> bytes:
        """The main packet, UTF-8.

        Raises:
            InputError: one prefix stands for two URIs in one description, or the packet exceeds ``length``.
        """
        descriptions = self.descriptions
        if self.extended:
            note = attributes(_NOTE, HasExtendedXMP=self.extended_guid or self.guid())
            descriptions = (*descriptions, XmpDescription(items=note))
        body = _document(descriptions, self.toolkit)
        head, tail = ('<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n', '<?xpacket end="w"?>')
        before = (head + body if self.wrapped else body).encode()
        after = tail.encode() if self.wrapped else b""
        taken = len(before) + len(after)
        length = taken if self.length is None else self.length
        if taken > length:
            raise InputError(f"the XMP packet takes {taken} bytes, expected at most {length}")
        return before + _blanks(length - taken) + after

    def encode_extended(self) -> bytes:
        """The extended part: no xpacket instructions, nothing padded; empty where there is none."""
        return _document(self.extended, self.toolkit).encode() if self.extended else b""

    def guid(self) -> str:
        """MD5 of the extended part, the name both parts know it by."""
        return hashlib.md5(self.encode_extended(), usedforsecurity=False).hexdigest().upper()


def _document(descriptions: tuple[XmpDescription, ...], toolkit: str | None) -> str:
    tool = f" x:xmptk={_quoted(toolkit)}" if toolkit is not None else ""
    lines = [f'<x:xmpmeta xmlns:x="{_META.uri}"{tool}>', f' <rdf:RDF xmlns:rdf="{_RDF.uri}">']
    for description in descriptions:
        lines.extend(_description(description))
    return "\n".join([*lines, " </rdf:RDF>", "</x:xmpmeta>", ""])


def _description(description: XmpDescription) -> Iterator[str]:
    yield f"  <rdf:Description rdf:about={_quoted(description.about)}"
    uris: dict[str, str] = {}
    for item in description.items:
        space = item.namespace
        if uris.setdefault(space.prefix, space.uri) != space.uri:
            raise InputError(
                f"prefix {space.prefix!r} stands for {uris[space.prefix]!r} and {space.uri!r} in one "
                "rdf:Description; give each URI a description of its own"
            )
    yield from (f"    xmlns:{prefix}={_quoted(uri)}" for prefix, uri in uris.items())
    inner = []
    for item in description.items:
        if isinstance(item, XmpText) and item.as_attribute:
            yield f"   {_name(item)}={_quoted(item.text)}"
        else:
            inner.append(item)
    yield "  >"
    for item in inner:
        yield f"   {_element(item)}"
    yield "  </rdf:Description>"


def _element(item: XmpItem) -> str:
    name = _name(item)
    if isinstance(item, XmpText):
        return f"<{name}>{escaped(item.text)}</{name}>"
    if isinstance(item, XmpList):
        texts = "".join(f"<rdf:li>{escaped(text)}</rdf:li>" for text in item.texts)
        return f"<{name}><rdf:{item.kind}>{texts}</rdf:{item.kind}></{name}>"
    prefix = item.namespace.prefix
    if item.form is StructForm.INLINE:
        return f"<{name}{''.join(f' {prefix}:{key}={_quoted(text)}' for key, text in item.members)}/>"
    members = "".join(f"<{prefix}:{key}>{escaped(text)}</{prefix}:{key}>" for key, text in item.members)
    if item.form is StructForm.RESOURCE:
        return f'<{name} rdf:parseType="Resource">{members}</{name}>'
    return f"<{name}><rdf:Description>{members}</rdf:Description></{name}>"


def _name(item: XmpItem) -> str:
    return f"{item.namespace.prefix}:{item.name}"


# Blanks other than the space would be folded to spaces in an attribute (XML 1.0, section 3.3.3).
_ESCAPES = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
)


def escaped(text: str) -> str:
    """Text as it stands in an XML element or between double quotes."""
    return text.translate(_ESCAPES)


def _quoted(text: str) -> str:
    return f'"{escaped(text)}"'


def _blanks(count: int) -> bytes:
    """Padding in lines of a hundred, so that editors that show it stay usable."""
    line = b" " * 99 + b"\n"
    return (line * (count // 100 + 1))[:count]
