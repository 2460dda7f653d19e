"""Cameras and boards that the tests of rendering share."""

from __future__ import annotations

from calibrary.calib.board import Board
from calibrary.calib.synthesis import Settings, Truth, poses
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Distortion

BROWN = BrownConrady(k1=-0.2687, k2=0.1147, p1=1.5e-5, p2=-4.7e-5, k3=-0.0350)
BOARD = Board(columns=9, rows=6, square_mm=40)


def camera(
    size: ImageSize = (1280, 960), fx: float = 967.0, distortion: Distortion | None = BROWN
) -> Calibration:
    """With a principal point off the middle, and fx ≠ fy."""
    return Calibration(
        camera=CameraKey(make="Example", model="Stage"),
        intrinsics=Intrinsics(
            fx=fx, fy=0.998 * fx, cx=size[0] / 2 + 4.3, cy=size[1] / 2 - 6.1, image_size=size
        ),
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="synthesis"),
    )


def truth(
    calibration: Calibration, settings: Settings, *, count: int, seed: int = 5, board: Board = BOARD
) -> Truth:
    """With poses of its own."""
    return Truth(
        board=board,
        calibration=calibration,
        poses=poses(board, calibration, count, seed),
        settings=settings,
    )
