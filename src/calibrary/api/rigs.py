"""Calibration of camera rigs from images of a board: lenses and relative poses."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, like the flag
from pathlib import Path
from typing import TypeAlias

from msgspec import Struct

from calibrary.arguments import CameraLike, overlay
from calibrary.atomic import write_files
from calibrary.calib.board import parse_board
from calibrary.calib.lens_models import Solvable
from calibrary.calib.rig.estimation import RigResult
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.extras import CALIBRATE, require
from calibrary.jobs.calibrate.outputs import Files
from calibrary.jobs.calibrate.run import SolveRequest
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
    """Result of the calibration of a rig.

    Attributes:
        result: complete result, as the command line shows it.
        collected: corners used for the solution.
        request: arguments of the calibration.
        compared: rig from a file to compare with; None if there is none.
    """

    result: RigResult
    collected: RigCollected
    request: SolveRequest
    compared: Rig | None = None

    @property
    def verdict(self) -> BoardVerdict:
        """Verdict on the rig; those of the cameras are in ``result.cameras``."""
        return self.result.verdict

    @property
    def is_good(self) -> bool:
        """Whether the verdict is pass."""
        return self.verdict is BoardVerdict.PASS

    @property
    def calibrations(self) -> dict[str, Calibration]:
        """K and distortion by camera name, the reference first."""
        return {name: one.calibration for name, one in self.result.cameras.items()}

    @property
    def poses(self) -> dict[str, RigPose]:
        """Pose of every camera relative to the reference, with covariance; empty if the rig was not solved."""
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
        """Problems of the rig, most severe first."""
        return self.result.findings

    @property
    def report(self) -> RigReport:
        """The complete result as a record."""
        return rig_report(self.result, self.collected.how, self.collected.stated, self.compared)

    def entries(self, name: str) -> tuple[Entry, ...]:
        """Return the registry entries of the rig, for :meth:`calibrary.Fleet.propose_entries`.

        Args:
            name: name of the rig.

        Raises:
            InputError: the rig is refused, or make and model of a camera are unknown.
        """
        return rig_entries(self.result, self.request, name)

    def write(self, places: RigPlaces) -> Files:
        """Write the page, the corners and the rig; the rig is not written if it is refused.

        Raises:
            InputError: a file cannot be written.
            UnsupportedModelError: the format cannot represent these cameras.
        """
        files = places.files(self.result, self.collected, self.report)
        for path in files.content:
            path.parent.mkdir(parents=True, exist_ok=True)
        write_files(files.content)
        return files

    def to_dict(self) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/rig-calibration-result-1.schema.json)."""
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
    """Calibrate the lenses and relative poses of cameras that see one board at the same time.

    Args:
        frames: a list of folders, one per camera; or a folder or files with names that state camera and shot, as a
            payload writes them or as ``pattern`` describes.
        square_mm: side of a square in mm; for circles, the distance of their centres. The baselines are proportional
            to it.
        board: board type and number of inner corners, such as "checkerboard:11x8"; by default a checkerboard of a size
            found by trial.
        marker_mm: side of a marker, or diameter of a circle, in mm.
        corners: instead of frames, the rig.json of an earlier run.
        pattern: form of names that state camera and shot, such as "{camera}/{shot}.png".
        in_order: pair the n-th images of all folders.
        reference: camera that the poses refer to; by default the first by name.
        lens_model: "auto", which chooses a model for each camera, or the name of one lens model.
        warp: whether the board warp may be estimated.
        date: date of the calibration; by default that of the images' EXIF, else today.
        operator: person who made the calibration.
        focus: focus setting of the lenses: "locked at infinity".
        camera: facts about the cameras, the same for all, that the images do not state or state wrongly.
        compare: file of a rig to compare the poses with.
        workers: number of detection processes; 0 chooses it automatically.
        progress: called with (images done, number of images, "frames").

    Raises:
        InputError: the pairing of the images is ambiguous, or an argument is out of range.
        CalibrationError: no image of a camera shows the board, or the corners do not determine a camera.

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
    """Read a rig: a Kalibr camera chain, OpenCV's stereo files, COLMAP's rig_config.json, or MicaSense's JSON.

    Raises:
        InputError: the file cannot be read, or is none of these.
        ParseError: the file is damaged.
    """
    return _read_rig(Path(path))


def write_rig(rig: Rig, path: str | Path, *, format: str | None = None) -> Path:  # noqa: A002  as in write
    """Write a rig as "kalibr", "opencv_stereo", "colmap_rig" or "micasense_rig"; by default by the file's name.

    Raises:
        InputError: the format does not exist, or the file cannot be written.
        UnsupportedModelError: the format cannot represent these cameras.
    """
    path = Path(path)
    write_files({path: encode_rig(rig, format or format_of_name(path.name), path.name)})
    return path
