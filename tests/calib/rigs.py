"""Rigs whose cameras and places are known exactly, and what they see of a board."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detection import Detections
from calibrary.calib.rig.lens import Place
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.synthesis import Pose, poses
from calibrary.calib.synthesis.cameras import example_camera
from calibrary.calibration import Calibration
from calibrary.jobs.calibrate.rig import RigDetections, corner_files
from calibrary.records import replace
from calibrary.rig import RigPose
from calibrary.rotations import rotation_matrix, rotation_vector
from tests.calib.observing import observe

BOARD = Board(columns=11, rows=8, square_mm=40.0)
FEWEST = 20
"""Corners in a frame, for it to count as a view of the board."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueRig:
    """The truth.

    Attributes:
        calibrations: of the cameras, cam0 is the reference.
        places: before the reference.
        shots: poses of the board before the reference.
    """

    calibrations: tuple[Calibration, ...]
    places: tuple[Place, ...]
    shots: tuple[Pose, ...]

    def before(self, camera: int, moved: Callable[[int, Place], Place] | None = None) -> list[Pose]:
        """The board's poses before one camera; ``moved`` may change its place from shot to shot."""
        found = []
        for number, pose in enumerate(self.shots):
            place = moved(number, self.places[camera]) if moved is not None else self.places[camera]
            found.append(posed(place, pose))
        return found


def posed(place: Place, pose: Pose) -> Pose:
    """A pose before the reference as a camera of the rig has it."""
    rx, ry, rz = rotation_vector(place.rotation @ pose.matrix).tolist()
    tx, ty, tz = (place.rotation @ np.array(pose.translation_mm) + place.translation).tolist()
    return Pose(rotation=(rx, ry, rz), translation_mm=(tx, ty, tz))


def true_rig(
    seed: int, *, cameras: int = 2, shots: int = 16, board: Board = BOARD, step_mm: float = 120.0
) -> TrueRig:
    """Cameras side by side, each turned by some degrees."""
    random = np.random.default_rng([seed, 21])
    places = [Place(rotation=np.eye(3), translation=np.zeros(3))]
    for camera in range(1, cameras):
        turn = np.radians(random.normal(0.0, 1.5, 3))
        shift = np.array([-step_mm * camera, 0.05 * step_mm, 3.0])
        places.append(Place(rotation=rotation_matrix(turn), translation=shift))
    calibrations = tuple(example_camera(10 * seed + camera) for camera in range(cameras))
    return TrueRig(
        calibrations=calibrations,
        places=tuple(places),
        shots=poses(board, calibrations[0], shots, seed, fill=(0.3, 0.7)),
    )


def seen_by(
    rig: TrueRig,
    seed: int,
    *,
    sigma: Sequence[float] | float = 0.05,
    board: Board = BOARD,
    bow_mm: float = 0.0,
    moved: Callable[[int, int, Place], Place] | None = None,
) -> RigObservations:
    """What the cameras see of a board; ``moved`` may change a camera's place from shot to shot."""
    count = len(rig.calibrations)
    noise = [sigma] * count if isinstance(sigma, float) else list(sigma)
    cameras, shots = {}, {f"shot-{number:03}": dict[str, str]() for number in range(len(rig.shots))}
    for camera, calibration in enumerate(rig.calibrations):
        change = (lambda n, place, c=camera: moved(c, n, place)) if moved is not None else None
        seen = observe(
            board, calibration, rig.before(camera, change), noise[camera], 100 * seed + camera, bow_mm=bow_mm
        )
        views = tuple(view for view in seen.views if len(view.ids) >= FEWEST)
        cameras[f"cam{camera}"] = replace(seen, views=views)
        for view in views:
            shots[f"shot-{view.name.removeprefix('view-')}"][f"cam{camera}"] = view.name
    return RigObservations.of(cameras, shots)


def off(pose: RigPose, place: Place) -> tuple[float, float, FloatArray]:
    """(degrees, share of the baseline, (6,) in σ) by which a pose misses the truth."""
    turn = np.degrees(rotation_vector(pose.rotation @ place.rotation.T))
    shift = pose.translation - place.translation
    std = np.array([*(pose.rotation_std_deg or ()), *(pose.translation_std_mm or ())])
    along = abs(pose.baseline_mm / float(np.linalg.norm(place.translation)) - 1)
    return float(np.linalg.norm(turn)), along, np.concatenate([turn, shift]) / std


def write_rig_corners(folder: Path) -> None:
    """The corners of a small rig, as a run keeps them."""
    seen = seen_by(true_rig(3, shots=12), 3)
    collected = RigDetections(
        cameras={name: Detections(observations=one) for name, one in seen.cameras.items()},
        shots={
            shot: {
                name: one.views[view].name
                for (name, one), view in zip(seen.cameras.items(), row, strict=True)
                if view >= 0
            }
            for shot, row in zip(seen.shots, seen.rows.tolist(), strict=True)
        },
        how="by simulation",
    )
    folder.mkdir()
    for path, data in corner_files(collected, folder).items():
        path.write_bytes(data)
