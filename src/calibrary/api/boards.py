"""Frames of a calibration board in, a calibration with its verdict out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date as Day  # noqa: N812  the argument is called date, as the flag
from pathlib import Path

from calibrary.calib.board import parse_board
from calibrary.calib.collect import Collected, NamedRemark
from calibrary.calib.lens_models import Solvable
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import InputError
from calibrary.jobs.calibrate_board.frame_metadata import describe_frames, find_frames
from calibrary.jobs.calibrate_board.report import report_of
from calibrary.jobs.calibrate_board.run import SolveRequest, calibrate_from, observe, read_seed
from calibrary.progress import Progress, counted
from calibrary.records import Json, replace, to_json
from calibrary.validation import Finding

__all__ = ["CalibrateResult", "calibrate"]


@dataclass(frozen=True, slots=True, eq=False)
class CalibrateResult:
    """What frames of a board say of their camera.

    Attributes:
        result: all of it, as the command line shows it.
        collected: the corners it was solved from.
    """

    result: CalibrationResult
    collected: Collected

    @property
    def verdict(self) -> BoardVerdict:
        """Pass: to be approved; provisional: a draft at most; refuse: not to be used."""
        return self.result.verdict

    @property
    def is_good(self) -> bool:
        """Whether it passes."""
        return self.verdict is BoardVerdict.PASS

    @property
    def calibration(self) -> Calibration:
        """K and distortion with their covariance, and a provenance with date and frames."""
        return self.result.calibration

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What speaks against it, the gravest first, each with its ``message`` and ``remedy``."""
        return self.result.findings

    @property
    def skipped(self) -> tuple[NamedRemark, ...]:
        """The frames that show no board, or that cannot be read, each with its reason."""
        return self.collected.rejected

    def to_dict(self) -> dict[str, Json]:
        """The result as plain data for JSON (schemas/calibration-result-1.schema.json)."""
        return to_json(report_of(self.result))


def calibrate(
    frames: str | Path | Sequence[str | Path],
    *,
    square_mm: float,
    board: str | None = None,
    marker_mm: float | None = None,
    lens_model: str = "auto",
    warp: bool = True,
    seed_k: str | Path | None = None,
    date: Day | None = None,
    operator: str | None = None,
    focus: str | None = None,
    camera: CameraKey | None = None,
    workers: int = 0,
    progress: Progress | None = None,
) -> CalibrateResult:
    """Find a camera's K and distortion from frames of a board, and say how far to trust them.

    Args:
        frames: a folder, a file, a pattern, or a list of these; of one camera at one focus.
        square_mm: side of a square; of circles the distance of their centres.
        board: which one, in inner corners, such as "checkerboard:11x8"; a checkerboard whose size is found by
            trying when not given.
        marker_mm: side of a marker, diameter of a circle.
        lens_model: "auto", or the name of one lens model, such as "brown" or "fisheye".
        warp: whether the board's warp may be solved for.
        seed_k: a file with a K to start from.
        date: of the calibration; that of the frames' EXIF, else today, when not given.
        operator: who made it.
        focus: how the lens was focused: "locked at infinity".
        camera: what the frames do not say of the camera, or say wrong; None fields leave it to them.
        workers: processes that look for the board; 0 decides by itself.
        progress: called with (frames done, frames in all, "frames").

    Raises:
        InputError: there are no frames, they are of several cameras, or an argument is out of range.
        CalibrationError: no frame shows the board, or the corners do not determine a camera.

    >>> result = calibrary.calibrate("frames", board="checkerboard:9x6", square_mm=40)
    >>> result.verdict, result.calibration.camera.model
    (<BoardVerdict.PROVISIONAL: 'provisional'>, 'Board One')
    >>> result.findings[0].rule
    'few-views'
    """
    if lens_model != "auto" and lens_model not in list(Solvable):
        raise InputError(f"no lens model {lens_model!r:.40}; expected auto, {', '.join(Solvable)}")
    pattern = parse_board(board, square_mm, marker_mm) if board is not None else float(square_mm)
    paths = find_frames([str(one) for one in ([frames] if isinstance(frames, str | Path) else frames)])
    metadata = describe_frames(paths, _stated(camera), focus)
    collected = observe(
        paths, metadata, pattern, workers=workers, progress=counted(progress, len(paths), "frames")
    )
    size = collected.observations.image_size
    request = SolveRequest(
        model=lens_model,
        warp=warp,
        guess=read_seed(Path(seed_k), size) if seed_k is not None else None,
        date=date,
        operator=operator,
    )
    return CalibrateResult(calibrate_from(collected, request), collected)


def _stated(camera: CameraKey | None) -> Callable[[CameraKey], CameraKey]:
    """Replaces what the frames state of their camera by what the caller does."""
    names = CameraKey.__struct_fields__
    stated = {name: value for name in names if (value := getattr(camera, name, None)) is not None}
    return lambda known: replace(known, **stated)
