"""Propagation of a calibration's covariance to pixels by central differences."""

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
    """Return G·L, (N, 2, n), with C = L Lᵀ, by central differences along the columns of L.

    All parameters are changed together, as their errors are correlated: numerator and denominator of a rational lens
    are each undetermined and cancel, and changing one alone would give another lens.
    """
    focal = {name: getattr(calibration.intrinsics, name) for name in ("fx", "fy")}
    columns = []
    for direction in _root(covariance).T:
        moves = dict(zip(covariance.names, direction.tolist(), strict=True))
        # An undetermined focal length must not pass through zero.
        steep = max((abs(moves.get(name, 0.0)) / value for name, value in focal.items()), default=0.0)
        step = min(STEP_SIGMAS, LARGEST_STEP / steep) if steep > 0 else STEP_SIGMAS
        for _ in range(MAX_SHORTER):
            up, down = (
                pixels(_changed(calibration, {name: way * by for name, by in moves.items()}))
                for way in (step, -step)
            )
            # A lens with cancelling terms is strongly nonlinear along undetermined directions.
            if _most(up - down) <= LONGEST_STEP_PX:
                break
            step /= SHORTER
        columns.append((up - down) / (2 * step))
    return np.stack(columns, axis=-1)


def projected(calibration: Calibration, rays: FloatArray) -> PixelsOf:
    """Return a function that projects rays by slightly different cameras; equal distortion is computed only once."""
    lens = calibration.distortion or NoDistortion()
    bent = lens.distort_rays(rays)

    def pixels(other: Calibration) -> FloatArray:
        if other.distortion is not calibration.distortion:
            return other.project(rays)
        K, (x, y) = other.intrinsics, bent.T
        return np.column_stack([K.fx * x + (K.skew * y + K.cx), K.fy * y + K.cy])

    return pixels


def _most(moved: FloatArray) -> float:
    """Return the largest finite move, px; ``inf`` if fewer than half are finite."""
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
    """Return L with C = L Lᵀ, also if C is singular or slightly indefinite by rounding."""
    C = covariance.matrix
    scale = np.sqrt(np.diag(C))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(C / np.outer(safe, safe))
    return np.asarray(safe[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
