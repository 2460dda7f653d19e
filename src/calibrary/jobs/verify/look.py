"""Estimate the focal length from the pixels of a dozen images of one camera, if they determine it."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.calib.lens_models import Solvable
from calibrary.calibration import Calibration, ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, NoDistortion, Rational
from calibrary.errors import CalibraryError, CalibrationError, InputError
from calibrary.parsers.imagery.position import fix_of
from calibrary.progress import Progress, stage
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.engine import FlightImage, match, read_matches
from calibrary.sfm.image_selection import LocatedImage, select_images
from calibrary.sfm.mapping import reconstruct
from calibrary.sfm.pixel_check import PixelCheck
from calibrary.sfm.pixel_judging import (
    FEWEST_IMAGES,
    MeasuredFocal,
    cannot_tell,
    judge_pixels,
    measured_focal,
)
from calibrary.sfm.sigma import camera_uncertainty
from calibrary.sfm.tracks import Scene, Tracks, thinned
from calibrary.sfm.two_view import TwoViewFocal, focal_of_pairs

__all__ = ["MOST_IMAGES", "Look", "look"]

MOST_IMAGES: Final = 12

MOST_POINTS: Final = 2000
"""Largest number of points; more take longer and change little, because noise is not what limits a dozen images."""

START_OVER_WIDTH: Final = (0.4, 2.5)
"""Range of fx / W in which K is used as a start; a 35 mm equivalent mistaken for the focal length is outside."""

PERSPECTIVE = (NoDistortion, BrownConrady, Rational)


class Look(Struct, frozen=True, kw_only=True):
    """Measurement of the focal length by the pixels, independent of K.

    Attributes:
        chosen: number of images evaluated.
        found: result of the adjustment; None if it failed.
        pairs: result of pairs of images alone; None if they do not determine the focal length.
        reason: why there is no result; empty if there is one.
    """

    chosen: int
    found: MeasuredFocal | None = None
    pairs: TwoViewFocal | None = None
    reason: str = ""

    def check(self, K: Calibration, agreement: float) -> PixelCheck:
        """Compare a K with the measurement.

        Args:
            K: calibration at the size of the images.
            agreement: largest relative difference at which two sources agree.
        """
        if self.found is None:
            return cannot_tell(K, self.reason, chosen=self.chosen)
        return judge_pixels(K, self.found, self.pairs, chosen=self.chosen, agreement=agreement)


def look(paths: Sequence[Path], K: Calibration, *, progress: Progress | None = None) -> Look:
    """Estimate the focal length from images; a failure is reported in the result's ``reason``.

    Args:
        paths: images of one camera and size, in the order of capture.
        K: start value; the result does not depend on it.
        progress: called with (done, total, what), where what is "features", "pairs" or "placed".
    """
    if len(paths) < FEWEST_IMAGES:
        count = f"{len(paths)} image{'' if len(paths) == 1 else 's'}"
        return Look(chosen=0, reason=f"{count} of this camera, need {FEWEST_IMAGES}")
    images = _chosen(paths, K.intrinsics.image_size)
    try:
        with stage(f"looked at the pixels of {len(images)} images"), tempfile.TemporaryDirectory() as folder:
            return _look(images, K, Path(folder), progress)
    except (CalibrationError, InputError) as error:
        return Look(chosen=len(images), reason=str(error))


def _chosen(paths: Sequence[Path], size: ImageSize) -> tuple[FlightImage, ...]:
    taken = []
    for number, path in enumerate(paths):
        fix = None
        with suppress(CalibraryError):
            fix = fix_of(path)
        image = FlightImage(path=path, name=f"{number} {path.name}", size=size)
        taken.append(LocatedImage(image=image, fix=fix, file_bytes=path.stat().st_size))
    return select_images(taken, MOST_IMAGES).images


def _look(images: tuple[FlightImage, ...], K: Calibration, folder: Path, progress: Progress | None) -> Look:
    fisheye = K.distortion is not None and not isinstance(K.distortion, PERSPECTIVE)
    matched = match(images, folder=folder, start=_start(K.intrinsics), progress=progress)
    tracks, scene = reconstruct(matched, start=_start(K.intrinsics), fisheye=fisheye, progress=progress)
    with stage("adjusted the camera"):
        tracks = thinned(tracks, MOST_POINTS)
        adjustment = _adjust(tracks, scene, None if fisheye else Solvable.BROWN)
        found = measured_focal(adjustment, camera_uncertainty(adjustment))
    return Look(
        chosen=len(images), found=found, pairs=focal_of_pairs(read_matches(matched), _adjusted(adjustment, K))
    )


def _adjust(tracks: Tracks, scene: Scene, model: Solvable | None) -> Adjustment:
    """Adjust with the images' positions, which separate focal length and height if accurate; if it fails, without."""
    try:
        return adjust(tracks, scene, model=model)
    except CalibrationError:
        if tracks.positions is None:
            raise
        return adjust(replace(tracks, positions=None), scene, model=model)


def _start(K: Intrinsics) -> Intrinsics:
    """Return the start: K with a centred principal point, and a typical focal length if K's is implausible."""
    (width, height), (low, high) = K.image_size, START_OVER_WIDTH
    focal = K.fx if low <= K.fx / width <= high else 0.8 * max(width, height)
    return Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=K.image_size)


def _adjusted(found: Adjustment, K: Calibration) -> Calibration:
    """Return the adjusted camera; its distortion and principal point are used for the pairs of images."""
    scene = found.bundle.scene
    values = dict(zip(scene.model.parameters, scene.parameters.tolist(), strict=True))
    intrinsics = scene.model.intrinsics(values, K.intrinsics.image_size)
    if not all(math.isfinite(value) for value in values.values()):
        raise CalibrationError("the adjustment did not settle")
    return replace(K, intrinsics=intrinsics, distortion=scene.model.distortion(values), quality=None)
