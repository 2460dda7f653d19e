"""Compare K with the focal length that the pixels of some of its images show, considering its uncertainty.

The focal length is that of a small adjustment. Its σ includes the comparison of halves of the images, the effect of
holding the principal point (:mod:`calibrary.sfm.sigma`), and the effect of small systematic errors of the images with
the flight's geometry. The pixels contradict K if the difference is larger than σ explains *and* large enough to matter.
They agree if the whole ±2σ interval is within the limit for agreement of two sources.
"""

from __future__ import annotations

import math
from typing import Final

from calibrary.calibration import Calibration
from calibrary.sfm.adjust import Adjustment
from calibrary.sfm.alterations import (
    Claim,
    Kind,
    MeasuredCamera,
    claimed_shift,
    corner_shift,
    distortion_altered,
)
from calibrary.sfm.pixel_check import CentreCheck, DistortionCheck, PixelCheck, PixelVerdict
from calibrary.sfm.sigma import CameraUncertainty
from calibrary.sfm.tracks import Scene
from calibrary.sfm.two_view import TwoViewFocal

CONTRADICTS_FROM: Final = 0.015
"""Smallest relative difference of fx for a contradiction. Smaller differences of a self-calibration from a design value
are normal: focus, heat, rolling shutter."""

CONTRADICTS_SIGMAS: Final = 2.5
AGREES_SIGMAS: Final = 2.0

CENTRE_FROM: Final = 0.015
"""Smallest difference of the principal point for a contradiction, as a fraction of the image side. Tilt of the camera
and principal point are hard to tell apart from the air, and units of one model differ by 0.7 %."""
CENTRE_SIGMAS: Final = 4.0

UNDETERMINED_BY_PX: Final = 1.5
"""Relative change of fx by one such pixel above which the images do not determine it: vertical images of flat ground
have 3 and more, relief of 6 % of the height 0.7, oblique images 0.2 … 0.4 (simulated flights of twelve images)."""

FEWEST_IMAGES: Final = 8
"""Fewer cannot be split into halves."""


def measured_camera(found: Adjustment, known: CameraUncertainty) -> MeasuredCamera:
    """Return the camera of an adjustment, with allowances for what its own σ does not include."""
    bundle = found.bundle
    scene, size = bundle.scene, bundle.tracks.image_size
    return MeasuredCamera(
        focal_px=known.fx,
        std=known.focal_std,
        by_px=known.geometry.focal_by_px,
        images=int(bundle.tracks.used.sum()),
        corner_px=corner_shift(
            scene.model, scene.parameters, known.covariance.matrix * known.inflation, size
        ),
        split=known.halves is not None,
        centre_px=_centre(scene, known, math.sqrt(known.inflation)),
    )


def _centre(
    scene: Scene, known: CameraUncertainty, by: float
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The adjusted principal point and its standard deviations ``by`` times as large; None if it was fixed."""
    values = dict(zip(scene.model.parameters, scene.parameters.tolist(), strict=True))
    std = known.covariance.std
    if not (std.get("cx") and std.get("cy")):
        return None
    return (values["cx"], values["cy"]), (std["cx"] * by, std["cy"] * by)


def judge_pixels(
    K: Calibration, found: MeasuredCamera, pairs: TwoViewFocal | None, *, chosen: int, agreement: float
) -> PixelCheck:
    """Compare K with the measurement.

    Args:
        K: calibration at the size of the images.
        found: result of the adjustment.
        pairs: result of pairs of images alone; None if they do not determine fx.
        chosen: number of images evaluated.
        agreement: the policy's limit of the relative difference for agreement of two sources.
    """
    fx = K.intrinsics.fx
    difference = found.focal_px / fx - 1.0
    verdict, reason = _verdict(difference, found, pairs, agreement)
    told = verdict is not PixelVerdict.CANNOT_TELL or doubt_of(found, pairs) is None
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
        centre=_centre_check(K, found) if told else None,
    )


def cannot_tell(K: Calibration, reason: str, *, chosen: int = 0) -> PixelCheck:
    """Return the check for a failed measurement, with its reason."""
    return PixelCheck(verdict=PixelVerdict.CANNOT_TELL, fx=K.intrinsics.fx, chosen=chosen, reason=reason)


def _verdict(
    difference: float, found: MeasuredCamera, pairs: TwoViewFocal | None, agreement: float
) -> tuple[PixelVerdict, str]:
    doubt = doubt_of(found, pairs)
    if doubt is not None:
        return PixelVerdict.CANNOT_TELL, doubt
    size = abs(difference)
    # Both, because a long flight measures a difference that does not matter, and a short one a difference by chance.
    if size > max(CONTRADICTS_FROM, CONTRADICTS_SIGMAS * found.std):
        sigmas = size / found.std
        return PixelVerdict.CONTRADICTS, f"the difference is {sigmas:.0f} σ{_likely(difference, agreement)}"
    # The whole interval: a measurement that is merely vague would else agree with every K.
    if size + AGREES_SIGMAS * found.std <= agreement:
        return PixelVerdict.AGREES, f"within {agreement:.0%}, as far as ±2 σ of the pixels reaches"
    reach = AGREES_SIGMAS * found.std
    return (
        PixelVerdict.CANNOT_TELL,
        f"{difference:+.1%} ± {reach:.1%} (2 σ) is neither within {agreement:.0%} nor beyond doubt",
    )


def doubt_of(found: MeasuredCamera, pairs: TwoViewFocal | None) -> str | None:
    """Return why the measurement does not determine the focal length; None if it does."""
    if found.images < FEWEST_IMAGES:
        return f"{found.images} images fit one another, need {FEWEST_IMAGES}"
    if not found.split:
        return (
            f"the {found.images} images cannot be split into halves that determine a camera each, so nothing shows "
            "how far their result may be off"
        )
    if found.by_px > UNDETERMINED_BY_PX:
        return (
            "focal length and flying height cannot be told apart by these images: flat ground from one height, "
            f"straight down (a tenth of a pixel, in images reduced to 1600 px, moves fx by {found.by_px / 10:.0%})"
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
    """Return the likely cause of such a difference, as the end of a sentence; empty for a small one."""
    if difference > agreement:
        return f"; a crop or a digital zoom of {1 + difference:.2f}× would do that"
    if difference < -agreement:
        return "; a 35 mm equivalent taken for the focal length, or a sensor taken too small, would do that"
    return ""


def _centre_check(K: Calibration, found: MeasuredCamera) -> CentreCheck | None:
    if found.centre_px is None:
        return None
    measured, std = found.centre_px
    stated, size = (K.intrinsics.cx, K.intrinsics.cy), K.intrinsics.image_size
    assumed = stated == (size[0] / 2, size[1] / 2)
    off = any(
        abs(a - b) > max(CENTRE_FROM * side, CENTRE_SIGMAS * sigma)
        for a, b, side, sigma in zip(stated, measured, size, std, strict=True)
    )
    sharp = all(
        CONTRADICTS_SIGMAS * sigma <= CENTRE_FROM * side for side, sigma in zip(size, std, strict=True)
    )
    return CentreCheck(
        stated_px=stated, measured_px=measured, std_px=std, judged=off or sharp, off=off, assumed=assumed
    )


def _compared(K: Calibration, found: MeasuredCamera) -> DistortionCheck | None:
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
