"""Pix4D's internal camera parameters, the text file ``*_calibrated_internal_camera_parameters.cam``.

In the format's own words::

    Pix4D camera calibration file 0
    #Focal Length mm assuming a sensor width of 13.2x8.8mm
    F 8.6
    #Principal Point mm
    Px 6.61
    Py 4.38
    #Symmetrical Lens Distortion Coeffs
    K1 … K2 … K3 …
    #Tangential Lens Distortion Coeffs
    T1 … T2 …

one key to a line. Px and Py are mm from the image's top-left corner, y down; only the ratio of all lengths to
the sensor width in the comment means anything, and Pix4D does not state the image size: a file that is written here
has it in a comment (``#Image size 5472x3648 px``), and reads it there. Pixels are square. The coefficients act on x/z,
y/z as OpenCV's, T1 and T2 being its p1 and p2.

Sources: Pix4D support, "How are the internal and external camera parameters defined?"; a project's .cam and its
``calibrated_camera_parameters.txt`` hold the same K once both are in pixels.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from calibrary.calibration import Calibration, Grade, ImageSize
from calibrary.distortion import BrownConrady, Distortion, NoDistortion, required
from calibrary.errors import FrameError, ParseError, UnsupportedModelError
from calibrary.image_size import ASPECT_TOLERANCE
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, SizeMm, Unit
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._metric_lens import sensor_extra, sensor_mm_of
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.records import replace

COEFFICIENTS = ("K1", "K2", "K3", "T1", "T2")
KEYS = ("F", "Px", "Py", *COEFFICIENTS)
CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.CORNER,
    coefficients=COEFFICIENTS,
    remarks=(
        "lengths are relative to the sensor width that the file assumes",
        "pixels are square",
        "Pix4D does not state the image size: `--image-size WxH`",
    ),
)
SENSOR = "pix4d_cam/sensor_mm"

_FIRST_LINE = re.compile(r"Pix4\w* camera calibration file\b")
_SIZE = re.compile(r"#Image size (\d{1,7})x(\d{1,7}) px")
_SENSOR = re.compile(r"sensor width of\s*([\d.eE+-]+)\s*x\s*([\d.eE+-]+)\s*mm")


def sniff(content: Content) -> Sniff | None:
    """The first line says what it is."""
    if _FIRST_LINE.match(content.first_line):
        return Sniff(Sure.MAGIC, f"the first line is {strict.shown(content.first_line)}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file; where no comment states its size, it comes from the caller."""
    values, sensor, stated = _parsed(data)
    size = context.size(stated)
    stretch = sensor[0] * size[1] / (sensor[1] * size[0]) - 1
    if not abs(stretch) <= ASPECT_TOLERANCE:
        raise FrameError(
            f"on a sensor of {sensor[0]:g}×{sensor[1]:g} mm the pixels of a {size[0]}×{size[1]} image are not "
            f"square (by {stretch:+.1%}); --image-size must be the size of the images that Pix4D processed"
        )
    # Pixels are square, and it is the width that the file counts from.
    square = (sensor[0], sensor[0] * size[1] / size[0])
    native = Native(fx=values["F"], fy=values["F"], cx=values["Px"], cy=values["Py"])
    K = CONVENTION.intrinsics(native, size, sensor_mm=square)
    return [
        context.calibration(
            replace(K, fy=K.fx),
            _distortion(values),
            grade=Grade.ADJUSTED,
            extras=(sensor_extra(SENSOR, sensor),),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The keys in Pix4D's order, in mm of the sensor the camera was read with or of a nominal one."""
    [calibration] = calibrations
    sensor = sensor_mm_of(calibration, SENSOR)
    width, height = calibration.intrinsics.image_size
    native = CONVENTION.native(calibration.intrinsics, sensor_mm=(sensor[0], sensor[0] * height / width))
    brown = required(calibration.distortion, BrownConrady)
    rows = (
        "Pix4D camera calibration file 0",
        f"#Image size {width}x{height} px",
        f"#Focal Length mm assuming a sensor width of {sensor[0]!r}x{sensor[1]!r}mm",
        f"F {native.fx!r}",
        "#Principal Point mm",
        f"Px {native.cx!r}",
        f"Py {native.cy!r}",
        "#Symmetrical Lens Distortion Coeffs",
        *(
            f"{name} {value!r}"
            for name, value in zip(COEFFICIENTS, (brown.k1, brown.k2, brown.k3), strict=False)
        ),
        "#Tangential Lens Distortion Coeffs",
        f"T1 {brown.p1!r}",
        f"T2 {brown.p2!r}",
    )
    return "".join(f"{row}\n" for row in rows).encode()


def _parsed(data: bytes) -> tuple[dict[str, float], SizeMm, ImageSize | None]:
    """The numbers by key, the sensor's size in mm, and the image's if a comment of ours states it."""
    rows = rows_of(data)
    text = [(index, row.strip()) for index, row in enumerate(rows, start=1) if row.strip()]
    if not text or not _FIRST_LINE.match(text[0][1]):
        raise ParseError("the first line is not 'Pix4D camera calibration file'")
    values: dict[str, float] = {}
    sensor: SizeMm | None = None
    size: ImageSize | None = None
    for index, row in text[1:]:
        place = f"line {index}"
        if row.startswith("#"):
            sensor = sensor or _sensor_in(row, place=place)
            if found := _SIZE.fullmatch(row):
                size = strict.image_size(float(found[1]), float(found[2]), place=place)
            continue
        key, _, rest = row.partition(" ")
        if key not in KEYS:
            raise UnsupportedModelError(
                f"it contains {strict.shown(key)}, which a perspective camera's file does not (a fisheye's does); "
                "export the project as OPF instead",
                place=place,
            )
        if key in values:
            raise ParseError(f"{key} is a duplicate key", place=place)
        values[key] = strict.number(rest, place=place)
    missing = [key for key in KEYS if key not in values]
    if missing:
        raise ParseError(f"there is no {', '.join(missing)}")
    if sensor is None:
        raise ParseError(
            "there is no comment 'assuming a sensor width of …', without which millimetres are not pixels; "
            "add '#Focal Length mm assuming a sensor width of <width>x<height>mm'"
        )
    return values, sensor, size


def _sensor_in(comment: str, *, place: str) -> SizeMm | None:
    found = _SENSOR.search(comment)
    if found is None:
        return None
    width, height = (strict.number(side, place=place) for side in found.groups())
    if not (width > 0 and height > 0):
        raise ParseError(f"the sensor is {width:g}×{height:g} mm, expected positive", place=place)
    return width, height


def _distortion(values: dict[str, float]) -> Distortion:
    if not any(values[name] for name in COEFFICIENTS):
        return NoDistortion()
    return BrownConrady(k1=values["K1"], k2=values["K2"], k3=values["K3"], p1=values["T1"], p2=values["T2"])


FORMAT = Format(
    name="pix4d_cam",
    title="Pix4D camera calibration (.cam)",
    suffixes=(".cam",),
    syntaxes=(Syntax.TEXT,),
    reference="https://support.pix4d.com/hc/en-us/articles/202559089",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady), two_focals=False, unknown_lens=UnknownLens.FREE),
)
