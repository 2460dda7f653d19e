"""Calibration from frames of a board, saved corners or control points, with its provenance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, date, datetime
from pathlib import Path

from calibrary import parsers
from calibrary.arguments import CameraLike, PolicyLike, Stated
from calibrary.calib.board import Board
from calibrary.calib.control_points import read_control_points
from calibrary.calib.corners_arrays import Corners
from calibrary.calib.corners_file import write_corners
from calibrary.calib.detection import Detections, detect_all
from calibrary.calib.estimation import estimate
from calibrary.calib.observations import Days
from calibrary.calib.result import CalibrationResult
from calibrary.calib.start import seed
from calibrary.calibration import CameraKey, ImageSize, Intrinsics, Origin
from calibrary.catalogue import overlay
from calibrary.errors import (
    CalibrationError,
    FrameError,
    InputError,
    MissingTagError,
    UnknownCameraError,
    UsageError,
)
from calibrary.jobs.calibrate.corners_in import corners_of_arrays, corners_of_file
from calibrary.jobs.calibrate.frames import (
    FrameMetadata,
    SkippedFrames,
    Told,
    describe_frames,
    find_frames,
    without_other_sizes,
)
from calibrary.jobs.calibrate.report import Asked, require_key
from calibrary.policy import FLEET, Policy
from calibrary.policy_file import policy_of
from calibrary.progress import Progress, counted, log, stage
from calibrary.records import replace
from calibrary.registry.places import one_registry
from calibrary.registry.registry import Registry


def stated_camera(
    camera: CameraLike | None, registry: str | Path | None = None, key: str | None = None
) -> Callable[[CameraKey], CameraKey]:
    """Return a function that completes a camera's key from the entry to replace, then from what the user states.

    Raises:
        UnknownCameraError: no entry has the key.
        RegistryError: several entries match the key, or there is no registry.
    """
    said = overlay(camera)
    if registry is None and key is None:
        return said
    opened = Registry.open(one_registry(registry))
    if key is None:
        return said
    try:
        named = opened.get(key).entry.calibration.camera
    except UnknownCameraError as error:
        raise UnknownCameraError(
            f"{error}; a camera without an entry is named by --make NAME --model NAME"
        ) from None
    return lambda known: said(replace(named, firmware=known.firmware, image_size=known.image_size))


def policy_for(
    policy: PolicyLike | None, registry: str | Path | None = None, key: str | None = None
) -> Policy:
    """Return the limits: the stated ones, else those of the registry that the calibration is for, else ``fleet``.

    Raises:
        InputError: the policy is unknown, or its file cannot be read.
        RegistryError: there is no registry.
    """
    if policy is not None:
        return policy_of(policy)
    if registry is None and key is None:
        return FLEET
    return Registry.open(one_registry(registry)).snapshot().policy


def not_in_future(stated: Stated | None) -> Stated:
    """Return what is stated of the calibration.

    Raises:
        UsageError: its day is in the future.
    """
    if stated is not None and stated.date is not None and stated.date > date.today():
        raise UsageError(f"--date {stated.date}: expected a day that is not in the future")
    return stated or Stated()


def detections_from_frames(
    frames: Sequence[Path],
    board: Board | float | None,
    told: Told,
    *,
    skip_other_sizes: bool = False,
    workers: int = 0,
    progress: Progress | None = None,
) -> Detections:
    """Find the board in frames.

    Raises:
        InputError: there are no frames, they are of several cameras, or their camera has no make and model.
        CalibrationError: no frame shows the board.
    """
    paths, skipped = find_frames(frames), SkippedFrames()
    if skip_other_sizes:
        paths, skipped = without_other_sizes(paths)
    metadata = describe_frames(paths, told)
    if told.needs_key:
        require_key(metadata.setting.camera if metadata.setting is not None else told.camera(CameraKey()))
    if metadata.setting is not None:
        told.check_size(metadata.setting.image_size, "the frames")
    with stage(f"looked for the board in {len(paths)} frames"):
        found = observe(
            paths, metadata, board, workers=workers, progress=counted(progress, len(paths), "frames")
        )
    found = replace(found, rejected=(*found.rejected, *skipped.remarks), notes=(*found.notes, *skipped.notes))
    for one in found.rejected:
        log.info("skipped %s", one)
    return found


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
        board: the board; or the side of its squares in mm, or None if unknown: it is then found by
            trying.
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


def detections_from_corners(
    corners: Path | Corners,
    told: Told,
    board: Board | None,
    origin: Origin | None,
    square_mm: float | None = None,
) -> Detections:
    """Take corners that were found before, here or by another detector.

    Raises:
        InputError: the file cannot be read, the arrays do not go together, a required argument is missing, or the
            camera has no make and model.
        ParseError: the file is broken.
    """
    found = (
        corners_of_arrays(corners, told, board=board, square_mm=square_mm, origin=origin)
        if isinstance(corners, Corners)
        else corners_of_file(corners, told, board=board, origin=origin)
    )
    if told.needs_key:
        require_key(found.observations.camera)
    return found


def detections_from_points(path: Path, told: Told, origin: Origin) -> Detections:
    """Read points at known places, with the pixels in which they were seen.

    Raises:
        InputError: the file cannot be read, the size of its images is not stated, or its camera has no make and model.
        ParseError: the file is broken.
    """
    if told.image_size is None:
        raise UsageError("--points needs the size of its images: say --image-size WxH")
    camera = told.camera(CameraKey(image_size=told.image_size))
    if told.needs_key:
        require_key(camera)
    return Detections(observations=read_control_points(path, told.image_size, camera, origin, told.focus))


def starting_k(start: str | float | Path, size: ImageSize) -> Intrinsics:
    """Return the initial K from a number or a file.

    Args:
        start: focal length in px; or the file of a calibration of any format, or of the seed of an extraction.
        size: (width, height) px of the images; a K of the same sensor crop at another size is scaled to it.

    Raises:
        InputError: there is no such K, the file has several cameras, or its camera has another sensor crop.
    """
    try:
        focal = float(str(start))
    except ValueError:
        pass
    else:
        if not 0.1 * max(size) < focal < 30 * max(size):
            raise InputError(f"{focal:g} px is not a focal length of images of {size[0]}×{size[1]} px")
        return replace(seed(size), fx=focal, fy=focal)
    path = Path(str(start))
    try:
        found = parsers.read(path)
    except MissingTagError:
        # A bare matrix does not state its image size.
        found = parsers.read(path, image_size=size)
    if len(found) != 1:
        raise InputError(f"has {len(found)} cameras, expected one to start from", source=path.name)
    return scaled_start(found[0].intrinsics, size, path.name)


def scaled_start(K: Intrinsics, size: ImageSize, source: str) -> Intrinsics:
    """Return an initial K at the size of the images.

    Raises:
        InputError: it is of another sensor crop.
    """
    try:
        return K.scaled(size)
    except FrameError as error:
        raise InputError(f"not a K to start from for these images: {error.message}", source=source) from None


def solved(
    detections: Detections,
    asked: Asked,
    told: Told,
    *,
    guess: Intrinsics | None = None,
    corners_from: Path | None = None,
    corners_to: Path | None = None,
) -> CalibrationResult:
    """Solve the calibration; its provenance names every frame.

    Args:
        detections: the corners.
        asked: lens model, and whether the board's warp may be solved for.
        told: what the user states; without a day, that of the frames, or today if they state none.
        guess: initial K.
        corners_from: file of the corners, if they were read from one.
        corners_to: file for the corners, which are kept even if they determine no camera.

    Raises:
        InputError: the corners are inconsistent.
        CalibrationError: the corners do not determine a camera.
    """
    seen = detections.observations
    try:
        with stage(f"solved {len(seen.views)} views with lens model {asked.model}"):
            result = estimate(seen, asked.model, guess=guess, warp=asked.warp, policy=told.policy)
    except CalibrationError as error:
        if corners_to is None:
            raise
        write_corners(seen, corners_to)
        raise CalibrationError(f"{error}; the corners are kept in {corners_to.name}") from None
    file = corners_to or corners_from
    return dated(result, told.stated, file.name if file is not None else None)


def dated(result: CalibrationResult, stated: Stated, source: str | None = None) -> CalibrationResult:
    """Return the result with its day and operator, and with the file that its corners are from."""
    taken, day, origin = result.observations.taken, None, "the images state none; --date gives it"
    # Frames of a board are taken for the calibration, images of a flight need not be.
    if result.flown is None or stated.date is not None or taken is not None:
        found, origin = calibration_date(stated.date, taken, datetime.now(UTC).date())
        day = found.isoformat()
    made = result.calibration.provenance
    made = stated.of(replace(made, source=source or made.source, date=day))
    return replace(result, calibration=replace(result.calibration, provenance=made), date_origin=origin)


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
