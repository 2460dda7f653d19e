"""The one way XML enters calibrary: no DTD, no entities, no network, bounded in bytes, in depth and in memory.

A calibration file or an XMP packet has no use for a document type, and a document type is what every XML
attack needs (entity expansion, external files), so one is refused before the parser sees it.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from calibrary.errors import ParseError

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["MAX_BYTES", "MAX_DEPTH", "parse_xml"]

MAX_BYTES = 16 * 1024 * 1024
"""A block of some twenty thousand Metashape cameras is about this long."""

MAX_DEPTH = 64

MAX_TREE_BYTES = 320 * 1024 * 1024
"""What the tree may take in memory; the rest of half a gigabyte is for who reads it. Metashape's and Bentley's
files take some eight times their length, hostile ones up to sixty times."""

NODE_BYTES = 160
"""An element, or the text between two: libxml2's node of 120 bytes, its string, malloc's share."""

ATTRIBUTE_BYTES = 340
"""An attribute and the node of its text, likewise."""

MAX_OPAQUE_BYTES = 2 * 1024 * 1024
"""Of a document in whose encoding a "<" is not the byte 0x3C, so that its tags cannot be counted."""

_UTF_16 = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
# A document type may follow only white space, processing instructions and comments (XML 1.0, production 22).
# The groups are atomic, so hostile prologs cost linear time.
_DECLARED = re.compile(rb"""\s*<\?xml[^>]{0,100}?\sencoding\s*=\s*["']([\w.:-]{1,40})""")
_WITH_ASCII = re.compile(
    rb"utf-?(?:8|16|32)(?:-?[lb]e)?|(?:us-)?ascii|iso-8859-\d+|latin-?\d+|(?:windows-|cp)125\d|koi8-[ru]|"
    rb"shift_jis|euc-(?:jp|kr|tw)|gb(?:2312|k|18030)|big5",
    re.IGNORECASE,
)
_DOCTYPE = re.compile(rb"(?>\s+|<\?(?>.*?\?>)|<!--(?>.*?-->))*+<!DOCTYPE", re.DOTALL)


def parse_xml(
    data: bytes, *, source: str, max_bytes: int = MAX_BYTES, max_depth: int = MAX_DEPTH, whole: bool = False
) -> _Element:
    """The root element of an XML document that cannot reach outside itself.

    Comments and processing instructions are left out of the tree, so every child is an element, unless it is to be
    written again. A byte-order mark and any encoding libxml2 knows are fine.

    Args:
        data: the whole document.
        source: the file's name, for messages.
        max_bytes: longest document accepted.
        max_depth: deepest nesting of elements accepted; the root is at depth 1.
        whole: keep comments and processing instructions.

    Raises:
        ParseError: the document is not well-formed, has a DTD, or is too long, too deep or too dense.
    """
    from lxml import etree

    if len(data) > max_bytes:
        raise ParseError(f"{len(data)} bytes of XML; at most {max_bytes} are read", source=source)
    prolog = _ascii_prolog(data)
    if _DOCTYPE.match(prolog):
        raise _dtd_refused(source)
    elements = _refuse_dense(data, prolog, source)
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        attribute_defaults=False,
        huge_tree=False,
        recover=False,
        remove_comments=not whole,
        remove_pis=not whole,
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise ParseError(
            f"this is not well-formed XML: {_reason(error)}", source=source, place=_place(error)
        ) from None
    except (
        ValueError,
        LookupError,
    ) as error:  # lxml's own refusals, such as a declared encoding it cannot decode
        raise ParseError(f"this is not readable XML: {error}", source=source) from None
    # A document in an encoding the prolog test cannot see through (EBCDIC, UTF-7) ends here.
    if root.getroottree().docinfo.internalDTD is not None:
        raise _dtd_refused(source)
    if elements > max_depth and root.xpath(f"boolean({'/*' * (max_depth + 1)})"):
        raise ParseError(f"XML elements are nested more than {max_depth} deep", source=source)
    return root


def _refuse_dense(data: bytes, prolog: bytes, source: str) -> float:
    """Estimate from above, by counting marks, what a tree will take before anything is built.

    Returns:
        how many elements there can be at most.

    Raises:
        ParseError: it is too much.
    """
    declared = _DECLARED.match(prolog[:256])
    opaque = not prolog.lstrip().startswith(b"<") or (declared and not _WITH_ASCII.fullmatch(declared[1]))
    if opaque and len(data) > MAX_OPAQUE_BYTES:
        raise ParseError(
            f"{len(data)} bytes of XML in an unusual encoding; at most {MAX_OPAQUE_BYTES} are read, save it as UTF-8",
            source=source,
        )
    tags = data.count(b"<")
    if len(data) * ATTRIBUTE_BYTES <= MAX_TREE_BYTES:
        return math.inf if opaque else tags  # no byte takes more
    # Before every tag there may be a text; one that closes makes no element.
    nodes = 2 * tags - data.count(b"</")
    estimate = nodes * NODE_BYTES + data.count(b"=") * ATTRIBUTE_BYTES
    if estimate > MAX_TREE_BYTES:
        raise ParseError(
            f"{tags} tags of XML, more than are read at once: in memory they would take up to "
            f"{estimate // 2**20} MiB; leave out what is not cameras",
            source=source,
        )
    return math.inf if opaque else tags


def _ascii_prolog(data: bytes) -> bytes:
    """The document as ASCII where its encoding leaves ASCII recognisable: UTF-8, -16, -32, Latin-n."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    for mark in _UTF_16:
        data = data.removeprefix(mark)
    return data.replace(b"\0", b"") if b"\0" in data[:4] else data


def _dtd_refused(source: str) -> ParseError:
    return ParseError(
        "the XML has a document type (DTD), which nothing here needs; take the <!DOCTYPE …> out of it",
        source=source,
    )


def _reason(error: Exception) -> str:
    """libxml2's sentence without the position, which goes into ``place``."""
    return (
        re.sub(r",? line \d+, column \d+.*$", "", str(error), flags=re.DOTALL).strip()[:200]
        or "unknown fault"
    )


def _place(error: object) -> str | None:
    line = getattr(error, "lineno", None)
    return f"line {line}" if line else None
