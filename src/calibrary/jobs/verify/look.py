"""A look at the pixels of a dozen images of one camera: what focal length they show, if any."""

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
from calibrary.sfm.choose import Taken, choose
from calibrary.sfm.engine import FlightImage, match, read_matches
from calibrary.sfm.pixel_check import PixelCheck
from calibrary.sfm.pixel_judging import FEWEST_IMAGES, Measured, cannot_tell, judge_pixels, measured
from calibrary.sfm.reconstruct import reconstruct
from calibrary.sfm.sigma import trust
from calibrary.sfm.tracks import Scene, Tracks, thinned
from calibrary.sfm.two_view import TwoViewFocal, focal_of_pairs

__all__ = ["MOST_IMAGES", "Look", "look"]

MOST_IMAGES: Final = 12

MOST_POINTS: Final = 2000
"""More take longer and change little: what a dozen images leave open is not noise."""

START_OVER_WIDTH: Final = (0.4, 2.5)
"""fx / W within which a K is worth starting from; a 35 mm equivalent taken for a focal length lies beyond."""

PERSPECTIVE = (NoDistortion, BrownConrady, Rational)


class Look(Struct, frozen=True, kw_only=True):
    """What the pixels show, whatever K says.

    Attributes:
        chosen: how many images were looked at.
        found: by the adjustment; None where it failed.
        pairs: by pairs of images alone; None where they determine nothing.
        reason: why there is nothing; empty where there is.
    """

    chosen: int
    found: Measured | None = None
    pairs: TwoViewFocal | None = None
    reason: str = ""

    def check(self, K: Calibration, agreement: float) -> PixelCheck:
        """Hold a K against it.

        Args:
            K: at the size of the images.
            agreement: relative difference up to which two sources agree.
        """
        if self.found is None:
            return cannot_tell(K, self.reason, chosen=self.chosen)
        return judge_pixels(K, self.found, self.pairs, chosen=self.chosen, agreement=agreement)


def look(paths: Sequence[Path], K: Calibration, *, progress: Progress | None = None) -> Look:
    """Find the focal length that images show.

    Args:
        paths: of one camera, of one size, in the order they were taken in.
        K: to start from; what is found does not depend on it.
        progress: called with (done, total, what) of "images", "pairs" and "placed".
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
        taken.append(Taken(image=image, fix=fix, file_bytes=path.stat().st_size))
    return choose(taken, MOST_IMAGES).images


def _look(images: tuple[FlightImage, ...], K: Calibration, folder: Path, progress: Progress | None) -> Look:
    fisheye = K.distortion is not None and not isinstance(K.distortion, PERSPECTIVE)
    matched = match(images, folder=folder, start=_start(K.intrinsics), progress=progress)
    tracks, scene = reconstruct(matched, start=_start(K.intrinsics), fisheye=fisheye, progress=progress)
    with stage("adjusted the camera"):
        tracks = thinned(tracks, MOST_POINTS)
        adjustment = _adjust(tracks, scene, None if fisheye else Solvable.BROWN)
        found = measured(adjustment, trust(adjustment))
    return Look(
        chosen=len(images), found=found, pairs=focal_of_pairs(read_matches(matched), _adjusted(adjustment, K))
    )


def _adjust(tracks: Tracks, scene: Scene, model: Solvable | None) -> Adjustment:
    """With the images' positions, which tell the focal length from the height where they are exact; else without."""
    try:
        return adjust(tracks, scene, model=model)
    except CalibrationError:
        if tracks.positions is None:
            raise
        return adjust(replace(tracks, positions=None), scene, model=model)


def _start(K: Intrinsics) -> Intrinsics:
    """Where to start: K with its principal point in the middle, or a usual focal length where K's is unusual."""
    (width, height), (low, high) = K.image_size, START_OVER_WIDTH
    focal = K.fx if low <= K.fx / width <= high else 0.8 * max(width, height)
    return Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=K.image_size)


def _adjusted(found: Adjustment, K: Calibration) -> Calibration:
    """The adjusted camera, whose distortion and principal point the pairs of images are read with."""
    scene = found.bundle.scene
    values = dict(zip(scene.model.parameters, scene.parameters.tolist(), strict=True))
    intrinsics = scene.model.intrinsics(values, K.intrinsics.image_size)
    if not all(math.isfinite(value) for value in values.values()):
        raise CalibrationError("the adjustment did not settle")
    return replace(K, intrinsics=intrinsics, distortion=scene.model.distortion(values), quality=None)
