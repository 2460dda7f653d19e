"""Solve corners.json with lensboy, in whatever Python has it: prints one JSON object, for benchmarks/calibration.py.

    python3 benchmarks/peer_lensboy.py corners.json

OpenCV's five coefficients, no outlier rejection; once with a flat board and once with a bent one, whose warp has five
terms there. Pixels are counted from the centre of the first.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import lensboy  # type: ignore[import-not-found]  # from PyPI, in no environment of ours
import numpy as np


def main() -> None:
    """Solve and print."""
    document = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    board, (width, height) = document["board"], document["image_size"]
    y, x = np.mgrid[: board["rows"], : board["columns"]]
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]) * board["square_mm"]
    frames = [
        lensboy.Frame(
            target_point_indices=np.array(view["ids"]),
            detected_points_in_image=np.column_stack([view["x"], view["y"]]) - 0.5,
        )
        for view in document["views"]
    ]
    config = lensboy.OpenCVConfig(image_height=height, image_width=width)
    found = {}
    for name, bent in (("flat", False), ("bent", True)):
        result = lensboy.calibrate_camera(
            points, frames, config, estimate_target_warp=bent, outlier_threshold_stddevs=None
        )
        model = next(value for value in vars(result).values() if isinstance(value, lensboy.OpenCV))
        found[name] = {"parameters": [float(model.fx), float(model.fy), float(model.cx), float(model.cy)]}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
