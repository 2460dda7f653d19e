"""Realistic board poses: tilted, near and far, over the whole image."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.calib.artwork import paper_rim
from calibrary.calib.board import Board
from calibrary.calib.synthesis.sheet import Pose
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.rotations import rotation_matrix, rotation_vector

TRIES = 128
"""Number of poses drawn at a time; if none fits, the board is moved further away."""
SHRINK, MOST_SHRINKS = 0.95, 60
FACING_DEG = 50.0
"""For cameras with a larger half angle of view, the board faces the camera instead of being parallel to the sensor."""
MARGIN = 0.008
"""Free margin along the image's edge, as a share of its width."""


def poses(
    board: Board,
    calibration: Calibration,
    count: int,
    seed: int,
    max_tilt_deg: float = 35.0,
    fill: tuple[float, float] = (0.3, 0.85),
    *,
    roll_deg: float = 20.0,
    reach: float = 1.0,
) -> tuple[Pose, ...]:
    """Draw random poses with the whole board inside the image.

    Args:
        board: the board.
        calibration: the camera.
        count: number of poses.
        seed: the same arguments give the same poses.
        max_tilt_deg: largest tilt about each of the board's axes, degrees.
        fill: smallest and largest share of the image's width covered by the sheet's longer side, seen frontally.
        roll_deg: largest rotation about the viewing direction, degrees.
        reach: share of the image's width and height, around its centre, that the board may cover.

    Raises:
        InputError: no such pose exists.
    """
    random = np.random.default_rng([seed, 7])
    return tuple(_pose(board, calibration, random, max_tilt_deg, fill, roll_deg, reach) for _ in range(count))


def _pose(
    board: Board,
    calibration: Calibration,
    random: np.random.Generator,
    max_tilt_deg: float,
    fill: tuple[float, float],
    roll_deg: float,
    reach: float,
) -> Pose:
    K = calibration.intrinsics
    size = np.array(K.image_size, dtype=np.float64)
    rim = paper_rim(board)
    middle, length = rim.mean(axis=0), float(np.ptp(rim, axis=0).max())
    facing = _half_view_deg(calibration) > FACING_DEG
    share = random.uniform(*fill)
    for _ in range(MOST_SHRINKS):
        tilts = np.radians(random.uniform(-max_tilt_deg, max_tilt_deg, (TRIES, 2)))
        rolls = np.radians(random.uniform(-roll_deg, roll_deg, TRIES))
        rays = calibration.unproject(size / 2 + random.uniform(-0.5, 0.5, (TRIES, 2)) * size * reach)
        zero = np.zeros(TRIES)
        turns = rotation_matrix(np.column_stack([zero, zero, rolls]))
        turns = turns @ rotation_matrix(np.column_stack([tilts, zero]))
        distance = K.fx * length / (share * size[0])
        if facing:
            turns, places = _towards(rays) @ turns, rays * distance
        else:
            places = rays / rays[:, 2:] * distance
        seen = calibration.project(
            ((rim - middle) @ turns.transpose(0, 2, 1) + places[:, None]).reshape(-1, 3)
        )
        fitting = np.flatnonzero(_inside(seen.reshape(TRIES, -1, 2), size, reach))
        if len(fitting):
            turn, place = turns[fitting[0]], places[fitting[0]]
            tx, ty, tz = place - turn @ middle
            rx, ry, rz = rotation_vector(turn).tolist()
            return Pose(rotation=(rx, ry, rz), translation_mm=(float(tx), float(ty), float(tz)))
        share *= SHRINK
    raise InputError(
        f"{board.described} squares fits nowhere into a {K.image_size[0]}×{K.image_size[1]} frame; "
        "expected a smaller fill, less tilt or more reach"
    )


def _inside(seen: FloatArray, size: FloatArray, reach: float) -> NDArray[np.bool_]:
    """Return which outlines, (n, M, 2) px, are within reach."""
    free = size * (1 - reach) / 2 + MARGIN * size[0]
    return np.asarray(((seen > free) & (seen < size - free)).all(axis=(1, 2)))


def _half_view_deg(calibration: Calibration) -> float:
    """Return the angle in degrees between the axis and the direction at the middle of the image's left edge."""
    height = calibration.intrinsics.image_size[1]
    ray = calibration.unproject([[0.0, height / 2]])[0]
    return math.degrees(math.acos(ray[2])) if np.isfinite(ray).all() else 90.0


def _towards(rays: FloatArray) -> FloatArray:
    """Return the shortest rotations from the optical axis to each direction, (N, 3, 3)."""
    x, y, z = rays.T
    sine = np.hypot(x, y)
    angle = np.arctan2(sine, z) / np.maximum(sine, 1e-12)
    return rotation_matrix(np.column_stack([-y * angle, x * angle, 0 * z]))
