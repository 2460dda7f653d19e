"""Initial values for a camera: OpenCV's initialisation, a default K, and a scale search for fisheyes.

``cv2.calibrateCamera`` estimates the initial K from vanishing points. If the boards are nearly parallel to the sensor,
this estimate may be so poor that the search ends in a wrong minimum (3 of 40 sets at tilts of 10°). So it is run again
from fx = fy = 0.8 · max(W, H) with the principal point at the centre, and the better result is used.
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
"""fx / max(W, H) of the source document's start of a self-calibration: 64° across, near the catalogue's median."""
FIRST_VIEWS: Final = 24
"""Number of views passed to OpenCV, which solves for all poses together at a cost cubic in their number."""
FIRST_STEPS: Final = (3, 40, 1e-6)
"""OpenCV's COUNT + EPS: close enough for the adjustment to take over."""
FISHEYE_SCALES: Final = (0.25, 0.32, 0.4, 0.5, 0.65)
"""Values of fx / max(W, H) tried for a fisheye; 180° across the image is 0.32."""
CAREFUL: Final = 1.0
"""Damping of the first steps after a change between omnidirectional models."""
WIDEST_START_RAD: Final = 1.3
"""Corners at larger angles are inaccurate in the tangent plane; the initial poses of a fisheye do not use them."""


def seed(image_size: ImageSize) -> Intrinsics:
    """Return the default K: fx = fy = 0.8 · max(W, H), with the principal point at the image centre."""
    width, height = image_size
    focal = SEED_FACTOR * max(image_size)
    return Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=image_size)


def start(network: Network, image_size: ImageSize, model: Solvable, guess: Intrinsics | None) -> Adjusted:
    """Return the best initial adjustment of several methods.

    Args:
        network: views, each with used corners.
        image_size: (width, height) px.
        model: lens model. Perspective models start from k1, k2, p1, p2, omnidirectional ones from the Kannala–Brandt
            model.
        guess: an initial K instead of the default.

    Raises:
        CalibrationError: no method gives a result.
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
        # OpenCV cannot estimate K if the points are not in a plane.
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
                # With all boards parallel to the sensor, OpenCV's estimate may have a negative focal length.
                continue
            rotations = np.array([cv2.Rodrigues(turn)[0] for turn in turns], dtype=np.float64)
            if len(few) == len(network.seen):
                places_mm = np.array([np.ravel(place) for place in places], dtype=np.float64)
                yield _start_state(Solvable.K1K2P1P2, parameters, rotations, places_mm)
                continue
            lens4 = np.ravel(lens)[:4]

            def pose(
                p: FloatArray, q: FloatArray, K: Any = K, lens4: Any = lens4
            ) -> tuple[FloatArray, FloatArray]:
                return _pose(p, q, K, lens4)

            yield _start_state(Solvable.K1K2P1P2, parameters, *_poses(network, pose))


def _fisheye_states(network: Network, image_size: ImageSize, guess: Intrinsics | None) -> Iterator[State]:
    """Yield equidistant cameras with several scales; the adjustment refines their poses."""
    largest = max(image_size)
    # From a wrong scale the search ends in a wrong minimum, so several are tried; the best one is kept by the caller.
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
            # A pinhole's pose of the rays: solvePnP knows no fisheye, so its points are moved to the tangent plane.
            safe = np.maximum(theta[near], 1e-12)
            ideal = observed[near] * (np.tan(safe) / safe)[:, None]
            return _pose(p[near], ideal, np.eye(3), np.zeros(4))

        with suppress(CalibrationError):
            parameters = np.array([focal, focal, *centre, 0.0, 0.0, 0.0, 0.0])
            rough = _start_state(Solvable.FISHEYE, parameters, *_poses(network, pose))
            yield adjust(network, rough, poses_only=True).state


def _start_state(model: Solvable, parameters: FloatArray, rotations: FloatArray, places: FloatArray) -> State:
    return State(
        model=model,
        parameters=parameters,
        warp=np.zeros(2),
        rotations=rotations,
        translations=np.array(places),
    )


def _lists(network: Network, rows: IntArray) -> tuple[list[NDArray[np.float32]], list[NDArray[np.float32]]]:
    """Return corners by view in float32 for OpenCV: its rounding at 20 megapixels is a tenth of the noise."""
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
    """Return rotation, (3, 3), and translation, (3,), of one board in a known camera."""
    import cv2

    try:
        done, turn, place = cv2.solvePnP(points, pixels, K, lens)
    except cv2.error:
        done = False
    if not done:
        raise CalibrationError("a view's corners fit no pose of the board")
    return np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64), np.asarray(place, dtype=np.float64).ravel()
