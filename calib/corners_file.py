"""corners.json: what was seen, bit for bit, so that a calibration can be solved again without its frames.

JSON writes a float64 with as many digits as bring the same float64 back. The document says which pixel
origin it counts in, names no folder, and matches schemas/corners-1.schema.json.
"""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias, cast

import numpy as np

from calibrary.atomic import write_files
from calibrary.calib.board import Board
from calibrary.calib.observations import ControlPoints, Days, Observations, View
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, ParseError
from calibrary.provenance import SourceFile
from calibrary.records import Json, Meta, Record, from_json, replace, to_json

__all__ = [
    "FileName",
    "corners_sha256",
    "decode_corners",
    "encode_corners",
    "read_corners",
    "read_table",
    "write_corners",
]


MAX_BYTES: Final = 64_000_000
MAX_POINTS: Final = 1_000_000
Pixels: TypeAlias = Annotated[int, Meta(ge=1, le=200_000)]
Words: TypeAlias = Annotated[str, Meta(max_length=200)]
FileName: TypeAlias = Annotated[str, Meta(pattern=r"^[^/\\\u0000-\u001f\u007f]{1,255}$")]


class ViewCorners(Record):
    """The corners of one frame.

    Attributes:
        name: the frame's file name, without its folder.
        sha256: of the frame's bytes.
        sharpness_px: width of the edges around the corners.
        spacing_px: smallest distance between neighbouring corners.
        ids: which of the board's points, row by row from 0.
        x: pixels to the right, as many as ids.
        y: pixels down, as many as ids.
    """

    name: FileName
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")] | None
    sharpness_px: float | None
    spacing_px: float | None
    ids: tuple[Annotated[int, Meta(ge=0, lt=MAX_POINTS)], ...]
    x: tuple[float, ...]
    y: tuple[float, ...]

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        return _without_items(schema, "ids", "x", "y")


class CornersFile(Record, tag_field="schema", tag="corners-1"):
    """Corners of a board, by view: enough to solve a calibration again without its frames.

    Attributes:
        pixel_origin: the outer corner of the top-left pixel.
        image_size: width and height in px of every frame.
        camera: which camera, as its frames say.
        focus: how the lens was focused, in words.
        firmware: as the frames say it.
        board: which board; None where the points are on none.
        control_points_mm: [x, y, z] of points that are on no board; then board is None.
        taken: the first and the last day of the frames by the camera's clock; None where they state none.
        views: in the order of the frames.
        source: the file of another program that the corners were read from.
    """

    pixel_origin: Literal["corner"]
    image_size: tuple[Pixels, Pixels]
    camera: CameraKey
    focus: Words | None
    firmware: Words | None
    board: Board | None
    control_points_mm: Annotated[tuple[tuple[float, float, float], ...], Meta(max_length=MAX_POINTS)] | None
    taken: Days | None
    views: Annotated[tuple[ViewCorners, ...], Meta(max_length=20_000)]
    source: SourceFile | None = None

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        return _without_items(schema, "control_points_mm")


def _without_items(schema: dict[str, Any], *lists: str) -> dict[str, Any]:
    """A list may hold millions of numbers: reading checks them, a schema would take minutes."""
    for name in lists:
        del schema["properties"][name]["items"]
    return schema


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
    content = read_table(path)
    seen = decode_corners(content, source=path.name)
    if seen.source is None and all(view.sha256 is None for view in seen.views):
        # Without frames behind it, the document is all that the corners can be traced to.
        return replace(seen, source=SourceFile(name=path.name, sha256=hashlib.sha256(content).hexdigest()))
    return seen


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
    document = to_json(
        CornersFile(
            pixel_origin="corner",
            image_size=observations.image_size,
            camera=observations.camera,
            focus=observations.focus,
            firmware=observations.firmware,
            board=board if isinstance(board, Board) else None,
            control_points_mm=board.points.tolist() if isinstance(board, ControlPoints) else None,
            taken=observations.taken,
            source=observations.source,
            views=tuple(map(_corners_of, observations.views)),
        )
    )
    views = ",\n  ".join(map(_dump, cast("list[Json]", document.pop("views"))))
    lines = [f"{_dump(key)}: {_dump(value)}" for key, value in document.items()]
    return ("{\n" + ",\n".join([*lines, f'"views": [\n  {views}\n]']) + "\n}\n").encode()


def corners_sha256(observations: Observations) -> str:
    """Of the document's bytes: which corners a calibration was made from."""
    return hashlib.sha256(encode_corners(observations)).hexdigest()


def decode_corners(content: bytes, *, source: str | None = None) -> Observations:
    """What was seen, from the document's bytes.

    Args:
        content: at most 64 MB.
        source: what errors call it.

    Raises:
        ParseError: it is broken or contradicts itself.
    """
    document = from_json(CornersFile, _parsed(content, source), source=source)
    try:
        board = _board(document)
        points = len(board.points)
        return Observations(
            board=board,
            image_size=document.image_size,
            views=tuple(_view(view, points, f"views[{index}]") for index, view in enumerate(document.views)),
            camera=document.camera,
            focus=document.focus,
            firmware=document.firmware,
            taken=document.taken,
            source=document.source,
        )
    except InputError as error:
        raise ParseError(error.message, source=source, place=error.place) from None


def _parsed(content: bytes, source: str | None) -> Any:
    if len(content) > MAX_BYTES:
        raise ParseError(f"is {len(content)} bytes long, expected at most {MAX_BYTES}", source=source)
    try:
        return json.loads(content.decode("utf-8"), object_pairs_hook=_unique, parse_constant=_not_finite)
    except UnicodeDecodeError:
        raise ParseError("is not UTF-8, expected a JSON document of corners", source=source) from None
    except json.JSONDecodeError as error:
        raise ParseError(f"is not JSON: {error.msg}", source=source, place=f"line {error.lineno}") from None
    except (ValueError, RecursionError) as error:
        raise ParseError(
            f"is not JSON of corners: {str(error) or 'nested too deep'}", source=source
        ) from None


def _unique(pairs: Sequence[tuple[str, object]]) -> dict[str, object]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a duplicate key in one object")
    return found


def _not_finite(text: str) -> float:
    raise ValueError(f"{text} is not a number")


def _board(document: CornersFile) -> Board | ControlPoints:
    board, points = document.board, document.control_points_mm
    if board is not None and points is None:
        return board
    if points is not None and board is None:
        return ControlPoints(points=np.array(points, dtype=np.float64).reshape(-1, 3))
    raise InputError("expected either a board or control_points_mm, and null for the other", place="board")


def _view(view: ViewCorners, points: int, place: str) -> View:
    if not len(view.ids) == len(view.x) == len(view.y):
        raise InputError(
            f"contains {len(view.ids)} ids, {len(view.x)} x and {len(view.y)} y: expected as many",
            place=place,
        )
    if len(set(view.ids)) != len(view.ids) or max(view.ids, default=0) >= points:
        raise InputError(f"expected ids below {points}, each once", place=f"{place}.ids")
    return View(
        name=view.name,
        sha256=view.sha256,
        ids=np.array(view.ids, dtype=np.intp),
        image_points=np.column_stack(
            [np.array(view.x, dtype=np.float64), np.array(view.y, dtype=np.float64)]
        ),
        sharpness_px=view.sharpness_px,
        spacing_px=view.spacing_px,
    )


def _corners_of(view: View) -> ViewCorners:
    x, y = view.image_points.T.tolist()
    return ViewCorners(
        name=view.name,
        sha256=view.sha256,
        sharpness_px=view.sharpness_px,
        spacing_px=view.spacing_px,
        ids=tuple(view.ids.tolist()),
        x=tuple(x),
        y=tuple(y),
    )


def _dump(value: Json) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
