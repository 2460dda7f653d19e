"""How right and how honest the poses of rigs are, beside OpenCV's and mrcal's on the same corners.

    python -m benchmarks.rig [--seeds N] [--cameras N] [--mrcal-python /usr/bin/python3]

Rigs are known exactly; corners have normal noise of 0.05 px at 1920 × 1440. The peers solve pairs: OpenCV each camera
and then the pair, mrcal all at once in a process of its own.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.rig.estimation import estimate_rig
from calibrary.calib.rig.lens import Place
from calibrary.calib.rig.observations import RigObservations
from calibrary.rotations import rotation_matrix, rotation_vector
from tests.calib.rigs import off, seen_by, true_rig

PEER = Path(__file__).with_name("peer_mrcal_rig.py")


def pair_document(seen: RigObservations) -> dict[str, Any]:
    """The first two cameras' corners, as the peer reads them."""
    first, second, *_ = seen.cameras.values()
    board = first.board
    if not isinstance(board, Board):
        raise TypeError("a benchmark's points are on a board")
    return {
        "board": {"rows": board.rows, "columns": board.columns, "square_mm": board.square_mm},
        "shots": len(seen.shots),
        "cameras": [
            {
                "image_size": list(one.image_size),
                "views": {
                    str(shot): {
                        "ids": one.views[view].ids.tolist(),
                        "x": one.views[view].image_points[:, 0].tolist(),
                        "y": one.views[view].image_points[:, 1].tolist(),
                    }
                    for shot, view in enumerate(seen.rows[:, camera].tolist())
                    if view >= 0
                },
            }
            for camera, one in enumerate((first, second))
        ],
    }


def by_mrcal(seen: RigObservations, python: str) -> Place | None:
    """The second camera's place; None where the search, started as this script does it, ends in another minimum."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pair.json"
        path.write_text(json.dumps(pair_document(seen)), encoding="utf-8")
        ended = subprocess.run([python, str(PEER), str(path)], capture_output=True, text=True, check=True)
    found = json.loads(ended.stdout)
    if found["rms_px"] > 1:
        return None
    return Place(
        rotation=rotation_matrix(np.array(found["rotations"][0])),
        translation=np.array(found["translations_mm"][0]),
    )


def by_opencv(seen: RigObservations) -> Place:
    """The second camera's place, from the shots that both cameras share."""
    first, second, *_ = seen.cameras.values()
    points: list[Any] = []
    pixels: tuple[list[Any], list[Any]] = ([], [])
    solve: Any = cv2.stereoCalibrate
    for row in seen.rows[(seen.rows[:, :2] >= 0).all(axis=1)]:
        views = (first.views[row[0]], second.views[row[1]])
        both = np.intersect1d(views[0].ids, views[1].ids)
        points.append(first.board.points[both].astype(np.float32))
        for side, view in zip(pixels, views, strict=True):
            side.append((view.image_points[np.searchsorted(view.ids, both)] - 0.5).astype(np.float32))
    lenses: list[Any] = []
    for side, one in zip(pixels, (first, second), strict=True):
        lenses += cv2.calibrateCamera(points, side, one.image_size, np.eye(3), np.zeros(5))[1:3]
    found = solve(points, *pixels, *lenses, first.image_size, flags=0, criteria=(3, 200, 1e-12))
    return Place(
        rotation=np.asarray(found[5], dtype=np.float64), translation=np.ravel(found[6]).astype(np.float64)
    )


def misses(place: Place, truth: Place) -> tuple[float, float]:
    """(degrees, share of the baseline)."""
    turn = rotation_vector(place.rotation @ truth.rotation.T)
    length = float(np.linalg.norm(place.translation) / np.linalg.norm(truth.translation))
    return float(np.degrees(np.linalg.norm(turn))), abs(length - 1)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--cameras", type=int, default=2)
    parser.add_argument("--mrcal-python")
    given = parser.parse_args()
    ours: list[tuple[float, float]] = []
    z: list[FloatArray] = []
    peers: dict[str, list[tuple[float, float]]] = {"OpenCV": []}
    if given.mrcal_python:
        peers["mrcal"] = []
    for seed in range(1, given.seeds + 1):
        truth = true_rig(seed, cameras=given.cameras)
        seen = seen_by(truth, seed)
        result = estimate_rig(seen)
        for camera, (name, pose) in enumerate(result.poses.items(), start=1):
            degrees, share, sigmas = off(pose, truth.places[camera])
            z.append(sigmas)
            if name == "cam1":
                ours.append((degrees, share))
        peers["OpenCV"].append(misses(by_opencv(seen), truth.places[1]))
        if given.mrcal_python:
            place = by_mrcal(seen, given.mrcal_python)
            peers["mrcal"] += [misses(place, truth.places[1])] if place is not None else []
    for name, found in {"calibrary": ours, **peers}.items():
        turns, shares = np.array(found).reshape(-1, 2).T
        print(
            f"{name:<10} rotation {np.median(turns):.4f}° (largest {turns.max():.4f}°), "
            f"baseline {np.median(shares):.4%} (largest {shares.max():.4%}), {len(found)} of {given.seeds} solved"
        )
    every = np.abs(np.concatenate(z))
    print(f"|z| < 3 in {(every < 3).mean():.1%} of {len(every)}, rms {np.sqrt((every**2).mean()):.2f}")


if __name__ == "__main__":
    main()
