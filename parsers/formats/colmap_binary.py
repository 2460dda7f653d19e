"""COLMAP's ``cameras.bin``: the cameras of a reconstruction, without a mark of its own.

In the format's own words, all of it little endian::

    uint64  number of cameras
    of each camera:
        uint32  camera id        int32   model id
        uint64  width            uint64  height
        double  parameters[as many as the model has]

So nothing says how long a camera is but its model, and a model that is not known leaves the rest unreadable.
The parameters are those of ``cameras.txt``, see :mod:`calibrary.interop.colmap`. A file is recognised by
being filled by its cameras to the last byte.

Source: COLMAP, ``WriteCamerasBinary`` and ``scripts/python/read_write_model.py``.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence

from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.interop.colmap import PANORAMAS, model_named, model_numbered
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._colmap import (
    CAPACITY,
    CONVENTION,
    MAX_CAMERAS,
    StoredCamera,
    cameras,
    records,
)

__all__ = ["FORMAT"]

COUNT = struct.Struct("<Q")
HEAD = struct.Struct("<IiQQ")
LONGEST_SIDE_PX = 1_000_000


def sniff(content: Content) -> Sniff | None:
    """Known models and plausible sizes, one after the other up to the very last byte."""
    data = content.data
    if len(data) < COUNT.size + HEAD.size:
        return None
    [count] = COUNT.unpack_from(data)
    if not 0 < count <= (len(data) - COUNT.size) // HEAD.size:
        return None
    at = COUNT.size
    for _ in range(count):
        if at + HEAD.size > len(data):
            return None
        _number, model, width, height = HEAD.unpack_from(data, at)
        parameters = _parameters(model)
        if parameters is None or not (0 < width <= LONGEST_SIDE_PX and 0 < height <= LONGEST_SIDE_PX):
            return None
        at += HEAD.size + 8 * parameters
    if at != len(data):
        return None
    return Sniff(Sure.SHAPE, f"{count} cameras of known models fill it to the last byte")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in order."""
    return cameras(list(_cameras(data)), context, grade=Grade.ADJUSTED)


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """As COLMAP writes it."""
    parts = [COUNT.pack(len(calibrations))]
    for number, camera in records(calibrations):
        model = model_named(camera.model)
        assert model is not None  # noqa: S101  the name is from the same table
        parts.append(HEAD.pack(number, model.number, camera.width, camera.height))
        parts.append(struct.pack(f"<{model.count}d", *camera.params))
    return b"".join(parts)


def _cameras(data: bytes) -> Iterator[StoredCamera]:
    if len(data) < COUNT.size:
        raise ParseError(f"{len(data)} bytes, expected a number of cameras in the first 8")
    (count,) = COUNT.unpack_from(data)
    if not count:
        raise ParseError("it states 0 cameras, expected 1 or more")
    if count > MAX_CAMERAS:
        raise ParseError(f"it states {count} cameras; at most {MAX_CAMERAS} are read")
    at = COUNT.size
    for index in range(count):
        place = f"camera {index + 1} of {count}"
        _check(data, at + HEAD.size, place=place)
        number, model, width, height = HEAD.unpack_from(data, at)
        parameters = _parameters(model)
        if parameters is None:
            raise UnsupportedModelError(
                f"COLMAP's model {model} is not known here, so the rest cannot be read; write the "
                "reconstruction as text (colmap model_converter --output_type TXT)",
                place=place,
            )
        at += HEAD.size
        _check(data, at + 8 * parameters, place=place)
        numbers = struct.unpack_from(f"<{parameters}d", data, at)
        at += 8 * parameters
        if not all(map(math.isfinite, numbers)):
            raise ParseError("a parameter is not finite", place=place)
        yield StoredCamera(
            number=number,
            model=model_numbered(model) or PANORAMAS[model][0],
            image_size=strict.image_size(width, height, place=place),
            parameters=numbers,
            place=place,
        )
    if at != len(data):
        raise ParseError(f"{len(data) - at} bytes follow the last camera")


def _parameters(number: int) -> int | None:
    """How many a model has, None when it is not known."""
    model = model_numbered(number)
    if model is not None:
        return model.count
    return PANORAMAS[number][1] if number in PANORAMAS else None


def _check(data: bytes, end: int, *, place: str) -> None:
    if end > len(data):
        raise ParseError("the file ends inside it", place=place)


FORMAT = Format(
    name="colmap_binary",
    title="COLMAP cameras.bin",
    suffixes=(".bin",),
    reference="https://colmap.github.io/format.html#binary-file-format",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=CAPACITY,
)
