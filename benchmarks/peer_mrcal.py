"""Solve corners.json with mrcal, in whatever Python has it: prints one JSON object, for benchmarks/calibration.py.

    python3 benchmarks/peer_mrcal.py corners.json
    python3 benchmarks/peer_mrcal.py pairs.json     {"image_size": [W, H], "pairs": [[lens, lens], …]}: differences only

OpenCV's five coefficients, no regularisation, no outlier rejection; once with a flat board and once with a bent one.
Pixels are counted from the centre of the first, warps in mm.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import mrcal  # type: ignore[import-not-found]  # Debian's python3-mrcal: in no environment of ours
import numpy as np


def solve(document: dict[str, Any], *, bent: bool) -> dict[str, Any]:
    """One calibration."""
    began = time.process_time()
    board, (width, height) = document["board"], document["image_size"]
    seen = np.zeros((len(document["views"]), board["rows"], board["columns"], 3))
    seen[..., 2] = -1.0
    for row, view in enumerate(document["views"]):
        at = np.unravel_index(view["ids"], (board["rows"], board["columns"]))
        seen[row][at] = np.column_stack(
            [np.array(view["x"]) - 0.5, np.array(view["y"]) - 0.5, np.ones(len(view["x"]))]
        )
    focal = 0.8 * max(width, height)
    pinhole = np.array([focal, focal, (width - 1) / 2, (height - 1) / 2])
    first = mrcal.cameramodel(intrinsics=("LENSMODEL_STEREOGRAPHIC", pinhole), imagersize=(width, height))
    index = np.array([[row, 0, -1] for row in range(len(seen))], dtype=np.int32)
    spacing = board["square_mm"] / 1000
    poses = mrcal.estimate_monocular_calobject_poses_Rt_tocam(index, seen, spacing, [first])
    lens = np.zeros((1, 9))
    lens[0, :4] = pinhole
    problem: dict[str, Any] = {
        "intrinsics": lens,
        "extrinsics_rt_fromref": np.zeros((0, 6)),
        "frames_rt_toref": mrcal.rt_from_Rt(poses),
        "points": None,
        "observations_board": seen,
        "indices_frame_camintrinsics_camextrinsics": index,
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
        "lensmodel": "LENSMODEL_OPENCV5",
        "imagersizes": np.array([[width, height]], dtype=np.int32),
        "calobject_warp": np.zeros(2) if bent else None,
        "calibration_object_spacing": spacing,
        "point_min_range": -1.0,
        "point_max_range": -1.0,
        "verbose": False,
        "do_apply_outlier_rejection": False,
        "do_apply_regularization": False,
        "do_optimize_intrinsics_core": True,
        "do_optimize_extrinsics": True,
        "do_optimize_frames": True,
    }
    for lens_too, warp_too in ((False, False), (True, False), (True, bent), (True, bent)):
        problem["do_optimize_intrinsics_distortions"] = lens_too
        problem["do_optimize_calobject_warp"] = warp_too
        stats = mrcal.optimize(**problem)
    return {
        "parameters": problem["intrinsics"][0].tolist(),
        "warp_mm": (problem["calobject_warp"] * 1000).tolist() if bent else [0.0, 0.0],
        "rms_px": float(stats["rms_reproj_error__pixels"] * np.sqrt(2)),
        "seconds": time.process_time() - began,
    }


def difference(a: list[float], b: list[float], size: tuple[int, int]) -> list[float]:
    """px, lengths of mrcal's own difference of two lenses, laid together in a disc about the middle, on 33 × 25."""
    models = [
        mrcal.cameramodel(intrinsics=("LENSMODEL_OPENCV5", np.array(p)), imagersize=size) for p in (a, b)
    ]
    found = mrcal.projection_diff(
        models, gridn_width=33, gridn_height=25, use_uncertainties=False, focus_radius=min(size) / 4
    )
    return np.asarray(found[0]).ravel().tolist()


def main() -> None:
    """Solve and print."""
    document = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    if "pairs" in document:
        size = tuple(document["image_size"])
        print(json.dumps([difference(a, b, size) for a, b in document["pairs"]]))
        return
    flat, bent = solve(document, bent=False), solve(document, bent=True)
    lengths = difference(flat["parameters"], bent["parameters"], tuple(document["image_size"]))
    print(json.dumps({"flat": flat, "bent": bent, "difference_px": lengths}))


if __name__ == "__main__":
    main()
