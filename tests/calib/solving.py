"""Boards seen by known cameras, corners only: what the tests of the solver share."""

from __future__ import annotations

from dataclasses import dataclass

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.observations import Observations
from calibrary.calib.synthesis import Shutter, poses
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Distortion
from calibrary.records import replace
from tests.calib.observing import observe

BOARD = Board(columns=11, rows=8, square_mm=40.0)
BROWN = BrownConrady(k1=-0.2687, k2=0.1147, p1=3e-4, p2=-4e-4, k3=-0.035)
SIZE = (1920, 1440)


def camera(
    size: ImageSize = SIZE, fx: float = 1450.37, fy: float = 1447.6, distortion: Distortion | None = BROWN
) -> Calibration:
    """A survey camera at a third of its size, its principal point off the middle."""
    width, height = size
    return Calibration(
        camera=CameraKey(make="Acme", model="A1", image_size=size),
        intrinsics=Intrinsics(fx=fx, fy=fy, cx=width / 2 + 6.3, cy=height / 2 - 4.1, image_size=size),
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )


@dataclass(frozen=True, kw_only=True)
class Session:
    """How a set of views is taken."""

    views: int = 16
    tilt_deg: float = 35.0
    fill: tuple[float, float] = (0.3, 0.85)
    reach: float = 1.0
    roll_deg: float = 180.0
    sigma_px: float = 0.05
    bow_mm: float = 0.0
    stretch: tuple[float, float] = (1.0, 1.0)
    shutter: Shutter | None = None


def shoot(
    seen_by: Calibration | None = None, how: Session | None = None, seed: int = 0, board: Board = BOARD
) -> Observations:
    """Corners of a set of views with Gaussian noise; same seed, same corners."""
    seen_by, how = seen_by or camera(), how or Session()
    held = poses(
        board, seen_by, how.views, seed, how.tilt_deg, how.fill, roll_deg=how.roll_deg, reach=how.reach
    )
    return observe(
        board, seen_by, held, how.sigma_px, seed, bow_mm=how.bow_mm, stretch=how.stretch, shutter=how.shutter
    )


def moved(seen: Observations, view: int, by: FloatArray) -> Observations:
    """The same set with one view's corners moved by (N, 2) px."""
    views = list(seen.views)
    views[view] = replace(views[view], image_points=views[view].image_points + by)
    return replace(seen, views=tuple(views))
