"""Whether a K and its lens can be a camera's, judged without images where they become a Calibration.

What no camera can have is refused unless it is forced. What a camera hardly has, such as a principal point outside the
image, is passed on and told, with the reading of the same numbers that makes a camera of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

from calibrary.arrays import np
from calibrary.calibration import Calibration, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.errors import InputError
from calibrary.policy import FLEET
from calibrary.validation import Finding, Severity

ADMISSION: Final = "admission"
"""Rule of the findings on a K that is hardly, or not, a camera's."""

SHORTEST = 0.05
"""Smallest focal length ÷ longer side; a 220° fisheye circle over a third of the image width has 0.09."""
SHORTEST_PLANE = 0.2
"""The same of a lens that is no fisheye: a field of view of 136 degrees."""
LONGEST = 1000.0
"""Largest focal length ÷ longer side; an 8 m telescope on a full-frame sensor has 222."""
MOST_OBLONG = 4.0
"""Largest ratio of fx and fy; that of the most stretched anamorphic images is 2."""
LEAST_PX = 3.0
"""A principal point within this many px of the corner on both axes is an offset from the centre, or a ratio."""
MOST_MOVED = 0.2
"""Largest displacement by a distortion ÷ longer side, halfway to the corners."""
MOST_TANGENTIAL = 0.03
"""Displacement by tangential terms ÷ longer side, at the corners, from which another order of them is sought."""
FARTHEST = 10.0
"""Largest distance of the principal point from the image centre in image sides, as in a crop of a wide image."""
OFF_CENTRE = 0.1
"""Distance of the principal point from the image centre ÷ side from which another reading of the numbers is sought.

Boards have measured 0.21 in crops, and projectors are shifted by half a side: without such a reading it is no doubt.
"""
CENTRED = 0.06
"""The same of another reading of the numbers, which only a camera has by chance so near."""
SAME_SHARE = 0.15
"""Largest difference of cx / W and cy / H of a K of another image size, of 3:2 for 4:3."""
INNER = 0.75
"""Share of the way to the corners that a lens maps; fits to boards in the middle fold from 0.87 on, and are right."""
MOST_TELE = 10.0
"""Largest focal length ÷ width of another reading of the numbers: a field of view of 6 degrees."""
OBLONG_IMAGE = 2.2
"""Longer side ÷ shorter side of images; wider ones are panoramas."""


def admission(item: Calibration) -> Finding | None:
    """The first reason why K and lens are not, or hardly, a camera's; None if there is none.

    An error is of no camera; what is unproven is unlikely.
    """
    reason = why_implausible(item.intrinsics) or why_no_lens(item)
    if reason is not None:
        remedy = "give --force to take it all the same"
        return Finding(rule=ADMISSION, severity=Severity.ERROR, message=reason, remedy=remedy)
    for reason, twist in _unlikely(item):
        message = reason if twist is None else f"{reason}; {twist}"
        return Finding(rule=ADMISSION, severity=Severity.UNPROVEN, message=message)
    return None


def refuse_implausible(cameras: Sequence[Calibration], source: str) -> None:
    """Refuse a K that no camera can have, or a distortion that no lens has, before it is passed on.

    Raises:
        InputError: one is implausible.
    """
    for item in cameras:
        found = admission(item)
        if found is not None and found.severity is Severity.ERROR:
            raise InputError(f"{found.message}; {found.remedy}", source=source)


def _unlikely(item: Calibration) -> Iterator[tuple[str, str | None]]:
    """What is unlikely, with the other reading of the numbers that makes a camera of them."""
    K, (width, height), lens = item.intrinsics, item.intrinsics.image_size, item.distortion
    twist = next(_twists(K), None)
    is_inside = 0 <= K.cx <= width and 0 <= K.cy <= height
    if not is_inside or (twist is not None and _off_centre(K) > OFF_CENTRE):
        where = f"{_off_centre(K):.0%} of a side from the middle of" if is_inside else "outside"
        yield f"the principal point ({K.cx:.0f}, {K.cy:.0f}) lies {where} {width}×{height}", twist
    apart = abs(K.fx - K.fy) / max(K.fx, K.fy)
    if apart > FLEET.focal_symmetry_max:
        yield f"fx and fy differ by {apart:.2%}, at most {FLEET.focal_symmetry_max:.2%}", twist
    if not isinstance(lens, Omnidirectional) and _folds(item):
        # The corners of a fisheye's image may lie outside its circle.
        yield "the distortion folds the image back three quarters of the way to its corners", None
    if isinstance(lens, OpenCVDistortion | NoDistortion) and K.fx < SHORTEST_PLANE * width:
        degrees = 2 * math.degrees(math.atan(width / 2 / K.fx))
        yield (
            f"fx = {K.fx / width:.3f} W is a field of view of {degrees:.0f}°, and the lens is no fisheye",
            None,
        )


def _folds(item: Calibration) -> bool:
    if item.distortion is None:
        return False
    K, (width, height) = item.intrinsics, item.intrinsics.image_size
    corners, centre = np.array([[0, 0], [width, 0], [0, height], [width, height]]), np.array([K.cx, K.cy])
    return bool(np.isnan(item.unproject(centre + INNER * (corners - centre))).any())


def _off_centre(K: Intrinsics) -> float:
    width, height = K.image_size
    return max(abs(K.cx / width - 0.5), abs(K.cy / height - 0.5))


def _twists(K: Intrinsics) -> Iterator[str]:
    """Other readings of the numbers that make a camera of them, likeliest first."""
    width, height = K.image_size
    whole = (2 * round(K.cx), 2 * round(K.cy))
    readings = [
        ((K.fx, K.fy, K.cx, K.cy), (height, width), f"it fits {height}×{width}: the sides are exchanged"),
        ((K.fx, K.cx, K.fy, K.cy), (width, height), "its numbers fit as fx, cx, fy, cy"),
        ((K.cx, K.cy, K.fx, K.fy), (width, height), "its numbers fit as cx, cy, fx, fy"),
        (
            (K.fx, K.fy, K.cx + width / 2, K.cy + height / 2),
            (width, height),
            "it fits if the principal point is counted from the middle",
        ),
    ]
    is_inside = 0 <= K.cx <= width and 0 <= K.cy <= height
    if not is_inside or abs(K.cx / width - K.cy / height) <= SAME_SHARE * K.cy / height:
        readings.append(((K.fx, K.fy, K.cx, K.cy), whole, f"it fits {whole[0]}×{whole[1]}"))
    for (fx, fy, cx, cy), size, told in readings:
        if min(fx, fy, *size) > 0 and max(size) <= OBLONG_IMAGE * min(size):
            read = Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, image_size=size)
            is_usual = FLEET.focal_symmetry_max >= abs(fx - fy) / max(fx, fy)
            is_usual = is_usual and SHORTEST_PLANE <= fx / size[0] <= MOST_TELE
            if is_usual and _off_centre(read) <= CENTRED:
                yield told


def why_implausible(K: Any) -> str | None:
    """Reason why a K cannot be that of a camera, in words; None if it can.

    Args:
        K: of a file that may lack an image size, and what depends on it.
    """
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
    fifth of it; real lenses reach an eighth. At the corners themselves a polynomial that was fitted to points nearer
    the middle may do anything. A solver finds both tangential terms or none: a zero where only another order of the
    coefficients has one is that order's.

    Tangential terms are small beside k3. Where k1 k2 k3 p1 p2 stand for k1 k2 p1 p2 k3, the largest of the three is
    read as a tangential term. Of 345 cameras in public files 19 have tangential terms that move a corner by over 3 %,
    up to 13 %, because views were few or the principal point was fixed; in each k3 is larger, or there is none. Where
    k3 is as small as the tangential terms of real lenses, both readings are lenses, and nothing tells them apart.
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
    p1, p2, k3 = (abs(lens.coefficients.get(name, 0.0)) for name in ("p1", "p2", "k3"))
    if isinstance(lens, BrownConrady) and ((p2 and k3 and not p1) or (p1 and not (p2 or k3))):
        return _no_lens(lens, f"has p1 {lens.p1:g}, p2 {lens.p2:g} and k3 {lens.k3:g}")
    moved = 3 * max(p1, p2) * np.square(corners).sum(axis=1).max() * focals.max()
    if moved > (MOST_TANGENTIAL if 0 < k3 < max(p1, p2) else MOST_MOVED) * max(K.image_size):
        return _no_lens(lens, f"moves a pixel by {moved:.3g} px by its tangential terms p1 and p2")
    return None


def _no_lens(lens: Distortion, why: str) -> str:
    return (
        f"a distortion ({lens.model}) that {why} is that of no lens: its coefficients are perhaps in another order "
        "or unit"
    )


def _longer_side(K: Any) -> float | None:
    """Longer side of the image; without an image size, estimated from the principal point."""
    if K.image_size is not None:
        return float(max(K.image_size))
    return None if K.cx is None or K.cy is None else 2.0 * float(max(K.cx, K.cy))
