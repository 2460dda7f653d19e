"""Whether K agrees with what the pixels of some of its images show: a verdict of its own, with its uncertainty.

The pixels' focal length is that of a small adjustment; its σ is the adjustment's with halves of the images compared and
the principal point held and free (:mod:`calibrary.sfm.sigma`), and what a small systematic error of the images would
do by way of the flight's geometry. K is contradicted where the difference is larger than that explains *and* large
enough to matter; agreement needs the whole ±2σ to be inside what counts as agreement of two sources.
"""

from __future__ import annotations

import math
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.sfm.adjust import Adjustment
from calibrary.sfm.as_stated import Claim, Kind, claimed_shift, corner_shift, distortion_altered
from calibrary.sfm.pixel_check import DistortionCheck, PixelCheck, PixelVerdict
from calibrary.sfm.sigma import Trust
from calibrary.sfm.two_view import TwoViewFocal

__all__ = ["Measured", "cannot_tell", "judge_pixels", "measured"]

CONTRADICTS_FROM: Final = 0.015
"""Of fx. Smaller differences of a self-calibration from a design value are ordinary: focus, heat, rolling shutter."""

CONTRADICTS_SIGMAS: Final = 2.5
AGREES_SIGMAS: Final = 2.0

SYSTEMATIC: Final = 0.01
"""Relative standard deviation of fx by systematic errors of the images, where one pixel at its worst doubles fx;
it goes with the square of that. Chosen by simulated flights, and so that parts of one real nadir flight agree."""

LEAST_STD: Final = 0.002
"""Of fx: what no dozen images can claim to know better; focus and heat move it by as much from day to day."""

UNDETERMINED_BY_PX: Final = 1.5
"""Change of fx by one such pixel from which the images do not determine it: flat ground straight down has 3 and more,
relief of 6 % of the height 0.7, oblique images 0.2 … 0.4 (simulated flights of twelve images)."""

FEWEST_IMAGES: Final = 8
"""Fewer cannot be dealt into halves."""


class Measured(Struct, frozen=True, kw_only=True, eq=False):
    """What an adjustment of a few images found.

    Attributes:
        focal_px: fx.
        std: relative, with every allowance.
        by_px: relative change of fx by one systematic pixel of an image of 1600 px.
        images: in the adjustment.
        corner_px: outward shift by the distortion at the image's corners, and its standard deviation.
        split: whether halves of the images could be compared.
    """

    focal_px: float
    std: float
    by_px: float
    images: int
    corner_px: tuple[float, float]
    split: bool


def measured(found: Adjustment, known: Trust) -> Measured:
    """The focal length and the distortion of an adjustment, with what its own σ leaves out."""
    bundle = found.bundle
    scene, size = bundle.scene, bundle.tracks.image_size
    focal = float(scene.parameters[0])
    inflation = max(1.0, known.halves.kappa2) if known.halves is not None else 1.0
    by_px = known.geometry.focal_by_px
    std = math.hypot(
        LEAST_STD, math.sqrt(known.covariance.matrix[0, 0] * inflation) / focal, SYSTEMATIC * by_px**2
    )
    return Measured(
        focal_px=focal,
        std=std,
        by_px=by_px,
        images=int(bundle.tracks.used.sum()),
        corner_px=corner_shift(scene.model, scene.parameters, known.covariance.matrix * inflation, size),
        split=known.halves is not None,
    )


def judge_pixels(
    K: Calibration, found: Measured, pairs: TwoViewFocal | None, *, chosen: int, agreement: float
) -> PixelCheck:
    """Hold K against what was measured.

    Args:
        K: at the size of the images.
        found: by the adjustment.
        pairs: by pairs of images alone, None where they determine nothing.
        chosen: images that were looked at.
        agreement: relative difference up to which two sources agree, of the policy.
    """
    fx = K.intrinsics.fx
    difference = found.focal_px / fx - 1.0
    verdict, reason = _verdict(difference, found, pairs, agreement)
    told = verdict is not PixelVerdict.CANNOT_TELL or _doubt(found, pairs) is None
    return PixelCheck(
        verdict=verdict,
        fx=fx,
        measured_fx=found.focal_px,
        difference=difference,
        std=found.std,
        images=found.images,
        chosen=chosen,
        reason=reason,
        pair_fx=pairs.focal_px if pairs is not None else None,
        pair_std=pairs.std if pairs is not None else None,
        pairs=pairs.pairs if pairs is not None else 0,
        distortion=_compared(K, found) if told else None,
    )


def cannot_tell(K: Calibration, reason: str, *, chosen: int = 0) -> PixelCheck:
    """Nothing was measured, for this reason."""
    return PixelCheck(verdict=PixelVerdict.CANNOT_TELL, fx=K.intrinsics.fx, chosen=chosen, reason=reason)


def _verdict(
    difference: float, found: Measured, pairs: TwoViewFocal | None, agreement: float
) -> tuple[PixelVerdict, str]:
    doubt = _doubt(found, pairs)
    if doubt is not None:
        return PixelVerdict.CANNOT_TELL, doubt
    size = abs(difference)
    if size > max(CONTRADICTS_FROM, CONTRADICTS_SIGMAS * found.std):
        sigmas = size / found.std
        return PixelVerdict.CONTRADICTS, f"the difference is {sigmas:.0f} σ{_likely(difference, agreement)}"
    if size + AGREES_SIGMAS * found.std <= agreement:
        return PixelVerdict.AGREES, f"within {agreement:.0%}, as far as ±2 σ of the pixels reaches"
    reach = AGREES_SIGMAS * found.std
    return (
        PixelVerdict.CANNOT_TELL,
        f"{difference:+.1%} ± {reach:.1%} (2 σ) is neither within {agreement:.0%} nor beyond doubt",
    )


def _doubt(found: Measured, pairs: TwoViewFocal | None) -> str | None:
    """Why the measurement determines no focal length; None where it does."""
    if found.images < FEWEST_IMAGES or not found.split:
        return f"{found.images} images fit one another, need {FEWEST_IMAGES}"
    if found.by_px > UNDETERMINED_BY_PX:
        return (
            "focal length and flying height cannot be told apart by these images: flat ground from one height, "
            f"straight down (a tenth of a pixel (of 1600) moves fx by {found.by_px / 10:.0%})"
        )
    if pairs is not None:
        apart = abs(math.log(pairs.focal_px / found.focal_px))
        if apart > max(CONTRADICTS_FROM, CONTRADICTS_SIGMAS * math.hypot(pairs.std, found.std)):
            return (
                f"pairs of images give fx = {pairs.focal_px:.0f} px and the adjustment {found.focal_px:.0f} px, "
                "further apart than their uncertainties explain"
            )
    return None


def _likely(difference: float, agreement: float) -> str:
    """What makes the pixels' focal length so much longer or shorter."""
    if difference > agreement:
        return f"; a crop or a digital zoom of {1 + difference:.2f}× would do that"
    if difference < -agreement:
        return "; a 35 mm equivalent taken for the focal length, or a sensor taken too small, would do that"
    return ""


def _compared(K: Calibration, found: Measured) -> DistortionCheck | None:
    stated = claimed_shift(Claim(K=K))
    if stated is None:
        return None
    kind = distortion_altered(stated, *found.corner_px, max(K.intrinsics.image_size))
    return DistortionCheck(
        stated_px=stated,
        measured_px=found.corner_px[0],
        std_px=found.corner_px[1],
        removed=kind is Kind.DISTORTION_REMOVED,
        present=kind is Kind.DISTORTION_PRESENT,
    )
