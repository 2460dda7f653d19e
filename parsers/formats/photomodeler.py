"""PhotoModeler: its camera model, its status report and its text export."""

from __future__ import annotations

import re
from collections.abc import Mapping

from msgspec import Struct, field

from calibrary.calibration import Calibration, ImageSize, Intrinsics, Quality
from calibrary.distortion import Distortion, InverseBrown, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Direction, Native, Origin, Tangential, Unit
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._metric_lens import normalised
from calibrary.parsers.formats._text_rows import rows_of

LENS = ("K1", "K2", "K3", "P1", "P2")
PARAMETERS = ("F", "Xp", "Yp", "Fw", "Fh", *LENS)

CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.CORNER,
    direction=Direction.DISTORTED_TO_UNDISTORTED,
    tangential=Tangential.SWAPPED,
    coefficients=LENS,
    remarks=("Xp and Yp count y down, the lens terms count it up",),
)


def optics(values: Mapping[str, float], size: ImageSize, *, source: str) -> tuple[Intrinsics, Distortion]:
    """K and distortion from the ten parameters.

    Raises:
        ParseError: the parameters are not a valid camera.
    """
    focal, width, height = values["F"], values["Fw"], values["Fh"]
    if not (width > 0 and height > 0):
        raise ParseError(f"the format is {width:g}×{height:g} mm, expected a positive one", source=source)
    native = Native(fx=focal, fy=focal, cx=values["Xp"], cy=values["Yp"])
    K = CONVENTION.intrinsics(native, size, sensor_mm=(width, height), source=source)
    if not any(values[key] for key in LENS):
        return K, NoDistortion()
    k1, k2, k3 = normalised([values[key] for key in ("K1", "K2", "K3")], focal)
    # y points up here, so P2, which corresponds to OpenCV's p1, changes its sign.
    return K, InverseBrown(k1=k1, k2=k2, k3=k3, p1=-values["P2"] * focal, p2=values["P1"] * focal)


REPORT_MAX_BYTES = 2 * 1024 * 1024
"""Every photo has its own lines; this is some three thousand."""

REPORT_TITLE = "Status Report Tree"
SECTION = "Camera Calibration Standard Deviations"
NEXT_SECTIONS = ("Photograph Standard Deviations", "Point Standard Deviations", "Quality")
NAMES = {"Focal Length": "F"} | {name: name for name in PARAMETERS[1:]}
"""What a parameter's heading begins with."""

_CAMERA = re.compile(r"Camera\d+\s*:\s*(.*)")
_HEADING = re.compile(rf"({'|'.join(NAMES)})\b")
_VALUE = re.compile(r"Value\s*:\s*(\S+)")
_DEVIATION = re.compile(r"Deviation\s*:.*:\s*(\S+)")
_RMS = re.compile(r"Overall RMS\s*:\s*(\S+)\s+pixels")
_PROCESSED = re.compile(r"Last Processing Attempt\s*:\s*(\S.{0,60})")
_VERSION = re.compile(r"Version\s*:\s*(PhotoModeler\b.{0,80})")
_ORIENTED = re.compile(r"Number Oriented\s*:\s*(\S+)")


class _Camera(Struct):
    """One camera's values and deviations by parameter."""

    name: str
    place: str
    values: dict[str, float] = field(default_factory=dict)
    deviations: dict[str, float] = field(default_factory=dict)


class _Report(Struct):
    """What is taken from a report."""

    cameras: list[_Camera] = field(default_factory=list)
    rms_px: float | None = None
    views: int | None = None
    date: str | None = None
    tool: str | None = None


def sniff_report(content: Content) -> Sniff | None:
    """The title says what it is."""
    if content.first_line == REPORT_TITLE:
        return Sniff(Sure.MAGIC, f"the first line is '{REPORT_TITLE}'")
    return None


def read_report(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that was calibrated, in order; their size comes from the caller."""
    report = _taken_apart(data)
    if not report.cameras:
        raise ParseError(
            f"there is no camera under '{SECTION}': the project was processed without calibration; export the "
            "camera, or report a project that calibrates it"
        )
    several = len(report.cameras) > 1
    found: list[Calibration] = []
    for camera in report.cameras:
        missing = [name for name in PARAMETERS if name not in camera.values]
        if missing:
            raise ParseError(f"it lacks {', '.join(missing)}", place=camera.place)
        size = context.size(None)
        intrinsics, distortion = optics(camera.values, size, source=context.name)
        found.append(
            context.calibration(
                intrinsics,
                distortion,
                name=camera.name if several else None,
                tag=camera.name or None,
                date=report.date,
                tool=report.tool,
                quality=_quality(report, camera, size),
            )
        )
    return found


def _taken_apart(data: bytes) -> _Report:
    """The cameras of the calibration section, and four facts about the processing."""
    rows = rows_of(data, most=REPORT_MAX_BYTES)
    if not any(row.strip() == REPORT_TITLE for row in rows[:10]):
        raise ParseError(f"there is no line '{REPORT_TITLE}'")
    report = _Report()
    inside, parameter = False, ""
    for index, row in enumerate(rows, start=1):
        line = row.strip()
        if not line:
            continue
        place = f"line {index}"
        if line == SECTION:
            inside = True
        elif line in NEXT_SECTIONS:
            inside = False
        elif not inside:
            _take_fact(report, line, place=place)
        elif found := _CAMERA.fullmatch(line):
            report.cameras.append(_Camera(found.group(1).strip(), place))
        elif found := _HEADING.match(line):
            parameter = NAMES[found.group(1)]
        elif parameter and report.cameras:
            _take_number(report.cameras[-1], parameter, line, place=place)
    return report


def _take_number(camera: _Camera, parameter: str, line: str, *, place: str) -> None:
    """A value or a deviation; correlations are passed over."""
    for pattern, table in ((_VALUE, camera.values), (_DEVIATION, camera.deviations)):
        if found := pattern.match(line):
            if parameter in table:
                raise ParseError(f"{parameter} is a duplicate key", place=place)
            table[parameter] = strict.number(found.group(1), place=place)


def _take_fact(report: _Report, line: str, *, place: str) -> None:
    if report.rms_px is None and (found := _RMS.match(line)):
        report.rms_px = strict.number(found.group(1), place=place)
    elif report.date is None and (found := _PROCESSED.fullmatch(line)):
        report.date = found.group(1)
    elif report.tool is None and (found := _VERSION.fullmatch(line)):
        report.tool = found.group(1)
    elif report.views is None and (found := _ORIENTED.match(line)):
        report.views = strict.whole(found.group(1), place=place)


def _quality(report: _Report, camera: _Camera, size: ImageSize) -> Quality:
    across, down = size[0] / camera.values["Fw"], size[1] / camera.values["Fh"]
    scales = {"fx": ("F", across), "fy": ("F", down), "cx": ("Xp", across), "cy": ("Yp", down)}
    return Quality(
        rms_px=report.rms_px,
        views=report.views,
        std={
            name: camera.deviations[parameter] * scale
            for name, (parameter, scale) in scales.items()
            if parameter in camera.deviations
        },
    )


REPORT = Format(
    name="photomodeler_report",
    title="PhotoModeler status report",
    words="""\
PhotoModeler's status report, after a project that calibrated its camera.

In the format's own words, indented, among much else::

    Status Report Tree
       Information from most recent processing
          Last Processing Attempt: Fri Oct 06 15:18:09 2017
          Version: PhotoModeler UAS 2017.1.1.2199 (64-bit)
          Precisions / Standard Deviations
             Camera Calibration Standard Deviations
                Camera1: NAME [8.02]
                   Focal Length
                        Value: 8.760240 mm
                        Deviation: Focal: 0.004 mm
                   Xp - principal point x        (and Yp, Fw, Fh, K1, K2, K3, P1, P2, likewise)
             Photograph Standard Deviations
       Quality
          Photographs
             Number Oriented: 21
          Point Marking Residuals
             Overall RMS: 0.229 pixels

A parameter that was held fixed has no deviation. The size of the image is not in the report.

Sources: PhotoModeler help, "Project status report" and "Lens distortion formulation".
""",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://www.photomodeler.com",
    convention=CONVENTION,
    sniff=sniff_report,
    read=read_report,
    needs_image_size=True,
    states=("date", "tool"),
)


EXPORT_MAX_BYTES = 16 * 1024 * 1024
"""Some thirty thousand images."""

EXPORT_TITLE = "Bundle Soln PhotoModeler"
HEAD = 5
PHOTO = 6
"""Lines of the head, and of each photo, its empty one counted."""

ROUNDED = 0.00051
"""How far a photo's own camera, with three decimals, may lie from the same one with four."""

NOTE = (
    "an export contains the lens terms with five decimals only, which is too few for K2 and K3; the status report "
    "of the same project has them all"
)

Camera = tuple[float, ...]
"""The ten parameters, in the file's order."""


def sniff_export(content: Content) -> Sniff | None:
    """The first line says what it is."""
    if content.first_line.startswith(EXPORT_TITLE):
        return Sniff(Sure.MAGIC, f"the first line begins with '{EXPORT_TITLE}'")
    return None


def read_export(data: bytes, context: ReadContext) -> list[Calibration]:
    """The project's camera, or its photos' cameras where they are not all that one."""
    rows = rows_of(data, most=context.at_most(EXPORT_MAX_BYTES))
    if not rows or not rows[0].strip().startswith(EXPORT_TITLE) or len(rows) < HEAD:
        raise ParseError(f"this is not a head of {HEAD} lines that begins with '{EXPORT_TITLE}'")
    fields = strict.numbers(rows[1], count=4, place="line 2")
    size = context.size(strict.image_size(fields[2], fields[3], place="line 2"))
    project = _camera(rows[3], "line 4")
    photos = _photos(rows)
    if all(_agree(camera, project) for camera in photos):
        return [_calibration(project, size, context, name=None)]
    return [_calibration(camera, size, context, name=name) for camera, name in photos.items()]


def _photos(rows: tuple[str, ...]) -> dict[Camera, str]:
    """Every different camera of the photos, with the name of the first photo that has it."""
    found: dict[Camera, str] = {}
    for start in range(HEAD, len(rows) - PHOTO + 1, PHOTO):
        number, _, name = rows[start].strip().partition(" ")
        # The points follow the photos; theirs is not a line of a number and a name.
        if not number.isdigit() or not name or rows[start + 3].strip():
            break
        camera = _camera(rows[start + 4], f"line {start + 5}", numbered=True)
        found.setdefault(camera, name.strip())
    return found


def _camera(row: str, place: str, *, numbered: bool = False) -> Camera:
    """The ten parameters of a line, behind a photo's number where it has one."""
    values = strict.numbers(row, count=len(PARAMETERS) + numbered, place=place)
    return values[1:] if numbered else values


def _agree(photo: Camera, project: Camera) -> bool:
    return all(abs(a - b) <= ROUNDED for a, b in zip(photo[:3], project[:3], strict=True)) and (
        photo[3:] == project[3:]
    )


def _calibration(camera: Camera, size: ImageSize, context: ReadContext, *, name: str | None) -> Calibration:
    values = dict(zip(PARAMETERS, camera, strict=True))
    intrinsics, distortion = optics(values, size, source=context.name)
    return context.calibration(intrinsics, distortion, name=name, tag=name, notes=(NOTE,))


EXPORT = Format(
    name="photomodeler_export",
    title="PhotoModeler text export",
    words="""\
PhotoModeler's text export of a project ("Bundle Soln").

In the format's own words, by lines::

    Bundle Soln PhotoModeler Calibration Project
     0.000500 20 5472 3648                      …, iterations, image width and height
     1.00000  0.10000 10.00000 …                …
     8.7602  6.5791  4.3582 13.13280 8.75520 0.00498 -0.00010 0.00000 -0.00006 -0.00004
     0.00000  0.00725 …                         deviations
       0 photos/P8250021.JPG                    then six lines for each photo: its name, its place, the
       0 0.455 1.794 …                          deviations of that, an empty line, its own camera, and the
                                                deviations of that

A camera is F Xp Yp Fw Fh K1 K2 K3 P1 P2. The lens terms have five decimals, which is too few for most K2 and K3: the
status report of the same project has all their digits. A photo's own camera has three decimals less and is used only
where it contradicts the project's.

Sources: the DBAT toolbox' ``loadpm.m``; PhotoModeler help, "Lens distortion formulation".
""",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/niclasborlin/dbat",
    convention=CONVENTION,
    sniff=sniff_export,
    read=read_export,
)

FORMATS = (
    REPORT,
    EXPORT,
)
