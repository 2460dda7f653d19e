"""corners.json: what was seen, bit for bit, so that a calibration can be solved again without its frames.

JSON writes a float64 with as many digits as bring the same float64 back. The document says which pixel
origin it counts in, names no folder, and matches schemas/corners-1.schema.json.
"""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.atomic import write_files
from calibrary.calib.board import Board, Pattern
from calibrary.calib.observations import ControlPoints, Days, Observations, View
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, ParseError
from calibrary.records import Json, from_json, to_json
from calibrary.schemas import require

__all__ = [
    "corners_sha256",
    "decode_corners",
    "encode_corners",
    "read_corners",
    "read_table",
    "write_corners",
]


SCHEMA: Final = "corners-1"
MAX_BYTES: Final = 64_000_000
BOARD_FIELDS: Final = ("pattern", "columns", "rows", "square_mm", "dictionary", "marker_mm")


def write_corners(observations: Observations, path: Path) -> None:
    """Write the document, whole or not at all.

    Raises:
        InputError: it cannot be written there.
    """
    write_files({path: encode_corners(observations)})


def read_corners(path: Path) -> Observations:
    """Read the document.

    Raises:
        InputError: it is not a regular file, or cannot be read.
        ParseError: it is broken, longer than 64 MB, or contradicts itself.
    """
    return decode_corners(read_table(path), source=path.name)


def read_table(path: Path) -> bytes:
    """The bytes of a file of corners or points.

    Raises:
        InputError: it is not a regular file, or cannot be read.
        ParseError: it is longer than 64 MB.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise InputError("is not a regular file", source=path.name)
        if status.st_size > MAX_BYTES:
            raise ParseError(
                f"is {status.st_size} bytes long, expected at most {MAX_BYTES}", source=path.name
            )
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=path.name) from None


def encode_corners(observations: Observations) -> bytes:
    """The document's bytes: the same observations give the same bytes, one view a line."""
    board = observations.board
    on_board = isinstance(board, Board)
    head: dict[str, Json] = {
        "schema": SCHEMA,
        "pixel_origin": "corner",
        "image_size": list(observations.image_size),
        "camera": to_json(observations.camera),
        "focus": observations.focus,
        "firmware": observations.firmware,
        "board": {name: getattr(board, name) for name in BOARD_FIELDS} if on_board else None,
        "control_points_mm": None if isinstance(board, Board) else board.points.tolist(),
    }
    if observations.taken is not None:
        head["taken"] = [day.isoformat() for day in observations.taken]
    lines = [f"{_dump(key)}: {_dump(value)}" for key, value in head.items()]
    views = ",\n  ".join(_dump(_view_json(view)) for view in observations.views)
    return ("{\n" + ",\n".join([*lines, f'"views": [\n  {views}\n]']) + "\n}\n").encode()


def corners_sha256(observations: Observations) -> str:
    """Of the document's bytes: which corners a calibration was made from."""
    return hashlib.sha256(encode_corners(observations)).hexdigest()


def decode_corners(content: bytes, *, source: str | None = None) -> Observations:
    """The document from its bytes.

    Args:
        content: at most 64 MB.
        source: what errors call it.

    Raises:
        ParseError: it is broken or contradicts itself.
    """
    document = _parsed(content, source)
    # The numbers are many; the schema sees each list of them once, as what it is, and numpy looks inside.
    require(document, SCHEMA, source=source)
    try:
        board = _board(document)
        views = [
            _view(view, len(board.points), source, f"views[{index}]")
            for index, view in enumerate(document["views"])
        ]
        width, height = document["image_size"]
        return Observations(
            board=board,
            image_size=(width, height),
            views=tuple(views),
            camera=from_json(CameraKey, document["camera"], source=source),
            focus=document["focus"],
            firmware=document["firmware"],
            taken=_days(document.get("taken")),
        )
    except InputError as error:
        raise ParseError(error.message, source=source, place=error.place) from None


def _parsed(content: bytes, source: str | None) -> Any:
    if len(content) > MAX_BYTES:
        raise ParseError(f"is {len(content)} bytes long, wanted at most {MAX_BYTES}", source=source)
    try:
        return json.loads(content.decode("utf-8"), object_pairs_hook=_unique, parse_constant=_not_finite)
    except UnicodeDecodeError:
        raise ParseError("is not UTF-8, wanted a JSON document of corners", source=source) from None
    except json.JSONDecodeError as error:
        raise ParseError(f"is not JSON: {error.msg}", source=source, place=f"line {error.lineno}") from None
    except (ValueError, RecursionError) as error:
        raise ParseError(
            f"is not JSON of corners: {str(error) or 'nested too deep'}", source=source
        ) from None


def _unique(pairs: Sequence[tuple[str, object]]) -> dict[str, object]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key stands twice in one object")
    return found


def _not_finite(text: str) -> float:
    raise ValueError(f"{text} is not a number")


def _days(taken: Sequence[str] | None) -> Days | None:
    if taken is None:
        return None
    try:
        first, last = (date.fromisoformat(day) for day in taken)
    except ValueError:
        raise ParseError("expected the first and the last day, such as 2025-03-04", place="taken") from None
    return first, last


def _board(document: Mapping[str, Any]) -> Board | ControlPoints:
    board, points = document["board"], document["control_points_mm"]
    if (board is None) == (points is None):
        raise ParseError("wanted either a board or control_points_mm, and null for the other", place="board")
    if board is None:
        return ControlPoints(points=_numbers(points, "control_points_mm"))
    return Board(**{**board, "pattern": Pattern(board["pattern"])})


def _view(view: Mapping[str, Any], points: int, source: str | None, place: str) -> View:
    ids, x, y = (_numbers(view[key], f"{place}.{key}") for key in ("ids", "x", "y"))
    if not len(ids) == len(x) == len(y) or ids.ndim != 1 or x.ndim != 1 or y.ndim != 1:
        raise ParseError(
            f"holds {len(ids)} ids, {len(x)} x and {len(y)} y: wanted as many", source=source, place=place
        )
    if (ids % 1 != 0).any() or len(np.unique(ids)) != len(ids) or ((ids < 0) | (ids >= points)).any():
        raise ParseError(f"wanted whole ids below {points}, each once", source=source, place=f"{place}.ids")
    return View(
        name=view["name"],
        sha256=view["sha256"],
        ids=ids.astype(np.intp),
        image_points=np.column_stack([x, y]),
        sharpness_px=view["sharpness_px"],
        spacing_px=view["spacing_px"],
    )


def _numbers(values: Sequence[object], place: str) -> FloatArray:
    """A list, or a list of lists, of finite numbers; what JSON calls true is none."""
    flat = [item for row in values for item in (row if isinstance(row, list) else [row])]
    if any(type(item) not in {int, float} for item in flat):
        raise ParseError("holds something that is not a number", place=place)
    try:
        array = np.array(values, dtype=np.float64)
    except (ValueError, OverflowError):
        raise ParseError("holds rows of different lengths, or numbers too large", place=place) from None
    if not np.isfinite(array).all():
        raise ParseError("holds a number too large", place=place)
    return array


def _view_json(view: View) -> dict[str, Json]:
    return {
        "name": view.name,
        "sha256": view.sha256,
        "sharpness_px": view.sharpness_px,
        "spacing_px": view.spacing_px,
        "ids": view.ids.tolist(),
        "x": view.image_points[:, 0].tolist(),
        "y": view.image_points[:, 1].tolist(),
    }


def _dump(value: Json) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
