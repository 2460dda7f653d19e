"""Frames of several cameras that are fixed to one another in; their lenses, relative poses and a verdict out."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, as the flag
from pathlib import Path
from typing import TypeAlias

from msgspec import Struct

from calibrary.api.stated import CameraLike, overlay
from calibrary.atomic import write_files
from calibrary.calib.board import parse_board
from calibrary.calib.lens_models import Solvable
from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.extras import CALIBRATE, require
from calibrary.jobs.calibrate_board.outputs import Files
from calibrary.jobs.calibrate_board.run import SolveRequest
from calibrary.jobs.calibrate_rig.entry import rig_entries
from calibrary.jobs.calibrate_rig.outputs import RigPlaces
from calibrary.jobs.calibrate_rig.pairing import find_rig
from calibrary.jobs.calibrate_rig.report import RigReport, rig_report
from calibrary.jobs.calibrate_rig.run import RigCollected, calibrate_rig_from, collect_rig, saved_rig
from calibrary.parsers.rigs import encode_rig, format_of_name
from calibrary.parsers.rigs import read_rig as _read_rig
from calibrary.progress import Progress, counted, log, stage
from calibrary.records import Json, to_json
from calibrary.registry.entry import Entry
from calibrary.rig import Rig, RigPose
from calibrary.validation import Finding

__all__ = ["CalibrateRigResult", "RigPlaces", "calibrate_rig", "read_rig", "write_rig"]

Frames: TypeAlias = str | Path | Sequence[str | Path]


class CalibrateRigResult(Struct, frozen=True, eq=False):
    """What frames of a board say of the cameras of a rig.

    Attributes:
        result: all of it, as the command line shows it.
        collected: the corners it was solved from.
        request: how it was solved.
        compared: the rig of a file to compare with; None where there is none.
    """

    result: RigResult
    collected: RigCollected
    request: SolveRequest
    compared: Rig | None = None

    @property
    def verdict(self) -> BoardVerdict:
        """Of the rig; a camera's own is in ``result.cameras``."""
        return self.result.verdict

    @property
    def is_good(self) -> bool:
        """Whether it passes."""
        return self.verdict is BoardVerdict.PASS

    @property
    def calibrations(self) -> dict[str, Calibration]:
        """K and distortion by camera, the reference first."""
        return {name: one.calibration for name, one in self.result.cameras.items()}

    @property
    def poses(self) -> dict[str, RigPose]:
        """Of every camera before the reference, with covariance; empty where the rig was not solved."""
        return dict(self.result.poses)

    @property
    def rig(self) -> Rig:
        """The cameras with their poses, for :func:`write_rig`.

        Raises:
            CalibrationError: the rig was not solved.
        """
        return self.result.rig

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What speaks against the rig, the most severe first."""
        return self.result.findings

    @property
    def report(self) -> RigReport:
        """The whole result as a record."""
        return rig_report(self.result, self.collected.how, self.collected.stated, self.compared)

    def entries(self, name: str) -> tuple[Entry, ...]:
        """The registry's entries that the rig becomes, for :meth:`calibrary.Fleet.propose_entries`.

        Args:
            name: of the rig.

        Raises:
            InputError: the rig is refused, or make and model of a camera are not known.
        """
        return rig_entries(self.result, self.request, name)

    def write(self, places: RigPlaces) -> Files:
        """Write its page, its corners and the rig; of a refused rig no rig.

        Raises:
            InputError: a file cannot be written.
            UnsupportedModelError: the format does not hold these cameras.
        """
        files = places.files(self.result, self.collected, self.report)
        for path in files.content:
            path.parent.mkdir(parents=True, exist_ok=True)
        write_files(files.content)
        return files

    def to_dict(self) -> dict[str, Json]:
        """The result as plain data for JSON (schemas/rig-calibration-result-1.schema.json)."""
        return to_json(self.report)


def calibrate_rig(
    frames: Frames | None = None,
    *,
    square_mm: float | None = None,
    board: str | None = None,
    marker_mm: float | None = None,
    corners: str | Path | None = None,
    pattern: str | None = None,
    in_order: bool = False,
    reference: str | None = None,
    lens_model: str = "auto",
    warp: bool = True,
    date: Day | None = None,
    operator: str | None = None,
    focus: str | None = None,
    camera: CameraLike | None = None,
    compare: str | Path | None = None,
    workers: int = 0,
    progress: Progress | None = None,
) -> CalibrateRigResult:
    """Find lenses and relative poses of cameras that see one board at the same time.

    Args:
        frames: a list of folders, one for each camera; or a folder or files whose names say camera and shot, as a
            payload writes them or as ``pattern`` says.
        square_mm: side of a square; of circles the distance of their centres. Distances between cameras scale with it.
        board: which one, in inner corners, such as "checkerboard:11x8"; a checkerboard whose size is found by trying
            when not given.
        marker_mm: side of a marker, diameter of a circle.
        corners: in place of frames, the rig.json that an earlier run wrote.
        pattern: how names say camera and shot, such as "{camera}/{shot}.png".
        in_order: pair the n-th frames of all folders.
        reference: the camera that poses are counted from; the first by name when not given.
        lens_model: "auto", which chooses for each camera, or the name of one lens model.
        warp: whether the board's warp may be solved for.
        date: of the calibration; that of the frames' EXIF, else today, when not given.
        operator: who made it.
        focus: how the lenses were focused: "locked at infinity".
        camera: what the frames do not say of the cameras, or say wrong, the same for all.
        compare: a file of a rig to compare the poses with.
        workers: processes that look for the board; 0 decides by itself.
        progress: called with (frames done, frames in all, "frames").

    Raises:
        InputError: the frames cannot be paired without doubt, or an argument is out of range.
        CalibrationError: no frame of a camera shows the board, or the corners do not determine a camera.

    >>> from calibrary.api.rigs import calibrate_rig
    >>> result = calibrate_rig(["left", "right"], board="checkerboard:9x6", square_mm=40)  # doctest: +SKIP
    >>> result.poses["right"].baseline_mm  # doctest: +SKIP
    120.02
    """
    require(CALIBRATE, "a calibration")
    if lens_model != "auto" and lens_model not in list(Solvable):
        raise InputError(f"no lens model {lens_model!r:.40}; expected auto, {', '.join(Solvable)}")
    if (frames is None) is (corners is None):
        raise InputError("expected frames or corners, and one of them only")
    stated = overlay(camera)
    other = _read_rig(Path(compare)) if compare is not None else None
    if frames is not None:
        if square_mm is None:
            raise InputError(
                "distances between cameras need square_mm, the side of the board's squares",
                place="--square-mm",
            )
        found = find_rig(
            [str(one) for one in ([frames] if isinstance(frames, str | Path) else frames)],
            pattern=pattern,
            in_order=in_order,
            reference=reference,
        )
        total = sum(len(taken) for taken in found.shots.values())
        with stage(f"looked for the board in {total} frames of {len(found.cameras)} cameras"):
            collected = collect_rig(
                found,
                parse_board(board, square_mm, marker_mm) if board is not None else float(square_mm),
                stated,
                focus=focus,
                workers=workers,
                progress=counted(progress, total, "frames"),
            )
        for name, one in collected.cameras.items():
            for remark in one.rejected:
                log.info("skipped %s of %s: %s", remark.name, name, remark.remark.text)
    else:
        collected = saved_rig(Path(corners or ""), stated, reference)
    request = SolveRequest(
        model=lens_model,
        warp=warp,
        date=date,
        operator=operator,
        corners_name=Path(corners).name if corners is not None else None,
    )
    with stage(f"solved {len(collected.cameras)} cameras with lens model {lens_model}"):
        result = calibrate_rig_from(collected, request)
    return CalibrateRigResult(result, collected, request, other)


def read_rig(path: str | Path) -> Rig:
    """The rig of a file: a Kalibr camera chain, OpenCV's stereo files, COLMAP's rig_config.json, MicaSense's JSON.

    Raises:
        InputError: it cannot be read, or is none of these.
        ParseError: it is broken.
    """
    return _read_rig(Path(path))


def write_rig(rig: Rig, path: str | Path, *, format: str | None = None) -> Path:  # noqa: A002  as in write
    """Write a rig: "kalibr", "opencv_stereo", "colmap_rig" or "micasense_rig"; by the file's name when not given.

    Raises:
        InputError: there is no such format, or the file cannot be written.
        UnsupportedModelError: the format has no place for these cameras.
    """
    path = Path(path)
    write_files({path: encode_rig(rig, format or format_of_name(path.name), path.name)})
    return path
