"""Simulated flights as the folders that other programs leave."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.records import replace
from calibrary.rotations import quaternion, rotation_vector
from calibrary.sfm.tracks import Scene, Tracks
from tests.sfm.flights import CAMERA

STATED = replace(
    CAMERA, intrinsics=replace(CAMERA.intrinsics, fx=1130.0, fy=1130.0, cx=750.0, cy=500.0), distortion=None
)
"""What the program is made to state: not the truth, so that a result that merely repeats it is found out."""


def write_colmap(folder: Path, tracks: Tracks, scene: Scene, stated: Calibration = STATED) -> Path:
    """A sparse model as text."""
    folder.mkdir(parents=True)
    parsers.write([stated], folder / "cameras.txt", format="colmap_text")
    images: list[str] = []
    features: dict[tuple[int, int], int] = {}
    for at, name in enumerate(tracks.names):
        rows = np.flatnonzero(tracks.image == at)
        features |= {(at, int(tracks.point[row])): number for number, row in enumerate(rows)}
        q, t = quaternion(scene.rotations[at]), -scene.rotations[at] @ scene.centres[at]
        pose = " ".join(map(repr, [*q.tolist(), *t.tolist()]))
        images.append(f"{at + 1} {pose} 1 {name}")
        # The last feature is of no point.
        images.append(
            " ".join(f"{x!r} {y!r} {point + 7}" for (x, y), point in
                     zip(tracks.pixels[rows].tolist(), tracks.point[rows].tolist(), strict=True)) + " 5.0 6.0 -1"
        )  # fmt: skip
    points = []
    for point in np.unique(tracks.point).tolist():
        track = " ".join(
            f"{at + 1} {features[at, point]}" for at in tracks.image[tracks.point == point].tolist()
        )
        x, y, z = scene.points[point].tolist()
        points.append(f"{point + 7} {x!r} {y!r} {z!r} 90 90 90 0.5 {track}")
    (folder / "images.txt").write_text("# Image list\n" + "\n".join(images) + "\n")
    (folder / "points3D.txt").write_text("# 3D point list\n" + "\n".join(points) + "\n")
    return folder


def write_opensfm(folder: Path, tracks: Tracks, scene: Scene, stated: Calibration = STATED) -> Path:
    """A reconstruction with its tracks; a second, smaller one states another camera of the same name."""
    folder.mkdir(parents=True)
    width, height = tracks.image_size
    camera = {
        "projection_type": "brown", "width": width, "height": height, "focal_x": stated.intrinsics.fx / width,
        "focal_y": stated.intrinsics.fy / width, "c_x": 0.0, "c_y": 0.0, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0,
        "k3": 0.0,
    }  # fmt: skip
    shots = {}
    for at, name in enumerate(tracks.names):
        turn = scene.rotations[at]
        shots[name] = {
            "rotation": rotation_vector(turn).tolist(),
            "translation": (-turn @ scene.centres[at]).tolist(),
            "camera": "v2 example",
        }
        if tracks.positions is not None:
            shots[name] |= {
                "gps_position": tracks.positions.places[at].tolist(),
                "gps_dop": float(tracks.positions.std[at, 0]),
            }
    points = {
        str(point): {"color": [9, 9, 9], "coordinates": scene.points[point].tolist()}
        for point in np.unique(tracks.point).tolist()
    }
    other = {"cameras": {"v2 example": camera | {"focal_x": 0.5}}, "shots": {}, "points": {}}
    whole = {"cameras": {"v2 example": camera}, "shots": shots, "points": points}
    (folder / "reconstruction.json").write_text(json.dumps([other, whole]))
    rows = ["OPENSFM_TRACKS_VERSION_v2"]
    middle = np.array(tracks.image_size) / 2
    for at, point, (x, y) in zip(
        tracks.image.tolist(), tracks.point.tolist(), ((tracks.pixels - middle) / width).tolist(), strict=True
    ):
        rows.append("\t".join(map(str, (tracks.names[at], point, 0, x, y, 0.002, 9, 9, 9, -1, -1))))
    (folder / "tracks.csv").write_text("\n".join(rows) + "\n")
    return folder
