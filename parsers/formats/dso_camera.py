"""DSO's ``camera.txt``, which LSD-SLAM and the TUM monoVO, 4Seasons and VI datasets' tools share.

In the format's own words::

    RadTan 458.654 457.296 367.215 248.375 -0.2834 0.0740 0.00019 0.00002
    752 480                 # the images
    crop                    # full, none, or "fx fy cx cy 0": the rectified camera that DSO is to make
    640 480                 # its images

The models are Pinhole, FOV (omega after K) and RadTan, EquiDistant, KannalaBrandt with four coefficients each; without
a name five numbers are FOV, or Pinhole where the last is 0, and eight are RadTan. RadTan is OpenCV's k1 k2 p1 p2,
EquiDistant and KannalaBrandt are cv2.fisheye's. Where cx and cy are below 1, all of K is in fractions of the sides,
and the principal point counts from the corner of the first pixel: DSO takes half a pixel off. Else the numbers are
K itself.

Source: DSO, README.md "Geometric Calibration File" and ``src/util/Undistort.cpp``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, FieldOfView, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Unit
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.formats._text_rows import text_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2"),
    remarks=(
        "EquiDistant's and KannalaBrandt's four are cv2.fisheye's k1, k2, k3, k4",
        "where cx and cy are below 1, K is in fractions of each side, from the outer corner of the top-left pixel",
    ),
)
RELATIVE = Convention(unit=Unit.EACH_SIDE, origin=Origin.CORNER)
# 4Seasons writes Equidistant, and eight numbers after Pinhole.
COUNTS = {"pinhole": (4, 5, 8), "fov": (5,), "radtan": (8,), "equidistant": (8,), "kannalabrandt": (8,)}
MODES = ("crop", "full", "none")
MAX_BYTES = 4096


def sniff(content: Content) -> Sniff | None:
    """Four lines: a camera, two numbers, the kind of rectification, two numbers."""
    if len(content.lines) != 4:
        return None
    rows = [line.split() for line in content.lines]
    named = rows[0][0].lower() in COUNTS
    sized = [_numeric(rows[1]), _numeric(rows[3])] == [2, 2]
    rectified = rows[2][0] in MODES or _numeric(rows[2]) in (4, 5)
    if sized and rectified and (named or _numeric(rows[0]) in (5, 8)):
        return Sniff(
            Sure.MAGIC, f"four lines as DSO reads them, the third is {strict.shown(content.lines[2])}"
        )
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The camera of the first two lines."""
    text = text_of(data, most=MAX_BYTES)
    # The last two lines are of the camera that DSO is to make; where they are there, nothing is missing above.
    rows = [row for line in text.splitlines() if (row := line.split())]
    if len(rows) < 3:
        raise ParseError(f"{len(rows)} lines, expected the camera, its image size and what to make")
    model, values = _camera(rows[0])
    size = strict.numbers(" ".join(rows[1]), count=2, place="line 2")
    fx, fy, cx, cy, *rest = values
    convention = RELATIVE if cx < 1 and cy < 1 else CONVENTION
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy)
    image_size = strict.image_size(*size, place="line 2")
    return [camera(context, convention, native, image_size, _lens(model, rest), tag=model)]


def _numeric(row: list[str]) -> int:
    """How many numbers a row has, 0 where it has anything else."""
    try:
        return len(strict.numbers(" ".join(row)))
    except ParseError:
        return 0


def _camera(row: list[str]) -> tuple[str, tuple[float, ...]]:
    """The model's name in lower case, and all its numbers."""
    if row[0][:1].isalpha():
        model, row = row[0], row[1:]
        if model.lower() not in COUNTS:
            refuse_model(model, tuple(COUNTS), place="line 1")
    else:
        model = "radtan" if len(row) == 8 else "fov"
    counts = COUNTS[model.lower()]
    return model.lower(), strict.numbers(" ".join(row), count=counts, place="line 1")


def _lens(model: str, values: list[float]) -> Distortion:
    if model == "fov":
        return FieldOfView(omega=values[0]) if values[0] else NoDistortion()
    if model == "radtan":
        return lens(values)
    if model != "pinhole":
        return fisheye(values)
    if any(values):
        raise ParseError("a Pinhole has no distortion, but there are numbers after K", place="line 1")
    return NoDistortion()


FORMAT = Format(
    name="dso_camera",
    title="DSO camera.txt (TUM monoVO, 4Seasons)",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/JakobEngel/dso",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
