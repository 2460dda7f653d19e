"""Error message for a file that no format recognises: what it probably is instead, and the next step."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import islice

from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.text import shown

__all__ = ["described"]

LISTED_KEYS = 8

_ZIP = b"PK\x03\x04"
_MARKS = (
    (b"\x1f\x8b", "it is compressed with gzip; decompress it first (gunzip)"),
    (b"BZh", "it is compressed with bzip2; decompress it first (bunzip2)"),
    (b"\xfd7zXZ\0", "it is compressed with xz; decompress it first (unxz)"),
    (b"\x28\xb5\x2f\xfd", "it is compressed with Zstandard; decompress it first (unzstd)"),
    (_ZIP, "it is a ZIP archive; unpack it, and give the calibration file in it"),
    (b"7z\xbc\xaf\x27\x1c", "it is a 7z archive; unpack it, and give the calibration file in it"),
    (b"%PDF-", "it is a PDF; export the calibration from its program in a format of `calibrary formats`"),
)
_NUMPY_MEMBER = re.compile(rb"([\w.-]{1,60})\.npy")
_HTML = re.compile(r"<!doctype html|<html\b", re.IGNORECASE)
_HTML_STEP = "it is an HTML page, as servers send in place of a file; download the file itself"


def described(content: Content) -> str:
    """The sentence of the error message."""
    if content.data.startswith(_ZIP) and (arrays := _NUMPY_MEMBER.findall(content.data)):
        return f"no format claims it: {_of_arrays(arrays)}"
    for mark, sentence in _MARKS:
        if content.data.startswith(mark):
            return f"no format claims it: {sentence}"
    text = content.text
    if text is not None and not content.lines:
        return "no format claims it: it is blank; export or copy it again"
    if text is not None and _HTML.match(text.lstrip()):
        return f"no format claims it: {_HTML_STEP}"
    message = f"no format claims it; it begins with {content.beginning()}"
    if content.syntax is Syntax.JSON and content.json is None:
        # A valid document that begins like an object or a list would not be None.
        return f"{message}, and {_why_no_json(content)}"
    return f"{message}{_contents(content)}; if you know what it is, say so with --format NAME"


def _of_arrays(members: list[bytes]) -> str:
    listed = _listed(dict.fromkeys(name.decode("ascii", "replace") for name in members))
    return (
        f"it is a zip archive of numpy arrays, {listed}, and none has a camera matrix's name; save it again with"
        " np.savez(…, camera_matrix=…, dist_coeffs=…)"
    )


def _why_no_json(content: Content) -> str:
    error = content.json_error
    if error is None:
        return (
            f"JSON of over {content.max_json_bytes} bytes is not looked into unless --max-size-mib is raised"
        )
    why = f"{error.message} at {error.place}" if error.place else error.message
    return f"{why}; it may be cut short or edited: export or copy it again"


def _contents(content: Content) -> str:
    """Describe the top-level keys, and whether it is another kind of OpenCV file."""
    tags = tuple(dict.fromkeys(content.xml_tags))
    keys = tags[:1] if len(tags) == 1 else tags[1:] if tags else content.json_keys or content.yaml_keys
    if not keys:
        return ""
    listed = _listed(keys)
    if content.xml_root == "opencv_storage" or content.first_line.startswith("%YAML:1.0"):
        return f"; it is a file of OpenCV's without a camera matrix: it contains {listed}"
    return f"; it contains {listed}"


def _listed(names: Iterable[str]) -> str:
    first, more = tuple(islice(names, LISTED_KEYS + 1)), ""
    if len(first) > LISTED_KEYS:
        first, more = first[:LISTED_KEYS], ", …"
    return ", ".join(map(shown, first)) + more
