"""Images of a flight in, a calibration with its verdict out."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, as the flag
from pathlib import Path

from calibrary.api.boards import CalibrateResult
from calibrary.api.fleet import Fleet
from calibrary.api.stated import CameraLike, overlay
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import FrameError, InputError
from calibrary.extras import SFM, require
from calibrary.jobs.calibrate_board.entry import require_key
from calibrary.jobs.calibrate_board.frame_metadata import describe_frames, find_frames
from calibrary.jobs.calibrate_board.run import SolveRequest, read_seed
from calibrary.jobs.calibrate_flight.run import FlightRequest, calibrate_flight_from
from calibrary.progress import Progress

__all__ = ["calibrate_flight"]


def calibrate_flight(
    images: str | Path | Sequence[str | Path],
    *,
    most: int = 30,
    start: str | float | None = None,
    fleet: Fleet | None = None,
    from_registry: str | None = None,
    lens_model: str = "auto",
    max_side: int = 1600,
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
    if lens_model != "auto" and lens_model not in list(Solvable):
        raise InputError(f"no lens model {lens_model!r:.40}; expected auto, {', '.join(Solvable)}")
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
    model = None if lens_model == "auto" else Solvable(lens_model)
    request = FlightRequest(
        images=most, model=model, start=begin, max_side=max_side, date=date, operator=operator, focus=focus
    )
    result, collected = calibrate_flight_from(paths, request, stated, progress=progress)
    asked = SolveRequest(model=lens_model, warp=False, guess=begin, date=date, operator=operator)
    return CalibrateResult(result, collected, asked)


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
            f"{focal:g} px is no focal length of images of {size[0]}×{size[1]} px", place="--start"
        )
    return Intrinsics(fx=focal, fy=focal, cx=size[0] / 2, cy=size[1] / 2, image_size=size)
