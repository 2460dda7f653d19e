"""Corners from another program, as a table with one corner per line: mrcal's corners.vnl, or CSV with named columns.

mrcal and mrgingham write vnlog: columns separated by blanks, named in the first line that begins with a single ``#``
(``# filename x y level``), with ``-`` for a missing value. Every corner of the board has a line, row by row. A corner
with the level ``-``, a negative level or the weight 0 is not used; an image without the board has one line of ``-``.
See mrcal, "compute_chessboard_corners", and its test-parser-corners-vnl.py.

Kalibr writes no corners (ethz-asl/kalibr issues #727 and #739); its forks and users' scripts write various CSV files:
columns in any order, each with a name, one line per corner, with ``id`` if not all corners of the board are listed.
ROS's camera_calibration stores images in calibrationdata.tar.gz, but no corners.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath
from typing import Final

import numpy as np
from msgspec import Struct, field

from calibrary.calib.board import Board
from calibrary.calib.observations import View
from calibrary.errors import ParseError

MOST_ROWS: Final = 5_000_000
NONE: Final = "-"
COLUMNS: Final[Mapping[str, tuple[str, ...]]] = {
    "image": ("filename", "image", "image_name", "file", "frame", "timestamp", "timestamp_ns"),
    "x": ("x", "u", "px", "x_px"),
    "y": ("y", "v", "py", "y_px"),
    "id": ("id", "corner_id", "point_id", "corner", "cid"),
    "level": ("level",),
    "weight": ("weight",),
}
NEEDED: Final = ("image", "x", "y")
GZIP: Final = b"\x1f\x8b"


class _Frame(Struct):
    """Lines of one image."""

    corners: dict[int, tuple[float, float]] = field(default_factory=dict)
    lines: int = 0


class CornersTable(Struct, frozen=True, kw_only=True, eq=False):
    """Content of a table.

    Attributes:
        board: board of the corners.
        views: views by image name in the table; points in px in the table's pixel origin.
        empty: images in which no board was found.
        coarse: number of corners that were detected in a reduced image.
    """

    board: Board
    views: Mapping[str, View]
    empty: tuple[str, ...]
    coarse: int


def is_corners_table(content: bytes) -> bool:
    """Return whether the content is not a JSON document, which begins with a bracket."""
    return not content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith((b"{", b"["))


def read_corners_table(content: bytes, board: Board, *, source: str) -> CornersTable:
    """Read a table of corners.

    Args:
        content: content of the file.
        board: board of the corners.
        source: name of the file in errors.

    Raises:
        ParseError: the content is not such a table, or does not match the board.
    """
    if content.startswith(GZIP):
        raise ParseError(
            "is an archive; where it is calibrationdata.tar.gz of ROS's camera_calibration: that holds frames and no "
            "corners: unpack it with tar xzf, and give calibrate the frames (left-*.png) in place of --from",
            source=source,
        )
    frames: dict[str, _Frame] = {}
    coarse, total, numbered = 0, len(board.points), False
    for place, row in _rows(_text(content, source), source):
        frame = frames.setdefault(row["image"], _Frame())
        numbered = numbered or "id" in row
        at = _whole(row["id"], source, place) if row.get("id", NONE) != NONE else frame.lines
        frame.lines += 1
        if not _counts(row, source, place):
            continue
        if not 0 <= at < total or at in frame.corners:
            problem = "repeats" if at in frame.corners else "has"
            raise ParseError(
                f"{problem} corner {at} of {row['image']:.80}; {board} has the corners 0 … {total - 1}, each once",
                source=source,
                place=place,
            )
        frame.corners[at] = _number(row["x"], source, place), _number(row["y"], source, place)
        coarse += row.get("level", NONE) != NONE and _number(row["level"], source, place) > 0
    if not numbered:
        _check_whole(frames, total, board, source)
    views = {name: _view(name, frame) for name, frame in frames.items() if frame.corners}
    if not views:
        raise ParseError(f"has no corner of any of {len(frames)} images", source=source)
    empty = tuple(name for name, frame in frames.items() if not frame.corners)
    return CornersTable(board=board, views=views, empty=empty, coarse=coarse)


def _view(name: str, frame: _Frame) -> View:
    ids = sorted(frame.corners)
    return View(
        name=PurePosixPath(PureWindowsPath(name).as_posix()).name,
        ids=np.array(ids, dtype=np.intp),
        image_points=np.array([frame.corners[at] for at in ids]),
    )


def _check_whole(frames: Mapping[str, _Frame], total: int, board: Board, source: str) -> None:
    """Check that all corners are listed: without ids, a corner is identified by its line."""
    for name, frame in frames.items():
        if frame.corners and frame.lines != total:
            raise ParseError(
                f"has {frame.lines} corners of {name}, {board} has {total}; give the right --board, or a column id",
                source=source,
            )


def _text(content: bytes, source: str) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ParseError("is not UTF-8, expected a table of corners", source=source) from None


def _rows(text: str, source: str) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Yield (line, cells by column) of every corner."""
    order: Mapping[str, int] | None = None
    delimiter: str | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        stripped, place = line.strip(), f"line {number}"
        if number > MOST_ROWS:
            raise ParseError(f"has more than {MOST_ROWS} lines", source=source)
        if not stripped or (stripped.startswith("#") and (order is not None or stripped.startswith("##"))):
            continue
        if order is None:
            head = stripped.removeprefix("#")
            delimiter = next((one for one in ",;\t" if one in head), None)
            order = _order(_cells(head, delimiter), source, place)
            continue
        cells = _cells(stripped.partition("#")[0] if delimiter is None else stripped, delimiter)
        if len(cells) <= max(order[name] for name in NEEDED):
            raise ParseError(f"has {len(cells)} cells, expected {len(order)}", source=source, place=place)
        # Like mrcal, accept a line that ends early: the missing columns have no value.
        yield place, {name: cells[at] for name, at in order.items() if at < len(cells)}


def _cells(line: str, delimiter: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(delimiter)] if delimiter else line.split()


def _order(names: Sequence[str], source: str, place: str) -> Mapping[str, int]:
    found = {name.lower(): at for at, name in reversed(list(enumerate(names)))}
    order = {
        meaning: found[name]
        for meaning, known in COLUMNS.items()
        for name in reversed(known)
        if name in found
    }
    missing = [name for name in NEEDED if name not in order]
    if missing:
        raise ParseError(
            f"has no column {', '.join(missing)}; expected mrcal's '# filename x y level', or a first line that names "
            "image, x, y and, where not every corner of the board is listed, id",
            source=source,
            place=place,
        )
    return order


def _counts(row: Mapping[str, str], source: str, place: str) -> bool:
    """Return whether a line's corner was found: it has coordinates, and a level or weight that allows its use."""
    if NONE in (row["x"], row["y"]):
        return False
    for name in ("level", "weight"):
        said = row.get(name)
        if said == NONE or (said is not None and _number(said, source, place) < 0):
            return False
    return "weight" not in row or _number(row["weight"], source, place) > 0


def _number(text: str, source: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ParseError(f"{text!r:.40} is not a finite number", source=source, place=place)
    return value


def _whole(text: str, source: str, place: str) -> int:
    value = _number(text, source, place)
    if value != int(value):
        raise ParseError(f"{text!r:.40} is not a corner's number", source=source, place=place)
    return int(value)
