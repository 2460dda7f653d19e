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
from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, NoDistortion, Rational
from calibrary.errors import CalibraryError, CalibrationError, InputError
from calibrary.parsers.imagery.taken import fix_of
from calibrary.progress import Progress, stage
from calibrary.provenance import Provenance
from calibrary.quality import Quality
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.alterations import MeasuredCamera
from calibrary.sfm.engine import FlightImage, Matches, match, read_matches
from calibrary.sfm.image_selection import LocatedImage, select_images
from calibrary.sfm.mapping import reconstruct
from calibrary.sfm.nuisances import READOUT_S, readout_of
from calibrary.sfm.pixel_check import PixelCheck
from calibrary.sfm.pixel_judging import (
    FEWEST_IMAGES,
    cannot_tell,
    doubt_of,
    judge_pixels,
    measured_camera,
)
from calibrary.sfm.sigma import CameraUncertainty, camera_uncertainty
from calibrary.sfm.tracks import Scene, Tracks, thinned
from calibrary.sfm.two_view import TwoViewFocal, focal_of_pairs

MOST_IMAGES: Final = 12

START_STD: Final = 0.02
"""Largest relative σ of a focal length to start from: what a nominal one has."""

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
        calibration: K and lens by the adjustment, with their σ; None if it failed.
        reason: why there is no result; empty if there is one.
    """

    chosen: int
    found: MeasuredCamera | None = None
    pairs: TwoViewFocal | None = None
    calibration: Calibration | None = None
    reason: str = ""

    @property
    def measured(self) -> Calibration | None:
        """K by the pixels, a start; None if they do not determine it to :data:`START_STD`."""
        if self.found is None or self.calibration is None or self.found.std > START_STD:
            return None
        return self.calibration if doubt_of(self.found, self.pairs) is None else None

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
    images = chosen(paths, K.intrinsics.image_size)
    try:
        with stage(f"looked at the pixels of {len(images)} images"), tempfile.TemporaryDirectory() as folder:
            return _look(images, K, Path(folder), progress)
    except (CalibrationError, InputError) as error:
        return Look(chosen=len(images), reason=str(error))


def chosen(paths: Sequence[Path], size: ImageSize) -> tuple[FlightImage, ...]:
    """Return the images that are looked at."""
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
        model = None if fisheye else Solvable.BROWN
        return looked(
            tracks, scene, read_matches(matched), K, model=model, readout_s=readout_of(images[0].path)
        )


def looked(
    tracks: Tracks,
    scene: Scene,
    pairs: Sequence[Matches],
    K: Calibration,
    *,
    model: Solvable | None = Solvable.BROWN,
    readout_s: tuple[float, float] = READOUT_S,
) -> Look:
    """Return the measurement by what the images show.

    Args:
        tracks: observations of the images.
        scene: a first reconstruction.
        pairs: what each two of the images share.
        K: the calibration whose camera and size it is.
        model: lens model; None to choose one.
        readout_s: readout time of the shutter and its standard deviation, s.

    Raises:
        CalibrationError: the images do not determine a camera.
    """
    adjustment = _adjust(tracks, scene, model, readout_s)
    known = camera_uncertainty(adjustment)
    found = measured_camera(adjustment, known)
    adjusted = _adjusted(adjustment, K)
    return Look(
        chosen=len(tracks.names),
        found=found,
        pairs=focal_of_pairs(pairs, adjusted),
        calibration=_with_sigma(adjusted, found, known),
    )


def _with_sigma(adjusted: Calibration, found: MeasuredCamera, known: CameraUncertainty) -> Calibration:
    """The adjusted camera as a measurement, which a dozen images make a start and no more."""
    std = {name: value * math.sqrt(known.inflation) for name, value in known.covariance.std.items()}
    focal = found.std * found.focal_px
    return replace(
        adjusted,
        grade=Grade.ADJUSTED,
        quality=Quality(views=found.images, std={**std, "fx": focal, "fy": focal}),
        provenance=Provenance(kind="pixels", source="pixels", tag=f"the pixels of {found.images} images"),
        notes=(f"start: {Calibration.SHORT}",),
        extras=(),
    )


def _adjust(
    tracks: Tracks, scene: Scene, model: Solvable | None, readout_s: tuple[float, float]
) -> Adjustment:
    """Adjust with the images' positions, which separate focal length and height if accurate; if it fails, without."""
    try:
        return adjust(tracks, scene, model=model, readout_s=readout_s)
    except CalibrationError:
        if tracks.positions is None:
            raise
        return adjust(replace(tracks, positions=None), scene, model=model, readout_s=readout_s)


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
