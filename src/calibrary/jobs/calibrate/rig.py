"""Calibration of a rig from frames of several cameras, or from saved corners."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from msgspec import Struct

from calibrary.atomic import check_folder
from calibrary.calib.board import Board
from calibrary.calib.corners_arrays import Corners
from calibrary.calib.corners_file import FileName, encode_corners, read_corners, read_table
from calibrary.calib.detection import Detections, find_board
from calibrary.calib.rig.estimation import estimate_rig
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.rig.verdict import RigResult
from calibrary.calibration import CameraKey
from calibrary.errors import CalibrationError, InputError
from calibrary.jobs.calibrate.corners_in import corners_of_arrays, corners_of_rig_table
from calibrary.jobs.calibrate.frames import Told, describe_frames
from calibrary.jobs.calibrate.pairing import RigFrames
from calibrary.jobs.calibrate.report import Asked
from calibrary.jobs.calibrate.run import dated, observe
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.rigs.micasense import rotation_of_relatives
from calibrary.progress import Progress, counted, log, stage
from calibrary.records import Record, from_json, replace, to_json
from calibrary.rig import Rig, RigCamera, RigPose
from calibrary.strictjson import parse_json

CORNERS_NAME = "rig.json"


class RigDetections(Struct, frozen=True, kw_only=True, eq=False):
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


def detect_rig(
    frames: RigFrames,
    board: Board | float | None,
    told: Told,
    *,
    workers: int = 0,
    progress: Progress | None = None,
) -> RigDetections:
    """Detect the board in all frames of a rig.

    Args:
        frames: paired frames.
        board: the board, or the side of its squares in mm: it is then found by trying.
        told: what the user states of the frames.
        workers: processes; 0 for automatic.
        progress: called with (frames done, number of frames, "frames").

    Raises:
        InputError: frames of one camera differ in size, camera or focus, or were edited.
        CalibrationError: no frame of a camera shows the board.
    """
    described = {name: describe_frames(frames.of(name), told) for name in frames.cameras}
    keys = {
        name: one.setting.camera if one.setting is not None else told.camera(CameraKey())
        for name, one in described.items()
    }
    own = _told_apart(keys)
    notes = list(frames.notes)
    if not isinstance(board, Board):
        board, note = find_board([path for name in frames.cameras for path in frames.of(name)], board)
        notes.append(note)
    cameras: dict[str, Detections] = {}
    total = sum(len(taken) for taken in frames.shots.values())
    advance = counted(progress, total, "frames")
    for name, metadata in described.items():
        try:
            with stage(f"looked for the board in the frames of {name}"):
                found = observe(frames.of(name), metadata, board, workers=workers, progress=advance)
        except CalibrationError as error:
            raise CalibrationError(f"{name}: {error}") from None
        for remark in found.rejected:
            log.info("skipped of %s: %s", name, remark)
        seen = found.observations
        cameras[name] = replace(
            found,
            observations=replace(seen, camera=replace(own[name], image_size=seen.image_size, firmware=None)),
        )
    return RigDetections(
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


def folder_of_corners(path: str | Path | None) -> Path | None:
    """Check that a rig's corners can be written into a folder, and return it; None if there is no path.

    Raises:
        InputError: it is a file, or not writable.
    """
    if path is None:
        return None
    if Path(path).exists() and not Path(path).is_dir():
        raise InputError("is a file; expected a folder", source=str(path), place="--corners")
    check_folder(Path(path), place="--corners")
    return Path(path)


def corner_files(detections: RigDetections, folder: Path) -> dict[Path, bytes]:
    """Content of rig.json and of the corner files in a folder."""
    names = {name: f"{re.sub(r'[^A-Za-z0-9._-]+', '-', name)}.corners.json" for name in detections.cameras}
    kept = RigCorners(cameras=names, shots=detections.shots)
    files = {
        folder / names[name]: encode_corners(one.observations) for name, one in detections.cameras.items()
    }
    table = json.dumps(to_json(kept), indent=1, ensure_ascii=False) + "\n"
    return {folder / CORNERS_NAME: table.encode(), **files}


def saved_rig(path: Path, told: Told, reference: str | None) -> RigDetections:
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
        camera = replace(told.camera(seen.camera), image_size=seen.image_size)
        cameras[name] = Detections(observations=replace(seen, camera=camera))
    return RigDetections(cameras=cameras, shots=kept.shots, how=f"as {path.name} says")


def rig_from_table(
    path: Path, told: Told, board: Board | None, pattern: str | None, reference: str | None
) -> RigDetections:
    """Read the corners of several cameras from one table of another detector.

    Raises:
        InputError: the file cannot be read, or its images' names do not say camera and shot.
        ParseError: the file is broken.
    """
    cameras, paired = corners_of_rig_table(path, told, board=board, pattern=pattern, reference=reference)
    shots = {
        shot: {name: image.name for name, image in taken.items()} for shot, taken in paired.shots.items()
    }
    return RigDetections(cameras=_distinct(cameras), shots=shots, how=paired.how, notes=paired.notes)


def rig_from_arrays(
    corners: Mapping[str, Corners],
    told: Told,
    board: Board | None,
    square_mm: float | None,
    reference: str | None,
) -> RigDetections:
    """Take the corners of several cameras from arrays; views of one name belong together.

    Raises:
        InputError: the arrays of a camera do not go together.
    """
    cameras: dict[str, Detections] = {}
    if reference is not None and reference not in corners:
        raise InputError(f"no camera {reference!r:.60} among {', '.join(corners)}", place="reference")
    for name in sorted(corners, key=lambda name: name != (reference or next(iter(corners)))):
        try:
            cameras[name] = corners_of_arrays(corners[name], told, board=board, square_mm=square_mm)
        except InputError as error:
            raise InputError(error.message, source=name, place=error.place) from None
    views = dict.fromkeys(view.name for one in cameras.values() for view in one.observations.views)
    shots = {view: dict.fromkeys(cameras, view) for view in views}
    return RigDetections(cameras=_distinct(cameras), shots=shots, how="by the views' names")


def _distinct(cameras: Mapping[str, Detections]) -> dict[str, Detections]:
    """The same with keys of the cameras that differ."""
    own = _told_apart({name: one.observations.camera for name, one in cameras.items()})
    return {
        name: replace(one, observations=replace(one.observations, camera=own[name]))
        for name, one in cameras.items()
    }


def solved_rig(
    detections: RigDetections, asked: Asked, told: Told, *, corners_from: Path | None = None
) -> RigResult:
    """Solve the rig; the provenance names every frame.

    Raises:
        InputError: the corners are inconsistent.
        CalibrationError: the corners do not determine a camera.
    """
    with stage(f"solved {len(detections.cameras)} cameras with lens model {asked.model}"):
        result = estimate_rig(detections.observations, asked.model, warp=asked.warp, policy=told.policy)
    cameras = {
        name: dated(one, told.stated, f"{corners_from.name}: {name}" if corners_from is not None else None)
        for name, one in result.cameras.items()
    }
    return replace(result, cameras=cameras)


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
