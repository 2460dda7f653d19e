"""OpenCV's distortion coefficients: the model that a number of coefficients means, and the coefficients of a lens.

The order is ``k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [τx τy]]]]`` for ``cv2``'s perspective functions and
``k1 k2 k3 k4`` for ``cv2.fisheye``.

Source: OpenCV, "Camera Calibration and 3D Reconstruction" and "Fisheye camera model".
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from calibrary.arrays import ArrayLike, FloatArray, np
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
    exact,
)
from calibrary.errors import InputError, UnsupportedModelError

OPENCV_MODELS: Final[Mapping[int, type[Distortion]]] = MappingProxyType(
    {4: BrownConrady, 5: BrownConrady, 8: Rational, 12: ThinPrism, 14: Tilted}
)
"""Model that cv2's perspective functions use, by number of coefficients."""

OPENCV_LENSES: Final[tuple[type[Distortion], ...]] = (
    NoDistortion,
    BrownConrady,
    Rational,
    ThinPrism,
    Tilted,
    KannalaBrandt,
)
"""Lens models of OpenCV, simplest first; the last is that of ``cv2.fisheye``."""


def lens_from(coefficients: ArrayLike, *, fisheye: bool = False) -> Distortion:
    """Make the lens that OpenCV's coefficients describe.

    Args:
        coefficients: in OpenCV's order, (N,), (N, 1) or (1, N); N = 0 is a lens without distortion.
        fisheye: whether they are the 4 coefficients of ``cv2.fisheye``.

    Raises:
        InputError: OpenCV has no model with this number of coefficients, or they are not finite numbers.
    """
    try:
        values = np.asarray(coefficients, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("the distortion coefficients are not an array of numbers") from None
    if values.ndim > 2 or (values.ndim == 2 and 1 not in values.shape and values.size):
        raise InputError(
            f"the distortion coefficients have shape {values.shape}, expected one row or one column"
        )
    given = values.ravel().tolist()
    if fisheye:
        if len(given) != 4:
            raise InputError(f"{len(given)} coefficients of a fisheye, expected cv2.fisheye's k1 k2 k3 k4")
        return KannalaBrandt(**dict(zip(KannalaBrandt.names(), given, strict=True)))
    if not given:
        return NoDistortion()
    if len(given) not in OPENCV_MODELS:
        counts = ", ".join(map(str, OPENCV_MODELS))
        raise InputError(f"{len(given)} distortion coefficients, OpenCV has models of 0, {counts}")
    kind = OPENCV_MODELS[len(given)]
    lens = kind(**dict(zip(kind.names(), given, strict=False)))
    return lens if any(given) else NoDistortion()


def coefficients_of(lens: Distortion) -> FloatArray:
    """A lens's coefficients in OpenCV's order.

    Returns:
        (5,), (8,), (12,) or (14,) for cv2's perspective functions, the fewest that represent the lens exactly;
        (4,) only for ``cv2.fisheye``.

    Raises:
        UnsupportedModelError: no OpenCV model represents the lens exactly.
    """
    # A lens that is already one of OpenCV's models keeps its number of coefficients, even if higher terms are zero.
    for kind in (type(lens),) if type(lens) in OPENCV_LENSES else OPENCV_LENSES:
        same = exact(lens, kind)
        if same is not None:
            return np.array(list(same.coefficients.values())) if same.names() else np.zeros(5)
    raise UnsupportedModelError(
        f"OpenCV has no model that is exactly {lens.model!r}; calibrary.refit(camera, 'opencv', max_error_px=…) gives "
        "the nearest one it has, and camera.project and camera.unproject need none"
    )
