"""Reader of ground control: surveyed points and their marks in images.

``gcp_list.txt`` of ODM and WebODM: the coordinate system in the first line (``WGS84 UTM 32N``, an EPSG code, a PROJ
string), then ``x y z im_x im_y image [name]`` for each mark. OpenSfM, which reads it for ODM, adds half a pixel to
im_x and im_y (``read_gcp_list`` in ``io.py``, ``normalized_image_coordinates`` in ``features.py``): their origin is
the centre of the first pixel. The first line ``local`` means local metres, such as those of a test field. The table of
``calibrate --points`` is accepted too, as local metres.
"""

from __future__ import annotations

import hashlib
import math
import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.control_points import COLUMNS, read_control_points
from calibrary.calib.corners_file import read_table
from calibrary.calibration import CameraKey, Origin, SourceFile
from calibrary.errors import ParseError
from calibrary.extras import SURVEY, require

LOCAL: Final = "local"
MOST_LINES: Final = 100_000
_UTM = re.compile(r"WGS84 UTM (\d{1,2})([NS]?)", re.IGNORECASE)
WANTED: Final = "WGS84 UTM 32N, EPSG:CODE, a PROJ string, or local for metres of no map"


class Mark(Struct, frozen=True, kw_only=True):
    """Mark of a point in an image.

    Attributes:
        point: index of the point in the survey.
        image: file name, as stated.
        pixel: px from the outer corner of the first pixel.
        line: line of the file; 0 if unknown.
    """

    point: int
    image: str
    pixel: tuple[float, float]
    line: int


class Survey(Struct, frozen=True, kw_only=True, eq=False):
    """Ground control.

    Attributes:
        names: names of the G points.
        places: (G, 3) longitude, latitude (degrees) and height (m), WGS 84; x, y, z in m if local.
        is_local: whether the places are local metres.
        marks: marks of the points in images.
        file: file that was read.
        std_m: standard deviation of each coordinate of a place, m.
        mark_px: standard deviation of each coordinate of a mark, px.
        offset_std_m: standard deviation of the offset between the datums and height systems of image positions and
            points, m; inf if unknown.
    """

    names: tuple[str, ...]
    places: FloatArray
    is_local: bool
    marks: tuple[Mark, ...]
    file: SourceFile
    std_m: float = 0.03
    mark_px: float = 1.0
    offset_std_m: float = math.inf

    def points_of(self, images: Sequence[str]) -> Mapping[str, frozenset[int]]:
        """Return the points in each of some images, by the image's name."""
        shown: dict[str, set[int]] = {name: set() for name in images}
        for at, mark in self.marks_in(images):
            shown[images[at]].add(mark.point)
        return {name: frozenset(points) for name, points in shown.items()}

    def marks_in(self, images: Sequence[str]) -> list[tuple[int, Mark]]:
        """Return the marks in some images, each with the image's index, sorted by point.

        Images named with their folder, because their file names are not unique, must be so named in the survey too.
        """
        number = {_folded(name): at for at, name in enumerate(images)}
        found = []
        for mark in sorted(self.marks, key=lambda one: one.point):
            name = _folded(mark.image)
            ends = (name, "/".join(name.split("/")[-2:]), name.rpartition("/")[2])
            found += [(number[end], mark) for end in ends if end in number][:1]
        return found


def _folded(name: str) -> str:
    return unquote(name).replace("\\", "/").casefold()


def read_survey(path: Path) -> Survey:
    """Read the points and marks of a file.

    Raises:
        InputError: the file cannot be read.
        ParseError: a line is malformed or contradicts another one.
        MissingExtraError: pyproj is not installed, but the coordinates are not local.
    """
    data = read_table(path)
    file = SourceFile(name=path.name, sha256=hashlib.sha256(data).hexdigest())
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise ParseError("is not UTF-8, expected ODM's gcp_list.txt", source=path.name) from None
    stated = [(number, line.strip()) for number, line in enumerate(lines, start=1)]
    stated = [(number, line) for number, line in stated if line and not line.startswith("#")]
    if not stated or len(stated) > MOST_LINES:
        raise ParseError(f"has {len(stated)} lines, expected 2 … {MOST_LINES}", source=path.name)
    head = stated[0][1]
    if {*COLUMNS} <= {name.strip() for name in re.split("[,;\t]", head.lower())}:
        return _table(path, file)
    names, coordinates, marks = _marks(stated[1:], path.name)
    if not marks:
        raise ParseError("has no line below its first, expected x y z im_x im_y image", source=path.name)
    is_local = head.lower() == LOCAL
    places = coordinates if is_local else _geodetic(head, coordinates, f"{path.name}, line {stated[0][0]}")
    return Survey(names=names, places=places, is_local=is_local, marks=marks, file=file)


def _table(path: Path, file: SourceFile) -> Survey:
    """Read the table of ``calibrate --points``; its points have no names."""
    seen = read_control_points(path, (1, 1), CameraKey(), Origin.CORNER)
    places = seen.board.points / 1000
    marks = [
        Mark(point=int(point), image=view.name, pixel=(float(x), float(y)), line=0)
        for view in seen.views
        for point, (x, y) in zip(view.ids.tolist(), view.image_points.tolist(), strict=True)
    ]
    names = tuple(f"({x:g}, {y:g}, {z:g})" for x, y, z in places.tolist())
    return Survey(names=names, places=places, is_local=True, marks=tuple(marks), file=file)


def _marks(
    stated: Sequence[tuple[int, str]], source: str
) -> tuple[tuple[str, ...], FloatArray, tuple[Mark, ...]]:
    """Return names and coordinates of the points, and the marks."""
    names: dict[str, int] = {}
    places: dict[tuple[float, ...], int] = {}
    marks: dict[tuple[int, str], Mark] = {}
    for line, text in stated:
        words, place = text.split(), f"line {line}"
        try:
            x, y, z, im_x, im_y = map(float, words[:5])
        except ValueError:
            x = math.nan
        if len(words) < 6 or not all(map(math.isfinite, (x, y, z, im_x, im_y))):
            raise ParseError(
                f"{text:.60}: expected x y z im_x im_y image, five numbers and a file name", source=source,
                place=place,
            )  # fmt: skip
        point = places.setdefault((x, y, z), len(places))
        name = words[6] if len(words) > 6 else f"point {point + 1}"
        if names.setdefault(name, point) != point:
            raise ParseError(
                f"point {name} has other coordinates than above; expected one place for each name",
                source=source, place=place,
            )  # fmt: skip
        mark = Mark(point=point, image=words[5], pixel=(im_x + 0.5, im_y + 0.5), line=line)
        before = marks.setdefault((point, _folded(mark.image)), mark)
        if before is not mark:
            raise ParseError(
                f"point {name} is in {mark.image} on line {before.line} already; expected one mark", source=source,
                place=place,
            )  # fmt: skip
    by_number = {point: name for name, point in reversed(names.items())}
    listed = tuple(by_number[point] for point in range(len(places)))
    return listed, np.array([*places], dtype=np.float64).reshape(-1, 3), tuple(marks.values())


def _geodetic(head: str, coordinates: FloatArray, where: str) -> FloatArray:
    """Convert coordinates in the system of the first line to (G, 3) longitudes, latitudes and heights, WGS 84."""
    require(SURVEY, "the coordinate system of the points")
    import pyproj

    source, place = where.rsplit(", ", 1)
    utm = _UTM.fullmatch(head)
    named: Any = head.strip("'\"")
    if utm is not None:
        named = {"proj": "utm", "zone": int(utm[1]), "datum": "WGS84", "south": utm[2].upper() == "S"}
    elif head.upper() == "WGS84":
        named = "EPSG:4326"
    try:
        with warnings.catch_warnings():
            # Older programs write "+init=epsg:32632", for which pyproj warns.
            warnings.simplefilter("ignore", FutureWarning)
            system = pyproj.CRS.from_user_input(named)
        convert = pyproj.Transformer.from_crs(system, "EPSG:4979", always_xy=True)
    except pyproj.exceptions.ProjError:
        raise ParseError(
            f"{head!r:.60} is no coordinate system, expected {WANTED}", source=source, place=place
        ) from None
    units = [axis.unit_name for axis in system.axis_info]
    if len(units) == 2 and not {*units} <= {"metre", "degree"}:
        raise ParseError(
            f"{system.name} counts in {units[0]} and does not say what heights count in: convert the points to metres, "
            "such as WGS84 UTM", source=source, place=place,
        )  # fmt: skip
    found = np.column_stack(convert.transform(*coordinates.T))
    possible = (np.abs(found) <= (180.0, 90.0, 1e5)).all(axis=1)
    if not possible.all():
        outside = coordinates[~possible][0].tolist()
        raise ParseError(
            f"{outside[0]:g} {outside[1]:g} are no coordinates of {system.name}: check its zone, and that x is east "
            "and y north", source=source, place=place,
        )  # fmt: skip
    return np.asarray(found, dtype=np.float64)
