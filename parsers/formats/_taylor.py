"""Shared by OCamCalib and Kimera-VIO's omni cameras: the ray as a polynomial of the radius in px."""

from __future__ import annotations

import math
from collections.abc import Sequence

from calibrary.distortion.scaramuzza import Scaramuzza
from calibrary.errors import ParseError, UnsupportedModelError

MOST_READ = 5
LONGEST_PX = 1e9
"""Largest focal length, far above any camera's, whose cube is still a number."""


def taylor_lens(a: Sequence[float], *, place: str) -> tuple[Scaramuzza, float]:
    """The lens of the ray (x, y, a0 + a1·ρ + a2·ρ² + …) with an axis that points forwards, and its focal length in px.

    Raises:
        ParseError: there are no coefficients, or a0 is no focal length.
        UnsupportedModelError: there is a linear term, or one above the fourth power.
    """
    if not a:
        raise ParseError("there are no coefficients, expected up to 5", place=place)
    a0, a1, a2, a3, a4 = (*a, 0.0, 0.0, 0.0, 0.0)[:MOST_READ]
    if not 0 < a0 < LONGEST_PX:
        raise ParseError(
            f"the constant term is {a0:g}, expected a focal length above zero in px", place=place
        )
    if a1 or any(a[MOST_READ:]):
        raise UnsupportedModelError(
            "it has a linear term or terms above the fourth power, which are not known here; calibrate with a "
            "polynomial of order 4, the toolbox's own proposal, or with OpenCV's fisheye model",
            place=place,
        )
    return Scaramuzza(c2=a2 * a0, c3=a3 * a0**2, c4=a4 * a0**3), a0


def upper_triangle(
    f: float, c: float, d: float, e: float, *, place: str
) -> tuple[float, float, float, float]:
    """fx, skew, fy and the angle of the rotation Q in f·(1 e; d c) = (fx skew; 0 fy)·Q.

    Raises:
        ParseError: the matrix is singular or mirrored.
    """
    length = math.hypot(d, c)
    determinant = c - d * e
    if not (length > 0 and determinant > 0):
        raise ParseError("the affine parameters make no image", place=place)
    sine, cosine = d / length, c / length
    return f * determinant / length, f * (sine + e * cosine), f * length, math.atan2(sine, cosine)
