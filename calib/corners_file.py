"""corners.json: the detected corners, without loss, so that a calibration can be repeated without its images.

Every float64 is written with enough digits to restore it exactly. The document states its pixel origin, contains no
folder names, and follows schemas/corners-1.schema.json.
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
from calibrary.quality import ImageCircle
from calibrary.records import Json, Meta, Record, from_json, replace, to_json

MAX_BYTES: Final = 64_000_000
MAX_POINTS: Final = 1_000_000
Pixels: TypeAlias = Annotated[int, Meta(ge=1, le=200_000)]
Words: TypeAlias = Annotated[str, Meta(max_length=200)]
FileName: TypeAlias = Annotated[str, Meta(pattern=r"^[^/\\\u0000-\u001f\u007f]{1,255}$")]


class ViewCorners(Record):
    """Corners of one image.

    Attributes:
        name: file name of the image, without its folder.
        sha256: SHA-256 of the image file.
        sharpness_px: width of the edges at the corners, px.
        spacing_px: smallest distance between neighbouring corners, px.
        ids: indices of the board points, row by row from 0.
        x: x coordinates in px, one per id.
        y: y coordinates in px (down), one per id.
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
    """Corners of a board by view, sufficient to repeat a calibration without its images.

    Attributes:
        pixel_origin: the outer corner of the top-left pixel.
        image_size: (width, height) px of every image.
        camera: camera, as the images state it.
        focus: focus setting of the lens, in words.
        firmware: firmware, as the images state it.
        board: board; None for points without a board.
        control_points_mm: [x, y, z] of points that are not on a board; board is then None.
        views: views in the order of the images.
        taken: first and last day of the images by the camera's clock; None if they state none.
        source: file of another program that the corners were read from.
        circle: circle outside which the images are black; absent if they fill the frame.
    """

    pixel_origin: Literal["corner"]
    image_size: tuple[Pixels, Pixels]
    camera: CameraKey
    focus: Words | None
    firmware: Words | None
    board: Board | None
    control_points_mm: Annotated[tuple[tuple[float, float, float], ...], Meta(max_length=MAX_POINTS)] | None
    views: Annotated[tuple[ViewCorners, ...], Meta(max_length=20_000)]
    taken: Days | None = None
    source: SourceFile | None = None
    circle: ImageCircle | None = None

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        return _without_items(schema, "control_points_mm")


def _without_items(schema: dict[str, Any], *lists: str) -> dict[str, Any]:
    """Omit the item types of long lists: reading checks them, and a schema check would take minutes."""
    for name in lists:
        del schema["properties"][name]["items"]
    return schema


def write_corners(observations: Observations, path: Path) -> None:
    """Write the corners atomically.

    Raises:
        InputError: the file cannot be written.
    """
    write_files({path: encode_corners(observations)})


def read_corners(path: Path) -> Observations:
    """Read the corners.

    Raises:
        InputError: the path is not a regular file, or cannot be read.
        ParseError: the file is damaged, longer than 64 MB, or inconsistent.
    """
    content = read_table(path)
    seen = decode_corners(content, source=path.name)
    if seen.source is None and all(view.sha256 is None for view in seen.views):
        # Without images, the document itself is the source of the corners.
        return replace(seen, source=SourceFile(name=path.name, sha256=hashlib.sha256(content).hexdigest()))
    return seen


def read_table(path: Path) -> bytes:
    """Read the bytes of a file of corners or points.

    Raises:
        InputError: the path is not a regular file, or cannot be read.
        ParseError: the file is longer than 64 MB.
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
    """Return the document as bytes, deterministically, with one view per line."""
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
            circle=observations.circle,
            views=tuple(map(_corners_of, observations.views)),
        )
    )
    if observations.circle is None:
        # The hash of corners stays that of documents from before circles were measured.
        del document["circle"]
    views = ",\n  ".join(map(_dump, cast("list[Json]", document.pop("views"))))
    lines = [f"{_dump(key)}: {_dump(value)}" for key, value in document.items()]
    return ("{\n" + ",\n".join([*lines, f'"views": [\n  {views}\n]']) + "\n}\n").encode()


def corners_sha256(observations: Observations) -> str:
    """Return the SHA-256 of the document, which identifies the corners of a calibration."""
    return hashlib.sha256(encode_corners(observations)).hexdigest()


def decode_corners(content: bytes, *, source: str | None = None) -> Observations:
    """Read the corners from the document's bytes.

    Args:
        content: at most 64 MB.
        source: name of the document in errors.

    Raises:
        ParseError: the document is damaged or inconsistent.
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
            circle=document.circle,
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
