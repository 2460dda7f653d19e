"""Solve the corners of a rig with mrcal, in whatever Python has it: prints one JSON object, for benchmarks/rig.py.

    python3 benchmarks/peer_mrcal_rig.py pair.json

OpenCV's five coefficients, a flat board, no regularisation, no outlier rejection. Lengths are in mm, angles in rad.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import mrcal  # type: ignore[import-not-found]  # Debian's python3-mrcal: in no environment of ours
import numpy as np


def solve(document: dict[str, Any]) -> dict[str, Any]:
    """Both cameras, and the place of the second before the first."""
    board, cameras = document["board"], document["cameras"]
    spacing, sizes = board["square_mm"] / 1000, [camera["image_size"] for camera in cameras]
    seen, index = [], []
    for shot in range(document["shots"]):
        for at, camera in enumerate(cameras):
            view = camera["views"].get(str(shot))
            if view is None:
                continue
            grid = np.full((board["rows"], board["columns"], 3), -1.0)
            place = np.unravel_index(view["ids"], grid.shape[:2])
            grid[place] = np.column_stack(
                [np.array(view["x"]) - 0.5, np.array(view["y"]) - 0.5, np.ones(len(view["x"]))]
            )
            seen.append(grid)
            index.append((shot, at, at - 1))
    observations, rows = np.array(seen), np.array(index, dtype=np.int32)
    intrinsics, extrinsics, frames = mrcal.seed_stereographic(
        imagersizes=sizes, focal_estimate=[0.8 * max(size) for size in sizes],
        indices_frame_camera=rows[:, :2], observations=observations, object_spacing=spacing,
    )  # fmt: skip
    lens = np.zeros((len(cameras), 9))
    lens[:, :4] = np.array(intrinsics)[:, :4]
    problem: dict[str, Any] = {
        "intrinsics": lens,
        "extrinsics_rt_fromref": extrinsics,
        "frames_rt_toref": frames,
        "points": None,
        "observations_board": observations,
        "indices_frame_camintrinsics_camextrinsics": rows,
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
        "lensmodel": "LENSMODEL_OPENCV5",
        "imagersizes": np.array(sizes, dtype=np.int32),
        "calobject_warp": None,
        "calibration_object_spacing": spacing,
        "point_min_range": -1.0,
        "point_max_range": -1.0,
        "verbose": False,
        "do_apply_outlier_rejection": False,
        "do_apply_regularization": False,
        "do_optimize_calobject_warp": False,
        "do_optimize_intrinsics_core": True,
        "do_optimize_extrinsics": True,
        "do_optimize_frames": True,
    }
    for lens_too in (False, *[True] * 6):
        problem["do_optimize_intrinsics_distortions"] = lens_too
        stats = mrcal.optimize(**problem)
    places = np.array(problem["extrinsics_rt_fromref"]).reshape(-1, 6)
    return {
        "parameters": problem["intrinsics"].tolist(),
        "rotations": places[:, :3].tolist(),
        "translations_mm": (places[:, 3:] * 1000).tolist(),
        "rms_px": float(stats["rms_reproj_error__pixels"] * np.sqrt(2)),
    }


if __name__ == "__main__":
    print(json.dumps(solve(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))))
