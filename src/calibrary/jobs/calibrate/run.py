"""Calibration from frames of a board, saved corners or control points, with its provenance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, date, datetime
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.calib.board import Board
from calibrary.calib.detection import Detections, detect_all
from calibrary.calib.estimation import estimate
from calibrary.calib.observations import Days
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import FrameError, InputError, MissingTagError
from calibrary.jobs.calibrate.frames import FrameMetadata
from calibrary.records import replace

__all__ = ["SolveRequest", "calibrate_from", "calibration_date", "observe", "read_seed"]


class SolveRequest(Struct, frozen=True, kw_only=True):
    """Options of the solve, and the stated provenance.

    Attributes:
        model: of the lens, or "auto".
        warp: whether the board's warp may be solved for.
        guess: initial K.
        date: of the calibration; None for the date of its frames, or today if they state none.
        operator: of the calibration; None if not stated.
        corners_name: name of the corners.json with the observations, if there is one.
    """

    model: str = "auto"
    warp: bool = True
    guess: Intrinsics | None = None
    date: date | None = None
    operator: str | None = None
    corners_name: str | None = None


def observe(
    frames: Sequence[Path],
    metadata: FrameMetadata,
    board: Board | float | None,
    *,
    workers: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Detections:
    """Detect the board in frames.

    Args:
        frames: files.
        metadata: of the frames.
        board: the board; or the side of its squares in mm, or None if unknown: the numbers of corners are then
            found by trying.
        workers: processes; 0 for automatic, up to the number of cores.
        progress: called with the number of frames done since the last call.

    Raises:
        InputError: no frame can be read, or the frames differ in size.
        CalibrationError: no frame shows the board.
    """
    found = detect_all(frames, board, setting=metadata.setting, workers=workers, progress=progress)
    return replace(
        found,
        observations=replace(found.observations, taken=metadata.taken),
        notes=(*metadata.notes, *found.notes),
    )


def read_seed(path: Path, image_size: ImageSize) -> Intrinsics:
    """Read the initial K: the self-calibration seed of an extraction, or a calibration of any format.

    Args:
        path: the file.
        image_size: (width, height) px of the frames; a K of the same sensor crop at another size is scaled to
            it.

    Raises:
        InputError: the file cannot be read, has several cameras, or its camera has another sensor crop.
    """
    try:
        found = parsers.read(path)
    except MissingTagError:
        # A bare matrix does not state its image size.
        found = parsers.read(path, image_size=image_size)
    if len(found) != 1:
        raise InputError(f"has {len(found)} cameras, expected one to start from", source=path.name)
    try:
        return found[0].intrinsics.scaled(image_size)
    except FrameError as error:
        raise InputError(
            f"not a K to start from for these frames: {error.message}", source=path.name
        ) from None


def calibrate_from(collected: Detections, request: SolveRequest) -> CalibrationResult:
    """Solve the calibration; its provenance names every frame.

    Raises:
        InputError: the corners are inconsistent.
        CalibrationError: the corners do not determine a camera.
    """
    seen = collected.observations
    result = estimate(seen, request.model, guess=request.guess, warp=request.warp)
    day, origin = calibration_date(request.date, seen.taken, datetime.now(UTC).date())
    made = result.calibration.provenance
    provenance = replace(
        made,
        source=request.corners_name or made.source,
        date=day.isoformat(),
        operator=request.operator,
    )
    return replace(result, calibration=replace(result.calibration, provenance=provenance), date_origin=origin)


def calibration_date(stated: date | None, taken: Days | None, today: date) -> tuple[date, str]:
    """The date of a calibration and its source in words.

    Args:
        stated: date stated by the user.
        taken: first and last date of the frames.
        today: used if the images state no date, or a future one because the camera's clock was not set.
    """
    if stated is not None:
        return stated, "as stated"
    if taken is None:
        return today, "today: the images state no date"
    first, last = taken
    if last > today:
        return today, f"today: the images' EXIF states {last}, which is in the future"
    if first < last:
        return last, f"from the images' EXIF, the last day of {first} to {last}"
    return last, "from the images' EXIF"
