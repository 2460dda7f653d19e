"""Calibration of a rig from frames of several cameras, or from saved corners."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Mapping
from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
from msgspec import Struct

from calibrary.calib.board import Board
from calibrary.calib.corners_file import FileName, encode_corners, read_corners, read_table
from calibrary.calib.detection import Detections, try_board_sizes
from calibrary.calib.result import CalibrationResult
from calibrary.calib.rig.estimation import RigResult, estimate_rig
from calibrary.calib.rig.observations import RigObservations
from calibrary.calibration import CameraKey
from calibrary.errors import CalibrationError, InputError
from calibrary.jobs.calibrate.frames import describe_frames
from calibrary.jobs.calibrate.run import SolveRequest, calibration_date, observe
from calibrary.jobs.calibrate_rig.pairing import RigFrames
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.rigs.micasense import rotation_of_relatives
from calibrary.records import Record, from_json, replace, to_json
from calibrary.rig import Rig, RigCamera, RigPose
from calibrary.strictjson import parse_json

__all__ = [
    "RigCollected",
    "RigCorners",
    "calibrate_rig_from",
    "collect_rig",
    "corner_files",
    "saved_rig",
]

CORNERS_NAME = "rig.json"


class RigCollected(Struct, frozen=True, kw_only=True, eq=False):
    """Observations of a rig.

    Attributes:
        cameras: by camera: its views, unusable frames and notes.
        shots: by shot, the name of each camera's frame.
        how: how the frames were paired.
        notes: on the rig.
        stated: relative poses in the frames' metadata; None if these state none.
    """

    cameras: Mapping[str, Detections]
    shots: Mapping[str, Mapping[str, str]]
    how: str
    notes: tuple[str, ...] = ()
    stated: Rig | None = None

    @property
    def observations(self) -> RigObservations:
        """The observations in the form of the solver."""
        return RigObservations.of({name: one.observations for name, one in self.cameras.items()}, self.shots)


def collect_rig(
    frames: RigFrames,
    board: Board | float,
    said: Callable[[CameraKey], CameraKey],
    *,
    focus: str | None = None,
    workers: int = 0,
    progress: Callable[[int], None] | None = None,
) -> RigCollected:
    """Detect the board in all frames of a rig.

    Args:
        frames: paired frames.
        board: the board, or the side of its squares in mm: the numbers of corners are then found by trying.
        said: replaces camera fields from the frames by those that the user states.
        focus: focus setting, replaces that of the frames.
        workers: processes; 0 for automatic.
        progress: called with the number of frames done since the last call.

    Raises:
        InputError: frames of one camera differ in size, camera or focus, or were edited.
        CalibrationError: no frame of a camera shows the board.
    """
    described = {name: describe_frames(frames.of(name), said, focus) for name in frames.cameras}
    keys = {
        name: one.setting.camera if one.setting is not None else said(CameraKey())
        for name, one in described.items()
    }
    own = _told_apart(keys)
    notes = list(frames.notes)
    if not isinstance(board, Board):
        board = try_board_sizes([path for name in frames.cameras for path in frames.of(name)], board)
        notes.append(f"the board was taken for {board}, which was found by trying")
    cameras: dict[str, Detections] = {}
    for name, metadata in described.items():
        try:
            found = observe(frames.of(name), metadata, board, workers=workers, progress=progress)
        except CalibrationError as error:
            raise CalibrationError(f"{name}: {error}") from None
        seen = found.observations
        cameras[name] = replace(
            found,
            observations=replace(seen, camera=replace(own[name], image_size=seen.image_size, firmware=None)),
        )
    return RigCollected(
        cameras=cameras,
        shots={
            shot: {name: path.name for name, path in taken.items()} for shot, taken in frames.shots.items()
        },
        how=frames.how,
        notes=tuple(notes),
        stated=_stated_relatives({name: frames.of(name)[0] for name in frames.cameras}),
    )


def _told_apart(keys: Mapping[str, CameraKey]) -> dict[str, CameraKey]:
    """Camera keys; equal keys are made distinct by the cameras' names in the rig."""
    counts = Counter((key.make, key.model, key.sub_camera, key.serial) for key in keys.values())
    return {
        name: replace(key, sub_camera=name)
        if counts[(key.make, key.model, key.sub_camera, key.serial)] > 1 and key.sub_camera is None
        else key
        for name, key in keys.items()
    }


class RigCorners(Record, tag_field="schema", tag="rig-corners-1"):
    """The corner files of a rig, and the frames of each shot.

    Attributes:
        cameras: corner file of each camera, in the folder of this file; the reference camera comes first.
        shots: by shot, the name of each camera's frame.
    """

    cameras: Mapping[str, FileName]
    shots: Mapping[str, Mapping[str, FileName]]


def saved_rig(path: Path, said: Callable[[CameraKey], CameraKey], reference: str | None) -> RigCollected:
    """Read the corners of an earlier run from its rig.json.

    Raises:
        InputError: a file cannot be read.
        ParseError: a file is broken.
    """
    kept = from_json(RigCorners, parse_json(read_table(path), source=path.name), source=path.name)
    if reference is not None and reference not in kept.cameras:
        raise InputError(f"no camera {reference!r:.60} among {', '.join(kept.cameras)}", place="--reference")
    cameras: dict[str, Detections] = {}
    for name in sorted(kept.cameras, key=lambda name: name != (reference or next(iter(kept.cameras)))):
        seen = read_corners(path.parent / kept.cameras[name])
        camera = replace(said(seen.camera), image_size=seen.image_size)
        cameras[name] = Detections(observations=replace(seen, camera=camera))
    return RigCollected(cameras=cameras, shots=kept.shots, how=f"as {path.name} says")


def corner_files(collected: RigCollected) -> dict[str, bytes]:
    """Content of rig.json and of the corner files, by file name."""
    names = {name: f"{re.sub(r'[^A-Za-z0-9._-]+', '-', name)}.corners.json" for name in collected.cameras}
    kept = RigCorners(cameras=names, shots=collected.shots)
    files = {names[name]: encode_corners(one.observations) for name, one in collected.cameras.items()}
    return {CORNERS_NAME: (json.dumps(to_json(kept), indent=1, ensure_ascii=False) + "\n").encode(), **files}


def calibrate_rig_from(collected: RigCollected, request: SolveRequest) -> RigResult:
    """Solve the rig; the provenance names every frame.

    Raises:
        InputError: the corners are inconsistent.
        CalibrationError: the corners do not determine a camera.
    """
    result = estimate_rig(collected.observations, request.model, warp=request.warp)
    today = datetime.now(UTC).date()
    return replace(
        result,
        cameras={name: _dated(one, request, today, name) for name, one in result.cameras.items()},
    )


def _dated(result: CalibrationResult, request: SolveRequest, today: date, name: str) -> CalibrationResult:
    day, origin = calibration_date(request.date, result.observations.taken, today)
    made = result.calibration.provenance
    source = f"{request.corners_name}: {name}" if request.corners_name is not None else made.source
    provenance = replace(made, source=source, date=day.isoformat(), operator=request.operator)
    return replace(result, calibration=replace(result.calibration, provenance=provenance), date_origin=origin)


def _stated_relatives(frames: Mapping[str, Path]) -> Rig | None:
    """Read the rig that the metadata of one frame per camera state.

    Returns:
        The rig with zero translations, because only rotations are stated; None unless all cameras state one.
    """
    turns = {}
    for name, path in frames.items():
        try:
            values = read_metadata(path).xmp_values("Camera", "RigRelatives")
            if values is None:
                return None
            turns[name] = rotation_of_relatives(values)
        except InputError:
            return None
    first, *others = turns
    return Rig(
        cameras=(
            RigCamera(name=first),
            *(
                RigCamera(name=name, pose=RigPose.of(turns[name].T @ turns[first], np.zeros(3)))
                for name in others
            ),
        )
    )
