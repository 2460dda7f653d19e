"""What a calibration from the corners of a board costs, beside OpenCV's of the same corners.

    python -m benchmarks.calibration [--views N ...]

Cameras are known exactly, corners have normal noise. Ours finds model, σ and verdict; OpenCV solves its five
coefficients, with σ up to 100 views: with it OpenCV needs 20 s for 400.
"""

from __future__ import annotations

import argparse
from functools import partial

import cv2
import numpy as np

from benchmarks.table import compared, in_turns, machine
from calibrary.calib.board import Board
from calibrary.calib.corners_arrays import Corners
from calibrary.calib.observations import Observations
from calibrary.calib.synthesis import poses
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.jobs.calibrate import calibrate
from tests.calib.observing import observe

BOARD = Board(columns=11, rows=8, square_mm=40.0)
SIZE = (1920, 1440)
CAMERA = Calibration(
    camera=CameraKey(image_size=SIZE),
    intrinsics=Intrinsics(fx=1450.4, fy=1447.5, cx=966.3, cy=715.7, image_size=SIZE),
    distortion=BrownConrady(k1=-0.2687, k2=0.1147, p1=1.5e-4, p2=-4.7e-4, k3=-0.035),
    grade=Grade.CALIBRATED,
    provenance=Provenance(kind="synthetic"),
)
MOST_WITH_SIGMA = 100


def shoot(views: int) -> Observations:
    """Corners of a session."""
    held = poses(BOARD, CAMERA, views, 1, 35.0, (0.3, 0.85), roll_deg=180.0)
    return observe(BOARD, CAMERA, held, 0.05, 1)


def measure(views: int, repeats: int) -> None:
    """CPU seconds on one thread, at the public door."""
    seen = shoot(views)
    points = [seen.object_points(view).astype(np.float32) for view in seen.views]
    pixels = [view.image_points.astype(np.float32) for view in seen.views]
    corners = Corners(object_points=points, image_points=pixels, image_size=seen.image_size)
    extended = views <= MOST_WITH_SIGMA
    call = cv2.calibrateCameraExtended if extended else cv2.calibrateCamera
    costs = in_turns(
        {
            "ours": partial(calibrate, corners=corners),
            "cv2": partial(call, points, pixels, seen.image_size, np.eye(3), np.zeros(5)),
        },
        repeats,
    )
    ours, theirs = ([cost.cpu_s for cost in costs[name]] for name in ("ours", "cv2"))
    what = f"{views} views × 88 corners: model, σ and verdict"
    compared(
        what, ours, theirs, scale=1, unit="s", name=f"OpenCV, lens {'and σ' if extended else 'without σ'}"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="What calibrations from boards cost.")
    parser.add_argument("--views", type=int, nargs="+", default=[25, 100, 400], metavar="N")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    print(machine(), f"OpenCV {cv2.__version__}", sep=", ")
    for views in given.views:
        measure(views, repeats=5 if views <= MOST_WITH_SIGMA else 1)


if __name__ == "__main__":
    main()
