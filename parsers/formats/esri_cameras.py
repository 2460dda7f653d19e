"""Esri's cameras table, a CSV from which ArcGIS Pro and Ortho Mapping take frame cameras.

In the format's own words, one row a camera::

    ObjectID,CameraID,FocalLength,PrincipalX,PrincipalY,NRows,NColumns,PixelSize
    1,FC6310R,8782.4,-10.9,-54.1,3648,5472,2.4

FocalLength, PrincipalX, PrincipalY and PixelSize are µm. The principal point is the offset from the fiducial centre,
which in a digital camera is the image's middle, in the film coordinate system, whose default is X_RIGHT_Y_UP. Pixels
are square. Tables of ArcMap state an affine transformation (A0 … B2) in place of the pixels.

Lens distortion has columns too (K0, K1, K2 and tables of radial distances), but Esri's description states neither their
sign nor the direction in which they map, and "Esri" and "USGS" kinds of them differ. So they are not written, and a
file that has them is refused: undistort the images first, and hand over the K of those.

Source: "Cameras table schema", https://pro.arcgis.com/en/pro-app/latest/help/data/imagery/cameras-table-schema.htm.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence

from calibrary.calibration import Calibration, Grade, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential, Unit, YAxis
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._metric_lens import sensor_extra, sensor_mm_of
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, camera
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.records import replace

COLUMNS = (
    "ObjectID",
    "CameraID",
    "FocalLength",
    "PrincipalX",
    "PrincipalY",
    "NRows",
    "NColumns",
    "PixelSize",
)
NEEDED = frozenset({"cameraid", "focallength", "pixelsize"})
LENS = ("k0", "k1", "k2", "k3", "k4", "p1", "p2", "radialdistances", "radialdistortions")
AFFINE = ("a0", "a1", "a2", "b0", "b1", "b2")
CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.IMAGE_CENTRE,
    y_axis=YAxis.UP,
    tangential=Tangential.NONE,
    remarks=("lengths in the file are micrometres", "pixels are square", "images are without distortion"),
)
MAX_CAMERAS = 100_000
UM_PER_MM = 1000.0
SENSOR = "esri_cameras/sensor_mm"


def sniff(content: Content) -> Sniff | None:
    """The heading's columns."""
    if {*_columns(content.first_line)} >= NEEDED:
        return Sniff(Sure.MAGIC, "the columns CameraID, FocalLength and PixelSize")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the file's order."""
    rows = [row for row in rows_of(data) if row.strip()]
    columns = _columns(rows[0]) if rows else ()
    if not {*columns} >= NEEDED or len({*columns}) != len(columns):
        raise ParseError("the first line lacks CameraID, FocalLength or PixelSize, or has a column twice")
    if len(rows) - 1 > MAX_CAMERAS:
        raise ParseError(f"there are {len(rows) - 1} cameras, expected at most {MAX_CAMERAS}")
    found = []
    for index, fields in enumerate(csv.reader(rows[1:]), start=2):
        place = f"line {index}"
        if len(fields) != len(columns):
            raise ParseError(f"{len(fields)} fields, expected {len(columns)}", place=place)
        row = {name: text for name, text in zip(columns, map(str.strip, fields), strict=True) if text}
        found.append(_camera(row, context, place, several=len(rows) > 2))
    return found


def _camera(row: Mapping[str, str], context: ReadContext, place: str, *, several: bool) -> Calibration:
    missing = [name for name in COLUMNS if name.lower() in NEEDED - {*row}]
    if missing:
        raise ParseError(f"{', '.join(missing)} is empty", place=place)
    values = {
        name: strict.number(row[name], place=f"{place}, {name}")
        for name in ("focallength", "principalx", "principaly", "pixelsize")
        if name in row
    }
    _refuse(row, place)
    if not values["pixelsize"] > 0:
        raise ParseError(f"PixelSize is {values['pixelsize']:g} µm, expected more than 0", place=place)
    size = context.size(_size(row, place))
    native = Native(
        fx=values["focallength"] / UM_PER_MM,
        fy=values["focallength"] / UM_PER_MM,
        cx=values.get("principalx", 0.0) / UM_PER_MM,
        cy=values.get("principaly", 0.0) / UM_PER_MM,
    )
    pitch_mm = values["pixelsize"] / UM_PER_MM
    sensor_mm = (size[0] * pitch_mm, size[1] * pitch_mm)
    K = CONVENTION.intrinsics(native, size, sensor_mm=sensor_mm)
    # The two sides give the same pitch but for the last digit.
    K = replace(K, fy=K.fx)
    px = Native(fx=K.fx, fy=K.fy, cx=K.cx, cy=K.cy)
    name = row["cameraid"]
    item = camera(
        context,
        Convention(origin=Origin.CORNER),
        px,
        size,
        NoDistortion(),
        name=name if several else None,
        tag=name,
        assumptions=(ORIGIN_UNKNOWN,),
    )
    return replace(item, grade=Grade.DERIVED, extras=(sensor_extra(SENSOR, sensor_mm),))


def _refuse(row: Mapping[str, str], place: str) -> None:
    """Refuse what the description does not define well enough to be read.

    Raises:
        UnsupportedModelError: lens distortion, or an affine transformation.
    """
    lens = [name for name in LENS if row.get(name, "0").strip("0.;, ")]
    if lens:
        raise UnsupportedModelError(
            f"it states lens distortion ({', '.join(lens)}), whose sign and direction Esri does not describe; export "
            "the camera from the program that calibrated it",
            place=place,
        )
    if any(name in row for name in AFFINE):
        raise UnsupportedModelError(
            "it states an affine transformation (A0 … B2), which is not read; expected PixelSize, NRows and NColumns",
            place=place,
        )


def _size(row: Mapping[str, str], place: str) -> ImageSize | None:
    if "nrows" not in row or "ncolumns" not in row:
        return None
    width, height = (strict.number(row[name], place=f"{place}, {name}") for name in ("ncolumns", "nrows"))
    return strict.image_size(width, height, place=place)


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """A row for each camera, by its name or its number."""
    lines = [",".join(COLUMNS)]
    for index, item in enumerate(calibrations, start=1):
        width_mm, _ = sensor_mm_of(item, SENSOR)
        (width, height), pitch_mm = item.intrinsics.image_size, width_mm / item.intrinsics.image_size[0]
        native = CONVENTION.native(item.intrinsics, sensor_mm=(width * pitch_mm, height * pitch_mm))
        name = item.camera.sub_camera or item.camera.model or f"camera{index}"
        kept = (
            "".join("_" if c in ',"' or not c.isprintable() else c for c in name).strip() or f"camera{index}"
        )
        numbers = [native.fx * UM_PER_MM, native.cx * UM_PER_MM, native.cy * UM_PER_MM]
        cells = [str(index), kept, *map(repr, numbers), str(height), str(width), repr(pitch_mm * UM_PER_MM)]
        lines.append(",".join(cells))
    return "".join(f"{line}\n" for line in lines).encode()


def _columns(line: str) -> tuple[str, ...]:
    return tuple(name.strip().lower() for name in line.split(","))


FORMAT = Format(
    name="esri_cameras",
    title="Esri cameras table (ArcGIS Pro, Ortho Mapping)",
    suffixes=(".csv",),
    syntaxes=(Syntax.TEXT,),
    reference="https://pro.arcgis.com/en/pro-app/latest/help/data/imagery/cameras-table-schema.htm",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion,), two_focals=False, several_cameras=True),
)
