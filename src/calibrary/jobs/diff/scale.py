"""Detection of a K for another image size, and of radial coefficients in another unit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, Literal

from calibrary.calibration import Calibration
from calibrary.jobs.diff.origin import K_NAMES, is_same
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.jobs.diff.wording import frame_size, listed

__all__ = ["of_scale"]

ONE_RATIO: Final = 1e-3
"""Relative tolerance at which the ratios of fx, fy, cx and cy count as one common factor."""
OTHER_RATIO: Final = 0.02
"""Relative difference between that factor and the ratio of the image sizes above which K was not scaled with them."""
OFF_CENTRE: Final = 0.05
"""Fraction of a side: a principal point farther from the image centre belongs to another image size."""

ONE_UNIT: Final = 0.01
"""Relative tolerance at which the ratios of k1, k2 and k3 count as powers of one factor."""
LEAST_FACTOR: Final = 2.0
NEAR_FOCAL_MM: Final = 0.05
"""Relative tolerance between the nominal and the calibrated focal length in mm."""
POWERS: Final = {"k1": 2, "k2": 4, "k3": 6}


def of_scale(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """Structural changes where the numbers of one calibration refer to another image size or unit."""
    yield from _of_another_size(a, b)
    yield from _of_another_unit(a, b)


def _of_another_size(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """All four numbers of K changed by one factor, not that of the image sizes; a crop would move the centre."""
    before, after = a.intrinsics, b.intrinsics
    if not all(getattr(before, name) > 0 and getattr(after, name) > 0 for name in K_NAMES):
        return
    ratios = [getattr(after, name) / getattr(before, name) for name in K_NAMES]
    frames = [now / was for was, now in zip(before.image_size, after.image_size, strict=True)]
    follows = all(abs(ratios[0] / frame - 1) <= OTHER_RATIO for frame in frames)
    if follows or max(ratios) / min(ratios) - 1 > ONE_RATIO:
        return
    off = [_off_centre(one) for one in (a, b)]
    if not min(off) <= OFF_CENTRE < max(off):
        return
    faulty: Literal["A", "B"] = "B" if off[1] > off[0] else "A"
    wrong, other, factor = (b, "A", ratios[0]) if faulty == "B" else (a, "B", 1 / ratios[0])
    K = wrong.intrinsics
    same = "the very numbers" if abs(factor - 1) <= ONE_RATIO else f"{factor:.4g} times the numbers"
    size = frame_size(K.image_size)
    yield Structural(
        kind=Kind.OTHER_SIZE,
        reason=f"fx, fy, cx and cy of {faulty} are {same} of {other}, and its principal point ({K.cx:.0f}, "
        f"{K.cy:.0f}) is not near the middle of its {size} frame: K counts in an image of another size",
        faulty=faulty,
    )


def _off_centre(calibration: Calibration) -> float:
    K = calibration.intrinsics
    return max(abs(K.cx / K.image_size[0] - 0.5), abs(K.cy / K.image_size[1] - 0.5))


def _of_another_unit(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """Radial coefficients for radii in pixels or millimetres instead of in focal lengths."""
    if a.distortion is None or b.distortion is None or type(a.distortion) is not type(b.distortion):
        return
    if not all(is_same(getattr(a.intrinsics, name), getattr(b.intrinsics, name)) for name in ("fx", "fy")):
        return
    one, two = a.distortion.coefficients, b.distortion.coefficients
    names = [name for name in POWERS if one.get(name) and two.get(name)]
    ratios = [one[name] / two[name] for name in names]
    if len(names) < 2 or min(ratios) <= 0:
        return
    factors = [ratio ** (1 / POWERS[name]) for name, ratio in zip(names, ratios, strict=True)]
    factor = factors[0]
    if max(factors) / min(factors) - 1 > ONE_UNIT or 1 / LEAST_FACTOR < factor < LEAST_FACTOR:
        return
    faulty: Literal["A", "B"] = "B" if factor > 1 else "A"
    other = "A" if faulty == "B" else "B"
    by = max(factor, 1 / factor)
    divisors = listed([f"{by:.5g}^{POWERS[name]}" for name in names])
    yield Structural(
        kind=Kind.OTHER_UNIT,
        reason=f"{listed(names)} of {faulty} are those of {other} divided by {divisors}{_unit(a, b, by)}: they are for "
        "lengths in another unit than the focal length",
        faulty=faulty,
    )


def _unit(a: Calibration, b: Calibration, by: float) -> str:
    if abs(by / a.intrinsics.fx - 1) <= ONE_UNIT:
        return ", the focal length in pixels"
    focals = [one.camera.focal_mm for one in (a, b) if one.camera.focal_mm]
    if any(math.isclose(by, focal, rel_tol=NEAR_FOCAL_MM) for focal in focals):
        return ", about the focal length in millimetres"
    return ""
