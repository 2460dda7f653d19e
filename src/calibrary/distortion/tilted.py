"""The thin-prism model in front of a sensor that is not perpendicular to the axis (Scheimpflug)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.distortion.polynomial import PolynomialMap
from calibrary.errors import InputError

__all__ = ["Tilted"]


class Tilted(OpenCVDistortion):
    """OpenCV's fourteen coefficients; τx and τy in radians.

    The result (x', y', 1) of :class:`~calibrary.distortion.ThinPrism` is multiplied by the homography::

        ⎡R33  0  −R13⎤                              ⎡cos τy  0  −sin τy⎤   ⎡1     0       0  ⎤
        ⎢ 0  R33 −R23⎥ · R        where R(τx, τy) = ⎢  0     1     0   ⎥ · ⎢0   cos τx  sin τx⎥
        ⎣ 0   0    1 ⎦                              ⎣sin τy  0   cos τy⎦   ⎣0  −sin τx  cos τx⎦

    Source: OpenCV, CALIB_TILTED_MODEL, after T. Louhichi et al., "A model of Scheimpflug camera for mobile
    mapping", 2007.

    Raises:
        InputError: a coefficient is not finite, or the sensor is tilted by 90° or more.
    """

    model: ClassVar[str] = "tilted"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.12, "tau_x": 0.08, "tau_y": 0.12}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    k5: float
    k6: float
    s1: float
    s2: float
    s3: float
    s4: float
    tau_x: float
    tau_y: float

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        for name in ("tau_x", "tau_y"):
            if abs(getattr(self, name)) >= math.pi / 2:
                raise InputError(
                    f"{name} is {getattr(self, name):g} rad, expected a tilt below 90° (1.5708 rad): "
                    "beyond it the sensor looks away from the lens; is it in degrees?",
                    place=name,
                )

    def _lens(self) -> PolynomialMap:
        """Map of the lens, before the tilt of the sensor."""
        return PolynomialMap(
            **{name: value for name, value in self.coefficients.items() if not name.startswith("tau")}
        )

    def _sensor(self) -> FloatArray | None:
        """(3, 3) homography from the image on an untilted sensor to the tilted one; None if there is no tilt."""
        if not (self.tau_x or self.tau_y):
            return None
        cx, sx = math.cos(self.tau_x), math.sin(self.tau_x)
        cy, sy = math.cos(self.tau_y), math.sin(self.tau_y)
        R = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array(
            [[1, 0, 0], [0, cx, sx], [0, -sx, cx]]
        )
        to_sensor = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]])
        return np.asarray(to_sensor @ R)
