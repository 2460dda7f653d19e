"""Small photographs of boards, and files that are none, for the tests of detection."""

from __future__ import annotations

import io
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board, parse_board
from calibrary.calib.synthesis import Pose, Settings, poses, render, seen_corners
from calibrary.calibration import Calibration
from tests.calib.staging import BROWN, camera

Gray = NDArray[np.uint8]

SIZE = (640, 480)
CAMERA: Calibration = camera(SIZE, fx=480.0, distortion=BROWN)
BOARD = Board(columns=9, rows=6, square_mm=40)
PLAIN = Settings()


def turned(pose: Pose) -> Pose:
    """The board held upside down: half a turn about the viewing direction."""
    half = np.diag([-1.0, -1.0, 1.0]) @ pose.matrix
    rotation = cv2.Rodrigues(half)[0].ravel()
    x, y, z = pose.translation_mm
    return Pose(
        rotation=(float(rotation[0]), float(rotation[1]), float(rotation[2])), translation_mm=(-x, -y, z)
    )


@cache
def photograph(
    name: str = "checkerboard:9x6", number: int = 0, settings: Settings = PLAIN, *, upside_down: bool = False
) -> tuple[Gray, FloatArray]:
    """A frame, and where the board's points are in it, (N, 2) px in the canonical origin."""
    board = parse_board(name, 40.0)
    pose = poses(board, CAMERA, number + 1, 5, 25.0, (0.6, 0.9))[number]
    pose = turned(pose) if upside_down else pose
    frame = render(board, CAMERA, pose, settings, number)
    frame.setflags(write=False)
    return frame.astype(np.uint8, copy=False), seen_corners(
        board, CAMERA, pose, settings.sheet, settings.shutter
    )


def encoded(pixels: NDArray[np.generic], kind: str, **options: object) -> bytes:
    """The bytes of an image file as Pillow writes them."""
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, kind, **options)
    return out.getvalue()


def saved(folder: Path, count: int, name: str = "checkerboard:9x6") -> list[Path]:
    """Frames of different poses, as files."""
    folder.mkdir(exist_ok=True)
    paths = [folder / f"frame_{number:02}.png" for number in range(count)]
    for number, path in enumerate(paths):
        path.write_bytes(encoded(photograph(name, number)[0], "PNG", compress_level=1))
    return paths
