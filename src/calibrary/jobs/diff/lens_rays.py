"""What a lens does by its rays: focal lengths on the axis, distortion at a place of the frame, one lens or two.

fx of a double sphere, of Mei's model or of a file with b1 is not the focal length on the axis, and equal coefficients
in two models are two lenses. Decisions about frames and lenses therefore look at rays, never at fx.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, Intrinsics
from calibrary.distortion import NoDistortion
from calibrary.jobs.diff.common_numbers import is_same
from calibrary.records import replace

STEP: Final = 1e-4
"""tan of the angle from the axis at which the focal lengths are taken; what the distortion adds is below 1e-8."""
STEEPEST: Final = math.cos(math.radians(70.0))
"""Directions farther from the axis are not compared with a pinhole, whose pixels run off to infinity there."""
MEASURABLE_PX: Final = 2.0
"""A lens that displaces the corners by less counts as free of distortion."""
ONE_LENS: Final = 0.3
"""Relative difference of the distortion at one angle below which both belong to one lens."""
INVERSE: Final = 0.3
"""What two maps one after the other leave of the distortion if one is the inverse of the other, as a fraction."""
SHARES: Final = np.array(
    [(x, y) for x in (0.0, 0.25, 0.5, 0.75, 1.0) for y in (0.0, 0.25, 0.5, 0.75, 1.0) if (x, y) != (0.5, 0.5)]
)
"""Places in the frame, as shares of its width and height."""


def axial(calibration: Calibration) -> Intrinsics:
    """K of the pinhole that has the same pixels as the lens near its axis; K itself if no ray there has a pixel."""
    K = calibration.intrinsics
    if calibration.distortion is None:
        return K
    rays = np.array([(STEP, 0, 1), (-STEP, 0, 1), (0, STEP, 1), (0, -STEP, 1), (0, 0, 1)], dtype=np.float64)
    right, left, down, up, (cx, cy) = calibration.project(rays)
    (fx, _), (skew, fy) = (right - left) / (2 * STEP), (down - up) / (2 * STEP)
    if not all(map(math.isfinite, (fx, fy, skew, cx, cy))) or min(fx, fy) <= 0:
        return K
    return replace(K, fx=float(fx), fy=float(fy), skew=float(skew), cx=float(cx), cy=float(cy))


def pinholes(a: Calibration, b: Calibration) -> tuple[Calibration, Calibration]:
    """Both without distortion, as far as K alone can be compared: by the focal lengths on the axis.

    K of a side that states no distortion may also be that of the other's file, whose distortion was left out.
    """
    K, other = a.intrinsics, b.intrinsics
    is_copy = is_same(K.fx, other.fx) and is_same(K.fy, other.fy)
    one, two = (K, other) if is_copy else (axial(a), axial(b))
    return replace(a, intrinsics=one, distortion=None), replace(b, intrinsics=two, distortion=None)


def bends_px(a: Calibration, b: Calibration) -> tuple[float, float] | None:
    """Largest displacement in px by each distortion, over the places of the frame at which both have a ray.

    Args:
        a: one.
        b: the other, of any image size.

    Returns:
        Those of a and b, each against the pinhole on its axis; None if there is no such place.
    """
    bends, known = [], []
    for calibration in (a, b):
        K = axial(calibration)
        seen = SHARES * np.array(K.image_size)
        rays = calibration.unproject(seen)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
        straight = np.column_stack([K.fx * x + K.skew * y + K.cx, K.fy * y + K.cy])
        bends.append(np.hypot(*(straight - seen).T))
        known.append(rays[:, 2] >= STEEPEST)
    both = np.logical_and(*known)
    if not both.any():
        return None
    one, two = (float(bend[both].max()) for bend in bends)
    return one, two


def is_one_lens(a: Calibration, b: Calibration, *, within: float = ONE_LENS) -> bool | None:
    """Whether both displace rays at one angle equally, as one lens does whatever the crop or the resampling.

    Args:
        a: one.
        b: the other, of any image size.
        within: relative difference of the distortion at one angle that counts as none.

    Returns:
        None if one of the distortions is unknown.
    """
    if a.distortion is None or b.distortion is None:
        return None
    furthest = min(_half_field(one) for one in (a, b))
    angles = np.linspace(0.2, 0.95, 6) * furthest
    around = np.arange(8) * (math.pi / 4)
    t, way = (grid.ravel() for grid in np.meshgrid(angles, around))
    rays = np.column_stack([np.sin(t) * np.cos(way), np.sin(t) * np.sin(way), np.cos(t)])
    sides = [_on_axis(one, rays) for one in (a, b)]
    apart = np.hypot(*(sides[1] - sides[0]).T)
    flat = rays[:, :2] / np.maximum(rays[:, 2:], 1e-3)
    round_ = np.column_stack([t * np.cos(way), t * np.sin(way)])
    # Near a perspective image and near an equidistant one, what departs from that image is the lens.
    bends = [min(_most(side - flat), _most(side - round_)) for side in sides]
    slack = MEASURABLE_PX * within / ONE_LENS / max(axial(one).fx for one in (a, b))
    return _most_of(apart) <= max(within * max(bends), slack)


def is_inverse(a: Calibration, b: Calibration) -> bool:
    """Whether one distortion undoes the other: one file states the map to ideal, the other that to observed points."""
    if a.distortion is None or b.distortion is None or isinstance(a.distortion, NoDistortion):
        return False
    sides = [
        side / f
        for one in (a.intrinsics, b.intrinsics)
        for side, f in zip(one.image_size, (one.fx, one.fy), strict=True)
    ]
    radius = 0.4 * min(sides)
    around = np.arange(8) * (math.pi / 4)
    xy = radius * np.column_stack([np.cos(around), np.sin(around)])
    with np.errstate(all="ignore"):
        bent = a.distortion.distort(xy)
        back = b.distortion.distort(bent)
    return _most(back - xy) <= INVERSE * _most(bent - xy)


def _half_field(calibration: Calibration) -> float:
    """Angle from the axis to the middle of the nearest side, rad."""
    K = axial(calibration)
    (width, height), centre = K.image_size, (K.cx, K.cy)
    sides = np.array([(0.0, centre[1]), (width, centre[1]), (centre[0], 0.0), (centre[0], height)])
    rays = calibration.unproject(sides)
    angles = np.arccos(np.clip(rays[:, 2], -1.0, 1.0))
    known = angles[np.isfinite(angles)]
    return float(known.min()) if known.size else math.atan(0.4 * min(width / K.fx, height / K.fy))


def _on_axis(calibration: Calibration, rays: FloatArray) -> FloatArray:
    """Pixels of the rays from the axis, in focal lengths on it."""
    K = axial(calibration)
    x, y = (calibration.project(rays) - (K.cx, K.cy)).T
    y = y / K.fy
    return np.column_stack([(x - K.skew * y) / K.fx, y])


def _most(vectors: FloatArray) -> float:
    return _most_of(np.hypot(*vectors.T))


def _most_of(lengths: FloatArray) -> float:
    known = lengths[np.isfinite(lengths)]
    return float(known.max()) if known.size else math.inf
