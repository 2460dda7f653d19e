"""What moved where K drifted: the focus, the principal point or the lens, by which of them explains the pixels."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.projection_difference import GRID, projection_difference
from calibrary.errors import CalibraryError
from calibrary.jobs.diff.lens_rays import axial, pinholes
from calibrary.jobs.diff.numbers import Numbers
from calibrary.jobs.diff.wording import percent, pixels
from calibrary.records import replace

__all__ = ["what_moved"]

LEFT: Final = 0.25
"""A part of K explains the difference if at most this fraction of it is left once that part is taken over."""


def what_moved(numbers: Numbers) -> str | None:
    """Name the part of K that explains the difference; None if several moved, or the distortion did.

    A focus or a temperature changes both focal lengths by one factor. The principal point moves alone if the lens
    or the sensor shifted.
    """
    a, b = (numbers.a, numbers.b) if numbers.lens_compared else pinholes(numbers.a, numbers.b)
    before, after = axial(a), axial(b)
    by = math.sqrt(after.fx / before.fx * (after.fy / before.fy))
    dx, dy = after.cx - before.cx, after.cy - before.cy
    weights: FloatArray = np.ones(GRID[::-1])
    for factor, shift, reason in (
        (
            by,
            (0.0, 0.0),
            f"the focal length alone moved ({percent(by - 1)}), and the lens bends as before: another focus or "
            "zoom, or another temperature",
        ),
        (
            1.0,
            (dx, dy),
            f"the principal point alone moved, by {pixels(math.hypot(dx, dy))}: the sensor or a lens "
            "element shifted, or an image was cut",
        ),
        (by, (dx, dy), "focal length and principal point moved, and the lens bends as before"),
    ):
        K = a.intrinsics
        moved = replace(
            K,
            fx=K.fx * factor,
            fy=K.fy * factor,
            skew=K.skew * factor,
            cx=K.cx + shift[0],
            cy=K.cy + shift[1],
        )
        try:
            left = projection_difference(replace(a, intrinsics=moved), b, weights=weights)
        except CalibraryError:
            continue
        if left.rms_px <= LEFT * numbers.difference.rms_px:
            return reason
    return None
