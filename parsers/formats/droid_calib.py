"""DROID-SLAM's calibration, one line of numbers, which DPVO, MASt3R-SLAM's kin and many scripts read as well.

In the format's own words (``calib/tum3.txt``, ``calib/barn.txt``, ``calib/euroc.txt``)::

    535.4 539.2 320.1 247.6
    458.654 457.296 367.215 248.375 -0.28340811 0.07395907 0.00019359 1.76187114e-05

They are fx, fy, cx, cy, followed by any coefficients that ``cv2.undistort`` takes: k1 k2 p1 p2, k3, and k4 k5 k6. The
program scales K with the images, so the file does not state their size.

Source: DROID-SLAM, ``demo.py``, ``image_stream``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._opencv_lens import COUNTS, lens
from calibrary.parsers.formats._text_rows import rows_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    remarks=("one line: fx, fy, cx, cy and the coefficients",),
)
MOST = 4096
LENGTHS = tuple(4 + count for count in COUNTS)
SMALLEST = 32.0
"""px; a shorter focal length, or a principal point nearer the corner, is of no photograph."""
SHARE = 1 / 3


def sniff(content: Content) -> Sniff | None:
    """Nothing but one line of numbers, the first four of which could be a K in pixels."""
    if len(content.lines) != 1:
        return None
    try:
        fx, fy, cx, cy, *_ = strict.numbers(content.first_line, count=LENGTHS)
    except ParseError:
        return None
    if min(fx, fy, cx, cy) < SMALLEST or abs(fx - fy) > SHARE * fx:
        return None
    return Sniff(
        Sure.WEAK, f"one line of {len(content.first_line.split())} numbers, as fx fy cx cy and coefficients"
    )


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    rows = [row for row in rows_of(data, most=MOST) if row.strip()]
    if len(rows) != 1:
        raise ParseError(f"{len(rows)} lines of numbers, expected one")
    fx, fy, cx, cy, *rest = strict.numbers(rows[0], count=LENGTHS)
    return [camera(context, CONVENTION, Native(fx=fx, fy=fy, cx=cx, cy=cy), None, lens(rest))]


FORMAT = Format(
    name="droid_calib",
    title="DROID-SLAM calibration (fx fy cx cy …)",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/princeton-vl/DROID-SLAM",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
)
