"""Solve corners.json with cv2.omnidir, in whatever Python has opencv-contrib: prints one JSON object.

    python3 benchmarks/peer_omnidir.py corners.json

Mei's model without skew, to compare with ``calibrary calibrate --from corners.json --lens-model mei``. Pixels are
counted from the centre of the first. cv2.omnidir leaves out views that its start cannot place, and says which it used.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np


def solve(document: dict[str, Any]) -> dict[str, Any]:
    """One calibration."""
    board, (width, height) = document["board"], document["image_size"]
    grid = np.indices((board["rows"], board["columns"]))[::-1].reshape(2, -1).T * board["square_mm"]
    points = np.column_stack([grid, np.zeros(len(grid))])
    seen = [np.array(view["ids"]) for view in document["views"]]
    objects = [points[ids].reshape(1, -1, 3) for ids in seen]
    pixels = [np.column_stack([view["x"], view["y"]]).reshape(1, -1, 2) - 0.5 for view in document["views"]]
    omnidir: Any = cv2.omnidir  # type: ignore[attr-defined]  # opencv-contrib: in no environment of ours
    rms, K, xi, lens, _, _, used = omnidir.calibrate(
        objects, pixels, (width, height), None, None, None, omnidir.CALIB_FIX_SKEW, (3, 500, 1e-10)
    )
    values = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(xi), *np.ravel(lens))
    names = ("fx", "fy", "cx", "cy", "xi", "k1", "k2", "p1", "p2")
    return {
        "parameters": {name: float(value) for name, value in zip(names, values, strict=True)},
        "rms_px": float(rms),
        "views": int(np.size(used)),
    }


if __name__ == "__main__":
    print(json.dumps(solve(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))))
