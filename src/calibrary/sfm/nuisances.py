"""What shifts the images of a flight besides the lens, as parameters with priors.

====================  ======  ====================================================================================
parameter             unit    meaning
====================  ======  ====================================================================================
along                 m       stated position − centre of projection, ahead: antenna ahead, or position taken late
right                 m       the same to the right: antenna to the right
height_scale          1       stated heights grow faster than heights by this share
readout               m       travel of the camera ahead while a rolling shutter reads the image from top to bottom
====================  ======  ====================================================================================

"Ahead" is where the top of an image points on the ground. At one speed a lever arm ahead and a delay of the positions
are one parameter, so they are one here. The datum and the height of the antenna are the world frame's own freedom.

None of them shows in the residuals: simulated flights with positions 15 ms late or heights 0.4 % off fit as well as
those without, while cy was 20 σ off. A lever arm ahead trades against cy, a readout against fy − fx, the scale of
heights against f. So each is adjusted with a prior, and the covariance carries what the images cannot tell into the
lens. Pixels of a sensor are square; without that, a readout and fy could not be told apart.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.catalogue import identified, shipped_catalogue
from calibrary.errors import CalibraryError
from calibrary.evidence.dji import is_mechanical
from calibrary.parsers.imagery import read_metadata

ASPECT_STD: Final = 1e-3
"""Standard deviation of fy ÷ fx before a flight: a choice, no measurement of cameras. With half of it, fy of a
simulated flight of 3000 points, whose camera has 7e-4, came out 4 σ off."""
SPEED: Final = 10.0
"""m/s of a mapping flight; the priors of delay and readout are times."""
LEVER_STD_M: Final = 0.15
DELAY_STD_S: Final = 0.02
HEIGHT_SCALE_STD: Final = 0.003
READOUT_S: Final = (0.02, 0.02)
"""Mean and standard deviation where the shutter is unknown: 0 for a mechanical one, 60 ms for the slowest that are
listed."""
KNOWN_READOUT_STD_S: Final = 0.005
"""Of a listed readout: two lists differ by 5 ms, two formats of one camera by 9 ms."""
PRECISE_M: Final = 0.5
"""Stated standard deviation of positions above which levers and delays are lost in it."""
TRAVEL_OF_HEIGHT: Final = 1 / 8
"""1/s, speed over flying height where positions give no metres: 10 m/s at 80 m."""


class Nuisance(StrEnum):
    """A parameter of a flight that is not the lens's, in the order of all arrays of them."""

    ALONG = "positions ahead of the camera"
    RIGHT = "positions to the right of the camera"
    HEIGHT_SCALE = "scale of the heights"
    READOUT = "travel during the readout"


HEIGHT_SCALE, READOUT = 2, 3
NONE: Final = np.zeros(len(Nuisance))


def readout_of(image: Path | None) -> tuple[float, float]:
    """Return the readout time of a shutter and its standard deviation, s.

    A mechanical shutter that the image states and a global one have none; for other cameras it is the catalogue's.

    Args:
        image: an image of the camera; None, or a file that is none, if nothing is known.
    """
    if image is None:
        return READOUT_S
    try:
        metadata = read_metadata(image)
    except CalibraryError:
        return READOUT_S
    if is_mechanical(metadata):
        return 0.0, 0.0
    camera = identified(metadata, shipped_catalogue()).camera
    if camera is None or camera.readout_ms is None:
        return READOUT_S
    return (camera.readout_ms / 1000, KNOWN_READOUT_STD_S) if camera.readout_ms else (0.0, 0.0)


class NuisancePriors(Struct, frozen=True, kw_only=True, eq=False):
    """What is known of the nuisances before the flight.

    Attributes:
        mean: (4,) in the order and units of the table above.
        std: (4,) standard deviations; 0 keeps one at its mean.
    """

    mean: FloatArray
    std: FloatArray

    @property
    def active(self) -> BoolArray:
        """(4,) which are adjusted."""
        return np.asarray(self.std > 0, dtype=np.bool_)

    @classmethod
    def of(
        cls, *, readout_s: tuple[float, float], positions_m: float | None, height: float
    ) -> NuisancePriors:
        """Return the priors of a flight.

        Args:
            readout_s: mean and standard deviation of the shutter's readout time, s.
            positions_m: stated standard deviation of the positions across, m; None if there are none.
            height: flying height in the scene's unit, which gives the travel during a readout where that is no metre.
        """
        speed = SPEED if positions_m is not None else TRAVEL_OF_HEIGHT * height
        precise = positions_m is not None and positions_m < PRECISE_M
        along = float(np.hypot(LEVER_STD_M, DELAY_STD_S * speed))
        places = (along, LEVER_STD_M, HEIGHT_SCALE_STD) if precise else (0.0, 0.0, 0.0)
        return cls(
            mean=np.array([0.0, 0.0, 0.0, readout_s[0] * speed]),
            std=np.array([*places, readout_s[1] * speed]),
        )


def ahead(rotations: FloatArray) -> FloatArray:
    """Return (V, 3) horizontal unit vectors in the world, z up, to where the top of each image points.

    Args:
        rotations: (V, 3, 3) world to camera.
    """
    right = rotations[:, 0] * (1.0, 1.0, 0.0)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-12)
    return np.stack([-right[:, 1], right[:, 0], np.zeros(len(right))], axis=1)


def ahead_by_turn(rotations: FloatArray) -> FloatArray:
    """Return (V, 3) derivatives of the heading, rad to the left, by a small rotation about the camera's axes.

    Without them the search for the minimum creeps where the images hardly determine a parameter.

    Args:
        rotations: (V, 3, 3) world to camera.
    """
    x, y, z = rotations[:, 0], rotations[:, 1], rotations[:, 2]
    square = np.maximum(x[:, 0] ** 2 + x[:, 1] ** 2, 1e-24)
    by_y = (x[:, 0] * z[:, 1] - x[:, 1] * z[:, 0]) / square
    by_z = -(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]) / square
    return np.stack([np.zeros(len(x)), by_y, by_z], axis=1)


def place_by_nuisance(rotations: FloatArray, heights: FloatArray) -> FloatArray:
    """Return (V, 3, 4) derivatives of the stated positions by the nuisances.

    Args:
        rotations: (V, 3, 3) world to camera.
        heights: (V,) of the images above their mean.
    """
    forward, by = ahead(rotations), np.zeros((len(rotations), 3, len(Nuisance)))
    by[..., 0] = forward
    by[:, 0, 1], by[:, 1, 1] = forward[:, 1], -forward[:, 0]
    by[:, 2, 2] = heights
    return by


def row_shift(
    pixels: FloatArray, measured: FloatArray, by_arm: FloatArray, travel: FloatArray, height: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move projections to the moment at which their row was read.

    The row is that of the projection, not the measured one: the noise of a measured row is the noise of its residual,
    and biased a readout by 10 ms. One linear step from the measured row is exact to a millionth of a pixel.

    Args:
        pixels: (N, 2) projections from the pose at the measured rows.
        measured: (N, 2) measured pixels.
        by_arm: (N, 2, 3) derivatives of the projections by the point in the camera's frame.
        travel: (N, 3) travel of the camera during the whole readout, in the camera's frame.
        height: of the image, px.

    Returns:
        (N, 2) projections; (N, 2, 2) matrices that carry derivatives at a fixed row to the row that moves with them;
        (N,) rows as shares of the height from the middle.
    """
    by_row = -np.einsum("nci,ni->nc", by_arm, travel) / height
    slack = (pixels[:, 1] - measured[:, 1]) / (1.0 - by_row[:, 1])
    carry = np.tile(np.eye(2), (len(pixels), 1, 1))
    carry[:, :, 1] += by_row / (1.0 - by_row[:, 1:])
    rows = measured[:, 1] + slack
    return pixels + by_row * slack[:, None], carry, rows / height - 0.5
