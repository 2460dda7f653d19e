"""An entry as the bytes of its file, and back: one writer, one strict reader, and a seal over the numbers."""

from __future__ import annotations

from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from functools import partial
from typing import Final

from calibrary.errors import ParseError
from calibrary.records import from_json, to_json
from calibrary.registry.digest import digest
from calibrary.registry.entry import Entry
from calibrary.registry.migrations import migrated
from calibrary.registry.yaml_text import Layout, document_lines
from calibrary.strictyaml import line_of, load_yaml

__all__ = ["LARGEST_ENTRY", "entry_yaml", "parse_entry"]

LARGEST_ENTRY: Final = 256 << 10
"""Bytes; an entry has some two thousand."""
DEEPEST: Final = 16
UTF_16: Final = (BOM_UTF16_LE, BOM_UTF16_BE)

LEGEND: Final = """\
# One camera of a fleet registry, written by calibrary; schema: entry-1.
# K is fx fy cx cy skew in pixels of an image of image_size (width, height), x to the right, y down. The origin is the
# outer corner of the top-left pixel, so the middle is (width/2, height/2); for OpenCV take 0.5 off cx and cy.
# The distortion is no part of K; its model maps ideal to observed x/z, y/z. null: unknown; "none": known to be none.
# The digest seals the numbers. To change one, take the digest line out and run: calibrary registry add FILE
"""

LAYOUT: Final = Layout(
    nulls=frozenset(
        {"distortion", "camera.firmware.min", "camera.firmware.max", "validity.from", "validity.until"}
    ),
    rows=frozenset({"quality.covariance.names"}),
    triangles=frozenset({"quality.covariance.upper"}),
    quoted_keys=frozenset({"extras"}),
)


def entry_yaml(entry: Entry) -> bytes:
    """The entry's file: the same bytes for the same entry, and the same entry from the bytes, bit for bit.

    Raises:
        InputError: a text holds a lone surrogate, a number is not finite, or an extension is nested too deep.
    """
    return (LEGEND + "\n".join(document_lines(to_json(entry), LAYOUT)) + "\n").encode()


def parse_entry(data: bytes, name: str, *, require_digest: bool = True) -> Entry:
    """Read one entry; older schema versions are brought to the present one.

    Args:
        data: the file's bytes.
        name: what errors call the file.
        require_digest: refuse a file without a digest. Where it is not required, one that is there still has to
            fit the numbers.

    Raises:
        ParseError: it is no YAML of one meaning, breaks schemas/entry-1.schema.json, is of a newer schema, or
            its numbers are not those that the digest was made over.
        InputError: its numbers are no camera's.
    """
    if data.startswith(UTF_16):
        raise ParseError("is text in UTF-16, which git shows to nobody; wanted UTF-8", source=name)
    value = load_yaml(data, source=name, max_bytes=LARGEST_ENTRY, max_depth=DEEPEST)
    document = migrated(value, source=name)
    entry = from_json(Entry, document, source=name, locate=partial(line_of, data))
    stated = document.get("digest")
    if stated is None:
        if require_digest:
            raise ParseError(
                "has no digest over its numbers; 'calibrary registry add FILE' checks it and writes it with one",
                source=name,
                place="digest",
            )
        return entry
    found = digest(entry.calibration, entry.sensor)
    if stated != found:
        raise ParseError(
            f"the digest is {_short(str(stated))} and the numbers give {_short(found)}: K, distortion, sensor or "
            "uncertainty were changed by hand, or a merge put two calibrations together; take a version that is "
            "whole (git checkout REV -- FILE), or, if these numbers are meant, take the digest line out and run "
            "'calibrary registry add FILE'",
            source=name,
            place="digest",
        )
    return entry


def _short(text: str) -> str:
    return f"{text.removeprefix('sha256:')[:12]}…"
