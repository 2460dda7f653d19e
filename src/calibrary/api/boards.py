"""Calibration from images of a calibration board, and boards to print."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, like the flag
from pathlib import Path
from typing import Final, Literal, TypeAlias

from msgspec import Struct

from calibrary.arguments import CameraLike, overlay
from calibrary.atomic import write_files
from calibrary.calib.board import Board, parse_board
from calibrary.calib.control_points import read_control_points
from calibrary.calib.corners_file import write_corners
from calibrary.calib.detection import Detections, NamedRemark
from calibrary.calib.lens_models import Solvable
from calibrary.calib.printing import Page, lay_out, page_size, to_pdf, to_svg
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, CameraKey, ImageSize
from calibrary.conventions import Origin
from calibrary.errors import CalibrationError, InputError
from calibrary.extras import CALIBRATE, require
from calibrary.jobs.calibrate.corners_in import corners_of_file
from calibrary.jobs.calibrate.entry import camera_named, entry_of, require_key
from calibrary.jobs.calibrate.frames import (
    SkippedSizes,
    describe_frames,
    find_frames,
    without_other_sizes,
)
from calibrary.jobs.calibrate.outputs import Files, Places
from calibrary.jobs.calibrate.report import report_of
from calibrary.jobs.calibrate.run import SolveRequest, calibrate_from, observe, read_seed
from calibrary.jobs.fleet import Fleet
from calibrary.progress import Progress, counted, log, stage
from calibrary.records import Json, replace, to_json
from calibrary.registry.entry import Entry
from calibrary.validation import Finding

__all__ = ["CalibrateResult", "Places", "calibrate", "camera_of_entry", "write_board"]

Frames: TypeAlias = str | Path | Sequence[str | Path]
_ORIGINS: Final = {"corner": Origin.CORNER, "centre": Origin.PIXEL_CENTRE}


class CalibrateResult(Struct, frozen=True, eq=False):
    """Result of a calibration: the camera's K and distortion, the findings and the verdict.

    Attributes:
        result: complete result, as the command line shows it.
        collected: corners used for the solution.
        request: arguments of the calibration.
    """

    result: CalibrationResult
    collected: Detections
    request: SolveRequest

    @property
    def verdict(self) -> BoardVerdict:
        """Pass: ready for approval; provisional: a draft at most; refuse: not usable."""
        return self.result.verdict

    @property
    def is_good(self) -> bool:
        """Whether the verdict is pass."""
        return self.verdict is BoardVerdict.PASS

    @property
    def calibration(self) -> Calibration:
        """K and distortion with their covariance, and a provenance with date and source images."""
        return self.result.calibration

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Problems of the calibration, most severe first, each with its ``message`` and ``remedy``."""
        return self.result.findings

    @property
    def skipped(self) -> tuple[NamedRemark, ...]:
        """Images that show no board or cannot be read, each with the reason."""
        return self.collected.rejected

    @property
    def entry(self) -> Entry:
        """Return the registry entry for this calibration, for :meth:`calibrary.Fleet.propose_entry`.

        Raises:
            InputError: the calibration is refused, or make and model of the camera are unknown.
        """
        return entry_of(self.result, self.request)

    def write(self, places: Places) -> Files:
        """Write the page, the corners and the calibration; the calibration is not written if it is refused.

        Raises:
            InputError: a file cannot be written.
            UnsupportedModelError: the format cannot represent this lens.
        """
        files = places.files(self.result, self.collected)
        write_files(files.content)
        return files

    def to_dict(self) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/calibration-result-1.schema.json)."""
        return to_json(report_of(self.result))


def calibrate(
    frames: Frames | None = None,
    *,
    square_mm: float | None = None,
    board: str | None = None,
    marker_mm: float | None = None,
    corners: str | Path | None = None,
    points: str | Path | None = None,
    image_size: ImageSize | None = None,
    pixel_origin: Literal["corner", "centre"] | None = None,
    lens_model: str = "auto",
    warp: bool = True,
    seed_k: str | Path | None = None,
    date: Day | None = None,
    operator: str | None = None,
    focus: str | None = None,
    camera: CameraLike | None = None,
    keep_corners: str | Path | None = None,
    for_registry: bool = False,
    skip_other_sizes: bool = False,
    workers: int = 0,
    progress: Progress | None = None,
) -> CalibrateResult:
    """Calibrate a camera (K and distortion) from images of a board, and assess the result.

    Args:
        frames: a folder, a file, a pattern, or a list of these; all of one camera at one focus setting.
        square_mm: side of a square in mm; for circles, the distance of their centres. K does not depend on it; without
            it, poses and the board warp are in units of squares.
        board: board type and number of inner corners, such as "checkerboard:11x8"; by default a checkerboard of a size
            found by trial.
        marker_mm: side of a marker, or diameter of a circle, in mm.
        corners: instead of frames, the corners.json of an earlier calibration, or the result of another detector: a
            corners.vnl of mrcal, or a CSV with the columns image, x, y and id. The latter two need ``board``, and
            ``image_size`` if the images are not in the same folder.
        points: instead of frames, a table of control points: X,Y,Z,u,v,image in metres and px; needs ``image_size``.
        image_size: (width, height) px of the images of ``points``; otherwise it is only checked.
        pixel_origin: origin of the pixel coordinates in a table: "corner" is the outer corner of the first pixel (the
            default for ``points``), "centre" its centre (the default for tables of ``corners``).
        lens_model: "auto", or the name of a lens model, such as "brown" or "fisheye".
        warp: whether the board warp may be estimated.
        seed_k: a file with an initial K.
        date: date of the calibration; by default that of the images' EXIF, else today.
        operator: person who made the calibration.
        focus: focus setting of the lens: "locked at infinity".
        camera: facts about the camera that the images do not state or state wrongly; fields that are None are taken
            from the images.
        keep_corners: file for the corners; the provenance contains its name (default: ``corners``). This function
            writes it if the corners do not determine a camera; otherwise :meth:`CalibrateResult.write` does.
        for_registry: reject a camera without make and model before the board is searched for.
        skip_other_sizes: skip images that differ in size from the majority; otherwise they are an error.
        workers: number of detection processes; 0 chooses it automatically.
        progress: called with (images done, number of images, "frames").

    Raises:
        InputError: there are no images, they are of several cameras, or an argument is out of range.
        CalibrationError: no image shows the board, or the corners do not determine a camera.
        MissingExtraError: OpenCV is not installed.

    >>> result = calibrary.calibrate("frames", board="checkerboard:9x6", square_mm=40)
    >>> result.verdict, result.calibration.camera.model
    (<BoardVerdict.PROVISIONAL: 'provisional'>, 'Board One')
    >>> result.findings[0].rule
    'few-views'
    """
    require(CALIBRATE, "a calibration")
    if lens_model != "auto" and lens_model not in list(Solvable):
        raise InputError(f"no lens model {lens_model!r:.40}; expected auto, {', '.join(Solvable)}")
    if [frames, corners, points].count(None) != 2:
        raise InputError("expected frames, corners or points, and one of them only")
    stated = overlay(camera)
    named = parse_board(board, square_mm, marker_mm) if board is not None else None
    if frames is not None:
        collected = _searched(
            frames,
            named or square_mm,
            stated,
            focus,
            image_size,
            for_registry=for_registry,
            skip_other_sizes=skip_other_sizes,
            workers=workers,
            progress=progress,
        )
    else:
        if corners is not None:
            collected = corners_of_file(
                Path(corners),
                stated,
                focus,
                board=named,
                image_size=image_size,
                origin=_ORIGINS[pixel_origin] if pixel_origin is not None else None,
            )
            _check_size(collected.observations.image_size, image_size, "its corners", Path(corners).name)
        else:
            origin = _ORIGINS[pixel_origin or "corner"]
            collected = _control_points(Path(points or ""), image_size, stated, origin, focus)
        if for_registry:
            require_key(collected.observations.camera)
    size = collected.observations.image_size
    request = SolveRequest(
        model=lens_model,
        warp=warp,
        guess=read_seed(Path(seed_k), size) if seed_k is not None else None,
        date=date,
        operator=operator,
        corners_name=Path(kept).name if (kept := keep_corners or corners) is not None else None,
    )
    with stage(f"solved {len(collected.observations.views)} views with lens model {lens_model}"):
        try:
            result = calibrate_from(collected, request)
        except CalibrationError as error:
            if keep_corners is None:
                raise
            write_corners(collected.observations, Path(keep_corners))
            raise CalibrationError(f"{error}; the corners are kept in {Path(keep_corners).name}") from None
    return CalibrateResult(result, collected, request)


def _searched(
    frames: Frames,
    pattern: Board | float | None,
    stated: Callable[[CameraKey], CameraKey],
    focus: str | None,
    image_size: ImageSize | None,
    *,
    for_registry: bool,
    skip_other_sizes: bool,
    workers: int,
    progress: Progress | None,
) -> Detections:
    paths = find_frames([str(one) for one in ([frames] if isinstance(frames, str | Path) else frames)])
    skipped = SkippedSizes()
    if skip_other_sizes:
        paths, skipped = without_other_sizes(paths)
    metadata = describe_frames(paths, stated, focus)
    if for_registry:
        require_key(metadata.setting.camera if metadata.setting is not None else stated(CameraKey()))
    if metadata.setting is not None:
        _check_size(metadata.setting.image_size, image_size, "the frames")
    with stage(f"looked for the board in {len(paths)} frames"):
        found = observe(
            paths, metadata, pattern, workers=workers, progress=counted(progress, len(paths), "frames")
        )
    found = replace(found, rejected=(*found.rejected, *skipped.remarks), notes=(*found.notes, *skipped.notes))
    for one in found.rejected:
        log.info("skipped %s: %s", one.name, one.remark.text)
    return found


def _control_points(
    points: Path,
    image_size: ImageSize | None,
    stated: Callable[[CameraKey], CameraKey],
    origin: Origin,
    focus: str | None,
) -> Detections:
    if image_size is None:
        raise InputError("points need image_size, the size of their images", source=points.name)
    camera = stated(CameraKey(image_size=image_size))
    return Detections(observations=read_control_points(points, image_size, camera, origin, focus))


def _check_size(found: ImageSize, given: ImageSize | None, what: str, source: str | None = None) -> None:
    if given not in {None, found}:
        raise InputError(
            f"{what} are of {found[0]}×{found[1]} px and no other size; leave --image-size out", source=source
        )


def camera_of_entry(fleet: Fleet, key: str) -> Callable[[CameraKey], CameraKey]:
    """Return a function that replaces a camera key by that of an entry, except firmware and image size.

    Raises:
        RegistryError: the entry does not exist, or several match.
    """
    named = camera_named(fleet.registry, key)
    return lambda known: replace(named, firmware=known.firmware, image_size=known.image_size)


def write_board(
    board: str,
    out: str | Path,
    *,
    square_mm: float,
    marker_mm: float | None = None,
    page: str | None = None,
) -> tuple[Board, Page]:
    """Write a board to scale as PDF or SVG; return the board and its page.

    Args:
        board: board type and number of inner corners, such as "checkerboard:11x8".
        out: a .pdf or .svg file.
        square_mm: side of a square in mm; for circles, the distance of their centres.
        marker_mm: side of a marker, or diameter of a circle, in mm.
        page: "a0" … "a4", "letter", "tabloid" or "WIDTHxHEIGHT" in mm; by default the smallest A size that is large
            enough.

    Raises:
        InputError: the board type or page is unknown, the board is too large, or the file cannot be written.
        MissingExtraError: OpenCV is not installed.

    >>> from calibrary.api.boards import write_board
    >>> board, page = write_board("checkerboard:9x6", "board.svg", square_mm=25)
    >>> page.width_mm, page.height_mm
    (420.0, 297.0)
    """
    require(CALIBRATE, "a board")
    write = {".pdf": to_pdf, ".svg": to_svg}.get(Path(out).suffix.lower())
    if write is None:
        raise InputError("expected a file that ends in .pdf or .svg", source=str(out))
    made = parse_board(board, square_mm, marker_mm)
    laid = lay_out(made, page_size(page) if page else None)
    write_files({Path(out): write(made, laid)})
    return made, laid
