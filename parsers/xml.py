"""Parsing of XML, used for all XML in calibrary: no DTD, no entities, no network, bounded size, depth and memory.

Calibration files and XMP packets need no document type, but every XML attack does (entity expansion, external
files), so a document type is refused before parsing.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.document import accounted

if TYPE_CHECKING:
    from lxml.etree import _Element

MAX_BYTES = 16 * 1024 * 1024
"""Longest document; about the size of a block of twenty thousand Metashape cameras."""

MAX_DEPTH = 64

MAX_TREE_BYTES = 320 * 1024 * 1024
"""Largest memory of the tree; the rest of half a gigabyte is for the reader. Metashape's and Bentley's files take
about eight times their length, hostile ones up to sixty times."""

NODE_BYTES = 160
"""Memory of an element or a text node: libxml2's node of 120 bytes, its string, malloc's overhead."""

ATTRIBUTE_BYTES = 340
"""Memory of an attribute and its text node."""

MAX_OPAQUE_BYTES = 2 * 1024 * 1024
"""Longest document in an encoding in which "<" is not the byte 0x3C, so that tags cannot be counted."""

_UTF_16 = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
# A document type may follow only white space, processing instructions and comments (XML 1.0, production 22).
# The groups are atomic, so hostile prologs take linear time.
_DECLARED = re.compile(rb"""\s*<\?xml[^>]{0,100}?\sencoding\s*=\s*["']([\w.:-]{1,40})""")
_WITH_ASCII = re.compile(
    rb"utf-?(?:8|16|32)(?:-?[lb]e)?|(?:us-)?ascii|iso-8859-\d+|latin-?\d+|(?:windows-|cp)125\d|koi8-[ru]|"
    rb"shift_jis|euc-(?:jp|kr|tw)|gb(?:2312|k|18030)|big5",
    re.IGNORECASE,
)
_DOCTYPE = re.compile(rb"(?>\s+|<\?(?>.*?\?>)|<!--(?>.*?-->))*+<!DOCTYPE", re.DOTALL)


@accounted
def parse_xml(
    data: bytes, *, source: str, max_bytes: int = MAX_BYTES, max_depth: int = MAX_DEPTH, whole: bool = False
) -> _Element:
    """Parse an XML document without access to anything outside it, and return the root element.

    Comments and processing instructions are removed unless ``whole`` is set, so that every child is an
    element. A byte-order mark and all encodings of libxml2 are supported.

    Args:
        data: the whole document.
        source: the file's name, for messages.
        max_bytes: longest document accepted.
        max_depth: deepest nesting of elements accepted; the root is at depth 1.
        whole: whether to keep comments and processing instructions.

    Raises:
        ParseError: the document is not well-formed, has a DTD, or is too long, too deep or too dense.
    """
    from lxml import etree

    strict.refuse_longer(data, max_bytes, "XML of this kind", source=source)
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
    ) as error:  # errors of lxml itself, such as an unknown declared encoding
        raise ParseError(f"this is not readable XML: {error}", source=source) from None
    # Reached by a document in an encoding that the prolog test cannot decode (EBCDIC, UTF-7).
    if root.getroottree().docinfo.internalDTD is not None:
        raise _dtd_refused(source)
    if elements > max_depth and root.xpath(f"boolean({'/*' * (max_depth + 1)})"):
        raise ParseError(f"XML elements are nested more than {max_depth} deep", source=source)
    return root


def _refuse_dense(data: bytes, prolog: bytes, source: str) -> float:
    """Refuse a document with too large a tree, from an upper bound by counting marks before parsing.

    Returns:
        Upper bound of the number of elements.

    Raises:
        ParseError: the tree would be too large.
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
        return math.inf if opaque else tags  # the worst case per byte
    # Each tag may be preceded by a text; a closing tag makes no element.
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
    """The document as ASCII, if its encoding permits: UTF-8, -16, -32, Latin-n."""
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
    """libxml2's message without the position, which is put into ``place``."""
    return (
        re.sub(r",? line \d+, column \d+.*$", "", str(error), flags=re.DOTALL).strip()[:200]
        or "unknown fault"
    )


def _place(error: object) -> str | None:
    line = getattr(error, "lineno", None)
    return f"line {line}" if line else None
