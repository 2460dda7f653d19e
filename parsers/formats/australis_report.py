"""The camera parameters that Australis, Photometrix's bundle adjustment, reports after a calibration.

In the format's own words, a table for each camera::

    Australis Bundle Adjustment Results:  Camera Parameters
                                        02 August, 2006   14:11:14
    Number of Points: 145
    Number of Images: 9
    RMS of Image coords:    0.47 (um)

    Results for Camera 1    NAME      Lens
    Sensor Size        Pixel Size (mm)
      H    5472          0.0024
      V    3648          0.0024

      Camera    Initial      Total          Final        Initial         Final
     Variable    Value     Adjustment       Value       Std. Error     Std. Error
        C …  XP …  YP …  K1 … K3 …  P1 …  P2 …  B1 …  B2 …

The *final* values count. Lengths are mm, XP and YP from the middle of the image with y up, K per mm², mm⁴ and
mm⁶, P per mm. With x = xd − XP and y = yd − YP measured, the corrected point is::

    x + x·(K1·r² + K2·r⁴ + K3·r⁶) + P1·(r² + 2x²) + 2·P2·x·y + B1·x + B2·y
    y + y·(K1·r² + K2·r⁴ + K3·r⁶) + P2·(r² + 2y²) + 2·P1·x·y

so a barrel has K1 > 0. The unit of length cancels: where nothing states the size of a pixel, a camera is written in
units of its focal length.

Sources: C. S. Fraser, "Digital camera self-calibration", 1997; Ames Stereo Pipeline, "Photometrix".
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from msgspec import Struct, field

from calibrary.calibration import Calibration, Quality
from calibrary.distortion import Australis, Distortion, NoDistortion, required
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Direction, Native, Origin, Tangential, Unit, YAxis
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._metric_lens import normalised, per_length
from calibrary.parsers.formats._text_rows import rows_of

TITLE = "Australis Bundle Adjustment Results"
PARAMETERS = ("C", "XP", "YP", "K1", "K2", "K3", "P1", "P2", "B1", "B2")
LENS = PARAMETERS[3:]
NEAR_TOP = 10
COLUMNS = 5
"""Initial value, adjustment, final value, and the standard errors before and after."""

CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.IMAGE_CENTRE,
    y_axis=YAxis.UP,
    direction=Direction.DISTORTED_TO_UNDISTORTED,
    tangential=Tangential.SWAPPED,
    coefficients=LENS,
    remarks=("B1·x + B2·y is added to x",),
)
PIXEL = "australis_report/pixel_mm"
AXES_NOTE = "YP was read with y pointing up, as photogrammetry counts; the report does not say"

_DATE = re.compile(r"(?![A-Z][\w ]{0,40}:)[\w ,./:+-]{0,40}\b\d{4}\b[\w ,./:+-]{0,40}")
_CAMERA = re.compile(r"Results for Camera\s+(\d+)\s*(.*)")
_SIDE = re.compile(r"([HV])\s+(\S+)\s+(\S+)")
_FACT = re.compile(r"(Number of Points|Number of Images|RMS of Image coords)\s*:\s*(\S+)")


class _Camera(Struct):
    """One camera's table: values and final standard errors by parameter, and pixels by axis."""

    name: str
    place: str
    values: dict[str, float] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    sides: dict[str, tuple[float, float]] = field(default_factory=dict)


def sniff(content: Content) -> Sniff | None:
    """The title says what it is."""
    if content.first_line.startswith(TITLE):
        return Sniff(Sure.MAGIC, f"the first line begins with '{TITLE}'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the adjustment, in order."""
    rows = rows_of(data)
    cameras, facts = _tables(rows)
    several, date = len(cameras) > 1, _date(rows)
    return [_calibration(camera, facts, context, several=several, date=date) for camera in cameras]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The report's rows with all their digits; nothing is said of initial values."""
    [calibration] = calibrations
    K = calibration.intrinsics
    width, height = K.image_size
    focal, pixel_width = _scale(calibration)
    pixels = (pixel_width, focal / K.fy)
    native = CONVENTION.native(K, sensor_mm=(width * pixels[0], height * pixels[1]))
    final = {"C": focal, "XP": native.cx, "YP": native.cy, **_lens_rows(calibration.distortion, focal)}
    quality = calibration.quality or Quality()
    facts = (
        ("Number of Points", quality.points, ""),
        ("Number of Images", quality.views, ""),
        ("RMS of Image coords", quality.rms_px and quality.rms_px * 1e3 * pixel_width, " (um)"),
    )
    errors = {
        key: quality.std.get(name, 0.0) * pixel
        for key, name, pixel in (("C", "fx", pixels[0]), ("XP", "cx", pixels[0]), ("YP", "cy", pixels[1]))
    }
    name = " ".join((calibration.camera.sub_camera or calibration.camera.model or "Camera").split())
    rows = [
        f"{TITLE}:  Camera Parameters",
        "",
        *([date, ""] if (date := calibration.provenance.date) else []),
        *(f"{title}: {value!r}{unit}" for title, value, unit in facts if value is not None),
        "",
        f"Results for Camera 1    {name}      Lens",
        "",
        "Sensor Size        Pixel Size (mm)",
        f"  H    {width}           {pixels[0]!r}",
        f"  V    {height}           {pixels[1]!r}",
        "",
        "  Camera    Initial      Total          Final        Initial         Final",
        " Variable    Value     Adjustment       Value       Std. Error     Std. Error",
        "",
        *(
            f"   {key}  0.0  {final[key]!r}  {final[key]!r}  0.0  {errors.get(key, 0.0)!r}"
            for key in PARAMETERS
        ),
    ]
    return "".join(f"{row}\n" for row in rows).encode()


def _date(rows: Sequence[str]) -> str | None:
    """The line below the title, which is the time of the adjustment and has no label; None if it is missing."""
    second = next((line for row in rows[1:NEAR_TOP] if (line := row.strip())), "")
    return second if _DATE.fullmatch(second) else None


def _tables(rows: Sequence[str]) -> tuple[list[_Camera], dict[str, float]]:
    """Every camera's table, and the facts about the whole adjustment."""
    if not any(row.strip().startswith(TITLE) for row in rows):
        raise ParseError(f"there is no line '{TITLE}'")
    cameras: list[_Camera] = []
    facts: dict[str, float] = {}
    for index, row in enumerate(rows, start=1):
        place, line = f"line {index}", row.strip()
        if found := _CAMERA.match(line):
            parts = re.split(r"\s{2,}", found.group(2))
            cameras.append(_Camera(parts[0] or f"camera {found.group(1)}", place))
        elif found := _FACT.match(line):
            facts[found.group(1)] = strict.number(found.group(2), place=place)
        elif cameras:
            _take(cameras[-1], line, place=place)
    if not cameras:
        raise ParseError("there is no 'Results for Camera'")
    return cameras, facts


def _take(camera: _Camera, line: str, *, place: str) -> None:
    """One line of a camera's table; what is neither a parameter nor a side is passed over."""
    if found := _SIDE.fullmatch(line):
        axis, count, pixel = found.groups()
        camera.sides[axis] = (
            strict.number(count, place=place),
            strict.number(pixel, place=place),
        )
        return
    key, _, rest = line.partition(" ")
    if key not in PARAMETERS:
        return
    if key in camera.values:
        raise ParseError(f"{key} is a duplicate key in one table", place=place)
    numbers = strict.numbers(rest.removesuffix("(mm)"), count=COLUMNS, place=place)
    camera.values[key], camera.errors[key] = numbers[2], numbers[4]


def _calibration(
    camera: _Camera, facts: dict[str, float], context: ReadContext, *, several: bool, date: str | None
) -> Calibration:
    missing = [key for key in PARAMETERS if key not in camera.values]
    missing += [f"{axis} size" for axis in "HV" if axis not in camera.sides]
    if missing:
        raise ParseError(f"its table lacks {', '.join(missing)}", place=camera.place)
    (columns, pitch_x), (rows, pitch_y) = camera.sides["H"], camera.sides["V"]
    if not (pitch_x > 0 and pitch_y > 0):
        raise ParseError("the pixel size is not positive", place=camera.place)
    size = context.size(strict.image_size(columns, rows, place=camera.place))
    values = camera.values
    native = Native(fx=values["C"], fy=values["C"], cx=values["XP"], cy=values["YP"])
    K = CONVENTION.intrinsics(native, size, sensor_mm=(size[0] * pitch_x, size[1] * pitch_y))
    return context.calibration(
        K,
        _distortion(values),
        name=camera.name if several else None,
        tag=camera.name,
        date=date,
        quality=_quality(camera, facts, (pitch_x, pitch_y)),
        notes=(AXES_NOTE,),
        extras=((PIXEL, repr(pitch_x)),),
    )


def _distortion(values: dict[str, float]) -> Distortion:
    if not any(values[key] for key in LENS):
        return NoDistortion()
    focal = values["C"]
    k1, k2, k3 = normalised([values[key] for key in ("K1", "K2", "K3")], focal)
    p1, p2 = CONVENTION.tangential_from_file(*(values[key] * focal for key in ("P1", "P2")))
    return Australis(k1=k1, k2=k2, k3=k3, p1=p1, p2=p2, b1=values["B1"], b2=-values["B2"])


def _lens_rows(distortion: Distortion | None, focal: float) -> dict[str, float]:
    lens = required(distortion, Australis)
    k1, k2, k3 = per_length((lens.k1, lens.k2, lens.k3), focal)
    P1, P2 = CONVENTION.tangential_to_file(lens.p1, lens.p2)
    return {"K1": k1, "K2": k2, "K3": k3, "P1": P1 / focal, "P2": P2 / focal, "B1": lens.b1, "B2": -lens.b2}


def _quality(camera: _Camera, facts: dict[str, float], pitch: tuple[float, float]) -> Quality:
    """What the report says of the adjustment; a standard error of zero says nothing."""
    points, views, rms_um = (
        facts.get(key) for key in ("Number of Points", "Number of Images", "RMS of Image coords")
    )
    errors = camera.errors
    std = {
        "fx": errors["C"] / pitch[0],
        "fy": errors["C"] / pitch[1],
        "cx": errors["XP"] / pitch[0],
        "cy": errors["YP"] / pitch[1],
    }
    return Quality(
        rms_px=None if rms_um is None else rms_um * 1e-3 / pitch[0],
        points=None if points is None else round(points),
        views=None if views is None else round(views),
        std={name: value for name, value in std.items() if value > 0},
    )


def _scale(calibration: Calibration) -> tuple[float, float]:
    """Focal length and width of a pixel in mm: as read, else by the nominal focal length, else in units of it."""
    K = calibration.intrinsics
    for key, value in calibration.extras:
        if key == PIXEL:
            pixel = strict.number(value)
            return K.fx * pixel, pixel
    focal = calibration.camera.focal_mm or 1.0
    return focal, focal / K.fx


FORMAT = Format(
    name="australis_report",
    title="Australis camera calibration report",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://stereopipeline.readthedocs.io/en/latest/pinholemodels.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, Australis)),
    states=("date",),
)
