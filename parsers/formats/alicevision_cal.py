"""AliceVision's (POPART's) ``.cal``: eight bare numbers of a camera.

In the format's own words::

    W H f ppx ppy k1 k2 k3

separated by white space. ``f`` is the mean of fx and fy. The principal point is that of OpenCV's matrix, unchanged. The
program that writes the file omits the two tangential coefficients of OpenCV's five. Nothing in the file identifies it,
so it is read in this format only if no other format recognises it.

(Meshroom's CameraCalibration node writes OpenCV's own storage format under the same ending.)

Source: AliceVision, ``dataio/IFeed.cpp``, readCalibrationFromFile, and the calibration's ``exportData``.
"""

from __future__ import annotations

import re

from calibrary.calibration import Calibration, Origin
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._text_rows import text_of

COUNT = 8
CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    coefficients=("k1", "k2", "k3"),
    remarks=("one focal length, the mean of fx and fy",),
)
LONGEST = 2000
NOTE = "the format omits tangential terms and the difference of fx and fy"

_WHOLE = re.compile(r"\d{1,7}(?:\.0*)?", re.ASCII)
_NUMBER = re.compile(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?", re.ASCII)


def sniff(content: Content) -> Sniff | None:
    """Eight numbers, the first two of them whole."""
    if len(content.data) > LONGEST or content.text is None:
        return None
    parts = content.text.split()
    if len(parts) != COUNT or not all(_NUMBER.fullmatch(part) for part in parts):
        return None
    if not all(_WHOLE.fullmatch(part) for part in parts[:2]):
        return None
    return Sniff(Sure.WEAK, "it is eight numbers, of which the first two could be an image size")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    rows = strict.lines(text_of(data, most=LONGEST))
    width, height, f, cx, cy, k1, k2, k3 = strict.numbers(" ".join(rows), count=COUNT)
    size = context.size(strict.image_size(width, height))
    K = CONVENTION.intrinsics(Native(fx=f, fy=f, cx=cx, cy=cy), size)
    if not (0 <= K.cx <= width and 0 <= K.cy <= height):
        raise ParseError(
            f"the principal point ({cx:g}, {cy:g}) lies outside the {size[0]}×{size[1]} image, so these are not the "
            "eight numbers W H f ppx ppy k1 k2 k3"
        )
    lens: Distortion = NoDistortion()
    if k1 or k2 or k3:
        lens = BrownConrady(k1=k1, k2=k2, p1=0.0, p2=0.0, k3=k3)
    return [context.calibration(K, lens, notes=(NOTE,))]


FORMAT = Format(
    name="alicevision_cal",
    title="AliceVision (POPART) calibration of eight numbers",
    suffixes=(".cal", ".txt"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/alicevision/AliceVision",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
