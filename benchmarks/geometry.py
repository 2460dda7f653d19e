"""What projecting, unprojecting and undistorting cost, beside OpenCV's own functions in the same run.

    python -m benchmarks.geometry [--rounds N]

CPU time of the process, the best of several rounds in which ours and OpenCV's take turns. OpenCV's undistortPoints
stops after five steps of a fixed-point iteration, at some 1e-5 px in the corners; ours goes on to machine precision.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.table import compared, machine
from calibrary.calib.undistort import Undistorter
from calibrary.calib.undistort_plan import plan
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt

SIZE = (5472, 3648)
LENSES: dict[str, Distortion] = {
    "brown": BrownConrady(k1=-0.26, k2=0.11, p1=0.0008, p2=-0.0001, k3=-0.03),
    "fisheye": KannalaBrandt(k1=0.01, k2=-0.003, k3=0.001, k4=0.0001),
}
POINTS = {1: 200, 88: 200, 100_000: 2}
"""How many at once, and how often in a round."""


@dataclass(frozen=True)
class Row:
    """One measurement: what is done, by us and by OpenCV, how often in a round, and the ratio aimed at."""

    name: str
    ours: Callable[[], object]
    theirs: Callable[[], object]
    repeats: int
    goal: float | None


def camera(lens: Distortion) -> Calibration:
    """A survey camera with this lens."""
    return Calibration(
        camera=CameraKey(model="made up"),
        intrinsics=Intrinsics(fx=3657.0, fy=3657.0, cx=2741.0, cy=1819.0, image_size=SIZE),
        distortion=lens,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="benchmark"),
    )


def rows() -> Iterator[Row]:
    """Every measurement."""
    for name, lens in LENSES.items():
        seen_by = camera(lens)
        for count, repeats in POINTS.items():
            yield from of_points(f"{name}, {count:,} points", seen_by, count, repeats)
        yield of_maps(f"{name}, maps of 20 MP", seen_by)


def of_points(name: str, seen_by: Calibration, count: int, repeats: int) -> Iterator[Row]:
    """Projecting and unprojecting so many points."""
    K, coefficients = seen_by.to_opencv()
    px = np.random.default_rng(1).uniform([400, 400], [5000, 3200], (count, 2))
    rays = seen_by.unproject(px)
    as_pixels, as_points, still = px.reshape(-1, 1, 2), rays.reshape(-1, 1, 3), np.zeros(3)
    peer = cv2.fisheye if isinstance(seen_by.distortion, KannalaBrandt) else cv2
    few = count < 1000
    yield Row(
        f"project, {name}",
        lambda: seen_by.project(rays),
        lambda: peer.projectPoints(as_points, still, still, K, coefficients),
        repeats,
        3.0 if few else 1.0,
    )
    yield Row(
        f"unproject, {name}",
        lambda: seen_by.unproject(px),
        lambda: peer.undistortPoints(as_pixels, K, coefficients),
        repeats,
        3.0 if few else 1.0 if peer is cv2.fisheye else None,
    )


def of_maps(name: str, seen_by: Calibration) -> Row:
    """Making the maps of an undistortion."""
    K, coefficients = seen_by.to_opencv()
    made = plan(seen_by)
    peer = cv2.fisheye if isinstance(seen_by.distortion, KannalaBrandt) else cv2
    return Row(
        name,
        lambda: Undistorter(made).maps(),
        lambda: peer.initUndistortRectifyMap(K, coefficients, np.eye(3), K, SIZE, cv2.CV_32FC1),
        1,
        None,
    )


def measured(row: Row, rounds: int) -> tuple[float, float]:
    """(ours, theirs) µs of CPU for each call, the best of all rounds."""
    best = [float("inf"), float("inf")]
    for _ in range(rounds):
        for which, act in enumerate((row.ours, row.theirs)):
            act()
            start = time.process_time()
            for _ in range(row.repeats):
                act()
            best[which] = min(best[which], (time.process_time() - start) / row.repeats * 1e6)
    return best[0], best[1]


def main() -> None:
    """Print a line for each measurement."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    cv2.setNumThreads(1)
    print(f"{machine()}, OpenCV {cv2.__version__}, NumPy {np.__version__}")
    for row in rows():
        ours, theirs = measured(row, rounds)
        compared(row.name, [ours], [theirs], scale=1, unit="µs", name="OpenCV", most=row.goal)


if __name__ == "__main__":
    main()
