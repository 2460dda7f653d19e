"""Difference between two calibrations of one camera in pixels, and its significance.

Two calibrations may differ in every parameter and still be equivalent: a shift of the principal point, for example, is
nearly a rotation of the camera, which has no effect for users. So the rays of the first calibration are rotated to fit
the second before the comparison (mrcal, "Differencing calibrations", for points at infinity; from the air, the ground
is nearly at infinity)::

    p = unproject₁(q)        dq = project₂(R p) − q        R minimises Σ w |dq|²

The rotation also absorbs a part of the parameters' noise. With G = ∂dq/∂(θ₁, θ₂) and J = ∂dq/∂R, the rest is P G with
P = I − J (Jᵀ W J)⁻¹ Jᵀ W, so Cov(dq) = (P G) C (P G)ᵀ. The mean of |dq|² is then a weighted sum of χ²₁; its tail
probability is Satterthwaite's approximation (F. E. Satterthwaite, "An approximate distribution of estimates of
variance components", 1946).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calibration import Calibration, Covariance, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.errors import CalibrationError, InputError
from calibrary.records import replace
from calibrary.rotations import rotation_matrix, rotation_vector

GRID: Final = (33, 25)
"""Columns and rows, including the image's edges."""
FOCUS: Final = 1 / 6
"""Default radius of the central disc used for the rotation, relative to the image's shorter side."""
CENTRE: Final = 0.25
"""Half-width of the centre, relative to the image's shorter side."""
STEP_RAD: Final = 1e-6
MAX_TURNS: Final = 20
SETTLED_RAD: Final = 1e-10
"""Rotations below this are negligible: 1e-7 px at any focal length."""
FEWEST_PIXELS: Final = 6


class ProjectionDifference(Struct, frozen=True, kw_only=True, eq=False):
    """Difference between two calibrations over the image.

    Attributes:
        pixels: (R, C, 2) px, grid of the first calibration.
        vectors: (R, C, 2) px, difference of the second, rotated calibration from the first; NaN where one has no ray.
        rotation_rad: (3,) rotation vector of R, from the first camera's frame to the second's.
        std_px: (R, C) px, standard deviation of the vectors in their worst direction; None without covariances.
        image_size: (width, height) px.
        region: (R, C) where the two are compared: both have a ray, and the standard deviation, if known, is below a
            limit.
        noise: (R, C, 2, n) px, effect of n independent standard normal variables on the vectors (the square root of
            their joint covariance); None without covariances.
    """

    pixels: FloatArray
    vectors: FloatArray
    rotation_rad: FloatArray
    std_px: FloatArray | None
    image_size: ImageSize
    region: BoolArray
    noise: FloatArray | None = None

    @property
    def lengths_px(self) -> FloatArray:
        """Lengths of the vectors, (R, C) px."""
        return np.asarray(np.linalg.norm(self.vectors, axis=-1))

    @property
    def rms_px(self) -> float:
        """RMS difference in the region, px."""
        return _rms(self.lengths_px[self.region])

    @property
    def max_px(self) -> float:
        """Largest difference in the region, px."""
        return float(self.lengths_px[self.region].max(initial=0.0))

    @property
    def centre_rms_px(self) -> float:
        """RMS difference in the central part of the region, px."""
        return _rms(self.lengths_px[self.region & _within(self.pixels, self.image_size, CENTRE)])

    @property
    def rotation_deg(self) -> float:
        """Rotation angle between the two cameras, degrees."""
        return math.degrees(float(np.linalg.norm(self.rotation_rad)))


class Uncertainty(Struct, frozen=True, kw_only=True, eq=False):
    """Standard deviation of the projection of points at infinity, with a free rotation of the camera.

    Attributes:
        pixels: (R, C, 2) px.
        std_px: (R, C) px, in the worst direction; NaN where there is no ray.
    """

    pixels: FloatArray
    std_px: FloatArray


def pixel_grid(image_size: ImageSize, shape: tuple[int, int] = GRID) -> FloatArray:
    """Return a regular grid of pixels over the image, including its edges, (rows, columns, 2) px.

    Args:
        image_size: (width, height) px.
        shape: (columns, rows).
    """
    x, y = np.meshgrid(np.linspace(0, image_size[0], shape[0]), np.linspace(0, image_size[1], shape[1]))
    return np.stack([x, y], axis=-1)


def projection_difference(
    first: Calibration,
    second: Calibration,
    *,
    shape: tuple[int, int] = GRID,
    weights: ArrayLike | None = None,
    covariances: tuple[Covariance, Covariance] | None = None,
    trusted_px: float = 1.0,
) -> ProjectionDifference:
    """Compare two calibrations for the same image size.

    Args:
        first: the grid is in its pixels.
        second: the other calibration, of any model.
        shape: (columns, rows) of the grid.
        weights: (rows, columns) weight of each pixel for the rotation. By default the inverse of the variance if
            covariances are given, else a central disc.
        covariances: covariances of the two calibrations' parameters, independent of each other and scaled by their
            variance factors.
        trusted_px: pixels with a larger standard deviation are excluded from the region.

    Raises:
        InputError: the sizes differ, or a weight is negative.
        CalibrationError: the common field of view is too small, or no rotation aligns the two.
    """
    size = first.intrinsics.image_size
    if size != second.intrinsics.image_size:
        raise InputError(
            "calibrations of {}×{} and of {}×{} frames cannot be compared: scale one first".format(
                *size, *second.intrinsics.image_size
            )
        )
    pixels = pixel_grid(size, shape)
    flat = pixels.reshape(-1, 2)
    # Where one of the two has no ray for a pixel, the other's is at the fold of its lens, and no derivative holds.
    rays = np.where(np.isfinite(second.unproject(flat)), first.unproject(flat), np.nan)
    given = None if weights is None else _weights(weights, pixels.shape[:2])
    W = _focus(pixels, size) if given is None else given
    R, seen = _fitted(second, rays, flat, W)
    std, propagated = None, None
    if covariances is not None:
        G, known = _sensitivity(first, second, R, flat, covariances)
        if given is None:
            J = _seen_by_turn(second, rays @ R.T, seen)
            W = _inverse_variance(_remaining(J, W * seen, G), seen & known)
            R, seen = _fitted(second, rays, flat, W)
        J = _seen_by_turn(second, rays @ R.T, seen)
        propagated = _remaining(J, W * seen, G).reshape(len(flat), 2, -1)
        std = np.where(seen & known, _worst(propagated), np.nan)
    vectors = np.where(seen[:, None], second.project(rays @ R.T) - flat, np.nan)
    region = seen if std is None else seen & (np.nan_to_num(std, nan=np.inf) <= trusted_px)
    grid = pixels.shape[:2]
    return ProjectionDifference(
        pixels=pixels,
        vectors=vectors.reshape(pixels.shape),
        rotation_rad=rotation_vector(R),
        std_px=None if std is None else std.reshape(grid),
        image_size=size,
        region=region.reshape(grid),
        noise=None if propagated is None else propagated.reshape(*grid, 2, -1),
    )


def projection_uncertainty(
    calibration: Calibration, covariance: Covariance, *, shape: tuple[int, int] = GRID
) -> Uncertainty:
    """Return the standard deviation in px over the image, after removing a rotation, which a free pose absorbs.

    Args:
        calibration: calibration at which the covariance is propagated.
        covariance: covariance of its parameters, scaled by the variance factor.
        shape: (columns, rows) of the grid.

    Raises:
        CalibrationError: the calibration has rays for too little of its own image.
    """
    pixels = pixel_grid(calibration.intrinsics.image_size, shape)
    flat = pixels.reshape(-1, 2)
    rays = calibration.unproject(flat)
    seen: BoolArray = np.asarray(np.isfinite(rays).all(axis=1), dtype=np.bool_)
    G = pixel_spread(calibration, covariance, projected(calibration, rays))
    G = G.reshape(2 * len(flat), -1)
    seen &= np.isfinite(G).reshape(len(flat), -1).all(axis=1)
    G = np.where(np.repeat(seen, 2)[:, None], G, 0.0)
    J = _seen_by_turn(calibration, rays, seen)
    W = (seen & _within(pixels, calibration.intrinsics.image_size, 0.5).ravel()).astype(np.float64)
    if np.count_nonzero(W) < FEWEST_PIXELS:
        raise CalibrationError("the calibration projects almost nothing into its own frame")
    left = _remaining(J, W, G)
    left = _remaining(J, _inverse_variance(left, seen), G)
    std = np.where(seen, _worst(left.reshape(len(flat), 2, -1)), np.nan)
    return Uncertainty(pixels=pixels, std_px=std.reshape(pixels.shape[:2]))


def _fitted(
    second: Calibration, rays: FloatArray, flat: FloatArray, W: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the rotation, and the pixels for which both calibrations then have a ray."""
    R = np.eye(3)
    for _ in range(MAX_TURNS):
        turned = rays @ R.T
        miss = second.project(turned) - flat
        J = _by_turn(second, turned)
        seen = np.asarray(np.isfinite(miss).all(axis=1) & np.isfinite(J).all(axis=(1, 2)), dtype=np.bool_)
        used = seen & (W > 0)
        if used.sum() < FEWEST_PIXELS:
            raise CalibrationError("the calibrations see too little of the frame in common to be compared")
        root = np.sqrt(W[used])
        A = (J[used] * root[:, None, None]).reshape(-1, 3)
        target = -(miss[used] * root[:, None]).ravel()
        step = np.asarray(np.linalg.lstsq(A, target, rcond=None)[0], dtype=np.float64)
        length = float(np.linalg.norm(step))
        if length > 0.2:
            step *= 0.2 / length
        R = rotation_matrix(step) @ R
        if length < SETTLED_RAD:
            return R, seen
    return R, seen


def _by_turn(camera: Calibration, rays: FloatArray) -> FloatArray:
    """Return ∂project(rotated ray)/∂rotation at zero rotation, (N, 2, 3) px per rad, by central differences."""
    turns = [rotation_matrix(STEP_RAD * axis) for axis in np.eye(3)]
    turned = np.concatenate([rays @ way for turn in turns for way in (turn.T, turn)])
    seen = camera.project(turned).reshape(3, 2, len(rays), 2)
    return np.moveaxis((seen[:, 0] - seen[:, 1]) / (2 * STEP_RAD), 0, -1)


def _remaining(J: FloatArray, W: FloatArray, G: FloatArray) -> FloatArray:
    """Return P G, (2N, n): changes of the pixels after the best rotation."""
    flat, w = J.reshape(-1, 3), np.repeat(W, 2)
    weighed = flat.T * w
    try:
        return np.asarray(G - flat @ np.linalg.solve(weighed @ flat, weighed @ G))
    except np.linalg.LinAlgError:
        raise CalibrationError(
            "no turn of the camera can be determined from the pixels that both see"
        ) from None


def _seen_by_turn(camera: Calibration, rays: FloatArray, seen: BoolArray) -> FloatArray:
    return np.where(seen[:, None, None], _by_turn(camera, rays), 0.0)


def _sensitivity(
    first: Calibration,
    second: Calibration,
    R: FloatArray,
    flat: FloatArray,
    covariances: tuple[Covariance, Covariance],
) -> tuple[FloatArray, BoolArray]:
    """Return G·L, (2N, n₁ + n₂), with L the root of both covariances, and where it is known; zero elsewhere."""
    rays = first.unproject(flat)
    by_first = pixel_spread(first, covariances[0], lambda other: second.project(other.unproject(flat) @ R.T))
    by_second = pixel_spread(second, covariances[1], lambda other: other.project(rays @ R.T))
    both = np.concatenate([by_first, by_second], axis=-1)
    known = np.asarray(np.isfinite(both).all(axis=(1, 2)), dtype=np.bool_)
    both[~known] = 0.0
    return both.reshape(2 * len(flat), -1), known


def _worst(propagated: FloatArray) -> FloatArray:
    """Return the semi-major axis of each pixel's error ellipse, (N,) px, from (N, 2, n)."""
    C = propagated @ propagated.transpose(0, 2, 1)
    mean, half = (C[:, 0, 0] + C[:, 1, 1]) / 2, (C[:, 0, 0] - C[:, 1, 1]) / 2
    return np.asarray(np.sqrt(mean + np.hypot(half, C[:, 0, 1])))


def _inverse_variance(left: FloatArray, seen: BoolArray) -> FloatArray:
    variance = (left**2).sum(axis=1).reshape(-1, 2).sum(axis=1)
    floor = 1e-6 * float(np.median(variance[seen])) if seen.any() else 1.0
    return np.where(seen, 1.0 / np.maximum(variance, max(floor, 1e-300)), 0.0)


def _weights(weights: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    W = np.asarray(weights, dtype=np.float64)
    if W.shape != shape or not (W >= 0).all():
        raise InputError(f"weights of shape {W.shape}: expected {shape} numbers, none of them negative")
    return W.ravel()


def _within(pixels: FloatArray, image_size: ImageSize, share: float) -> BoolArray:
    """Return which pixels are within a distance of the centre, given relative to the image's shorter side."""
    offset = np.linalg.norm(pixels - np.array(image_size) / 2, axis=-1)
    return np.asarray(offset <= share * min(image_size))


def _focus(pixels: FloatArray, image_size: ImageSize) -> FloatArray:
    """Return (N,) 1 in a central disc, enlarged if the grid is coarse, else 0."""
    offset = np.linalg.norm(pixels - np.array(image_size) / 2, axis=-1).ravel()
    nearest = np.sort(offset)[: 2 * FEWEST_PIXELS]
    return np.asarray(offset <= max(FOCUS * min(image_size), nearest[-1]), dtype=np.float64)


def _rms(lengths: FloatArray) -> float:
    return float(np.sqrt(np.mean(lengths**2))) if len(lengths) else 0.0


PixelsOf: TypeAlias = Callable[[Calibration], FloatArray]

PINHOLE: Final = frozenset({"fx", "fy", "cx", "cy", "skew"})
STEP_SIGMAS: Final = 0.05
LARGEST_STEP: Final = 1e-3
"""Largest relative change of a focal length in one difference."""
LONGEST_STEP_PX: Final = 0.5
"""Largest change of a pixel in one difference: above it the lens is not linear over the step, which is made shorter."""
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
            up = pixels(_changed(calibration, {name: step * by for name, by in moves.items()}))
            down = pixels(_changed(calibration, {name: -step * by for name, by in moves.items()}))
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
