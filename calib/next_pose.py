"""The most informative next pose of the board, from the information matrix of the adjustment.

A view adds to the normal matrix of the lens with its own pose eliminated (Schur complement, as in
:func:`calibrary.calib.least_squares.reduce`), so its contribution is known before it is taken. Candidate poses are
projected by the current camera, and the one is proposed that minimises the largest standard deviation over the image,
after removal of a common rotation of the camera.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.least_squares import reduce
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network, State, linearise
from calibrary.calib.observations import Observations, View
from calibrary.calib.result import CalibrationResult
from calibrary.calib.start import seed
from calibrary.calibration import CameraKey, ImageSize
from calibrary.records import Record, replace
from calibrary.rotations import rotation_matrix

PLACES: Final = (0.14, 0.38, 0.62, 0.86)
"""Positions of the board's centre, as shares of the image's width and height."""
TILTS: Final = ((0.0, 0.0), (30.0, 0.0), (-30.0, 0.0), (0.0, 30.0), (0.0, -30.0), (20.0, 20.0))
"""Degrees about the board's row and about its column."""
FILLS: Final = (0.3, 0.6)
"""Share of the image's width that the board's longer side covers."""
LEAST_SEEN = 0.5
GRID: Final = (9, 7)
FOCAL_PRIOR, CENTRE_PRIOR, LENS_PRIOR = 0.3, 0.1, 0.3
"""Prior standard deviations, relative: of the focal length, of the principal point by the width, of a coefficient."""
NOISE_PX = 0.2
"""Noise of a corner in px, before a view has determined it."""


class NextPose(Record):
    """A pose of the board to photograph next.

    Attributes:
        x, y: position of the board's centre in the image, as shares of width and height.
        tilt_x_deg, tilt_y_deg: tilt in degrees about its row (bottom away from the camera) and its column (left side
            away).
        fill: share of the image's width that its longer side covers.
        edge_px: largest standard deviation over the image that is then expected, px; without a camera it is only a
            guess.
        gain: relative reduction of that standard deviation by the view.
    """

    x: float
    y: float
    tilt_x_deg: float
    tilt_y_deg: float
    fill: float
    edge_px: float
    gain: float

    def __str__(self) -> str:
        across = "left" if self.x < 0.3 else "right" if self.x > 0.7 else "middle"
        down = "top" if self.y < 0.3 else "bottom" if self.y > 0.7 else "middle"
        place = (
            "the middle" if across == down == "middle" else f"the {down} {across}".replace(" middle", "", 1)
        )
        tilts = [
            f"its {side} tilted {abs(angle):.0f}° away"
            for angle, side in (
                (self.tilt_x_deg, "bottom" if self.tilt_x_deg > 0 else "top"),
                (self.tilt_y_deg, "left side" if self.tilt_y_deg > 0 else "right side"),
            )
            if angle
        ]
        tilt = " and ".join(tilts) or "facing the camera"
        place += f" ({self.x:.0%} across, {self.y:.0%} down)"
        return f"hold the board at {place}, {tilt}, {self.fill:.0%} of the frame wide"


def next_pose(board: Board, image_size: ImageSize, result: CalibrationResult | None = None) -> NextPose:
    """Return the pose that reduces the largest standard deviation over the image the most.

    Args:
        board: board to photograph.
        image_size: (width, height) px.
        result: result of the views so far; None if there are too few for a camera.
    """
    state, known, variance = _so_far(image_size, result)
    poses = [(x, y, tx, ty, fill) for x in PLACES for y in PLACES for tx, ty in TILTS for fill in FILLS]
    network, held = _candidates(board, image_size, state, np.array(poses))
    linear = linearise(network, held)
    worth = (
        np.zeros((len(poses), *known.shape))
        if linear is None
        else reduce(linear, np.arange(len(known))).by_member
    )
    enough = network.seen.mean(axis=1) >= LEAST_SEEN
    spread = _spread(state, image_size)
    before = float(_largest(spread, known[None], variance)[0])
    after = np.where(enough, _largest(spread, known + worth, variance), np.inf)
    best = int(np.argmin(after))
    x, y, tilt_x, tilt_y, fill = poses[best]
    left = min(float(after[best]) / before, 1.0)
    # The part of σ due to the choice of model (model averaging) is assumed to decrease like the noise part.
    stated = result.evidence.edge_px if result is not None else None
    return NextPose(
        x=x,
        y=y,
        tilt_x_deg=tilt_x,
        tilt_y_deg=tilt_y,
        fill=fill,
        edge_px=left * (stated if stated is not None else before),
        gain=1 - left,
    )


def _so_far(image_size: ImageSize, result: CalibrationResult | None) -> tuple[State, FloatArray, float]:
    """Return the camera, the information on its lens, (n, n) in 1/px² of residuals, and their variance in px²."""
    if result is None:
        first = seed(image_size)
        model = Solvable.BROWN
        parameters = np.array([first.fx, first.fy, first.cx, first.cy, *np.zeros(len(model.coefficients))])
        state = State(
            model=model,
            parameters=parameters,
            warp=np.zeros(2),
            rotations=np.zeros((0, 3, 3)),
            translations=np.zeros((0, 3)),
        )
        return state, _prior(state, image_size) * NOISE_PX**2, NOISE_PX**2
    views = [
        (seen, one)
        for seen, one in zip(result.observations.views, result.views, strict=True)
        if one.without is None and one.rotation is not None and one.translation is not None
    ]
    state = State(
        model=result.model,
        parameters=result.model.values(result.calibration.intrinsics, result.calibration.distortion),
        warp=np.zeros(2),
        rotations=np.array([one.rotation for _, one in views], dtype=np.float64),
        translations=np.array([one.translation for _, one in views], dtype=np.float64),
    )
    quality = result.calibration.quality
    inflation = quality.inflation if quality is not None else 1.0
    rms = result.evidence.rms_px
    variance = max(rms**2 / 2, 1e-6) * max(1.0, inflation)
    known = _prior(state, image_size) * variance
    linear = linearise(
        Network.of(replace(result.observations, views=tuple(seen for seen, _ in views))), state
    )
    if linear is not None:
        known = known + reduce(linear, np.arange(len(state.parameters))).matrix
    return state, known, variance


def _prior(state: State, image_size: ImageSize) -> FloatArray:
    """Return the prior information; without it, some combinations of parameters would be undetermined."""
    focal, centre = FOCAL_PRIOR * float(state.parameters[0]), CENTRE_PRIOR * image_size[0]
    std = np.array([focal, focal, centre, centre, *[LENS_PRIOR] * (len(state.parameters) - 4)])
    return np.diag(1 / std**2)


def _candidates(
    board: Board, image_size: ImageSize, state: State, poses: FloatArray
) -> tuple[Network, State]:
    """Return the board in each pose, projected by the camera; corners outside the image are unused."""
    size = np.array(image_size, dtype=np.float64)
    views = tuple(
        View(name=str(at), ids=np.arange(len(board.points)), image_points=np.zeros((len(board.points), 2)))
        for at in range(len(poses))
    )
    camera = Observations(board=board, image_size=image_size, views=views, camera=CameraKey())
    network = Network.of(camera)
    zero = np.zeros(len(poses))
    turns = rotation_matrix(np.column_stack([np.radians(poses[:, 2]), zero, zero]))
    turns = turns @ rotation_matrix(np.column_stack([zero, np.radians(poses[:, 3]), zero]))
    fx, fy, cx, cy = state.parameters[:4]
    rays = np.column_stack(
        [(poses[:, 0] * size[0] - cx) / fx, (poses[:, 1] * size[1] - cy) / fy, np.ones(len(poses))]
    )
    distance = fx * max(board.extent) / (poses[:, 4] * size[0])
    held = replace(state, rotations=turns, translations=rays * distance[:, None])
    inside = network.points @ turns.transpose(0, 2, 1) + held.translations[:, None]
    pixels = state.model.project(state.parameters, inside)[0]
    seen = ((pixels > 0) & (pixels < size)).all(axis=-1) & (inside[..., 2] > 0)
    return network.only(np.asarray(seen, dtype=np.bool_)), held


def _spread(state: State, image_size: ImageSize) -> FloatArray:
    """Return ∂px/∂parameters over the image, (N, 2, n), after removal of a rotation of the camera."""
    x, y = (np.linspace(0.02, 0.98, count) * side for count, side in zip(GRID, image_size, strict=True))
    u, v = np.meshgrid(x, y)
    fx, fy, cx, cy = state.parameters[:4]
    rays = np.column_stack([(u.ravel() - cx) / fx, (v.ravel() - cy) / fy, np.ones(u.size)])
    pixels, by_lens, by_ray = state.model.project(state.parameters, rays)
    inside = np.isfinite(pixels).all(axis=1) & np.isfinite(by_lens).all(axis=(1, 2))
    by_turn = np.stack([by_ray[inside] @ np.cross(axis, rays[inside])[..., None] for axis in np.eye(3)], -1)
    lens, turn = by_lens[inside].reshape(-1, by_lens.shape[-1]), by_turn.reshape(-1, 3)
    left = lens - turn @ np.linalg.lstsq(turn, lens, rcond=None)[0]
    return np.asarray(left.reshape(-1, 2, lens.shape[-1]))


def _largest(spread: FloatArray, information: FloatArray, variance: float) -> FloatArray:
    """Return the largest standard deviation over the image for each normal matrix, (V,) px."""
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    unit = np.linalg.pinv(information / (scale[:, :, None] * scale[:, None, :]))
    covariance = variance * unit / (scale[:, :, None] * scale[:, None, :])
    at = np.einsum("nki,vij,nkj->vn", spread, covariance, spread)
    return np.asarray(np.sqrt(np.maximum(at.max(axis=1), 0.0)))
