"""What projecting, unprojecting and undistorting cost, beside the quicker of OpenCV's and COLMAP's own functions.

    python -m benchmarks.geometry [--rounds N]

CPU time of the process, the best of several rounds in which all take turns. OpenCV's undistortPoints stops after five
steps of a fixed-point iteration, at some 1e-5 px in the corners; COLMAP and ours go on to machine precision. Models
that neither has stand without a peer.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import cv2
import numpy as np
import pycolmap

from benchmarks.table import at_most, compared, machine
from calibrary import kernel
from calibrary.arrays import FloatArray
from calibrary.calib.undistort import Undistorter
from calibrary.calib.undistort_plan import plan
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    Division,
    DoubleSphere,
    ExtendedUnified,
    KannalaBrandt,
    Rational,
    Unified,
)
from calibrary.errors import UnsupportedModelError

SIZE = (5472, 3648)
LENSES: dict[str, Distortion] = {
    "brown": BrownConrady(k1=-0.26, k2=0.11, p1=0.0008, p2=-0.0001),
    "fisheye": KannalaBrandt(k1=0.01, k2=-0.003, k3=0.001, k4=0.0001),
    "rational": Rational(k1=0.1, k2=0.02, p1=0.0008, p2=-0.0001, k3=0.001, k4=0.3, k5=0.03, k6=0.002),
    "unified": Unified(xi=0.8, k1=-0.05, k2=0.01, p1=1e-4, p2=1e-4),
    "EUCM": ExtendedUnified(alpha=0.6, beta=1.1),
    "double sphere": DoubleSphere(xi=-0.2, alpha=0.55),
    "division": Division(k=-0.1),
}
POINTS = {1: 2000, 88: 500, 100_000: 2}
"""How many at once, and how often in a round."""
SLOWEST_OF_ONE_US = 10.0

Act = Callable[[], object]


class Case(NamedTuple):
    """One measurement: what is done, by whom, how often in a round, and the limit of the ratio, or of ours in µs."""

    name: str
    ours: Act
    peers: dict[str, Act]
    repeats: int
    most: float


def camera(lens: Distortion) -> Calibration:
    """A survey camera with this lens."""
    return Calibration(
        camera=CameraKey(model="made up"),
        intrinsics=Intrinsics(fx=3657.0, fy=3657.0, cx=2741.0, cy=1819.0, image_size=SIZE),
        distortion=lens,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="benchmark"),
    )


def cases() -> Iterator[Case]:
    """Every measurement."""
    for name, lens in LENSES.items():
        seen_by = camera(lens)
        for count, repeats in POINTS.items():
            yield from of_points(f"{name}, {count:,} point{'s' * (count > 1)}", seen_by, count, repeats)
    for name in ("brown", "fisheye"):
        yield of_maps(f"{name}, maps of 20 MP", camera(LENSES[name]))


def of_points(name: str, seen_by: Calibration, count: int, repeats: int) -> Iterator[Case]:
    """Projecting and unprojecting so many points."""
    px = np.random.default_rng(1).uniform([400, 400], [5000, 3200], (count, 2))
    rays = seen_by.unproject(px)
    projects, unprojects = of_colmap(seen_by, px, rays)
    try:
        K, coefficients = seen_by.to_opencv()
    except UnsupportedModelError:
        pass
    else:
        as_pixels, as_points, still = px.reshape(-1, 1, 2), rays.reshape(-1, 1, 3), np.zeros(3)
        peer = cv2.fisheye if isinstance(seen_by.distortion, KannalaBrandt) else cv2
        projects["OpenCV"] = lambda: peer.projectPoints(as_points, still, still, K, coefficients)
        unprojects["OpenCV"] = lambda: peer.undistortPoints(as_pixels, K, coefficients)
    ratio = 1.0 if count > 1000 else 2.0
    for act, ours, peers in (
        ("project", lambda: seen_by.project(rays), projects),
        ("unproject", lambda: seen_by.unproject(px), unprojects),
    ):
        if peers or count == 1:
            yield Case(f"{act}, {name}", ours, peers, repeats, ratio if peers else SLOWEST_OF_ONE_US)


def of_colmap(
    seen_by: Calibration, px: FloatArray, rays: FloatArray
) -> tuple[dict[str, Act], dict[str, Act]]:
    """COLMAP's two functions, where this COLMAP has the model."""
    try:
        peer = pycolmap.Camera(**seen_by.to_colmap()._asdict())
    except (UnsupportedModelError, ValueError, TypeError):
        return {}, {}
    return {"COLMAP": lambda: peer.img_from_cam(rays)}, {"COLMAP": lambda: peer.cam_from_img(px)}


def of_maps(name: str, seen_by: Calibration) -> Case:
    """Making the maps of an undistortion."""
    K, coefficients = seen_by.to_opencv()
    made = plan(seen_by)
    peer = cv2.fisheye if isinstance(seen_by.distortion, KannalaBrandt) else cv2
    theirs = {
        "OpenCV": lambda: peer.initUndistortRectifyMap(K, coefficients, np.eye(3), K, SIZE, cv2.CV_32FC1)
    }
    return Case(name, lambda: Undistorter(made).maps(), theirs, 1, 1.1)


def measured(case: Case, rounds: int) -> dict[str, float]:
    """µs of CPU for each call, the best of all rounds; ours is ""."""
    acts = {"": case.ours, **case.peers}
    best = dict.fromkeys(acts, float("inf"))
    for _ in range(rounds):
        for who, act in acts.items():
            act()
            start = time.process_time()
            for _ in range(case.repeats):
                act()
            best[who] = min(best[who], (time.process_time() - start) / case.repeats * 1e6)
    return best


def main() -> None:
    """Print a line for each measurement."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    cv2.setNumThreads(1)
    how = "compiled" if kernel.compiled else "not compiled"
    print(
        f"{machine()}, OpenCV {cv2.__version__}, COLMAP {pycolmap.__version__}, NumPy {np.__version__}, geometry {how}"
    )
    for case in cases():
        took = measured(case, rounds)
        ours = took.pop("")
        if took:
            quickest = min(took, key=lambda who: took[who])
            compared(case.name, [ours], [took[quickest]], scale=1, unit="µs", name=quickest, most=case.most)
        else:
            at_most(case.name, ours, "µs", case.most)


if __name__ == "__main__":
    main()
