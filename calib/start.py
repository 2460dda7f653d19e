"""Where the search for a camera begins: OpenCV's own start, the seed, and a scale search for fisheyes.

``cv2.calibrateCamera`` guesses K from vanishing points. With boards held nearly parallel to the sensor that
guess may be so poor that the search ends in a wrong minimum (3 of 40 sets at tilts of 10°), so it is run again
from fx = fy = 0.8 · max(W, H) with the principal point in the middle, and the better of the two is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.lens_change import as_model, widest_angle
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network, State
from calibrary.calib.opencv_state import one_thread
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import CalibrationError

__all__ = ["seed", "start"]


SEED_FACTOR: Final = 0.8
FIRST_VIEWS: Final = 24
"""OpenCV solves for all poses at once, at a cost that grows with their cube: it is given this many views."""
FIRST_STEPS: Final = (3, 40, 1e-6)
"""OpenCV's COUNT + EPS: as near as the adjustment needs to take over, far nearer than the next minimum is."""
FISHEYE_SCALES: Final = (0.25, 0.32, 0.4, 0.5, 0.65)
"""fx / max(W, H) tried for a fisheye: 180° across the frame is 0.32."""
CAREFUL: Final = 1.0
"""Damping of the first steps from one omnidirectional model into another."""
WIDEST_START_RAD: Final = 1.3
"""Corners further off the axis say little in a tangent plane; they are left out of a fisheye's first poses."""


def seed(image_size: ImageSize) -> Intrinsics:
    """Fx = fy = 0.8 · max(W, H), the principal point in the middle."""
    width, height = image_size
    focal = SEED_FACTOR * max(image_size)
    return Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=image_size)


def start(network: Network, image_size: ImageSize, model: Solvable, guess: Intrinsics | None) -> Adjusted:
    """A first adjustment, the best of all that the ways above lead to.

    Args:
        network: every view has corners that count.
        image_size: (width, height) px.
        model: to be solved for. The perspective models all begin from k1, k2, p1, p2, the omnidirectional ones from
            Kannala and Brandt's.
        guess: taken instead of the seed.

    Raises:
        CalibrationError: no way leads anywhere.
    """
    first = guess or seed(image_size)
    if model.is_omnidirectional:
        states = _fisheye_states(network, image_size, guess)
    else:
        states = _perspective_states(network, image_size, first)
    best: Adjusted | None = None
    for state in states:
        with suppress(CalibrationError):
            found = adjust(network, state)
            if np.isfinite(found.rss) and (best is None or found.rss < best.rss):
                best = found
    if best is None:
        raise CalibrationError(
            f"no {model.value} camera explains these corners: are they all of this board, in its order, "
            "and of one camera at one focus?"
        )
    if model.is_omnidirectional and model is not Solvable.FISHEYE:
        other = as_model(best.state, model, widest_angle(best))
        return adjust(network, other, damping=CAREFUL)
    return best


def _perspective_states(network: Network, image_size: ImageSize, first: Intrinsics) -> Iterator[State]:
    import cv2

    order = np.flatnonzero(network.used)
    few = order[np.unique(np.linspace(0, len(order) - 1, min(len(order), FIRST_VIEWS)).astype(np.intp))]
    points, pixels = _lists(network, few)
    K0 = first.matrix
    runs: list[tuple[FloatArray, int]] = [(K0, cv2.CALIB_USE_INTRINSIC_GUESS)]
    if network.is_planar:
        # OpenCV refuses to guess where the points are not in a plane.
        runs.insert(0, (np.eye(3), 0))
    for matrix, flags in runs:
        with suppress(cv2.error):
            with one_thread():
                _, K, lens, turns, places = cv2.calibrateCamera(
                    points, pixels, image_size, matrix.copy(), np.zeros(5),
                    flags=flags | cv2.CALIB_FIX_K3, criteria=FIRST_STEPS,
                )  # fmt: skip
            parameters = np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], np.ravel(lens)[:4]])
            if not (np.isfinite(parameters).all() and (parameters[:2] > 0).all()):
                # Boards that are all parallel to the sensor leave OpenCV's guess with a negative focal length.
                continue
            rotations = np.array([cv2.Rodrigues(turn)[0] for turn in turns], dtype=np.float64)
            if len(few) == len(network.seen):
                places_mm = np.array([np.ravel(place) for place in places], dtype=np.float64)
                yield _state(Solvable.K1K2P1P2, parameters, rotations, places_mm)
                continue
            lens4 = np.ravel(lens)[:4]

            def pose(
                p: FloatArray, q: FloatArray, K: Any = K, lens4: Any = lens4
            ) -> tuple[FloatArray, FloatArray]:
                return _pose(p, q, K, lens4)

            yield _state(Solvable.K1K2P1P2, parameters, *_poses(network, pose))


def _fisheye_states(network: Network, image_size: ImageSize, guess: Intrinsics | None) -> Iterator[State]:
    """Equidistant cameras of several scales; whatever the poses then are, the adjustment takes it from there."""
    largest = max(image_size)
    scales = list(FISHEYE_SCALES) if guess is None else [guess.fx / largest, *FISHEYE_SCALES]
    for scale in scales:
        focal = scale * largest
        centre = np.array(image_size) / 2

        def pose(p: FloatArray, q: FloatArray, focal: float = focal, centre: FloatArray = centre) -> Any:
            observed = (q - centre) / focal
            theta = np.linalg.norm(observed, axis=1)
            near = theta < WIDEST_START_RAD
            if near.sum() < 6:
                raise CalibrationError("a board is at the very edge of a fisheye's view")
            safe = np.maximum(theta[near], 1e-12)
            ideal = observed[near] * (np.tan(safe) / safe)[:, None]
            return _pose(p[near], ideal, np.eye(3), np.zeros(4))

        with suppress(CalibrationError):
            parameters = np.array([focal, focal, *centre, 0.0, 0.0, 0.0, 0.0])
            rough = _state(Solvable.FISHEYE, parameters, *_poses(network, pose))
            yield adjust(network, rough, poses_only=True).state


def _state(model: Solvable, parameters: FloatArray, rotations: FloatArray, places: FloatArray) -> State:
    return State(
        model=model,
        parameters=parameters,
        warp=np.zeros(2),
        rotations=rotations,
        translations=np.array(places),
    )


def _lists(network: Network, rows: IntArray) -> tuple[list[NDArray[np.float32]], list[NDArray[np.float32]]]:
    """Corners view by view in OpenCV's float32: fine for a start, a tenth of the noise at 20 megapixels."""
    points = [network.points[row][network.seen[row]].astype(np.float32) for row in rows]
    pixels = [network.pixels[row][network.seen[row]].astype(np.float32) for row in rows]
    return points, pixels


def _poses(
    network: Network, pose: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    found = [
        pose(points[seen], pixels[seen])
        for points, pixels, seen in zip(network.points, network.pixels, network.seen, strict=True)
    ]
    return np.stack([R for R, _ in found]), np.stack([t for _, t in found])


def _pose(
    points: FloatArray, pixels: FloatArray, K: FloatArray, lens: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(3, 3) and (3,): one board before a known camera."""
    import cv2

    try:
        done, turn, place = cv2.solvePnP(points, pixels, K, lens)
    except cv2.error:
        done = False
    if not done:
        raise CalibrationError("a view's corners fit no pose of the board")
    return np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64), np.asarray(place, dtype=np.float64).ravel()
