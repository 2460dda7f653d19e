"""Detect what a camera did to its images before writing them: distortion removed or present, digital zoom, crop.

Tags and catalogue describe a lens and a sensor, but the pixels may show another camera. Each alteration is one
significant difference of this kind, with the tag that explains it. Distortion is stated in px at the corners of the
image, where it is largest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.records import Record

if TYPE_CHECKING:
    from calibrary.calib.lens_models import Solvable

MATTERS_PX: Final = 3.0
"""Smallest relevant distortion in the corners, in px of an image at the size of feature detection."""
SIGMAS: Final = 4.0
REMOVED_SHARE: Final = 0.25
"""Largest share of the stated distortion that remains after a camera has removed it."""
FOCAL_SIGMAS: Final = 2.5
FOCAL_MATTERS: Final = 0.015
"""Smallest relevant relative difference of fx, as for a contradiction of K (:mod:`calibrary.sfm.pixel_judging`)."""
OFF_CENTRE: Final = 0.04
"""Largest offset of the principal point from the centre in uncropped images, as a share of the longer side."""


class Kind(StrEnum):
    """Kind of alteration; the value is the rule of the finding."""

    DISTORTION_REMOVED = "distortion-removed"
    DISTORTION_PRESENT = "distortion-present"
    ZOOMED = "zoomed"
    CROPPED = "cropped"


DISTORTION: Final = frozenset({Kind.DISTORTION_REMOVED, Kind.DISTORTION_PRESENT})


class Alteration(Record):
    """One difference between the stated camera and the one that the pixels show.

    Attributes:
        kind: kind of alteration.
        stated: value by the tags: distortion at the image corner in px, factor of the focal length, or coordinate of
            the principal point in px.
        measured: the same by the pixels.
        std: standard deviation of measured.
        message: explanation in a sentence.
    """

    kind: Kind
    stated: float
    measured: float
    std: float
    message: str


class Claim(Struct, frozen=True, kw_only=True, eq=False):
    """The camera as stated without evaluating pixels.

    Attributes:
        K: calibration at the size of the images; its distortion is None if none is stated.
        by: source of the statement: "the tags", "the registry".
        zoom: EXIF DigitalZoomRatio, whether or not K includes it; 1 for none.
        native_size: full size of the sensor in px, by the catalogue.
        fisheye: whether the lens is a fisheye, by the catalogue.
    """

    K: Calibration
    by: str = "the tags"
    zoom: float = 1.0
    native_size: ImageSize | None = None
    fisheye: bool = False


class MeasuredCamera(Struct, frozen=True, kw_only=True, eq=False):
    """The camera as measured by an adjustment, with standard deviations.

    Attributes:
        focal_px: fx, px.
        std: relative standard deviation of fx, with all allowances.
        corner_px: outward shift by the distortion in the corners and its standard deviation, px.
        centre_px: (cx, cy) and their standard deviations, px; None if it was not adjusted.
        by_px: relative change of fx by one systematic pixel of an image of 1600 px.
        images: number of images in the adjustment.
        split: whether halves of the images could be compared.
    """

    focal_px: float
    std: float
    corner_px: tuple[float, float]
    centre_px: tuple[tuple[float, float], tuple[float, float]] | None = None
    by_px: float = 0.0
    images: int = 0
    split: bool = False


def find_alterations(claim: Claim, seen: MeasuredCamera) -> Iterator[Alteration]:
    """Yield all significant differences between the stated and the measured camera."""
    stated = claimed_shift(claim)
    if stated is not None:
        kind = distortion_altered(stated, *seen.corner_px, max(claim.K.intrinsics.image_size))
        if kind is not None:
            yield _of_distortion(kind, stated, claim, seen)
    focal = focal_altered(claim, seen.focal_px, seen.std)
    if focal is not None:
        yield focal
    yield from _of_centre(claim, seen)


def claimed_shift(claim: Claim) -> float | None:
    """Return the outward shift of the corners by the stated distortion, px; None if no distortion is stated."""
    K, lens = claim.K.intrinsics, claim.K.distortion
    radius = math.hypot(*K.image_size) / 2 / K.fx
    if isinstance(lens, NoDistortion):
        return 0.0
    if lens is None:
        # Assume an equidistant lens, which most fisheyes nearly are.
        return (math.atan(radius) - radius) * K.fx if claim.fisheye else None
    shifted = lens.distort(np.array([[radius, 0.0], [-radius, 0.0], [0.0, radius], [0.0, -radius]]))
    # A model that is not valid up to the corners states nothing there.
    stated = float(np.linalg.norm(shifted, axis=1).mean() - radius) * K.fx
    return stated if math.isfinite(stated) else None


def distortion_altered(stated: float, measured: float, std: float, side: int) -> Kind | None:
    """Return whether a stated distortion was removed or an unstated one is present; None for neither.

    Args:
        stated: outward shift in the corners, px; 0 if stated to be free of distortion.
        measured: the same by the pixels, px.
        std: standard deviation of measured, px.
        side: longer side of the image, px.
    """
    from calibrary.sfm.sigma import FEATURE_SIDE  # noqa: PLC0415  the records of a report need no adjustment

    matters, real = MATTERS_PX * max(1.0, side / FEATURE_SIDE), SIGMAS * std
    if (
        abs(stated) > matters
        and abs(measured) < REMOVED_SHARE * abs(stated)
        and abs(measured - stated) > real
    ):
        return Kind.DISTORTION_REMOVED
    if stated == 0.0 and abs(measured) > max(matters, real):
        return Kind.DISTORTION_PRESENT
    return None


def corner_shift(
    model: Solvable, parameters: FloatArray, C: FloatArray, size: ImageSize
) -> tuple[float, float]:
    """Return the outward shift of the corners by the radial distortion and its standard deviation, px."""
    focal = parameters[0]
    radius = math.hypot(*size) / 2 / focal
    points = np.array([[radius, 0.0, 1.0], [-radius, 0.0, 1.0], [0.0, radius, 1.0], [0.0, -radius, 1.0]])
    outward = points[:, :2] / radius

    def shift(vector: FloatArray) -> float:
        off = model.project(vector, points)[0] - vector[2:4] - vector[:2] * points[:, :2]
        return float(np.einsum("ni,ni->n", off, outward).mean())

    middle = shift(parameters)
    steps = np.maximum(np.sqrt(np.diag(C)), 1e-12)
    slope = np.array([(shift(parameters + step) - middle) for step in np.diag(steps)]) / steps
    # K affects the shift only through the radius of the corners, which is negligible.
    slope[:4] = 0.0
    return middle, math.sqrt(max(float(slope @ C @ slope), 0.0))


def _of_distortion(kind: Kind, stated: float, claim: Claim, seen: MeasuredCamera) -> Alteration:
    measured, std = seen.corner_px
    pixels = f"{measured:+.1f} ± {std:.1f} px"
    if kind is Kind.DISTORTION_REMOVED:
        message = (
            f"{claim.by} state a distortion of {stated:+.1f} px at the corner of the image, and the pixels show "
            f"{pixels}: it was removed already, in the camera or by a program"
        )
    else:
        message = f"{claim.by} state no distortion, and the pixels show {pixels} at the corner of the image"
    return Alteration(kind=kind, stated=stated, measured=measured, std=std, message=message)


def focal_altered(claim: Claim, focal_px: float, std: float) -> Alteration | None:
    """Explain a focal length that differs from the tags by digital zoom or a crop; None if it agrees or neither fits.

    Args:
        claim: the stated camera.
        focal_px: fx by the pixels, px.
        std: its relative standard deviation.
    """
    K = claim.K.intrinsics
    ratio, reach = focal_px / K.fx, max(FOCAL_SIGMAS * std, FOCAL_MATTERS)
    (width, height), full = K.image_size, claim.native_size
    candidates = []
    if claim.zoom > 1:
        zoomed = f"DigitalZoomRatio states {claim.zoom:g}×"
        candidates += [
            (Kind.ZOOMED, claim.zoom, f"{zoomed}, and K is without it"),
            (Kind.ZOOMED, 1 / claim.zoom, f"{zoomed}, and the pixels show none"),
        ]
    if full is not None and width < full[0]:
        part = f"{width}×{height} px of the sensor's {full[0]}×{full[1]}"
        candidates += [
            (Kind.CROPPED, full[0] / width, f"the image is {part}, and K is of all of them made smaller"),
            (
                Kind.CROPPED,
                width / full[0],
                f"the image is all of the sensor made smaller, and K is of {part}",
            ),
        ]
    fitting = [one for one in candidates if abs(ratio / one[1] - 1) <= reach]
    if abs(ratio - 1) <= reach or not fitting:
        return None
    kind, factor, why = min(fitting, key=lambda one: abs(ratio / one[1] - 1))
    figures = f"fx = {focal_px:.0f} px ± {std:.1%} is {ratio:.3f} times that of {claim.by}, {K.fx:.0f} px"
    return Alteration(kind=kind, stated=factor, measured=ratio, std=std * ratio, message=f"{figures}: {why}")


def _of_centre(claim: Claim, seen: MeasuredCamera) -> Iterator[Alteration]:
    """Detect a crop that is not centred by its principal point."""
    K = claim.K.intrinsics
    centre, std = seen.centre_px or ((K.cx, K.cy), (0.0, 0.0))
    side = max(K.image_size)
    for axis, stated, measured, sigma in zip("xy", (K.cx, K.cy), centre, std, strict=True):
        off = measured - stated
        if abs(off) > max(SIGMAS * sigma, OFF_CENTRE * side):
            yield Alteration(
                kind=Kind.CROPPED,
                stated=stated,
                measured=measured,
                std=sigma,
                message=f"the principal point is {off:+.0f} ± {sigma:.0f} px in {axis} from where {claim.by} have it: "
                "the image is a part of the frame that is not its middle, or was cut afterwards",
            )
