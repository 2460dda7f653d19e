"""Control points with known positions, as a table: X Y Z u v image, one row per observation of a point.

The points are ground control, or the sparse cloud of a reconstruction. X, Y and Z are metres in any right-handed
frame, u and v are pixels. K does not depend on the unit of length, so a cloud without scale is also usable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from calibrary.calib.corners_file import read_table
from calibrary.calib.observations import ControlPoints, Observations, View
from calibrary.calibration import CameraKey, ImageSize, Origin, canonical_from_file
from calibrary.errors import ParseError

COLUMNS: Final = ("x", "y", "z", "u", "v", "image")
MOST_ROWS: Final = 500_000
MM: Final = 1000.0
DELIMITERS: Final = ",;\t"


def read_control_points(
    path: Path, image_size: ImageSize, camera: CameraKey, origin: Origin, focus: str | None = None
) -> Observations:
    """Read the observations of a table.

    Args:
        path: text with comma-, semicolon- or tab-separated columns; the first line names them, in any order.
        image_size: (width, height) px of all images.
        camera: camera of the images.
        origin: pixel origin of u and v.
        focus: focus setting of the lens.

    Raises:
        InputError: the file cannot be read.
        ParseError: a column is missing, a value is not a number, or a point occurs twice in one image.
    """
    rows = _rows(_text(path), path.name)
    points: dict[tuple[float, float, float], int] = {}
    views: dict[str, dict[int, tuple[float, float]]] = {}
    for line, (place, seen, image) in rows:
        at = points.setdefault(place, len(points))
        view = views.setdefault(image, {})
        if at in view:
            raise ParseError(
                f"repeats the point {place} in {image}; expected one row for each", source=path.name,
                place=f"line {line}",
            )  # fmt: skip
        view[at] = seen
    if not views:
        raise ParseError("has no rows below its first line", source=path.name)
    shift = canonical_from_file((0.0, 0.0), origin, image_size)
    return Observations(
        board=ControlPoints(points=np.array(list(points)) * MM),
        image_size=image_size,
        views=tuple(
            View(
                name=name,
                ids=np.array(list(seen), dtype=np.intp),
                image_points=np.array(list(seen.values())) + shift,
            )
            for name, seen in views.items()
        ),
        camera=camera,
        focus=focus,
        firmware=camera.firmware,
    )


def _text(path: Path) -> str:
    try:
        return read_table(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ParseError("is not UTF-8, expected a table of text", source=path.name) from None


_Row = tuple[tuple[float, float, float], tuple[float, float], str]


def _rows(text: str, source: str) -> Iterator[tuple[int, _Row]]:
    head = text.partition("\n")[0]
    delimiter = max(DELIMITERS, key=head.count)
    order = _order(head.split(delimiter), source)
    for line, row in enumerate(text.splitlines()[1:], start=2):
        if line > MOST_ROWS:
            raise ParseError(f"has more than {MOST_ROWS} rows; thin them out", source=source)
        if row.strip():
            yield line, _row(row.split(delimiter), order, source, f"line {line}")


def _order(names: Sequence[str], source: str) -> Mapping[str, int]:
    found = {name.strip().lower(): at for at, name in enumerate(names)}
    missing = [name for name in COLUMNS if name not in found]
    if missing:
        raise ParseError(
            f"has no column {', '.join(missing)}; expected X,Y,Z,u,v,image in the first line, metres and pixels below",
            source=source,
            place="line 1",
        )
    return found


def _row(cells: Sequence[str], order: Mapping[str, int], source: str, place: str) -> _Row:
    if len(cells) <= max(order[name] for name in COLUMNS):
        raise ParseError(f"has {len(cells)} cells, expected {len(order)}", source=source, place=place)
    try:
        x, y, z, u, v = (float(cells[order[name]]) for name in COLUMNS[:-1])
    except ValueError as error:
        raise ParseError(f"{error}", source=source, place=place) from None
    image = cells[order["image"]].strip()
    if not all(math.isfinite(value) for value in (x, y, z, u, v)) or not image:
        raise ParseError("expected five finite numbers and an image's name", source=source, place=place)
    return (x, y, z), (u, v), image
