"""The lens models' geometry, compiled where the installation had a compiler; NumPy's formulas stay the reference.

>>> kernel.compiled
True

A model says by its :class:`Form` that it is one of the maps of ``_kernel.c``; :func:`planned` puts the numbers where
the C code reads them. What the compiled code cannot answer with certainty it leaves out, and the caller asks the model:
an installation without it has the same answers, to rounding, later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import TypeAlias

from msgspec import Struct

from calibrary.arrays import FloatArray, NDArray, np

try:
    from calibrary.kernel import _kernel
except ImportError:  # A pure wheel, or an installation without a compiler.
    _layout: int | None = None
else:
    _layout = _kernel.LAYOUT

__all__ = ["Form", "Front", "Where", "compiled", "mapped", "planned", "project", "unproject"]

SIZE = 40
LAYOUT = 1
"""The order of the numbers of a plan, as in ``_kernel.c``: a library that was compiled for another one is not used."""

compiled = _layout == LAYOUT
"""Whether the compiled code is in use."""


class Front(IntEnum):
    """How a direction gets to the plane."""

    PERSPECTIVE = 0
    ANGLE = 1
    UNIFIED = 2
    EUCM = 3
    DOUBLE_SPHERE = 4
    DIVISION = 5


class Form(Struct, frozen=True):
    """A lens as ``_kernel.c`` takes it.

    Attributes:
        front: how a direction gets to the plane.
        shape: coefficients of ``front``: of θ³, θ⁵, …, or ξ, alpha and beta, k.
        limit: the angle from the axis, rad, from which there is no image; for ``Front.ANGLE``.
        radius: of the disc in the plane, from which there is no image.
        numerator, denominator: of the radial factor, constant term first.
        tangential: p1, p2.
        prism: s1, s2, s3, s4.
        growth: of the tangential terms, t2 and t4.
        affinity: b1, b2.
    """

    front: Front = Front.PERSPECTIVE
    shape: tuple[float, ...] = ()
    limit: float = math.pi
    radius: float = math.inf
    numerator: Sequence[float] = (1.0,)
    denominator: Sequence[float] = (1.0,)
    tangential: tuple[float, float] = (0.0, 0.0)
    prism: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    growth: tuple[float, float] = (0.0, 0.0)
    affinity: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.numerator) > 7 or len(self.denominator) > 4 or len(self.shape) > 6:
            raise ValueError("a lens has more terms than the compiled code; its form is None")

    @property
    def plane(self) -> int:
        """The number of the map in the plane: none, radial, Brown's, or the one with all terms."""
        if len(self.numerator) > 4 or len(self.denominator) > 1 or any((*self.prism, *self.affinity)):
            return 3
        if any(self.tangential):
            return 3 if any(self.growth) else 2
        return 1 if len(self.numerator) > 1 else 0


def planned(form: Form, K: tuple[float, float, float, float, float]) -> FloatArray:
    """Return the (SIZE,) numbers of a camera; ``K`` is fx, fy, cx, cy, skew in px."""
    plan = np.zeros(SIZE)
    plan[0], plan[1], plan[2:7] = form.front, form.plane, K
    plan[7], plan[8] = form.radius * form.radius, form.limit
    plan[9 : 8 + len(form.numerator)] = form.numerator[1:]
    plan[15 : 14 + len(form.denominator)] = form.denominator[1:]
    plan[18:28] = *form.tangential, *form.prism, *form.growth, *form.affinity
    plan[28 : 28 + len(form.shape)] = form.shape
    # Where a start beyond the limit would not come back.
    plan[34] = 0.999 * form.limit
    return plan


def project(plan: FloatArray, rays: FloatArray) -> tuple[FloatArray, int]:
    """(N, 3) directions to (N, 2) px; NaN, and counted, where the model has to decide."""
    pixels = np.empty((len(rays), 2))
    return pixels, _kernel.project(plan, _laid(rays), pixels)


def unproject(plan: FloatArray, pixels: FloatArray) -> tuple[FloatArray, int]:
    """(N, 2) px to (N, 3) unit directions; NaN, and counted, where the model has to decide."""
    rays = np.empty((len(pixels), 3))
    return rays, _kernel.unproject(plan, _laid(pixels), rays)


def _laid(rows: FloatArray) -> FloatArray:
    """The rows as C reads them; rows of a file or a packet may lie at any byte."""
    return rows if rows.flags.c_contiguous and rows.flags.aligned else np.array(rows, order="C")


Where: TypeAlias = "tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]"
"""x and y, (H, W) px from the centre of the first pixel: position of each pixel of one image in another, −1 where it
has none; and whether it has one."""


def mapped(
    plan: FloatArray,
    pinhole: Sequence[float],
    rows: slice,
    width: int,
    into: tuple[int, int],
    slack: float,
) -> Where:
    """Map rows of a pinhole's image into the image of a camera.

    Args:
        plan: the camera.
        pinhole: fx, fy, cx, cy of the other image, px.
        rows: rows of the other image.
        width: its width, px.
        into: (width, height) px of the camera's image.
        slack: how far beyond the edge still counts as on it, px.
    """
    shape = (rows.stop - rows.start, width)
    x, y, seen = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.bool_)
    fx, fy, cx, cy = pinhole
    numbers = np.array([1.0 / fx, 1.0 / fy, cx, cy, slack])
    _kernel.map(plan, numbers, rows.start, *shape, float(into[0]), float(into[1]), x, y, seen)
    return x, y, seen
