"""Calibration from the images of a flight: select, match, reconstruct, adjust, assess."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.calib.detection import Detections, NamedRemark
from calibrary.calib.found import Reason
from calibrary.calib.lens_models import Solvable
from calibrary.calib.observations import ControlPoints, Observations, View
from calibrary.calib.result import CalibrationResult
from calibrary.calib.start import seed
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import InputError
from calibrary.extras import programs
from calibrary.jobs.calibrate.frames import (
    FrameMetadata,
    Told,
    describe_frames,
    observed,
    without_other_sizes,
    without_resaved,
)
from calibrary.jobs.calibrate.run import dated
from calibrary.jobs.extract.pixels import claim_of_image
from calibrary.parsers.files import sha256_of
from calibrary.parsers.imagery.taken import fix_of
from calibrary.progress import Progress, counted, stage
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.alterations import Claim
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.control import with_survey
from calibrary.sfm.engine import MAX_SIDE, FlightImage, match
from calibrary.sfm.image_selection import LocatedImage, Selection, select_images
from calibrary.sfm.mapping import reconstruct
from calibrary.sfm.nuisances import readout_of
from calibrary.sfm.survey import Survey
from calibrary.sfm.tracks import FEWEST_IMAGES, thinned

MOST_POINTS: Final = 6000
"""Largest number of points; more would reduce σ below the effect of systematic errors."""


class FlightOptions(Struct, frozen=True, kw_only=True):
    """How a flight is solved.

    Attributes:
        images: largest number of images to use.
        model: lens model; None to select it by the images.
        start: initial K; None for a typical one.
        max_side: longer side for feature detection, px.
        survey: ground control; None if there is none.
    """

    images: int = 30
    model: Solvable | None = None
    start: Intrinsics | None = None
    max_side: int = MAX_SIDE
    survey: Survey | None = None


class SolvedFlight(Struct, frozen=True, kw_only=True, eq=False):
    """An adjusted flight, with what its report says besides.

    Attributes:
        found: result of the adjustment.
        about: camera, focus, firmware and days as the images state them, and the hash of each file.
        scale: px of the images per px at the size of feature detection.
        chosen: how the images were selected, in words.
        versions: versions of the programs used.
        left_out: number of images that were not chosen.
        claim: the stated camera; None if nothing is stated.
        survey: ground control.
        skipped: images that were not used.
        notes: on the images.
        finish: adds what the program that reconstructed it states.
    """

    found: Adjustment
    about: Observations
    scale: float
    chosen: str
    left_out: int = 0
    versions: Mapping[str, str]
    claim: Claim | None = None
    survey: Survey | None = None
    skipped: tuple[NamedRemark, ...] = ()
    notes: tuple[str, ...] = ()
    finish: Callable[[CalibrationResult], CalibrationResult] = lambda result: result

    def calibrated(self, told: Told) -> tuple[CalibrationResult, Detections]:
        """Return the calibration with date and operator, and the images used.

        Raises:
            CalibrationError: the images do not determine a camera.
        """
        result = flight_result(
            self.found,
            about=self.about,
            scale=self.scale,
            chosen=self.chosen,
            versions=self.versions,
            claim=self.claim,
            left_out=self.left_out,
            policy=told.policy,
        )
        result = dated(self.finish(result), told.stated)
        if self.survey is not None:
            result = _with_control_of(self.survey, result)
        placed = set(result.rms_by_view)
        remarks = tuple(
            NamedRemark(name=view.name, reason=Reason.NOT_PLACED, message="does not fit to the other images")
            for view in self.about.views
            if view.name not in placed
        )
        return result, Detections(
            observations=result.observations, rejected=(*self.skipped, *remarks), notes=self.notes
        )


def solve_images(
    paths: Sequence[Path], told: Told, options: FlightOptions, *, progress: Progress | None = None
) -> SolvedFlight:
    """Match, reconstruct and adjust the images of a flight.

    Args:
        paths: images of one camera.
        told: what the user states of them.
        options: how to solve.
        progress: called with (done, total, what) for each part of the work.

    Raises:
        InputError: the images are of several cameras, or too few.
        CalibrationError: the images do not fit together, or do not determine a camera.
        MissingExtraError: pycolmap is not installed.
    """
    given, (paths, copies) = len(paths), _without_copies(paths)
    paths, skipped = without_other_sizes(paths)
    paths, resaved = without_resaved(paths)
    metadata = describe_frames(paths, told)
    if metadata.setting is None:
        raise InputError(f"none of {given} images can be read; expected a flight, some 20 to 60 that overlap")
    if len(paths) < FEWEST_IMAGES:
        raise InputError(
            f"{len(paths)} different image{'s' * (len(paths) != 1)} can be read; expected a flight, some "
            "20 to 60 that overlap"
        )
    size = metadata.setting.image_size
    taken = _taken(paths, size, progress)
    shown = options.survey.points_of([one.image.name for one in taken]) if options.survey is not None else {}
    chosen = select_images(taken, options.images, shown)
    start = options.start or seed(size)
    with tempfile.TemporaryDirectory(prefix="calibrary-flight-") as folder:
        with stage(f"matched {len(chosen.pairs)} pairs of {len(chosen.images)} images"):
            matched = match(
                chosen.images,
                folder=Path(folder),
                start=start,
                pairs=chosen.pairs,
                max_side=options.max_side,
                progress=progress,
            )
        with stage(f"reconstructed {len(chosen.images)} images"):
            tracks, scene = reconstruct(
                matched, start=start, fisheye=options.model is Solvable.FISHEYE, progress=progress
            )
    with stage(f"adjusted {len(tracks.point)} observations"):
        tracks = thinned(tracks, MOST_POINTS)
        if options.survey is not None:
            tracks, scene = with_survey(tracks, scene, options.survey, chosen.frame)
        found = adjust(tracks, scene, model=options.model, readout_s=readout_of(chosen.images[0].path))
    return SolvedFlight(
        found=found,
        about=described({image.name: image.path for image in chosen.images}, size, metadata, told),
        scale=max(1.0, max(size) / options.max_side),
        chosen=_how(chosen, len(paths)),
        left_out=chosen.left_out[0],
        versions=programs("pycolmap"),
        claim=claim_of_image(chosen.images[0].path),
        survey=options.survey,
        skipped=(*skipped.remarks, *resaved.remarks),
        notes=(*metadata.notes, *copies, *skipped.notes, *resaved.notes),
    )


def _without_copies(paths: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Return the files without exact copies, and a note on these: the noise of an image must count only once."""
    lengths = Counter(path.stat().st_size for path in paths)
    seen: dict[str | Path, Path] = {}
    for path in paths:
        seen.setdefault(sha256_of(path) if lengths[path.stat().st_size] > 1 else path, path)
    left = len(paths) - len(seen)
    note = f"{left} of {len(paths)} images are copies of others, byte for byte, and were left out"
    return tuple(seen.values()), (note,) * bool(left)


def _taken(paths: Sequence[Path], size: ImageSize, progress: Progress | None) -> list[LocatedImage]:
    """Read the position that each image states."""
    advance, found = counted(progress, len(paths), "positions"), []
    names = [path.name for path in paths]
    for path in paths:
        name = path.name if names.count(path.name) == 1 else f"{path.parent.name}/{path.name}"
        found.append(
            LocatedImage(
                image=FlightImage(path=path, name=name, size=size),
                fix=fix_of(path),
                file_bytes=path.stat().st_size,
            )
        )
        if advance is not None:
            advance(1)
    return found


def described(
    images: Mapping[str, Path | None], size: ImageSize, metadata: FrameMetadata, told: Told
) -> Observations:
    """Return what is known of the camera, and the hashes of its images by name, as observations without points.

    Raises:
        InputError: the images are not of that size.
    """
    if metadata.setting is not None and metadata.setting.image_size != size:
        raise InputError(
            "the images are of {}×{} px, and the reconstruction's camera of {}×{}: give the images that it was made "
            "from".format(*metadata.setting.image_size, *size)
        )
    views = (
        View(
            name=name,
            sha256=sha256_of(path) if path is not None else None,
            ids=np.empty(0, dtype=np.intp),
            image_points=np.empty((0, 2)),
        )
        for name, path in images.items()
    )
    return observed(ControlPoints(points=np.empty((0, 3))), size, views, metadata, told)


def _how(chosen: Selection, total: int) -> str:
    rest, blurred = chosen.left_out
    out = [f"{rest} not needed"] * bool(rest) + [
        f"{blurred} blurred or empty by the size of their files"
    ] * bool(blurred)
    return f"{len(chosen.images)} of {total}, {chosen.how}" + (f" ({', '.join(out)})" if out else "")


def _with_control_of(survey: Survey, result: CalibrationResult) -> CalibrationResult:
    """Add the file of ground control. It is no source: flights over one surveyed field are still independent."""
    made, flown, file = result.calibration.provenance, result.flown, survey.file
    if flown is None or flown.control is None:
        return result
    right = f"the ground control of SHA-256 {file.sha256} is right"
    made = replace(made, assumptions=(*made.assumptions, right))
    return replace(
        result,
        calibration=replace(result.calibration, provenance=made),
        flown=replace(flown, control=replace(flown.control, file=file)),
    )
