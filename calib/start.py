"""Initial values for a camera: K from vanishing points, a default K, and a scale search for fisheyes.

The K of vanishing points may be so poor, if the boards are nearly parallel to the sensor, that the search ends in a
wrong minimum (3 of 40 sets at tilts of 10°). So it is run again from fx = fy = 0.8 · max(W, H) with the principal point
at the centre, and, where the boards put that far off, from there; the best result is used.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Final

import numpy as np

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.lens_change import as_model, widest_angle
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network, State
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import CalibrationError

SEED_FACTOR: Final = 0.8
"""fx / max(W, H) of the source document's start of a self-calibration: 64° across, near the catalogue's median."""
FIRST_VIEWS: Final = 16
"""Number of views from which a perspective K is estimated, before all of them are used."""
OFF_CENTRE: Final = 0.15
FARTHEST: Final = 2.0
"""Distances of a principal point from the image centre, of the longer side, between which it is tried."""
FISHEYE_SCALES: Final = (0.25, 0.32, 0.4, 0.5, 0.65)
"""Values of fx / max(W, H) tried for a fisheye; 180° across the image is 0.32."""
CAREFUL: Final = 1.0
"""Damping of the first steps after a change between omnidirectional models."""
ROUGH: Final = 1e-3
"""Damping of the first steps from a K without distortion."""
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
    if model.is_omnidirectional:
        best = _best(network, _fisheye_states(network, image_size, guess))
    else:
        best = _perspective(network, image_size, guess or seed(image_size))
    if best is None:
        raise CalibrationError(
            f"no {model.value} camera explains these corners: are they all of this board, in its order, "
            "and of one camera at one focus?"
        )
    other = as_model(best.state, model, widest_angle(best) if model.is_omnidirectional else 0.0)
    careful = model.is_omnidirectional and model is not Solvable.FISHEYE
    return adjust(network, other, damping=CAREFUL if careful else 0.0, known=best)


def _best(network: Network, states: Iterator[State], damping: float = 0.0) -> Adjusted | None:
    """Return the best of the adjustments from several states."""
    best: Adjusted | None = None
    for state in states:
        with suppress(CalibrationError):
            found = adjust(network, state, damping=damping)
            if np.isfinite(found.rss) and (best is None or found.rss < best.rss):
                best = found
    return best


def _perspective(network: Network, image_size: ImageSize, first: Intrinsics) -> Adjusted | None:
    """Return a camera with k1, k2, p1 and p2, estimated from some of the views, and all views' poses in it."""
    order = np.flatnonzero(network.used)
    some = network
    if len(order) > FIRST_VIEWS:
        some = network.views(order[np.linspace(0, len(order) - 1, FIRST_VIEWS).astype(np.intp)])
    guesses = [np.array([first.fx, first.fy, first.cx, first.cy])]
    if network.is_planar:
        # Only planes have vanishing points of right angles.
        guesses = _by_vanishing_points(some, image_size) + guesses
    model = Solvable.K1K2P1P2

    def rough() -> Iterator[State]:
        for K in guesses:
            ideal = (some.pixels - K[2:]) / K[:2]
            with suppress(CalibrationError):
                yield _start_state(model, np.concatenate([K, np.zeros(4)]), some, ideal, some.seen)

    best = _best(some, rough(), ROUGH)
    if best is None or some is network:
        return best
    K = best.state.parameters[:4]
    lens = model.distortion(dict(zip(model.parameters, best.state.parameters.tolist(), strict=True)))
    ideal = lens.undistort(((network.pixels - K[2:]) / K[:2]).reshape(-1, 2)).reshape(network.pixels.shape)
    seen = network.seen & np.isfinite(ideal).all(axis=-1)
    ideal = np.where(seen[..., None], ideal, 0.0)
    with suppress(CalibrationError):
        state = _start_state(model, best.state.parameters, network, ideal, seen)
        return adjust(network, state, poses_only=True)
    return None


def _by_vanishing_points(network: Network, image_size: ImageSize) -> list[FloatArray]:
    """Return fx, fy, cx and cy for which the sides and the diagonals of the boards are at right angles.

    The principal point is the image centre. Where the boards put it far from there, as in a cropped image, a K with
    theirs is returned too: from the centre the search ends in a slow valley.

    Source: Z. Zhang, "A flexible new technique for camera calibration", 2000, without skew.
    """
    centre, scale = np.array(image_size) / 2, float(max(image_size))
    H = homographies(network.points, (network.pixels - centre) / scale, network.seen)
    across, down = H[:, :, 0], H[:, :, 1]
    pairs = [_unit_length(side) for side in (across, down, across + down, across - down)]
    (x, y, z), (u, v, w) = np.concatenate([pairs[0], pairs[2]]).T, np.concatenate([pairs[1], pairs[3]]).T
    inverse = np.linalg.lstsq(np.column_stack([x * u, y * v]), -z * w, rcond=None)[0]
    held = np.concatenate([scale / np.sqrt(np.maximum(np.abs(inverse), 1e-300)), centre])
    rows = np.column_stack([x * u, y * v, x * w + z * u, y * w + z * v, z * w])
    a, b, c, d, e = np.linalg.svd(rows)[2][-1]
    with np.errstate(all="ignore"):
        off = np.array([-c / a, -d / b])
        free = np.concatenate([np.sqrt((e - c * c / a - d * d / b) / np.array([a, b])), off])
    if np.isfinite(free).all() and OFF_CENTRE < np.abs(off).max() < FARTHEST:
        return [free * scale + np.concatenate([np.zeros(2), centre]), held]
    return [held]


def _unit_length(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300))


def _fisheye_states(network: Network, image_size: ImageSize, guess: Intrinsics | None) -> Iterator[State]:
    """Yield equidistant cameras with several scales; the adjustment refines their poses."""
    largest = max(image_size)
    centre = np.array(image_size) / 2
    # From a wrong scale the search ends in a wrong minimum, so several are tried; the best one is kept by the caller.
    scales = list(FISHEYE_SCALES) if guess is None else [guess.fx / largest, *FISHEYE_SCALES]
    for scale in scales:
        focal = scale * largest
        observed = (network.pixels - centre) / focal
        theta = np.linalg.norm(observed, axis=-1)
        near = network.seen & (theta < WIDEST_START_RAD)
        if (near.sum(axis=1)[network.used] < 6).any():
            # A board is at the very edge of the view.
            continue
        # A pinhole's pose of the rays, so its points are moved to the tangent plane.
        safe = np.where(near, np.maximum(theta, 1e-12), 1.0)
        ideal = observed * (np.tan(safe) / safe)[..., None]
        with suppress(CalibrationError):
            parameters = np.array([focal, focal, *centre, 0.0, 0.0, 0.0, 0.0])
            rough = _start_state(Solvable.FISHEYE, parameters, network, ideal, near)
            yield adjust(network, rough, poses_only=True).state


def _start_state(
    model: Solvable, parameters: FloatArray, network: Network, ideal: FloatArray, seen: BoolArray
) -> State:
    """Return a camera with the poses by which a pinhole sees points of the boards, (V, M, 2), at z = 1.

    Raises:
        CalibrationError: the points of a view fit no pose.
    """
    if network.is_planar:
        rotations, translations = _planar_poses(network, ideal, seen)
    else:
        found = [_pose(*each) for each in zip(network.points, ideal, seen, strict=True)]
        rotations, translations = np.stack([R for R, _ in found]), np.stack([t for _, t in found])
    return State(
        model=model,
        parameters=parameters,
        warp=np.zeros(2),
        rotations=rotations,
        translations=translations,
    )


def _planar_poses(network: Network, ideal: FloatArray, seen: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return rotations, (V, 3, 3), and translations, (V, 3), by the homographies of the boards."""
    H = homographies(network.points, ideal, seen)
    # What is seen of the board is in front of the camera, where its centre need not be; its sides have unit length.
    depths = (network.points[..., :2] @ H[:, 2, :2, None])[..., 0] + H[:, 2:, 2]
    H *= np.where((depths * seen).sum(axis=1) < 0, -1.0, 1.0)[:, None, None]
    H /= np.maximum(np.linalg.norm(H[:, :, :2], axis=1).mean(axis=1), 1e-300)[:, None, None]
    across, down = H[:, :, 0], H[:, :, 1]
    rough = np.stack([across, down, np.cross(across, down)], axis=-1)
    if not np.isfinite(rough).all():
        raise CalibrationError("a view's corners fit no pose of the board")
    U, _, Vt = np.linalg.svd(rough)
    return U @ Vt, H[:, :, 2]


def homographies(points: FloatArray, pixels: FloatArray, seen: BoolArray) -> FloatArray:
    """Return the homography of each view, (V, 3, 3), by the direct linear transform.

    Args:
        points: (V, M, 2) or more coordinates in the plane, of which the first two are used.
        pixels: (V, M, 2) in the image.
        seen: (V, M) which of them are used.

    Raises:
        CalibrationError: a view has fewer than four.

    Source: R. I. Hartley, "In defence of the 8-point algorithm", 1995, for the scale of the equations.
    """
    if (seen.sum(axis=1) < 4).any():
        raise CalibrationError("a view has too few corners within the lens for a homography")
    (source, to_source), (target, to_target) = (_unit(each[..., :2], seen) for each in (points, pixels))
    rows = np.concatenate([source, np.ones((*seen.shape, 1))], axis=-1) * seen[..., None]
    u, v = target[..., :1], target[..., 1:]
    by, by_u, by_v, by_both = (
        rows.transpose(0, 2, 1) @ (weight * rows) for weight in (1.0, -u, -v, u * u + v * v)
    )
    none = np.zeros_like(by)
    normal = np.block([[by, none, by_u], [none, by, by_v], [by_u, by_v, by_both]])
    H = np.linalg.eigh(normal)[1][:, :, 0].reshape(-1, 3, 3)
    return np.asarray(np.linalg.inv(to_target) @ H @ to_source)


def _unit(points: FloatArray, seen: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the points of each view, centred and scaled to unit size, and the (V, 3, 3) that makes them so."""
    counts = np.maximum(seen.sum(axis=1), 1)[:, None]
    middle = (points * seen[..., None]).sum(axis=1) / counts
    away = points - middle[:, None]
    size = np.sqrt(((away**2).sum(axis=-1) * seen).sum(axis=1) / counts[:, 0])
    scale = 1 / np.maximum(size, 1e-300)
    to_unit = np.zeros((len(points), 3, 3))
    to_unit[:, (0, 1), (0, 1)], to_unit[:, 2, 2] = scale[:, None], 1.0
    to_unit[:, :2, 2] = -middle * scale[:, None]
    return away * scale[:, None, None], to_unit


def _pose(points: FloatArray, ideal: FloatArray, seen: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return rotation, (3, 3), and translation, (3,), of points that are not in a plane."""
    import cv2

    try:
        done, turn, place = cv2.solvePnP(points[seen], ideal[seen], np.eye(3), None)
    except cv2.error:
        done = False
    if not done:
        raise CalibrationError("a view's corners fit no pose of the board")
    return np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64), np.asarray(place, dtype=np.float64).ravel()
