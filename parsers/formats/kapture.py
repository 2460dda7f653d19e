"""kapture's ``sensors.txt``: the cameras of a dataset for visual localisation.

In the format's own words::

    # kapture format: 1.1
    # sensor_id, name, sensor_type, [sensor_params]+
    cam0, left, camera, OPENCV, 5472, 3648, 3650.1, 3648.7, 2741.3, 1815.9, -0.0125, 0.0231, -0.0004, 0.0008
    imu0, , imu

The models and the order of their parameters are COLMAP's. kapture's importers copy COLMAP's numbers unchanged, so
calibrary reads the principal point from the corner of the first pixel, as COLMAP counts. An UNKNOWN_CAMERA has a size
and no K. Sensors of other types are not read.

Importers from elsewhere, such as Virtual Gallery's, copy numbers that count from that pixel's centre: ``origin``
chooses, and a principal point at exactly ((width − 1)/2, (height − 1)/2) is noted.

Source: kapture, ``kapture/core/Sensors.py`` and ``kapture/io/csv.py``; kapture 1.1.12 itself reads what is written
here, and the same numbers from the same files.
"""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import (
    BrownConrady,
    FieldOfView,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrismFisheye,
)
from calibrary.errors import ParseError
from calibrary.interop.colmap import model_named
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._one_camera import ORIGIN, refuse_model
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.parsers.formats.colmap import MAX_CAMERAS, StoredCamera, cameras, records
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.CORNER,
    remarks=(
        "one or two focal lengths, the principal point, and then the coefficients, as COLMAP's models have them",
        "the origin is COLMAP's, whose cameras kapture copies",
    ),
)
MARK = "# kapture format:"
HEADING = ("# kapture format: 1.1", "# sensor_id, name, sensor_type, [sensor_params]+")
MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
)  # fmt: skip
WITHOUT_K = "UNKNOWN_CAMERA"
SENSOR_ID = "kapture/sensor_id"
MAX_BYTES = 8 * 1024 * 1024
HALF = (
    "the principal point is the middle of the image for a program that counts from the centre of the first pixel; "
    "--pixel-origin centre reads it so"
)


def sniff(content: Content) -> Sniff | None:
    """The first line, or the heading of the columns."""
    if content.first_line.startswith(MARK) and any("sensor_type" in line for line in content.lines[:5]):
        return Sniff(
            Sure.MAGIC, f"the first line is '{content.first_line[:30]}' and the columns are sensors'"
        )
    if content.first_line.replace(" ", "") == HEADING[1].replace(" ", ""):
        return Sniff(Sure.MAGIC, f"the first line is '{HEADING[1]}'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that has a K, in order, by its sensor_id."""
    found: list[StoredCamera] = []
    names: dict[str, str] = {}
    for index, row in enumerate(rows_of(data, most=MAX_BYTES), start=1):
        fields = [field.strip() for field in row.split(",")]
        if not row.strip() or row.startswith("#") or len(fields) < 3 or fields[2] != "camera":
            continue
        if len(found) == MAX_CAMERAS:
            raise ParseError(f"there are over {MAX_CAMERAS} cameras")
        if fields[0] in names.values():
            raise ParseError("it is a duplicate sensor_id", place=strict.shown(fields[0]))
        found.append(_stored(fields[3:], index))
        names[str(index)] = fields[0]
    several = len(found) > 1
    centre = context.option(ORIGIN.name) == "centre"
    return [
        _with_sensor_id(
            _counted(item, from_centre=centre),
            names[(item.provenance.tag or "").removeprefix("camera ")],
            several=several,
        )
        for item in cameras(found, context, grade=Grade.CALIBRATED)
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The columns of kapture 1.1, with digits that read back bit for bit."""
    lines = [*HEADING]
    for item, (number, camera) in zip(calibrations, records(calibrations), strict=True):
        name = dict(item.extras).get(SENSOR_ID) or item.camera.sub_camera or f"cam{number}"
        sensor = (
            name if name.isprintable() and "," not in name and not name.startswith("#") else f"cam{number}"
        )
        numbers = ", ".join(map(repr, camera.params))
        lines.append(
            f"{sensor.strip()}, , camera, {camera.model}, {camera.width}, {camera.height}, {numbers}"
        )
    return "".join(f"{line}\n" for line in lines).encode()


def _stored(fields: Sequence[str], line: int) -> StoredCamera:
    place = f"line {line}"
    if len(fields) < 3:
        raise ParseError(f"{len(fields)} parameters, expected a model, a width and a height", place=place)
    width, height, *rest = (strict.number(field, place=place) for field in fields[1:])
    model = model_named(fields[0]) if fields[0] in MODELS else None
    if model is None and fields[0] != WITHOUT_K:
        refuse_model(fields[0], MODELS, place=place)
    size = strict.image_size(width, height, place=place)
    return StoredCamera(line, model or WITHOUT_K, *size, tuple(rest), place)


def _counted(item: Calibration, *, from_centre: bool) -> Calibration:
    """The camera with its principal point from the corner, and a note where the file seems to count from the centre."""
    K = item.intrinsics
    if from_centre:
        return replace(item, intrinsics=replace(K, cx=K.cx + 0.5, cy=K.cy + 0.5))
    if (K.cx, K.cy) == ((K.image_size[0] - 1) / 2, (K.image_size[1] - 1) / 2):
        return replace(item, notes=(*item.notes, HALF))
    return item


def _with_sensor_id(item: Calibration, name: str, *, several: bool) -> Calibration:
    """The camera under its sensor_id, of which COLMAP's list of numbers knows nothing."""
    extras = tuple((key, text) for key, text in item.extras if key != "colmap/camera_id")
    return replace(
        item,
        camera=replace(item.camera, sub_camera=name if several else None),
        provenance=replace(item.provenance, tag=name),
        extras=extras if several else ((SENSOR_ID, name), *extras),
    )


FORMAT = Format(
    name="kapture",
    title="kapture sensors.txt",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/naver/kapture/blob/main/kapture_format.adoc",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    options=(ORIGIN,),
    capacity=Capacity(
        models=(NoDistortion, BrownConrady, Rational, KannalaBrandt, FieldOfView, ThinPrismFisheye),
        several_cameras=True,
        unknown_lens=UnknownLens.FREE,
    ),
)
