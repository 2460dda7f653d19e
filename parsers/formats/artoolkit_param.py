"""ARToolKit's ``camera_para.dat``: the camera of ARToolKit 5 and artoolkitX, as big-endian binary numbers.

In the format's own words::

    int32 xsize, ysize
    double mat[3][4]                      fx/s  0  cx  0 …   of the undistorted image
    double dist_factor[9]                 version 4: k1 k2 p1 p2 fx fy cx cy s
    double dist_factor[17]                version 5: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 fx fy cx cy s

The distortion is OpenCV's: x = (u − cx)·s/fx of an undistorted pixel, whose image is fx·x'(x, y) + cx. So K has
dist_factor's fx, fy, cx, cy. The version is told by the length. Versions 1 to 3 have a polynomial of their own with
four to six numbers, and are refused.

Source: artoolkitX, ``AR/paramDistortion.c``, ``arParamIdeal2Observ``; ``paramFile.c``.
"""

from __future__ import annotations

import math
import struct

from calibrary.calibration import Calibration
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._opencv_lens import lens

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    remarks=("fx, fy, cx and cy of K are in dist_factor, and the matrix is that of the undistorted image",),
)
HEAD = ">2i12d"
FACTORS = {4: (1, 2), 6: (3,), 9: (4,), 17: (5,)}
"""Versions by the count of dist_factor."""
LENGTHS = {struct.calcsize(f"{HEAD}{count}d"): count for count in FACTORS}
AGREEMENT = 1e-3


def sniff(content: Content) -> Sniff | None:
    """A length of a version, two small numbers, and the last row of a projection."""
    data = content.data
    if len(data) not in LENGTHS or data[:2] != b"\0\0" or data[4:6] != b"\0\0":
        return None
    numbers = struct.unpack_from(HEAD, data)
    if numbers[2 + 8 : 2 + 11] != (0.0, 0.0, 1.0) or not (numbers[0] > 0 and numbers[1] > 0):
        return None
    return Sniff(Sure.MAGIC, f"{len(data)} bytes with a size and a 3×4 matrix, big-endian")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    if len(data) not in LENGTHS:
        raise ParseError(f"{len(data)} bytes, expected {' or '.join(map(str, LENGTHS))}")
    count = LENGTHS[len(data)]
    width, height, *numbers = struct.unpack(f"{HEAD}{count}d", data)
    if not all(map(math.isfinite, numbers)):
        raise ParseError("a number is not finite")
    if count < 9:
        raise UnsupportedModelError(
            "it is of ARToolKit before version 5, whose distortion is a polynomial in px that has no counterpart here; "
            "calibrate again with artoolkitX's calib_camera"
        )
    matrix, factor = numbers[:12], numbers[12:]
    fx, fy, cx, cy, s = factor[-5:]
    if not (fx > 0 and fy > 0 and s > 0):
        raise ParseError(
            f"fx {fx:g}, fy {fy:g} and s {s:g}, expected numbers above zero", place="dist_factor"
        )
    if abs(matrix[0] * s - fx) > AGREEMENT * fx or abs(matrix[5] * s - fy) > AGREEMENT * fy:
        raise ParseError(
            f"the matrix has {matrix[0]:g} and {matrix[5]:g}, and fx/s and fy/s are {fx / s:g} and {fy / s:g}",
            place="mat",
        )
    size = strict.image_size(width, height)
    return [camera(context, CONVENTION, Native(fx=fx, fy=fy, cx=cx, cy=cy), size, lens(factor[:-5]))]


FORMAT = Format(
    name="artoolkit_param",
    title="ARToolKit 5 and artoolkitX camera_para.dat",
    suffixes=(".dat",),
    syntaxes=(Syntax.BINARY,),
    reference="https://github.com/artoolkitx/artoolkitx",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
