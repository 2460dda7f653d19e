"""The intrinsics: the parameters of K and the image size they refer to."""

from __future__ import annotations

import math
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray
from calibrary.errors import FrameError, InputError
from calibrary.image_size import ImageSize, same_aspect
from calibrary.records import Meta, Record, force_setattr, replace

__all__ = ["Box", "Intrinsics"]

Box: TypeAlias = tuple[float, float, int, int]
"""(left, top, width, height) px, in the image to be cropped."""


class Intrinsics(Record, tag_field="pixel_origin", tag="corner"):
    """The parameters of K and the image size they refer to.

    Attributes:
        fx, fy: focal lengths in px, positive.
        cx, cy: principal point in px from the outer corner of the top-left pixel.
        skew: K[0, 1] in px; zero for every digital camera except scanners.
        image_size: (width, height) px.

    Raises:
        InputError: a parameter is not finite, or a focal length or a side of the image is not positive.

    >>> K = calibrary.Intrinsics(fx=3659.5, fy=3655.0, cx=2731.75, cy=1846.5, image_size=(5472, 3648))
    >>> K.scaled((2736, 1824)).fx
    1829.75
    """

    fx: Annotated[float, Meta(gt=0)]
    fy: Annotated[float, Meta(gt=0)]
    cx: float
    cy: float
    skew: float = 0.0
    image_size: ImageSize

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy", "skew"):
            value = float(getattr(self, name))
            if not math.isfinite(value):
                raise InputError(f"{name} is {value}, expected a finite number of pixels")
            force_setattr(self, name, value)
        if self.fx <= 0 or self.fy <= 0:
            raise InputError(f"focal lengths are {self.fx:g} and {self.fy:g} px, expected positive ones")
        force_setattr(self, "image_size", _whole(self.image_size))

    @property
    def matrix(self) -> FloatArray:
        """K, (3, 3) float64, in the canonical pixel origin."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, image_size: ImageSize) -> Intrinsics:
        """Make the intrinsics from a K in the canonical pixel origin.

        Args:
            matrix: (3, 3), upper triangular; it is divided by its element K[2, 2].
            image_size: (width, height) px of the image that K refers to.

        Raises:
            InputError: K has the wrong shape, is not finite, or is not an intrinsic matrix.
        """
        K = np.asarray(matrix, dtype=np.float64)
        if K.shape != (3, 3):
            raise InputError(f"K has shape {K.shape}, expected (3, 3)")
        if not np.isfinite(K).all():
            raise InputError("K contains NaN or infinity, expected nine finite numbers")
        if K[2, 2] == 0 or K[1, 0] != 0 or K[2, 0] != 0 or K[2, 1] != 0:
            raise InputError(f"K is not upper triangular with K[2, 2] ≠ 0: {K.tolist()}")
        K = K / K[2, 2]
        return cls(fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2], skew=K[0, 1], image_size=image_size)

    def scaled(self, size: ImageSize) -> Intrinsics:
        """Return the intrinsics for the image resized to ``size``.

        Raises:
            FrameError: the aspect ratios differ by more than 1 %, so ``size`` is a crop, not a resize.
            InputError: ``size`` is not two positive integers.
        """
        size = _whole(size)
        (w0, h0), (w1, h1) = self.image_size, size
        if not same_aspect(self.image_size, size):
            raise FrameError(
                f"a {w0}×{h0} frame cannot be scaled to {w1}×{h1}: their aspect ratios differ by over 1 %; "
                "crop it first"
            )
        sx, sy = w1 / w0, h1 / h0
        return Intrinsics(
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=self.cx * sx,
            cy=self.cy * sy,
            skew=self.skew * sx,
            image_size=size,
        )

    def cropped(self, box: Box) -> Intrinsics:
        """Return the intrinsics for the crop ``box`` = (left, top, width, height) of the image.

        Raises:
            FrameError: the box is empty or extends beyond the image.
        """
        left, top, width, height = box
        w0, h0 = self.image_size
        if width <= 0 or height <= 0 or left < 0 or top < 0 or left + width > w0 or top + height > h0:
            raise FrameError(
                f"a {w0}×{h0} frame has no part {width}×{height} at ({left:g}, {top:g}); "
                "expected a box inside the frame"
            )
        return replace(self, cx=self.cx - left, cy=self.cy - top, image_size=(width, height))


def _whole(size: ImageSize) -> ImageSize:
    """Return ``size`` as two ints; raise InputError if it is not an image size."""
    width, height = size
    if not (math.isfinite(width) and math.isfinite(height)) or width % 1 or height % 1 or min(size) <= 0:
        raise InputError(f"image size is {width}×{height}, expected whole positive numbers of pixels")
    return int(width), int(height)
