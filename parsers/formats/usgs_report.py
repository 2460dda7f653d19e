"""The U.S. Geological Survey's report of calibration of an aerial mapping camera, as text.

In the report's own words, anywhere on the page::

    REPORT OF CALIBRATION   May 11, 2004
    of Aerial Mapping Camera
    Camera type: Wild RC30          Lens type: Wild Universal Aviogon /4-S
    I. Calibrated Focal Length: 153.247 mm
    K0 = 0.3285 x 10-4   P1 = -0.1218 x 10-7   xp = 0.006 mm
    K1 … K4              P2 … P4               yp = -0.001 mm

with x and y in mm from the calibrated principal point, y up, and r² = x² + y², the corrected point is::

    x·(1 + K0 + K1·r² + K2·r⁴ + K3·r⁶ + K4·r⁸) + (P1·(r² + 2x²) + 2·P2·x·y)·(1 + P3·r² + P4·r⁴)
    y·(1 + K0 + K1·r² + K2·r⁴ + K3·r⁶ + K4·r⁸) + (P2·(r² + 2y²) + 2·P1·x·y)·(1 + P3·r² + P4·r⁴)

K0 is a scale and joins the focal length: CFL / (1 + K0). The report is of a film camera, so it has no pixels. It gives
a K for scans that were resampled to the fiducial marks, upright, with the centre of the marks in the middle of the
image. You have to state their pixel size.

Source: the reports themselves (method of Simultaneous Multiframe Analytical Calibration); the radial distortion
they tabulate is the correction above with its sign turned.
"""

from __future__ import annotations

import re

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.distortion import Distortion, InverseBrown, InversePolynomial, exact
from calibrary.errors import MissingTagError, ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Direction, Native, Origin, Tangential, Unit, YAxis
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._metric_lens import normalised
from calibrary.parsers.formats._text_rows import text_of

RADIAL = ("K0", "K1", "K2", "K3", "K4")
DECENTRING = ("P1", "P2", "P3", "P4")
CONVENTION = Convention(
    unit=Unit.MILLIMETRE,
    origin=Origin.IMAGE_CENTRE,
    y_axis=YAxis.UP,
    direction=Direction.DISTORTED_TO_UNDISTORTED,
    tangential=Tangential.SWAPPED,
    coefficients=(*RADIAL, *DECENTRING),
    remarks=("the focal length is CFL / (1 + K0)", "the tangential terms grow by 1 + P3·r² + P4·r⁴"),
)
SCAN_UM = Option(
    name="scan_um",
    values=("5", "6", "7", "7.5", "8", "10", "12", "12.5", "14", "15", "16", "20", "21", "22.5", "24", "25", "28",
            "30", "32", "35", "40", "42", "42.3", "50", "64", "84", "84.7", "100", "127"),
    meaning="size of a pixel, in micrometres, of the scans that were resampled to the fiducial marks",
)  # fmt: skip
ASSUMPTION = (
    "the scan is upright, resampled to the fiducial marks, their centre in the middle of the image; its pixels "
    "are {} µm"
)

LABORATORY = "U.S. Geological Survey"
"""Every such report is of its Optical Science Laboratory."""

_MONTHS = "(?:January|February|March|April|May|June|July|August|September|October|November|December)"
_TIDY = str.maketrans("−–—×⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "---x0123456789-")
# Spaces are counted and words are bounded, so that a long line of either costs no more than its length.
_FOCAL = re.compile(
    r"Calibrated\s{1,20}Focal\s{1,20}Length\s{0,20}:?\s{0,20}(\S{1,60})\s{0,20}mm", re.IGNORECASE
)
_POINT = re.compile(r"\b([xy]p)\s{0,20}=\s{0,20}(\S{1,60})\s{0,20}mm")
# A zero is often read as a letter.
_TERM = re.compile(
    r"\b([KP])\s?([0-4oO])\s{0,20}=\s{0,20}([-+]?[\d.]{1,60}(?:[eE][-+]?\d{1,4})?)"
    r"(?:\s{0,20}x\s{0,20}10[\s^*]{0,20}([-+]?\s?\d{1,4}))?"
)
_CAMERA = re.compile(r"Camera type\s{0,20}:\s{0,20}(\S[^\n]{0,120}?)\s*(?:Camera serial|\n)", re.IGNORECASE)
_LENS = re.compile(r"Lens type\s{0,20}:\s{0,20}(\S[^\n]{0,120}?)\s*(?:Lens serial|\n)", re.IGNORECASE)


_DATE = re.compile(
    rf"REPORT OF CALIBRATION\s{{1,40}}({_MONTHS}\s{{1,5}}\d{{1,2}},?\s{{1,5}}\d{{4}})\b", re.IGNORECASE
)


def sniff(content: Content) -> Sniff | None:
    """The report's title and the focal length it is about."""
    text = content.text or ""
    if re.search(r"REPORT OF CALIBRATION", text) and "Mapping Camera" in text and _FOCAL.search(text):
        return Sniff(Sure.MAGIC, "it is a REPORT OF CALIBRATION of a Mapping Camera")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the report, for scans of the given pixel size."""
    text = text_of(data).translate(_TIDY)
    focal, values = _values(text)
    scale = 1.0 + values["K0"]
    if not scale > 0:
        raise ParseError(f"K0 is {values['K0']:g}, expected a small scale", place="K0")
    scan_um = context.option(SCAN_UM.name)
    if scan_um is None:
        raise MissingTagError(
            "the report is of a film camera and knows no pixels; say how large those of the scans are, once "
            "resampled to the fiducial marks, with --set scan_um=20"
        )
    size = context.size(None)
    pitch = strict.number(scan_um) / 1000
    native = Native(fx=focal / scale, fy=focal / scale, cx=values["xp"], cy=values["yp"])
    sensor = (size[0] * pitch, size[1] * pitch)
    return [
        Calibration(
            camera=CameraKey(
                model=_first_match(_CAMERA, text), lens=_first_match(_LENS, text), image_size=size
            ),
            intrinsics=CONVENTION.intrinsics(native, size, sensor_mm=sensor),
            distortion=_distortion(values, focal / scale, scale),
            grade=Grade.CALIBRATED,
            provenance=context.provenance(
                assumptions=(ASSUMPTION.format(scan_um),), date=_first_match(_DATE, text), operator=LABORATORY
            ),
        )
    ]


def _values(text: str) -> tuple[float, dict[str, float]]:
    """The calibrated focal length in mm, and the terms and the principal point by name."""
    found = _FOCAL.search(text)
    if found is None:
        raise ParseError("there is no 'Calibrated Focal Length: … mm'")
    focal = strict.number(found.group(1), place="Calibrated Focal Length")
    values: dict[str, float] = {}
    for letter, digit, mantissa, exponent in _TERM.findall(text):
        name = letter + ("0" if digit in "oO" else digit)
        _put(values, name, _scaled(mantissa, exponent, place=name))
    for name, number in _POINT.findall(text):
        _put(values, name, strict.number(number, place=name))
    missing = [name for name in (*RADIAL, *DECENTRING, "xp", "yp") if name not in values]
    if missing:
        raise ParseError(f"there is no {', '.join(missing)}")
    return focal, values


def _put(values: dict[str, float], name: str, value: float) -> None:
    """A value that a report may repeat, but not contradict."""
    if values.setdefault(name, value) != value:
        raise ParseError(f"it is {values[name]:g} and {value:g}", place=name)


def _scaled(mantissa: str, exponent: str, *, place: str) -> float:
    """A number as printed, "0.3285 x 10-4"."""
    power = exponent.replace(" ", "")
    if power and not power.startswith("-"):
        raise ParseError(
            f"it is {mantissa} x 10 to the {power}, which no lens has; the sign of the exponent may be lost",
            place=place,
        )
    return strict.number(f"{mantissa}e{power}" if power else mantissa, place=place)


def _distortion(values: dict[str, float], focal: float, scale: float) -> Distortion:
    """In units of the focal length that K has, which takes 1 + K0 out of every term."""
    k1, k2, k3, k4 = (k / scale for k in normalised([values[name] for name in RADIAL[1:]], focal))
    p1, p2 = CONVENTION.tangential_from_file(values["P1"] * focal / scale, values["P2"] * focal / scale)
    p3, p4 = normalised((values["P3"], values["P4"]), focal)
    wide = InversePolynomial(
        k1=k1, k2=k2, k3=k3, k4=k4, p1=p1, p2=p2, p3=p3, p4=p4, s1=0.0, s2=0.0, s3=0.0, s4=0.0
    )
    return exact(wide, InverseBrown) or wide


def _first_match(pattern: re.Pattern[str], text: str) -> str | None:
    match = pattern.search(text)
    return match.group(1) if match else None


FORMAT = Format(
    name="usgs_report",
    title="USGS report of calibration (aerial film camera)",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://www.usgs.gov",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    states=("date", "operator"),
    options=(SCAN_UM,),
)
