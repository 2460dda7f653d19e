"""Focus of the lens as stated in EXIF: CIPA DC-008, SubjectDistance and SubjectDistanceRange.

No standard tag states whether the focus was locked; if two images differ here, the lens was refocused in
between.
"""

from __future__ import annotations

import math
import struct
from contextlib import suppress
from pathlib import Path
from typing import Final

from calibrary.errors import InputError
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery.directory import Directory, Tiff
from calibrary.parsers.imagery.exif import EXIF_POINTER
from calibrary.parsers.imagery.source import open_source
from calibrary.parsers.imagery.taken import exif_block

__all__ = ["focus_of"]

DISTANCE: Final = 0x9206
RANGE: Final = 0xA40C
RATIONAL, SHORT = 5, 3
INFINITY: Final = 0xFFFFFFFF
"""Numerator of a SubjectDistance that means infinity."""
RANGES: Final = {1: "macro", 2: "close", 3: "distant"}


def focus_of(path: Path) -> str | None:
    """The focus distance in words; None if the image does not state it.

    Raises:
        InputError: the file cannot be read.
    """
    with open_source(path) as source, suppress(InputError):
        block = exif_block(source)
        if block is not None:
            tiff = Tiff(block)
            return _in_words(tiff, _exif_directory(tiff))
    return None


def _exif_directory(tiff: Tiff) -> Directory | None:
    pointer = tiff.directory(tiff.first, frozenset({EXIF_POINTER})).entries.get(EXIF_POINTER)
    offsets = tiff.integers(pointer) if pointer is not None else ()
    return tiff.directory(offsets[0], frozenset({DISTANCE, RANGE})) if len(offsets) == 1 else None


def _in_words(tiff: Tiff, exif: Directory | None) -> str | None:
    distance = exif.entries.get(DISTANCE) if exif is not None else None
    if distance is not None and distance.kind == RATIONAL and distance.count == 1:
        data = tiff.value("EXIF SubjectDistance", distance, 8)
        if not isinstance(data, TagFault):
            above, below = struct.unpack(f"{tiff.byte_order}II", data)
            if above == INFINITY:
                return "infinity"
            if above and below and math.isfinite(above / below):
                return f"{above / below:.4g} m"
    near = exif.entries.get(RANGE) if exif is not None else None
    if near is not None and near.kind == SHORT and near.count == 1:
        return RANGES.get(next(iter(tiff.integers(near)), 0))
    return None
