"""Undistortion of images: pictures as a pinhole camera would have taken them.

Each pixel of the new image is projected to the original one by the camera's own model
(:meth:`~calibrary.calibration.Calibration.project`), so the maps are as exact as the model. The compiled code makes
them for most models; without it OpenCV does for its own, where they are monotonic. OpenCV interpolates the pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary import kernel
from calibrary.calib.undistort_plan import (
    ON_THE_EDGE_PX,
    Plan,
    cell_centres,
    grid,
    known_distortion,
    pinhole_rays,
)
from calibrary.calibration import Calibration, Intrinsics, plan_of
from calibrary.distortion.base import blocks
from calibrary.errors import FrameError, UnsupportedModelError

Pixels: TypeAlias = NDArray[Any]
"""(H, W) or (H, W, channels), 8 or 16 bits or floating point."""

_Where: TypeAlias = tuple[NDArray[np.float32], NDArray[np.float32]]
"""x and y, (H, W) px from the centre of the first pixel: position of each pixel of one image in another."""

STRIP_PIXELS = 1 << 22
CACHED_PIXELS = 1 << 26
"""Maps with up to this many pixels (half a gigabyte) are kept for the next image."""


class Interpolation(StrEnum):
    """Interpolation between pixels."""

    NEAREST = "nearest"
    LINEAR = "linear"
    CUBIC = "cubic"
    LANCZOS = "lanczos"


class Undistorter:
    """Undistorts images of one camera; the maps are computed once."""

    def __init__(self, plan: Plan, *, interpolation: Interpolation = Interpolation.CUBIC) -> None:
        self.plan = plan
        self.interpolation = interpolation
        shrunk = 1 if interpolation is Interpolation.NEAREST else _shrinkage(plan)
        width, height = plan.source.intrinsics.image_size
        self._size = (max(1, width // shrunk), max(1, height // shrunk))
        self._source = plan.source if shrunk == 1 else plan.source.scaled(self._size)
        width, height = plan.intrinsics.image_size
        self._cache: list[_Map] | None = [] if width * height <= CACHED_PIXELS else None

    def maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the position of every pixel of the new image in the original one, as ``cv2.remap`` takes it.

        Returns:
            x and y, (H, W) px from the centre of the top-left pixel; −1 where the camera has no ray. If the new image
            is much smaller, they refer to the original one reduced by an integer.
        """
        first, *others = self._maps()
        if not others:
            return first.x, first.y
        return np.vstack([first.x, *(part.x for part in others)]), np.vstack(
            [first.y, *(part.y for part in others)]
        )

    def mask(self) -> NDArray[np.uint8]:
        """Return (H, W): 255 where the undistorted image has content, 0 where it is empty."""
        return np.vstack([part.seen for part in self._maps()]).astype(np.uint8) * np.uint8(255)

    def __call__(self, pixels: Pixels) -> Pixels:
        """Undistort one image; empty pixels are 0 in every channel, including alpha.

        Args:
            pixels: the image as stored, with the size of ``plan.source``.

        Raises:
            FrameError: the image has another size.
        """
        import cv2

        height, width = pixels.shape[:2]
        if (width, height) != self.plan.source.intrinsics.image_size:
            wanted = "{}×{}".format(*self.plan.source.intrinsics.image_size)
            raise FrameError(f"the picture is {width}×{height} px, expected {wanted}")
        if (width, height) != self._size:
            pixels = cv2.resize(pixels, self._size, interpolation=cv2.INTER_AREA)
        how = {
            Interpolation.NEAREST: cv2.INTER_NEAREST,
            Interpolation.LINEAR: cv2.INTER_LINEAR,
            Interpolation.CUBIC: cv2.INTER_CUBIC,
            Interpolation.LANCZOS: cv2.INTER_LANCZOS4,
        }[self.interpolation]
        width, height = self.plan.intrinsics.image_size
        result = np.empty((height, width, *pixels.shape[2:]), pixels.dtype)
        for part in self._maps():
            # Replicate the edge pixels; otherwise cubic interpolation would produce a dark line along the edge.
            strip = cv2.remap(pixels, part.x, part.y, how, borderMode=cv2.BORDER_REPLICATE)
            result[part.rows] = strip
            result[part.rows][~part.seen] = 0
        return result

    def _maps(self) -> Iterator[_Map]:
        if self._cache:
            yield from self._cache
            return
        made = []
        width, height = self.plan.intrinsics.image_size
        # Only formulas of arrays, and OpenCV's, need much memory besides the map.
        swift = kernel.compiled and plan_of(self._source.intrinsics, self._source.distortion) is not None
        whole = swift and self._cache is not None
        for rows in blocks(height, height if whole else max(1, STRIP_PIXELS // width)):
            part = _map(self._source, self.plan.intrinsics, rows)
            if self._cache is not None:
                made.append(part)
            yield part
        if self._cache is not None:
            self._cache = made


class _Map(Struct, frozen=True):
    """Some rows of a map."""

    rows: slice
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    seen: NDArray[np.bool_]


def _map(source: Calibration, K: Intrinsics, rows: slice) -> _Map:
    if kernel.compiled and (plan := plan_of(source.intrinsics, source.distortion)) is not None:
        pinhole, (width, _) = (K.fx, K.fy, K.cx, K.cy), K.image_size
        return _Map(
            rows, *kernel.mapped(plan, pinhole, rows, width, source.intrinsics.image_size, ON_THE_EDGE_PX)
        )
    x, y = _opencv_map(source, K, rows) or _own_map(source, K, rows)
    (width, height), slack = source.intrinsics.image_size, ON_THE_EDGE_PX
    # Relative to the first pixel's centre; NaN positions are empty.
    seen = (
        (x >= -0.5 - slack) & (x <= width - 0.5 + slack) & (y >= -0.5 - slack) & (y <= height - 0.5 + slack)
    )
    x[~seen] = y[~seen] = -1.0
    return _Map(rows, x, y, seen)


def _opencv_map(source: Calibration, K: Intrinsics, rows: slice) -> _Where | None:
    """Return OpenCV's map; None for other lens models, or where the lens model is not monotonic in the image."""
    import cv2

    lens = known_distortion(source)
    width, height = K.image_size
    corners = pinhole_rays(K, np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]))
    if np.arctan(np.hypot(corners[:, 0], corners[:, 1])).max() >= lens.max_angle_rad():
        return None
    try:
        camera, coefficients = source.to_opencv()
    except UnsupportedModelError:
        return None
    cx, cy = K.cx - 0.5, K.cy - 0.5 - rows.start
    new = np.array([[K.fx, 0.0, cx], [0.0, K.fy, cy], [0.0, 0.0, 1.0]])
    size = (width, rows.stop - rows.start)
    # Four coefficients are always those of cv2.fisheye.
    fisheye = coefficients is not None and len(coefficients) == 4
    make = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
    x, y = make(camera, coefficients, np.eye(3), new, size, cv2.CV_32FC1)
    return np.asarray(x, np.float32), np.asarray(y, np.float32)


def _own_map(source: Calibration, K: Intrinsics, rows: slice) -> _Where:
    """Return the map for any lens; NaN where the camera has no ray."""
    columns = np.arange(K.image_size[0], dtype=np.float64)
    lines = np.arange(rows.start, rows.stop, dtype=np.float64)
    pixels = grid(columns + 0.5, lines + 0.5)
    shape = (rows.stop - rows.start, K.image_size[0])
    # OpenCV's origin is the centre of the first pixel.
    x, y = (source.project(pinhole_rays(K, pixels)) - 0.5).astype(np.float32).T
    return x.reshape(shape).copy(), y.reshape(shape).copy()


def _shrinkage(plan: Plan) -> int:
    """Return the integer by which the original can be reduced and still be finer than the new image everywhere."""
    pixels, step = cell_centres(plan.intrinsics.image_size), 0.5
    right, down = (
        plan.source.project(pinhole_rays(plan.intrinsics, pixels + shift))
        - plan.source.project(pinhole_rays(plan.intrinsics, pixels - shift))
        for shift in (np.array([step, 0.0]), np.array([0.0, step]))
    )
    lengths = np.minimum(np.hypot(*right.T), np.hypot(*down.T))
    lengths = lengths[np.isfinite(lengths)]
    return max(1, int(lengths.min() + ON_THE_EDGE_PX)) if len(lengths) else 1
