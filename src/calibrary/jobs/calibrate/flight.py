"""Calibration from a flight: of its images, or of another program's finished reconstruction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from calibrary.calib.detection import Detections
from calibrary.calib.lens_models import Solvable
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import CameraKey, ImageSize, Intrinsics
from calibrary.errors import InputError, UsageError
from calibrary.extras import SFM, require
from calibrary.jobs.calibrate import Flight
from calibrary.jobs.calibrate.flight_images import FlightOptions, solve_images
from calibrary.jobs.calibrate.frames import Told, describe_frames, find_frames
from calibrary.jobs.calibrate.reconstruction import MOST_IMAGES, solve_reconstruction
from calibrary.jobs.calibrate.report import Asked, require_key
from calibrary.jobs.calibrate.run import scaled_start, starting_k
from calibrary.progress import Progress
from calibrary.records import replace
from calibrary.registry.places import one_registry
from calibrary.registry.registry import Registry
from calibrary.sfm.engine import MAX_SIDE
from calibrary.sfm.survey import Survey, read_survey

LENSES: Final = ("auto", "k1k2", "k1k2p1p2", "brown", "rational", "fisheye")
"""Lens models of a flight."""


def solve_flight(
    frames: Sequence[Path],
    flight: Flight,
    told: Told,
    asked: Asked,
    *,
    points: str | Path | None = None,
    start: str | float | Path | None = None,
    registry: str | Path | None = None,
    progress: Progress | None = None,
) -> tuple[CalibrationResult, Detections, Intrinsics | None]:
    """Calibrate from the images of a flight, or from its finished reconstruction.

    Args:
        frames: files, folders and patterns.
        flight: how.
        told: what the user states.
        asked: lens model.
        points: file of surveyed points.
        start: focal length in px, or a calibration file.
        registry: of the entry to start from.
        progress: called with (done, total, what).

    Returns:
        The calibration, the images used, and the initial K; None if none was given.

    Raises:
        UsageError: the arguments do not go together.
        InputError: there are no images, they are of several cameras, or a file cannot be read.
        CalibrationError: the images cannot be matched, or do not determine a camera.
        MissingExtraError: pycolmap is not installed.
    """
    _check(flight, frames, asked, points, start)
    files = find_frames(frames, "the images of the flight") if frames else ()
    setting = describe_frames(files[:1], told).setting if files else None
    if told.needs_key:
        require_key(setting.camera if setting is not None else told.camera(CameraKey()))
    options = FlightOptions(
        images=flight.most or (30 if flight.result_of is None else MOST_IMAGES),
        model=Solvable.named(asked.model),
        max_side=flight.max_side_px or MAX_SIDE,
        survey=_surveyed(flight, Path(points)) if points is not None else None,
    )
    if flight.result_of is not None:
        folder = Path(flight.result_of)
        solved = solve_reconstruction(folder, files, told, options, camera=flight.camera_number)
        return *solved.calibrated(told), None
    size = setting.image_size if setting is not None else None
    options = replace(options, start=_start(start, flight.from_registry, registry, size))
    return *solve_images(files, told, options, progress=progress).calibrated(told), options.start


def _check(
    flight: Flight,
    frames: Sequence[Path],
    asked: Asked,
    points: str | Path | None,
    start: str | float | Path | None,
) -> None:
    if flight.result_of is None:
        if not frames:
            raise UsageError(
                "expected DIR, the images of a flight, or --from FOLDER, a finished reconstruction"
            )
        require(SFM, "a calibration from a flight")
    elif not (start is None and flight.from_registry is None and flight.max_side_px is None):
        raise UsageError(
            "--start, --from-registry and --max-side-px are of images: a reconstruction has its points"
        )
    if flight.camera_number is not None and (flight.result_of is None or frames):
        raise UsageError("--camera is of a reconstruction by several cameras, --from FOLDER without DIR")
    if points is None and {flight.points_std_m, flight.mark_std_px, flight.same_datum_m} != {None}:
        raise UsageError(
            "--points-std-m, --mark-std-px and --same-datum-m are of ground control, --points FILE"
        )
    if asked.model not in LENSES:
        raise UsageError(f"--lens-model {asked.model}: expected of a flight {', '.join(LENSES)}")


def _surveyed(flight: Flight, points: Path) -> Survey:
    survey = read_survey(points)
    return replace(
        survey,
        std_m=flight.points_std_m or survey.std_m,
        mark_px=flight.mark_std_px or survey.mark_px,
        offset_std_m=flight.same_datum_m or math.inf,
    )


def _start(
    start: str | float | Path | None, key: str | None, registry: str | Path | None, size: ImageSize | None
) -> Intrinsics | None:
    if start is None and key is None:
        return None
    if start is not None and key is not None:
        raise UsageError("--start and --from-registry are two ways to begin; give one")
    if size is None:
        raise InputError("the first image cannot be read, so nothing says for which size K is")
    if key is None:
        return starting_k(start or "", size)
    entry = Registry.open(one_registry(registry)).get(key).entry
    return scaled_start(entry.calibration.intrinsics, size, key)
