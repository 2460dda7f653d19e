"""The K of an undistorted picture.

It is one of a family: the camera's own, without skew, its focal lengths multiplied by one *zoom* while the principal
point keeps its place in the frame. One number then settles what is kept: the largest zoom that loses no pixel
(``alpha`` 1), or the smallest that leaves no pixel empty (``alpha`` 0, as OpenCV's ``alpha``).
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

__all__ = [
    "MAX_ANGLE_DEG",
    "MAX_SIDE",
    "ON_THE_EDGE_PX",
    "Plan",
    "cell_centres",
    "grid",
    "known_distortion",
    "pinhole_rays",
    "plan",
]

MAX_ANGLE_DEG = 80.0
"""A plane shows less than 90° off the axis, and at 80° already stretches a pixel to six by thirty-three."""

MAX_SIDE = 32_766
"""OpenCV's remap counts pixels in 16 bits."""

BORDER_SAMPLES = 1024
RING_SAMPLES = 720
GRID = 64

ON_THE_EDGE_PX = 1e-6
SAME_ZOOM = 1e-6
ZOOM_STEPS = 40
LARGEST_ZOOM = 2**20


class Plan(Struct, frozen=True, kw_only=True):
    """The camera that an undistorted picture is of.

    Attributes:
        source: the camera as it is, in the frame of the pictures to undistort.
        intrinsics: K of the undistorted picture.
        kept: the part of the picture's pixels that are in the undistorted one, 0 … 1.
        empty: the part of the undistorted picture that shows nothing, 0 … 1.
        cropped_to_deg: the full angle of view that was kept of a camera that sees more than a plane can show.
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
    """Choose the K of the undistorted picture.

    Args:
        calibration: in the frame of the pictures; its distortion is known.
        alpha: None for the camera's own K; 1 keeps every pixel, 0 leaves none empty, and between them.
        size: (width, height) px of the undistorted picture; as the camera's when None.
        same_focal: keep the focal lengths, and with them the resolution, and let the size follow.
        max_angle_deg: how far off the axis ``alpha`` looks.

    Raises:
        UnsupportedModelError: the distortion is unknown.
        InputError: an argument is out of range, or the picture would be larger than 32 766 px a side.
        FrameError: the camera's own K is asked for in a frame of another shape, or its principal point is
            outside the frame, so that no zoom about it can be chosen.
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
    """K for a frame of any shape: pixels stay as square as they are, the principal point where it is."""
    (w0, h0), (w1, h1) = K.image_size, size
    scale = w1 / w0
    return replace(K, fx=K.fx * scale, fy=K.fy * scale, cx=K.cx * w1 / w0, cy=K.cy * h1 / h0, image_size=size)


def _zoomed(K: Intrinsics, zoom: float) -> Intrinsics:
    return replace(K, fx=K.fx * zoom, fy=K.fy * zoom)


def _resized(K: Intrinsics, zoom: float, *, outwards: bool) -> Intrinsics:
    """The frame that shows at the same focal lengths what ``zoom`` shows in the same frame."""
    whole = math.ceil if outwards else math.floor
    # A millionth of a pixel over is no reason for another row.
    slack = -ON_THE_EDGE_PX if outwards else ON_THE_EDGE_PX
    width, height = (max(1, whole(side / zoom + slack)) for side in K.image_size)
    return replace(K, cx=K.cx / zoom, cy=K.cy / zoom, image_size=(width, height))


def _zoom(
    calibration: Calibration, start: Intrinsics, alpha: float, max_angle_rad: float
) -> tuple[float, bool]:
    """By how much ``start`` is to be zoomed, and whether the camera sees further than ``max_angle_rad``."""
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
    """The edge, in undistorted coordinates, of what the frame shows within an angle, and whether it shows more."""
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
    """The largest zoom that leaves the whole outline in the frame."""
    (width, height), (x, y) = K.image_size, outline.T
    with np.errstate(divide="ignore"):
        limits = [
            np.where(x > 0, width - K.cx, K.cx) / (K.fx * np.abs(x)),
            np.where(y > 0, height - K.cy, K.cy) / (K.fy * np.abs(y)),
        ]
    return float(np.min(limits))


def _zoom_of_none_empty(calibration: Calibration, K: Intrinsics, max_angle_rad: float) -> float:
    """The smallest zoom at which every pixel of the frame's edge, and so of the frame, was seen."""
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
    """The distortion of a calibration.

    Raises:
        UnsupportedModelError: it is unknown.
    """
    if calibration.distortion is None:
        raise UnsupportedModelError(
            f"the distortion of {calibration.camera} is unknown, so it cannot be removed; expected a "
            "calibration that states its distortion, also if it is none"
        )
    return calibration.distortion


def pinhole_rays(K: Intrinsics, pixels: FloatArray) -> FloatArray:
    """(N, 3) directions that a pinhole without skew sees at (N, 2) pixels."""
    x, y = (pixels[:, 0] - K.cx) / K.fx, (pixels[:, 1] - K.cy) / K.fy
    return np.column_stack([x, y, np.ones_like(x)])


def _inside(pixels: FloatArray, size: ImageSize) -> NDArray[np.bool_]:
    """Which pixels are in the frame; NaN is not."""
    (x, y), (width, height), slack = pixels.T, size, ON_THE_EDGE_PX
    inside: NDArray[np.bool_] = (x >= -slack) & (x <= width + slack) & (y >= -slack) & (y <= height + slack)
    return inside


def _border(size: ImageSize) -> FloatArray:
    """Points along the outer edge of a frame."""
    width, height = size
    across = np.linspace(0, width, min(width, BORDER_SAMPLES) + 1)
    down = np.linspace(0, height, min(height, BORDER_SAMPLES) + 1)
    ends_x, ends_y = np.array([0.0, width]), np.array([0.0, height])
    return np.vstack([grid(across, ends_y), grid(ends_x, down)])


def cell_centres(size: ImageSize) -> FloatArray:
    """The middles of the cells when a frame is cut into a coarse grid."""
    steps = (np.arange(GRID) + 0.5) / GRID
    return grid(steps * size[0], steps * size[1])


def grid(x: FloatArray, y: FloatArray) -> FloatArray:
    """(N, 2) of all pairs, row by row."""
    return np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])
