"""COLMAP's ``cameras.bin``: the cameras of a reconstruction, without a mark of its own.

In the format's own words, all of it little endian::

    uint64  number of cameras
    of each camera:
        uint32  camera id        int32   model id
        uint64  width            uint64  height
        double  parameters[as many as the model has]

Only the model determines the length of a camera's record, so after an unknown model the rest cannot be read. The
parameters are those of ``cameras.txt``, see :mod:`calibrary.interop.colmap`. calibrary recognises a file because its
cameras fill it to the last byte.

Source: COLMAP, ``WriteCamerasBinary`` and ``scripts/python/read_write_model.py``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.interop.colmap import COLMAP_MODELS, PANORAMAS, ColmapModel, model_named
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._colmap import (
    CAPACITY,
    CONVENTION,
    MAX_CAMERAS,
    StoredCamera,
    StoredColumns,
    cameras,
    records,
)
from calibrary.parsers.on_demand import Columns

COUNT = struct.Struct("<Q")
HEAD = struct.Struct("<IiQQ")
LONGEST_SIDE_PX = 1_000_000
MODELS: Final[Mapping[int, ColmapModel | str]] = MappingProxyType(
    {model.number: model for model in COLMAP_MODELS}
    | {number: name for number, (name, _) in PANORAMAS.items()}
)
PARAMETERS: Final = MappingProxyType(
    {model.number: struct.Struct(f"<{model.count}d") for model in COLMAP_MODELS}
    | {number: struct.Struct(f"<{count}d") for number, (_, count) in PANORAMAS.items()}
)
"""Those of each model, by its number."""


def sniff(content: Content) -> Sniff | None:
    """Known models and plausible sizes, one after the other up to the very last byte."""
    data = content.data
    if len(data) < COUNT.size + HEAD.size:
        return None
    [count] = COUNT.unpack_from(data)
    if not 0 < count <= (len(data) - COUNT.size) // HEAD.size:
        return None
    claim = Sniff(Sure.SHAPE, f"{count} cameras of known models fill it to the last byte")
    rows = _alike(data)
    if rows is not None:
        sides = np.stack([rows["width"], rows["height"]])
        return claim if ((sides > 0) & (sides <= LONGEST_SIDE_PX)).all() else None
    at, last = COUNT.size, len(data) - HEAD.size
    for _ in range(count):
        if at > last:
            return None
        _number, model, width, height = HEAD.unpack_from(data, at)
        if model not in PARAMETERS or not (0 < width <= LONGEST_SIDE_PX and 0 < height <= LONGEST_SIDE_PX):
            return None
        at += HEAD.size + PARAMETERS[model].size
    if at != len(data):
        return None
    return claim


def read(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Every camera, in order."""
    rows = _alike(data)
    if rows is None:
        return cameras(list(_cameras(data)), context, grade=Grade.ADJUSTED)
    model = MODELS[int(rows["model"][0])]
    sizes = np.stack([rows["width"], rows["height"]], axis=1)
    if isinstance(model, str) or (sizes > LONGEST_SIDE_PX).any():
        return cameras(list(_cameras(data)), context, grade=Grade.ADJUSTED)
    place = f"camera {{}} of {len(rows)}"
    stored = StoredColumns(model, rows["number"], sizes, rows["parameters"], place)
    return cameras(stored, context, grade=Grade.ADJUSTED)


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """As COLMAP writes it."""
    parts = [COUNT.pack(len(calibrations))]
    for number, camera in records(calibrations):
        model = model_named(camera.model)
        if model is None:
            raise UnsupportedModelError(f"COLMAP has no model {camera.model}")
        parts.append(HEAD.pack(number, model.number, camera.width, camera.height))
        parts.append(struct.pack(f"<{model.count}d", *camera.params))
    return b"".join(parts)


def write_columns(columns: Columns) -> bytes | None:
    """The same of many cameras of one of COLMAP's models."""
    model = columns.model
    if not isinstance(model, ColmapModel):
        return None
    rows = np.empty(len(columns.ids), _row(model.count))
    rows["number"], rows["model"] = columns.ids, model.number
    rows["width"], rows["height"] = columns.sizes.T
    rows["parameters"] = np.concatenate([columns.K[:, 2 - model.focals :], columns.coefficients], axis=1)
    return COUNT.pack(len(rows)) + rows.tobytes()


def _row(parameters: int) -> np.dtype[np.void]:
    head = [("number", "<u4"), ("model", "<i4"), ("width", "<u8"), ("height", "<u8")]
    return np.dtype([*head, ("parameters", "<f8", (parameters,))])


def _alike(data: bytes) -> NDArray[np.void] | None:
    """The cameras as columns, where all are of one model, as one program's mostly are, and fill the file exactly."""
    if len(data) < COUNT.size + HEAD.size:
        return None
    [count] = COUNT.unpack_from(data)
    _, model, _, _ = HEAD.unpack_from(data, COUNT.size)
    parameters = PARAMETERS.get(model)
    if parameters is None or count > MAX_CAMERAS:
        return None
    kind = _row(parameters.size // 8)
    if COUNT.size + count * kind.itemsize != len(data):
        return None
    rows: NDArray[np.void] = np.frombuffer(data, kind, count, COUNT.size)
    return rows if (rows["model"] == model).all() else None


def _cameras(data: bytes) -> Iterator[StoredCamera]:
    if len(data) < COUNT.size:
        raise ParseError(f"{len(data)} bytes, expected a number of cameras in the first 8")
    (count,) = COUNT.unpack_from(data)
    if not count:
        raise ParseError("it states 0 cameras, expected 1 or more")
    if count > MAX_CAMERAS:
        raise ParseError(f"it states {count} cameras; at most {MAX_CAMERAS} are read")
    at = COUNT.size
    for index in range(1, count + 1):
        place = f"camera {index} of {count}"
        if at + HEAD.size > len(data):
            raise ParseError("the file ends inside it", place=place)
        number, model, width, height = HEAD.unpack_from(data, at)
        parameters = PARAMETERS.get(model)
        if parameters is None:
            raise UnsupportedModelError(
                f"COLMAP's model {model} is not known here, so the rest cannot be read; write the "
                "reconstruction as text (colmap model_converter --output_type TXT)",
                place=place,
            )
        at += HEAD.size
        if at + parameters.size > len(data):
            raise ParseError("the file ends inside it", place=place)
        numbers = parameters.unpack_from(data, at)
        at += parameters.size
        yield StoredCamera(number, MODELS[model], width, height, numbers, place)
    if at != len(data):
        raise ParseError(f"{len(data) - at} bytes follow the last camera")


FORMAT = Format(
    name="colmap_binary",
    title="COLMAP cameras.bin",
    suffixes=(".bin",),
    syntaxes=(Syntax.BINARY,),
    reference="https://colmap.github.io/format.html#binary-file-format",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    write_columns=write_columns,
    capacity=CAPACITY,
)
