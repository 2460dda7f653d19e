"""Self-calibration from the images of a flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, like the flag
from pathlib import Path
from typing import TypeAlias

from calibrary.api.boards import CalibrateResult
from calibrary.arguments import CameraLike, overlay
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import CameraKey, ImageSize, Intrinsics
from calibrary.errors import FrameError, InputError
from calibrary.extras import SFM, require
from calibrary.jobs.calibrate.entry import require_key
from calibrary.jobs.calibrate.frames import describe_frames, find_frames
from calibrary.jobs.calibrate.run import SolveRequest, read_seed
from calibrary.jobs.calibrate_flight.reconstruction import (
    MOST_IMAGES,
    calibrate_finished_from,
    is_reconstruction,
)
from calibrary.jobs.calibrate_flight.run import FlightRequest, calibrate_flight_from
from calibrary.jobs.fleet import Fleet
from calibrary.progress import Progress
from calibrary.records import replace
from calibrary.sfm.survey import Survey, read_survey

__all__ = ["Survey", "calibrate_flight", "calibrate_reconstruction", "ground_control"]

PointsLike: TypeAlias = str | Path | Survey
"""Ground control: a file, or the result of :func:`ground_control`."""


def ground_control(
    path: str | Path, *, std_m: float = 0.03, mark_px: float = 1.0, offset_std_m: float = math.inf
) -> Survey:
    """Read surveyed points and their image measurements, for ``points`` of the functions below.

    Args:
        path: ODM's gcp_list.txt, or the table of :func:`calibrary.calibrate`'s ``points``.
        std_m: standard deviation of each coordinate of a point, in m.
        mark_px: standard deviation of each coordinate of an image measurement, in px.
        offset_std_m: standard deviation, in m, of the offset in datum and height between the image positions and the
            points; by default the offset is unknown.

    Raises:
        InputError: the file cannot be read, or contains no points and image measurements.
        MissingExtraError: the coordinates are in a map projection, and pyproj is not installed.
    """
    return replace(read_survey(Path(path)), std_m=std_m, mark_px=mark_px, offset_std_m=offset_std_m)


def _survey(points: PointsLike | None) -> Survey | None:
    return ground_control(points) if isinstance(points, str | Path) else points


def calibrate_flight(
    images: str | Path | Sequence[str | Path],
    *,
    most: int = 30,
    start: str | float | None = None,
    fleet: Fleet | None = None,
    from_registry: str | None = None,
    lens_model: str = "auto",
    max_side: int = 1600,
    points: PointsLike | None = None,
    date: Day | None = None,
    operator: str | None = None,
    focus: str | None = None,
    camera: CameraLike | None = None,
    for_registry: bool = False,
    progress: Progress | None = None,
) -> CalibrateResult:
    """Calibrate a camera (K and distortion) from the images of a flight, and assess the result.

    Args:
        images: a folder, a file, a pattern, or a list of these; all of one camera at one focus and zoom setting.
        most: largest number of images used.
        start: initial K: a focal length in px, or a calibration file; by default a typical one.
        fleet: registry with the entry ``from_registry``.
        from_registry: key of the entry with the initial K.
        lens_model: "auto", or the name of a lens model, such as "brown" or "fisheye".
        max_side: longer side in px of the images in which features are detected.
        points: ground control.
        date: date of the calibration; by default that of the images' EXIF, or none if they state none.
        operator: person who made the calibration.
        focus: focus setting of the lens: "locked at infinity".
        camera: facts about the camera that the images do not state or state wrongly; fields that are None are taken
            from the images.
        for_registry: reject a camera without make and model before anything is matched.
        progress: called with (done, total, what).

    Raises:
        InputError: there are no images, they are of several cameras, or an argument is out of range.
        CalibrationError: the images cannot be matched, or do not determine a camera.
        MissingExtraError: pycolmap is not installed.
    """
    require(SFM, "a calibration from a flight")
    model, survey = _model(lens_model), _survey(points)
    paths = find_frames([str(one) for one in ([images] if isinstance(images, str | Path) else images)])
    stated = overlay(camera)
    begin: Intrinsics | None = None
    if for_registry or start is not None or from_registry is not None:
        setting = describe_frames(paths[:1], stated, focus).setting
        if setting is None:
            raise InputError("cannot be read", source=paths[0].name)
        if for_registry:
            require_key(setting.camera)
        begin = _start(start, fleet, from_registry, setting.image_size)
    request = FlightRequest(
        images=most,
        model=model,
        start=begin,
        max_side=max_side,
        date=date,
        operator=operator,
        focus=focus,
        survey=survey,
    )
    result, collected = calibrate_flight_from(paths, request, stated, progress=progress)
    asked = SolveRequest(model=lens_model, warp=False, guess=begin, date=date, operator=operator)
    return CalibrateResult(result, collected, asked)


def calibrate_reconstruction(
    result_of: str | Path,
    images: str | Path | Sequence[str | Path] = (),
    *,
    camera_number: int | None = None,
    most: int = MOST_IMAGES,
    lens_model: str = "auto",
    points: PointsLike | None = None,
    date: Day | None = None,
    operator: str | None = None,
    focus: str | None = None,
    camera: CameraLike | None = None,
    for_registry: bool = False,
) -> CalibrateResult:
    """Calibrate a camera from the observations in another program's reconstruction; assessed like a flight.

    Args:
        result_of: a folder with a sparse model of COLMAP, or with the result of OpenSfM or ODM.
        images: images of the reconstruction, if available: they provide the camera and the positions, and limit which
            images are used.
        camera_number: number of the camera in a reconstruction with several, from 1, if no images are given.
        most: largest number of images used.
        lens_model: as for :func:`calibrate_flight`.
        points: ground control.
        date: date of the calibration.
        operator: person who made the calibration.
        focus: focus setting of the lens.
        camera: facts about the camera that the images do not state.
        for_registry: reject a camera without make and model before anything is solved.

    Raises:
        InputError: the folder contains no such result, or the camera is ambiguous.
        CalibrationError: the images do not determine a camera.
    """
    model, stated, folder = _model(lens_model), overlay(camera), Path(result_of)
    if not is_reconstruction(folder):
        raise InputError(
            "expected a folder with COLMAP's sparse model (cameras, images, points3D; .bin or .txt), or with OpenSfM's "
            "or ODM's reconstruction.json and tracks.csv; a file of K and σ alone is for calibrate combine",
            source=str(result_of),
        )
    given = [images] if isinstance(images, str | Path) else [*images]
    paths = find_frames([str(one) for one in given]) if given else ()
    if for_registry:
        setting = describe_frames(paths[:1], stated, focus).setting if paths else None
        require_key(setting.camera if setting is not None else stated(CameraKey()))
    survey = _survey(points)
    request = FlightRequest(
        images=most, model=model, date=date, operator=operator, focus=focus, survey=survey
    )
    result, collected = calibrate_finished_from(folder, paths, request, stated, camera=camera_number)
    asked = SolveRequest(model=lens_model, warp=False, date=date, operator=operator)
    return CalibrateResult(result, collected, asked)


def _model(lens_model: str) -> Solvable | None:
    """Return the lens model of that name; None to choose it automatically."""
    if lens_model != "auto" and lens_model not in list(Solvable):
        raise InputError(f"no lens model {lens_model!r:.40}; expected auto, {', '.join(Solvable)}")
    return None if lens_model == "auto" else Solvable(lens_model)


def _start(
    start: str | float | None, fleet: Fleet | None, key: str | None, size: ImageSize
) -> Intrinsics | None:
    """Return the initial K from a number, a file or an entry; None if none is given."""
    if key is not None:
        if fleet is None:
            raise InputError("an entry to begin with is of a registry: give one", place="--from-registry")
        try:
            return fleet.registry.get(key).entry.calibration.intrinsics.scaled(size)
        except FrameError as error:
            raise InputError(f"not a K to start from for these images: {error.message}", source=key) from None
    if start is None:
        return None
    try:
        focal = float(start)
    except ValueError:
        return read_seed(Path(str(start)), size)
    if not 0.1 * max(size) < focal < 30 * max(size):
        raise InputError(
            f"{focal:g} px is not a focal length of images of {size[0]}×{size[1]} px", place="--start"
        )
    return Intrinsics(fx=focal, fy=focal, cx=size[0] / 2, cy=size[1] / 2, image_size=size)
