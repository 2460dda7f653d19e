"""The covariance of a calibration, propagated to pixels by central differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, Covariance
from calibrary.distortion import NoDistortion
from calibrary.errors import InputError
from calibrary.records import replace

__all__ = ["PixelsOf", "pixel_spread", "projected"]

PixelsOf: TypeAlias = Callable[[Calibration], FloatArray]

PINHOLE: Final = frozenset({"fx", "fy", "cx", "cy", "skew"})
STEP_SIGMAS: Final = 0.05
LARGEST_STEP: Final = 1e-3
LONGEST_STEP_PX: Final = 0.5
SHORTER: Final = 8.0
MAX_SHORTER: Final = 8


def pixel_spread(calibration: Calibration, covariance: Covariance, pixels: PixelsOf) -> FloatArray:
    """(N, 2, n) G·L with C = L Lᵀ, by central differences along the columns of L.

    All parameters are moved together, as they err together: numerator and denominator of a rational lens are each
    known to nothing and cancel, and one of them moved alone would be another lens.
    """
    focal = {name: getattr(calibration.intrinsics, name) for name in ("fx", "fy")}
    columns = []
    for direction in _root(covariance).T:
        moves = dict(zip(covariance.names, direction.tolist(), strict=True))
        # A focal length that nothing determines must not be taken through zero.
        steep = max((abs(moves.get(name, 0.0)) / value for name, value in focal.items()), default=0.0)
        step = min(STEP_SIGMAS, LARGEST_STEP / steep) if steep > 0 else STEP_SIGMAS
        for _ in range(MAX_SHORTER):
            up, down = (
                pixels(_changed(calibration, {name: way * by for name, by in moves.items()}))
                for way in (step, -step)
            )
            # A lens whose terms cancel bends far from straight along what nothing determines.
            if _most(up - down) <= LONGEST_STEP_PX:
                break
            step /= SHORTER
        columns.append((up - down) / (2 * step))
    return np.stack(columns, axis=-1)


def projected(calibration: Calibration, rays: FloatArray) -> PixelsOf:
    """The pixels of rays as cameras see them that differ little; the same lens bends them once."""
    lens = calibration.distortion or NoDistortion()
    bent = lens.distort_rays(rays)

    def pixels(other: Calibration) -> FloatArray:
        if other.distortion is not calibration.distortion:
            return other.project(rays)
        K, (x, y) = other.intrinsics, bent.T
        return np.column_stack([K.fx * x + (K.skew * y + K.cx), K.fy * y + K.cy])

    return pixels


def _most(moved: FloatArray) -> float:
    """Px, the largest of the moves that are numbers; ``inf`` where fewer than half of them are."""
    known = moved[np.isfinite(moved)]
    return float(np.abs(known).max()) if 2 * len(known) >= moved.size else math.inf


def _changed(calibration: Calibration, by: Mapping[str, float]) -> Calibration:
    K, lens = calibration.intrinsics, calibration.distortion
    pinhole = {name: getattr(K, name) + by[name] for name in by if name in PINHOLE}
    theirs = lens.coefficients if lens is not None else {}
    bends = {name: move for name, move in by.items() if name not in PINHOLE}
    for name in bends:
        if name not in theirs:
            raise InputError(f"the covariance contains {name!r}, which this calibration does not have")
    if lens is not None and any(bends.values()):
        lens = replace(lens, **{name: theirs[name] + move for name, move in bends.items()})
    return replace(calibration, intrinsics=replace(K, **pinhole), distortion=lens)


def _root(covariance: Covariance) -> FloatArray:
    """L with C = L Lᵀ, also of a matrix that is singular or, by rounding, a little worse."""
    C = covariance.matrix
    scale = np.sqrt(np.diag(C))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(C / np.outer(safe, safe))
    return np.asarray(safe[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
