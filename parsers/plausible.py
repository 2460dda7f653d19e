"""Check whether numbers can be the K of a camera: files of equal structure may contain millimetres or ratios."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrary.calibration import Calibration, Intrinsics
from calibrary.distortion import BrownConrady, Distortion
from calibrary.errors import InputError
from calibrary.parsers.unsized import UnsizedIntrinsics

SHORTEST = 0.05
"""Smallest focal length ÷ longer side; a 220° fisheye circle over a third of the image width has 0.09."""
LONGEST = 1000.0
"""Largest focal length ÷ longer side; an 8 m telescope on a full-frame sensor has 222."""
MOST_OBLONG = 4.0
"""Largest ratio of fx and fy; that of the most stretched anamorphic images is 2."""
LEAST_PX = 3.0
"""A principal point within this many px of the corner on both axes is an offset from the centre, or a ratio."""
MOST_MOVED = 0.2
"""Largest displacement by a distortion ÷ longer side, halfway to the corners."""
MOST_TANGENTIAL = 0.026
"""Largest displacement by tangential terms ÷ longer side, at the corners."""
FARTHEST = 10.0
"""Largest distance of the principal point from the image centre in image sides, as in a crop of a wide image."""


def why_implausible(K: Intrinsics | UnsizedIntrinsics) -> str | None:
    """Reason why a K cannot be that of a camera, in words; None if it can."""
    side = _longer_side(K)
    cx, cy = K.cx, K.cy
    if K.fx is None or K.fy is None or side is None:
        return None
    shorter, longer = sorted((K.fx, K.fy))
    of_images = "" if K.image_size is None else f" of images of {K.image_size[0]}×{K.image_size[1]} px"
    if shorter < SHORTEST * side:
        return (
            f"a focal length of {shorter:.4g} px{of_images} is that of no camera: it is {shorter / side:.2g} of the "
            "image's side, so its unit is perhaps mm, or it is a ratio"
        )
    if longer > LONGEST * side:
        return f"a focal length of {longer:.4g} px{of_images}, {longer / side:.2g} image sides, is that of no camera"
    if longer > MOST_OBLONG * shorter:
        return f"fx {K.fx:.4g} and fy {K.fy:.4g} px differ as no camera's do"
    if cx is None or cy is None or K.image_size is None:
        return None
    if max(abs(cx), abs(cy)) <= LEAST_PX:
        return (
            f"the principal point ({cx:.3g}, {cy:.3g}) px is the image's corner, so it is perhaps an offset from the "
            "middle, or in another unit"
        )
    if max(abs(cx - K.image_size[0] / 2), abs(cy - K.image_size[1] / 2)) > FARTHEST * side:
        return f"the principal point ({cx:.4g}, {cy:.4g}) px is far outside{of_images or ' the image'}"
    return None


def why_no_lens(calibration: Calibration) -> str | None:
    """Reason why a distortion cannot be that of a lens, in words; None if it can.

    Halfway from the principal point to the corners and the sides no lens folds an image back, or moves a pixel by a
    fifth of it, and at the corners no tangential terms move one by 2.6 %. Real lenses reach an eighth and 2.4 %. At the
    corners themselves a polynomial that was fitted to points nearer the middle may do anything. A solver finds both
    tangential terms or none: a zero where only another order of the coefficients has one is that order's.

    Where k1 k2 k3 p1 p2 stand for k1 k2 p1 p2 k3 and k3 is as small as the tangential terms of real lenses, both
    readings are lenses, and nothing tells them apart.
    """
    K, lens = calibration.intrinsics, calibration.distortion
    if lens is None:
        return None
    (width, height), focals = K.image_size, np.array([K.fx, K.fy])
    corners = (
        np.array([[x, y] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)]) * [width, height] / focals
    )
    halfway = corners / 2
    with np.errstate(all="ignore"):
        moved = np.abs((lens.distort(halfway) - halfway) * focals).max()
    if not moved <= MOST_MOVED * max(K.image_size):
        far = "folds the image back" if np.isnan(moved) else f"moves a pixel by {moved:.3g} px"
        return _no_lens(lens, f"{far} halfway to the image's corners")
    if isinstance(lens, BrownConrady) and (
        (lens.p2 and lens.k3 and not lens.p1) or (lens.p1 and not (lens.p2 or lens.k3))
    ):
        return _no_lens(lens, f"has p1 {lens.p1:g}, p2 {lens.p2:g} and k3 {lens.k3:g}")
    tangential = [abs(lens.coefficients.get(name, 0.0)) for name in ("p1", "p2")]
    reach = float(np.square(corners).sum(axis=1).max()) * max(K.fx, K.fy)
    if 3 * max(tangential) * reach > MOST_TANGENTIAL * max(K.image_size):
        return _no_lens(
            lens, f"moves a pixel by {3 * max(tangential) * reach:.3g} px by its tangential terms p1 and p2"
        )
    return None


def _no_lens(lens: Distortion, why: str) -> str:
    return (
        f"a distortion ({lens.model}) that {why} is that of no lens: its coefficients are perhaps in another order "
        "or unit"
    )


def refuse_implausible(cameras: Sequence[Calibration], source: str) -> None:
    """Refuse a K that no camera can have, or a distortion that no lens has, before it is passed on.

    Raises:
        InputError: one is implausible.
    """
    for item in cameras:
        reason = why_implausible(item.intrinsics) or why_no_lens(item)
        if reason is not None:
            raise InputError(f"{reason}; give --force to take it all the same", source=source)


def _longer_side(K: Intrinsics | UnsizedIntrinsics) -> float | None:
    """Longer side of the image; without an image size, estimated from the principal point."""
    if K.image_size is not None:
        return float(max(K.image_size))
    if K.cx is None or K.cy is None:
        return None
    return 2 * max(K.cx, K.cy)
