"""A file's bytes as the sniffers see them: each view is made once, on demand, and shared by all formats.

A sniffer must never parse on its own: with some fifty formats every file would be parsed fifty times. The
views are made to recognise a file, not to read it; they never raise, and a broken file simply shows less of
itself.
"""

from __future__ import annotations

import json
import re
from enum import Enum
from functools import cached_property

from calibrary.errors import ParseError
from calibrary.parsers.text import decode
from calibrary.records import Json
from calibrary.strictjson import parse_json

__all__ = ["HEAD_BYTES", "MAX_JSON_BYTES", "Content", "Syntax"]

HEAD_BYTES = 64 * 1024
"""How much of a file the text views look at; what identifies a calibration stands near the top."""

MAX_JSON_BYTES = 16 * 1024 * 1024
"""JSON has no head: its keys are known once all of it is parsed, in half a second and 250 MB for this much."""

_XML_SKIPPED = re.compile(r"(?>\s+|<\?(?>.*?\?>)|<!--(?>.*?-->))*+", re.DOTALL)
_XML_TAG = re.compile(r"<([A-Za-z_][\w.:-]*+)(?=[\s/>])")
_JSON_BEGINS = re.compile(r'\{|\[\s*+(?:$|[\[\]{"\d-]|(?:true|false|null)\b)')
# Lengths are bounded, so that a line of a hundred thousand spaces costs no more than its share.
_YAML_KEY = re.compile(r"""^["']?([A-Za-z_][\w .-]{0,80}?)["']?[ \t]{0,8}:(?=[ \t]|$)""", re.MULTILINE)


class Syntax(Enum):
    """What a file is written in, as its beginning shows it."""

    XML = "XML"
    JSON = "JSON"
    TEXT = "other text"
    BINARY = "binary"


class Content:
    """What identifies a file.

    Attributes:
        data: all its bytes.
        name: the file's name, without a folder.
        max_json_bytes: longest JSON that is looked into.
        json_error: what is wrong with the JSON, once :attr:`json` was asked for and is broken.
    """

    def __init__(self, data: bytes, name: str, *, max_json_bytes: int = MAX_JSON_BYTES) -> None:
        self.data = data
        self.name = name
        self.max_json_bytes = max_json_bytes
        self.json_error: ParseError | None = None

    @cached_property
    def suffix(self) -> str:
        """Such as ".xml" for "Left.XML"; empty when there is none."""
        dot = self.name.rfind(".")
        return self.name[dot:].lower() if dot > 0 else ""

    @cached_property
    def text(self) -> str | None:
        """The head as text, None when it is binary."""
        head = self.data[:HEAD_BYTES]
        if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
            return None
        try:
            # A cut may part a character in two; a sniffer does not mind a replacement at the end.
            return decode(head, source=self.name, errors="replace")
        except ParseError:
            return None

    @cached_property
    def syntax(self) -> Syntax:
        """What it is written in; a broken file shows its kind as long as its beginning is whole."""
        if self.text is None:
            return Syntax.BINARY
        if self.xml_tags:
            return Syntax.XML
        return Syntax.JSON if self.looks_like_json else Syntax.TEXT

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """The head's lines without surrounding space, empty ones left out, and without one it ends in."""
        rows = (self.text or "").splitlines()
        if len(self.data) > HEAD_BYTES and len(rows) > 1:
            rows.pop()
        return tuple(line for raw in rows if (line := raw.strip()))

    @cached_property
    def first_line(self) -> str:
        """The first line that is not empty; "" when there is none."""
        return self.lines[0] if self.lines else ""

    @cached_property
    def xml_tags(self) -> tuple[str, ...]:
        """The element names in the head in document order, with their prefixes; the first is the root's.

        Empty when the file is not XML.
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
        """The root element's local name, None when the file is not XML."""
        return self.xml_tags[0].rpartition(":")[2] if self.xml_tags else None

    @cached_property
    def json(self) -> Json:
        """The JSON document, None when the file is none or is longer than ``max_json_bytes``."""
        if not self.looks_like_json or len(self.data) > self.max_json_bytes:
            return None
        try:
            return parse_json(self.data, source=self.name)
        except ParseError as error:
            self.json_error = error
            return None

    @property
    def parsed_json(self) -> Json:
        """The JSON document if a sniffer has asked for it, else None."""
        document: Json = self.__dict__.get("json")
        return document

    @cached_property
    def json_keys(self) -> tuple[str, ...]:
        """The keys of a JSON object in their order, empty for every other file."""
        return tuple(self.json) if isinstance(self.json, dict) else ()

    @cached_property
    def looks_like_json(self) -> bool:
        """Whether it begins as a JSON object or array does; an INI file's ``[section]`` does not."""
        return _JSON_BEGINS.match(self.first_line) is not None

    @cached_property
    def yaml_keys(self) -> tuple[str, ...]:
        """What comes before a colon at the start of a line of the head: a YAML mapping's outermost keys.

        The text need not be YAML by the book: OpenCV's and ORB-SLAM's dialects show theirs as well.
        """
        if self.xml_tags or self.looks_like_json:
            return ()
        return tuple(dict.fromkeys(_YAML_KEY.findall(self.text or "")))

    def beginning(self, characters: int = 40) -> str:
        """The first characters for a message, with what cannot be printed escaped."""
        return json.dumps((self.first_line or repr(self.data[:16]))[:characters])


def _without_comments(text: str) -> str:
    """XML without its comments; from one that does not end, nothing is left."""
    parts = text.split("<!--")
    return parts[0] + "".join(part.partition("-->")[2] for part in parts[1:])
