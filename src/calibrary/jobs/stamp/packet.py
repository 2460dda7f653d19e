"""Merging of properties into an XMP packet; the rest stays unchanged, and its length too if the padding suffices."""

from __future__ import annotations

import re
from collections.abc import Mapping, Set
from typing import TYPE_CHECKING, Final

from calibrary.errors import ParseError
from calibrary.parsers.imagery.head import MAX_XMP_BYTES
from calibrary.parsers.xml import parse_xml
from calibrary.synthetic import packet as empty_packet

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["Properties", "merged"]

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
