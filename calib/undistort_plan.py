"""Choice of the K of an undistorted image.

The candidates are the camera's own K, without skew, with focal lengths multiplied by a *zoom* and an unchanged
principal point. The zoom determines what is kept: the largest one that loses no pixel (``alpha`` 1), or the smallest
one that leaves no pixel empty (``alpha`` 0, like OpenCV's ``alpha``).
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, ImageSize, Intrinsics
from calibrary.distortion import Distortion
from calibrary.distortion.base import perspective
from calibrary.errors import FrameError, InputError, UnsupportedModelError
from calibrary.records import replace

MAX_ANGLE_DEG = 80.0
"""A plane shows less than 90° from the axis; at 80° it already stretches a pixel to six by thirty-three."""

MAX_SIDE = 32_766
"""OpenCV's remap uses 16-bit pixel coordinates."""

BORDER_SAMPLES = 1024
RING_SAMPLES = 720
GRID = 64

ON_THE_EDGE_PX = 1e-6
SAME_ZOOM = 1e-6
ZOOM_STEPS = 40
LARGEST_ZOOM = 2**20


class Plan(Struct, frozen=True, kw_only=True):
    """The camera of an undistorted image.

    Attributes:
        source: original camera, at the size of the images to undistort.
        intrinsics: K of the undistorted image.
        kept: share of the original's pixels that are in the undistorted image, 0 … 1.
        empty: share of the undistorted image that is empty, 0 … 1.
        cropped_to_deg: full angle of view that was kept, if the camera sees more than a plane can show, degrees.
    """

    source: Calibration
    intrinsics: Intrinsics
    kept: float
    empty: float
    cropped_to_deg: float | None = None


def plan(
    calibration: Calibration,
    *,
    alpha: float | None = None,
    size: ImageSize | None = None,
    same_focal: bool = False,
    max_angle_deg: float = MAX_ANGLE_DEG,
) -> Plan:
    """Choose the K of the undistorted image.

    Args:
        calibration: calibration at the size of the images, with known distortion.
        alpha: None for the camera's own K; 1 keeps every pixel, 0 leaves none empty, values between interpolate.
        size: (width, height) px of the undistorted image; by default that of the camera.
        same_focal: keep the focal lengths, and so the resolution, and choose the size accordingly.
        max_angle_deg: largest angle from the axis that ``alpha`` considers, degrees.

    Raises:
        UnsupportedModelError: the distortion is unknown.
        InputError: an argument is out of range, or the image would be larger than 32 766 px per side.
        FrameError: the camera's own K is requested at another aspect ratio, or its principal point is outside the
            image, so that no zoom about it is possible.
    """
    known_distortion(calibration)
    if alpha is not None and not 0 <= alpha <= 1:
        raise InputError(f"alpha is {alpha:g}, expected 0 (no pixel empty) to 1 (every pixel kept)")
    if not 0 < max_angle_deg < 90:
        raise InputError(
            f"the largest angle off the axis is {max_angle_deg:g}°, expected over 0° and below 90°"
        )
    if same_focal and size is not None:
        raise InputError("the size cannot both be given and follow from the focal lengths; give one of them")
    K = replace(calibration.intrinsics, skew=0.0)
    cropped = None
    if alpha is None:
        new = K if size is None else K.scaled(size)
    else:
        start = K if size is None else _reframed(K, size)
        zoom, is_cropped = _zoom(calibration, start, alpha, math.radians(max_angle_deg))
        cropped = 2 * max_angle_deg if is_cropped else None
        new = _resized(start, zoom, outwards=alpha > 0) if same_focal else _zoomed(start, zoom)
    if max(*new.image_size, *K.image_size) > MAX_SIDE:
        raise InputError(
            f"{'{}×{}'.format(*K.image_size)} px would become {'{}×{}'.format(*new.image_size)}, expected at "
            f"most {MAX_SIDE} a side; choose a size, or a smaller angle"
        )
    kept, empty = _kept(calibration, new), _empty(calibration, new)
    return Plan(source=calibration, intrinsics=new, kept=kept, empty=empty, cropped_to_deg=cropped)


def _reframed(K: Intrinsics, size: ImageSize) -> Intrinsics:
    """Return K for an image of any aspect ratio: square pixels stay square, and the principal point keeps its place."""
    (w0, h0), (w1, h1) = K.image_size, size
    scale = w1 / w0
    return replace(K, fx=K.fx * scale, fy=K.fy * scale, cx=K.cx * w1 / w0, cy=K.cy * h1 / h0, image_size=size)


def _zoomed(K: Intrinsics, zoom: float) -> Intrinsics:
    return replace(K, fx=K.fx * zoom, fy=K.fy * zoom)


def _resized(K: Intrinsics, zoom: float, *, outwards: bool) -> Intrinsics:
    """Return K for the size that shows, at unchanged focal lengths, what ``zoom`` shows at the same size."""
    whole = math.ceil if outwards else math.floor
    # An excess of a millionth of a pixel does not need another row.
    slack = -ON_THE_EDGE_PX if outwards else ON_THE_EDGE_PX
    width, height = (max(1, whole(side / zoom + slack)) for side in K.image_size)
    return replace(K, cx=K.cx / zoom, cy=K.cy / zoom, image_size=(width, height))


def _zoom(
    calibration: Calibration, start: Intrinsics, alpha: float, max_angle_rad: float
) -> tuple[float, bool]:
    """Return the zoom to apply to ``start``, and whether the camera sees beyond ``max_angle_rad``."""
    K, (width, height) = start, start.image_size
    if not (0 < K.cx < width and 0 < K.cy < height):
        raise FrameError(
            f"the principal point ({K.cx:g}, {K.cy:g}) is outside the {width}×{height} frame, so no zoom about "
            "it keeps the picture; expected the camera's own K"
        )
    outline, is_cropped = _outline(calibration, max_angle_rad)
    keeps_all = _zoom_of_all(outline, K) if alpha > 0 else 1.0
    none_empty = _zoom_of_none_empty(calibration, K, max_angle_rad) if alpha < 1 else 1.0
    zoom = alpha * keeps_all + (1 - alpha) * none_empty
    return (1.0 if abs(zoom - 1) < SAME_ZOOM else zoom), is_cropped


def _outline(calibration: Calibration, max_angle_rad: float) -> tuple[FloatArray, bool]:
    """Return the outline of the visible area within an angle, undistorted, and whether it is cut off."""
    border = calibration.unproject(_border(calibration.intrinsics.image_size))
    shown = border[border[:, 2] >= math.cos(max_angle_rad)]
    lens_ends = known_distortion(calibration).max_angle_rad() * (1 - 1e-9)
    angle = min(max_angle_rad, lens_ends)
    turn = np.linspace(0, 2 * math.pi, RING_SAMPLES, endpoint=False)
    ring = np.column_stack(
        [math.sin(angle) * np.cos(turn), math.sin(angle) * np.sin(turn), np.full_like(turn, math.cos(angle))]
    )
    ring = ring[_inside(calibration.project(ring), calibration.intrinsics.image_size)]
    outline = perspective(np.vstack([shown, ring]))
    if not len(outline):
        raise FrameError(f"the frame shows nothing within {math.degrees(max_angle_rad):g}° of the axis")
    return outline, bool(len(ring)) and angle < lens_ends


def _zoom_of_all(outline: FloatArray, K: Intrinsics) -> float:
    """Return the largest zoom that keeps the whole outline in the image."""
    (width, height), (x, y) = K.image_size, outline.T
    with np.errstate(divide="ignore"):
        limits = [
            np.where(x > 0, width - K.cx, K.cx) / (K.fx * np.abs(x)),
            np.where(y > 0, height - K.cy, K.cy) / (K.fy * np.abs(y)),
        ]
    return float(np.min(limits))


def _zoom_of_none_empty(calibration: Calibration, K: Intrinsics, max_angle_rad: float) -> float:
    """Return the smallest zoom for which every pixel of the image's edge, and so of the image, has content."""
    border, steepest = _border(K.image_size), math.tan(max_angle_rad)

    def is_seen(zoom: float) -> bool:
        rays = pinhole_rays(_zoomed(K, zoom), border)
        if np.hypot(rays[:, 0], rays[:, 1]).max() > steepest:
            return False
        return bool(_inside(calibration.project(rays), calibration.intrinsics.image_size).all())

    high = 1.0
    while not is_seen(high):
        high *= 2
        if high > LARGEST_ZOOM:
            raise FrameError(
                "the camera sees nothing at its own principal point; no zoom leaves no pixel empty"
            )
    low = high / 2
    while is_seen(low):
        low, high = low / 2, low
    for _ in range(ZOOM_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if is_seen(middle) else (middle, high)
    return high


def _kept(calibration: Calibration, K: Intrinsics) -> float:
    with np.errstate(invalid="ignore"):
        x, y = perspective(calibration.unproject(cell_centres(calibration.intrinsics.image_size))).T
    return float(np.mean(_inside(np.column_stack([K.fx * x + K.cx, K.fy * y + K.cy]), K.image_size)))


def _empty(calibration: Calibration, K: Intrinsics) -> float:
    seen_at = calibration.project(pinhole_rays(K, cell_centres(K.image_size)))
    return 1.0 - float(np.mean(_inside(seen_at, calibration.intrinsics.image_size)))


def known_distortion(calibration: Calibration) -> Distortion:
    """Return the distortion of a calibration.

    Raises:
        UnsupportedModelError: the distortion is unknown.
    """
    if calibration.distortion is None:
        raise UnsupportedModelError(
            f"the distortion of {calibration.camera} is unknown, so it cannot be removed; expected a "
            "calibration that states its distortion, also if it is none"
        )
    return calibration.distortion


def pinhole_rays(K: Intrinsics, pixels: FloatArray) -> FloatArray:
    """Return the directions, (N, 3), of pixels, (N, 2), of a pinhole camera without skew."""
    x, y = (pixels[:, 0] - K.cx) / K.fx, (pixels[:, 1] - K.cy) / K.fy
    return np.column_stack([x, y, np.ones_like(x)])


def _inside(pixels: FloatArray, size: ImageSize) -> NDArray[np.bool_]:
    """Return which pixels are in the image; NaN is not."""
    (x, y), (width, height), slack = pixels.T, size, ON_THE_EDGE_PX
    inside: NDArray[np.bool_] = (x >= -slack) & (x <= width + slack) & (y >= -slack) & (y <= height + slack)
    return inside


def _border(size: ImageSize) -> FloatArray:
    """Return points along the outer edge of an image."""
    width, height = size
    across = np.linspace(0, width, min(width, BORDER_SAMPLES) + 1)
    down = np.linspace(0, height, min(height, BORDER_SAMPLES) + 1)
    ends_x, ends_y = np.array([0.0, width]), np.array([0.0, height])
    return np.vstack([grid(across, ends_y), grid(ends_x, down)])


def cell_centres(size: ImageSize) -> FloatArray:
    """Return the centres of the cells of a coarse grid over an image."""
    steps = (np.arange(GRID) + 0.5) / GRID
    return grid(steps * size[0], steps * size[1])


def grid(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return all pairs, (N, 2), row by row."""
    return np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])
