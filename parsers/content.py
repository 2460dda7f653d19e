"""Views of a file for the sniffers; each is computed once, on demand, and shared by all formats.

A sniffer must not parse a file itself: with more than fifty formats, every file would be parsed fifty times.
The views serve to recognise a file, not to read it. They never raise; a broken file gives less content.
"""

from __future__ import annotations

import codecs
import json
import re
from enum import Enum
from functools import cached_property

from calibrary.errors import ParseError
from calibrary.parsers.text import decode
from calibrary.records import Json
from calibrary.strictjson import parse_json

HEAD_BYTES = 64 * 1024
"""Bytes of a file that the text views use; a calibration can be identified by its beginning."""

MAX_JSON_BYTES = 16 * 1024 * 1024
"""Largest JSON that is parsed: its keys are known only after parsing all of it, for this size in 0.5 s and 250 MB."""

_XML_SKIPPED = re.compile(r"(?>\s+|<\?(?>.*?\?>)|<!--(?>.*?-->))*+", re.DOTALL)
_XML_TAG = re.compile(r"<([A-Za-z_][\w.:-]*+)(?=[\s/>])")
_DOCTYPE = re.compile(r"<!DOCTYPE\s+([A-Za-z_][\w.:-]{0,60})", re.IGNORECASE)
_JSON_BEGINS = re.compile(r'\{|\[\s*+(?:$|[\[\]{"\d-]|(?:true|false|null)\b)')
# Lengths are bounded, so that a line of a hundred thousand spaces takes linear time.
_YAML_KEY = re.compile(r"""^["']?([A-Za-z_][\w .-]{0,80}?)["']?[ \t]{0,8}:(?=[ \t]|$)""", re.MULTILINE)


UTF_16 = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
"""Encodings by their mark."""


def ended(data: bytes) -> bytes:
    """The bytes of a text with a newline at its end."""
    encoding = UTF_16.get(data[:2], "utf-8")
    if data[-8:].decode(encoding, "replace").endswith(("\n", "\r")):
        return data
    return data + "\n".encode(encoding)


class Syntax(Enum):
    """Syntax of a file, recognised by its beginning."""

    XML = "XML"
    JSON = "JSON"
    TEXT = "other text"
    BINARY = "binary"


class Content:
    """The content of a file, with views to identify it.

    Attributes:
        data: all bytes.
        name: file name without folder.
        max_json_bytes: largest JSON that is parsed.
        json_error: error of a broken JSON, after :attr:`json` was accessed.
    """

    def __init__(self, data: bytes, name: str, *, max_json_bytes: int = MAX_JSON_BYTES) -> None:
        self.data = data
        self.name = name
        self.max_json_bytes = max_json_bytes
        self.json_error: ParseError | None = None

    @cached_property
    def suffix(self) -> str:
        """Suffix in lower case, such as ".xml" for "Left.XML"; empty if there is none."""
        dot = self.name.rfind(".")
        return self.name[dot:].lower() if dot > 0 else ""

    @cached_property
    def text(self) -> str | None:
        """The beginning of the file as text, None if it is binary."""
        head = self.data[:HEAD_BYTES]
        if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
            return None
        try:
            # The cut may split a character; a replacement character at the end does not affect sniffers.
            return decode(head, source=self.name, errors="replace")
        except ParseError:
            return None

    @cached_property
    def syntax(self) -> Syntax:
        """Syntax of the file; also recognised in a broken file with an intact beginning."""
        if self.text is None:
            return Syntax.BINARY
        if self.xml_tags:
            return Syntax.XML
        return Syntax.JSON if self.looks_like_json else Syntax.TEXT

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """Non-empty, stripped lines of the beginning, without the possibly incomplete last one."""
        rows = (self.text or "").splitlines()
        if len(self.data) > HEAD_BYTES and len(rows) > 1:
            rows.pop()
        return tuple(line for raw in rows if (line := raw.strip()))

    @cached_property
    def first_line(self) -> str:
        """The first non-empty line; "" if there is none."""
        return self.lines[0] if self.lines else ""

    @cached_property
    def xml_tags(self) -> tuple[str, ...]:
        """Element names in the beginning of the file, in document order and with prefixes; the first is the root.

        Empty if the file is not XML.
        """
        text = self.text
        if text is None:
            return ()
        start = _XML_SKIPPED.match(text)
        position = start.end() if start else 0
        if not _XML_TAG.match(text, position):
            return ()
        return tuple(_XML_TAG.findall(_without_comments(text[position:])))

    @property
    def xml_root(self) -> str | None:
        """Local name of the root element, None if the file is not XML."""
        return self.xml_tags[0].rpartition(":")[2] if self.xml_tags else None

    @property
    def doctype(self) -> str | None:
        """Name in the declaration of a document type before the root element, None if there is none."""
        text = self.text or ""
        start = _XML_SKIPPED.match(text)
        found = _DOCTYPE.match(text, start.end() if start else 0)
        return found[1] if found else None

    @cached_property
    def json(self) -> Json:
        """The JSON document; None if the file is not JSON or is longer than ``max_json_bytes``."""
        if not self.looks_like_json or len(self.data) > self.max_json_bytes:
            return None
        try:
            return parse_json(self.data, source=self.name)
        except ParseError as error:
            self.json_error = error
            return None

    @property
    def parsed_json(self) -> Json:
        """The JSON document if it has already been parsed for a sniffer, else None."""
        document: Json = self.__dict__.get("json")
        return document

    @cached_property
    def json_keys(self) -> tuple[str, ...]:
        """The keys of a JSON object in order; empty for any other file."""
        return tuple(self.json) if isinstance(self.json, dict) else ()

    @cached_property
    def looks_like_json(self) -> bool:
        """Whether the file begins like a JSON object or array, unlike the ``[section]`` of an INI file."""
        return _JSON_BEGINS.match(self.first_line) is not None

    @cached_property
    def yaml_keys(self) -> tuple[str, ...]:
        """Words before a colon at the start of lines: the top-level keys of a YAML mapping.

        The text need not be standard YAML: the dialects of OpenCV and ORB-SLAM work as well.
        """
        if self.xml_tags or self.looks_like_json:
            return ()
        return tuple(dict.fromkeys(_YAML_KEY.findall(self.text or "")))

    @cached_property
    def names(self) -> frozenset[str]:
        """Tags of XML, else top keys of JSON or YAML."""
        return frozenset(self.xml_tags or self.json_keys or self.yaml_keys)

    def beginning(self, characters: int = 40) -> str:
        """The first characters for a message, with unprintable ones escaped."""
        return json.dumps((self.first_line or repr(self.data[:16]))[:characters])


def _without_comments(text: str) -> str:
    """XML without comments; an unterminated comment extends to the end."""
    parts = text.split("<!--")
    return parts[0] + "".join(part.partition("-->")[2] for part in parts[1:])
