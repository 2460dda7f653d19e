"""PhotoModeler's status report, after a project that calibrated its camera.

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
"""

from __future__ import annotations

import re

from msgspec import Struct, field

from calibrary.calibration import Calibration, ImageSize, Quality
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _photomodeler
from calibrary.parsers.formats._photomodeler import PARAMETERS
from calibrary.parsers.formats._text_rows import rows_of

MAX_BYTES = 2 * 1024 * 1024
"""Every photo has its own lines; this is some three thousand."""

TITLE = "Status Report Tree"
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


def sniff(content: Content) -> Sniff | None:
    """The title says what it is."""
    if content.first_line == TITLE:
        return Sniff(Sure.MAGIC, f"the first line is '{TITLE}'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
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
        intrinsics, distortion = _photomodeler.optics(camera.values, size, source=context.name)
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
    rows = rows_of(data, most=MAX_BYTES)
    if not any(row.strip() == TITLE for row in rows[:10]):
        raise ParseError(f"there is no line '{TITLE}'")
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


FORMAT = Format(
    name="photomodeler_report",
    title="PhotoModeler status report",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://www.photomodeler.com",
    convention=_photomodeler.CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    states=("date", "tool"),
)
