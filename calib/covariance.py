"""Covariance of the lens parameters from the corners, with poses and warp marginalised.

With S the normal matrix after elimination of the poses, C = s²·S⁻¹, where s² = rss / (2N − n − 6V). Its diagonal
agrees with the standard deviations of ``cv2.calibrateCameraExtended`` (correct since OpenCV 4.8.1, too large by a
factor of 1.46 in 4.6 and 4.7); OpenCV gives no correlations. This covariance contains corner noise only. The effects
of a bent board, a rolling shutter or an unsuitable model appear only in :mod:`calibrary.calib.variance_factor`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted, reduce
from calibrary.calib.network import LensT
from calibrary.calibration import Covariance
from calibrary.errors import CalibrationError

MEANINGLESS: Final = 1e-100
"""A parameter with less influence than this on all corners together is taken to have none."""


class Identifiability(Struct, frozen=True, kw_only=True):
    """The combination of parameters that the views determine worst.

    Attributes:
        condition: condition of the normal matrix after Jacobi scaling.
        weakest: share of each parameter in that combination; the squares add up to one.
    """

    condition: float
    weakest: dict[str, float]

    @property
    def culprits(self) -> tuple[str, ...]:
        """Parameters with the largest shares in that combination, largest first."""
        ordered = sorted(self.weakest, key=lambda name: -abs(self.weakest[name]))
        return tuple(name for name in ordered if abs(self.weakest[name]) > 0.3)


def lens_covariance(adjusted: Adjusted) -> Covariance:
    """Return the covariance of the lens parameters.

    Raises:
        CalibrationError: the corners do not determine the parameters.
    """
    return Covariance.from_matrix(adjusted.state.model.parameters, parameter_covariance(adjusted))


def parameter_covariance(adjusted: Adjusted[LensT]) -> FloatArray:
    """Return the covariance, (n, n), of the parameters of a lens or a rig.

    Raises:
        CalibrationError: the corners do not determine the parameters.
    """
    matrix = reduce(adjusted.linear, adjusted.free).matrix
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    values, vectors = (
        np.linalg.eigh(matrix / np.outer(scale, scale))
        if (scale > MEANINGLESS).all()
        else (np.zeros(1), matrix)
    )
    if not values[0] > 0:
        raise CalibrationError(
            "the views do not determine all parameters: tilt the board in several directions and fill the frame"
        )
    lens = slice(len(adjusted.state.parameters))
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return np.asarray(adjusted.variance * ((inverse + inverse.T) / 2)[lens, lens])


def lens_condition(adjusted: Adjusted) -> float:
    """Return the condition of the scaled normal matrix (largest over smallest eigenvalue); inf if it is singular."""
    return condition(reduce(adjusted.linear, adjusted.free).matrix)


def condition(matrix: FloatArray) -> float:
    """Return the same for any normal matrix."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (np.isfinite(matrix).all() and (scale > MEANINGLESS).all()):
        return math.inf
    values = np.linalg.eigvalsh(matrix / np.outer(scale, scale))
    return float(values[-1] / values[0]) if values[0] > 0 else math.inf


def identifiability(adjusted: Adjusted) -> Identifiability:
    """Return the combination of parameters that the views determine worst."""
    matrix = reduce(adjusted.linear, adjusted.free).matrix
    scale = np.maximum(np.sqrt(np.maximum(np.diag(matrix), 0.0)), MEANINGLESS)
    _, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    names = (*adjusted.state.model.parameters, "warp across", "warp down")
    shares = dict(zip(names, vectors[:, 0].tolist(), strict=False))
    return Identifiability(condition=lens_condition(adjusted), weakest=shares)
