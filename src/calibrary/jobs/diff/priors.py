"""Uncertainty of a calibration's parameters: measured, or else typical for its grade, with a note on which.

A K without a covariance is not exact. The uncertainty of its focal length depends on its origin: an EXIF
focal length is rounded and nominal, a maker's table describes the type and not the unit, and in a bundle
adjustment focal length and height are correlated. Distortion coefficients get the spread that moves the
corners by the corresponding number of pixels. Such a typical spread is shown, but it explains a difference
only between two independent measurements (:mod:`calibrary.jobs.diff.noise`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, Covariance, Grade
from calibrary.distortion import Distortion
from calibrary.records import replace

__all__ = ["PRIORS", "Prior", "Spread", "spread_of", "std_of"]


class Prior(Struct, frozen=True, kw_only=True):
    """Typical relative standard deviations.

    Attributes:
        focal: of fx and fy together.
        aspect: of fx / fy.
        centre: of cx and cy, as a fraction of the width.
        lens: of the displacement of the corners by the distortion.
    """

    focal: float
    aspect: float
    centre: float
    lens: float


PRIORS: Final = {
    Grade.CALIBRATED: Prior(focal=0.001, aspect=0.0002, centre=0.0005, lens=0.01),
    Grade.ADJUSTED: Prior(focal=0.002, aspect=0.0005, centre=0.001, lens=0.02),
    Grade.DESIGN: Prior(focal=0.003, aspect=0.001, centre=0.005, lens=0.1),
    Grade.DERIVED: Prior(focal=0.015, aspect=0.005, centre=0.01, lens=0.2),
    Grade.PRIOR: Prior(focal=0.05, aspect=0.02, centre=0.02, lens=0.5),
    Grade.SEED: Prior(focal=0.3, aspect=0.05, centre=0.05, lens=1.0),
}
"""Makers' tables agree with a unit's focal length to about 0.3 %, EXIF to 1 … 2 %. Calibrations of one unit from
several sets of frames scatter by 0.05 … 0.1 %, three times as much as their own solves state."""

SMALLEST_LENS_PX: Final = 0.5


class Spread(Struct, frozen=True, kw_only=True):
    """Uncertainty of a calibration's parameters.

    Attributes:
        covariance: of K and the distortion coefficients, including the variance factor if known.
        source: where it is from, in words.
        is_measured: whether the calibration states it.
    """

    covariance: Covariance
    source: str
    is_measured: bool


def spread_of(calibration: Calibration) -> Spread:
    """The calibration's covariance with its variance factor; else its standard deviations; else its grade's prior.

    A parameter that is missing in a measured covariance was fixed by the model and has variance 0.
    """
    quality, names = calibration.quality, _names(calibration)
    if quality is not None:
        inflated = f", × κ² = {quality.inflation:.2g}" if quality.inflation > 1 else ""
        if quality.covariance is not None and "fx" in quality.covariance.names:
            own = _padded(quality.covariance, names) * quality.inflation
            return Spread(
                covariance=Covariance.from_matrix(names, own),
                source=f"its own covariance{inflated}",
                is_measured=True,
            )
        if {"fx", "fy"} <= quality.std.keys():
            variances = np.square([quality.std.get(name, 0.0) for name in names]) * quality.inflation
            silent = [name for name in names if name not in quality.std]
            return Spread(
                covariance=Covariance.from_matrix(names, np.diag(variances)),
                source=f"its own standard deviations{inflated}, without their correlations"
                + (f" and without {', '.join(silent)}" if silent else ""),
                is_measured=True,
            )
    return Spread(
        covariance=Covariance.from_matrix(names, _prior(calibration, names)),
        source=f"none stated; a K of grade {calibration.grade.value} is usually known to "
        f"{PRIORS[calibration.grade].focal:.1%} of f",
        is_measured=False,
    )


def std_of(calibration: Calibration, name: str) -> float:
    """Measured standard deviation of one parameter, including the variance factor; 0 if unknown."""
    quality = calibration.quality
    if quality is None:
        return 0.0
    covariance = quality.covariance.std if quality.covariance is not None else {}
    return quality.std.get(name, covariance.get(name, 0.0)) * math.sqrt(quality.inflation)


def _names(calibration: Calibration) -> tuple[str, ...]:
    lens = calibration.distortion
    return ("fx", "fy", "cx", "cy", *(lens.coefficients if lens is not None else ()))


def _padded(covariance: Covariance, names: tuple[str, ...]) -> FloatArray:
    known = [name for name in names if name in covariance.names]
    at = [names.index(name) for name in known]
    C = np.zeros((len(names), len(names)))
    C[np.ix_(at, at)] = covariance.of(tuple(known))
    return C


def _prior(calibration: Calibration, names: tuple[str, ...]) -> FloatArray:
    prior, K = PRIORS[calibration.grade], calibration.intrinsics
    C = np.zeros((len(names), len(names)))
    f = np.array([K.fx, K.fy])
    C[:2, :2] = np.outer(f, f) * prior.focal**2
    C[1, 1] += (K.fy * prior.aspect) ** 2
    C[2, 2] = C[3, 3] = (K.image_size[0] * prior.centre) ** 2
    # Only a lens has coefficients.
    if calibration.distortion is not None:
        for at, name in enumerate(names[4:], start=4):
            C[at, at] = _lens_std(calibration, calibration.distortion, name, prior.lens) ** 2
    return C


def _lens_std(calibration: Calibration, lens: Distortion, name: str, share: float) -> float:
    """Change of one coefficient that moves the image border by ``share`` of the total displacement by the lens."""
    rays = _edge_rays(calibration)
    bend = _furthest(calibration.project(rays) - _pinhole(calibration, rays))
    value = lens.coefficients[name]
    step = 1e-4 * max(abs(value), 1e-3)
    moved = _furthest(_with(calibration, lens, name, value + step).project(rays) - calibration.project(rays))
    return max(SMALLEST_LENS_PX, share * bend) * step / moved if moved > 0 else abs(value) * share


def _edge_rays(calibration: Calibration) -> FloatArray:
    width, height = calibration.intrinsics.image_size
    x, y = (np.linspace(0.1, 0.9, 5) * side for side in (width, height))
    seen = np.array([(a, b) for a in x for b in y])
    rays = calibration.unproject(seen)
    return rays[np.isfinite(rays).all(axis=1) & (rays[:, 2] > 0)]


def _pinhole(calibration: Calibration, rays: FloatArray) -> FloatArray:
    return replace(calibration, distortion=None).project(rays)


def _with(calibration: Calibration, lens: Distortion, name: str, value: float) -> Calibration:
    return replace(calibration, distortion=replace(lens, **{name: value}))


def _furthest(vectors: FloatArray) -> float:
    lengths = np.hypot(*vectors.T)
    lengths = lengths[np.isfinite(lengths)]
    return float(lengths.max()) if lengths.size else 0.0
