"""Images of a flight in, a calibration with its verdict out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, as the flag
from pathlib import Path
from typing import TypeAlias

from calibrary.api.boards import CalibrateResult
from calibrary.api.fleet import Fleet
from calibrary.api.stated import CameraLike, overlay
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import CameraKey, ImageSize, Intrinsics
from calibrary.errors import FrameError, InputError
from calibrary.extras import SFM, require
from calibrary.jobs.calibrate_board.entry import require_key
from calibrary.jobs.calibrate_board.frame_metadata import describe_frames, find_frames
from calibrary.jobs.calibrate_board.run import SolveRequest, read_seed
from calibrary.jobs.calibrate_flight.finished import MOST_IMAGES, calibrate_finished_from, is_reconstruction
from calibrary.jobs.calibrate_flight.run import FlightRequest, calibrate_flight_from
from calibrary.progress import Progress
from calibrary.records import replace
from calibrary.sfm.survey import Survey, read_survey

__all__ = ["Survey", "calibrate_flight", "calibrate_reconstruction", "ground_control"]

PointsLike: TypeAlias = str | Path | Survey
"""Ground control: a file, or what :func:`ground_control` made of it."""


def ground_control(
    path: str | Path, *, std_m: float = 0.03, mark_px: float = 1.0, offset_std_m: float = math.inf
) -> Survey:
    """Surveyed points and where images show them, for ``points`` of the functions below.

    Args:
        path: ODM's gcp_list.txt, or the table of :func:`calibrary.calibrate`'s ``points``.
        std_m: standard deviation of each coordinate of a point.
        mark_px: of each coordinate of a mark.
        offset_std_m: how far positions in the images and points may be apart in datum and heights; not at all known,
            unless it is stated.

    Raises:
        InputError: it cannot be read, or states no points and marks.
        MissingExtraError: pyproj is not installed, and the coordinates are a map's.
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
    """Find a camera's K and distortion from the images of a flight, and say how far to trust them.

    Args:
        images: a folder, a file, a pattern, or a list of these; of one camera at one focus and zoom.
        most: of them are calibrated from.
        start: K to begin with: a focal length in px, or a calibration file; a usual one when not given.
        fleet: whose entry ``from_registry`` names.
        from_registry: the entry whose K to begin with.
        lens_model: "auto", or the name of one lens model, such as "brown" or "fisheye".
        max_side: px, longer side of what points are looked for in.
        points: ground control.
        date: of the calibration; that of the images' EXIF, else today, when not given.
        operator: who made it.
        focus: how the lens was focused: "locked at infinity".
        camera: what the images do not say of the camera, or say wrong; None fields leave it to them.
        for_registry: refuse a camera without make and model before anything is matched.
        progress: called with (done, total, what).

    Raises:
        InputError: there are no images, they are of several cameras, or an argument is out of range.
        CalibrationError: the images do not fit together, or do not determine a camera.
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
    """Find a camera's K and distortion from what another program's reconstruction observed, judged as a flight's.

    Args:
        result_of: a folder with COLMAP's sparse model, or with OpenSfM's or ODM's result.
        images: of it, where they are at hand: they state the camera and their positions, and which images count.
        camera_number: which one of a reconstruction by several, from 1, where no images are given.
        most: images are calibrated from.
        lens_model: as of :func:`calibrate_flight`, as the next five.
        points: ground control.
        date: of the calibration.
        operator: who made it.
        focus: how the lens was focused.
        camera: what the images do not say of the camera.
        for_registry: refuse a camera without make and model before anything is solved.

    Raises:
        InputError: the folder holds no such result, or does not say which camera is meant.
        CalibrationError: its images do not determine a camera.
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
    """The one that is named; None to choose it by the images."""
    if lens_model != "auto" and lens_model not in list(Solvable):
        raise InputError(f"no lens model {lens_model!r:.40}; expected auto, {', '.join(Solvable)}")
    return None if lens_model == "auto" else Solvable(lens_model)


def _start(
    start: str | float | None, fleet: Fleet | None, key: str | None, size: ImageSize
) -> Intrinsics | None:
    """K to begin with, of a number, a file or an entry."""
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
