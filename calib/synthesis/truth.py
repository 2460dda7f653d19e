"""The true values of synthetic images."""

from __future__ import annotations

from msgspec import Struct, field

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.synthesis.settings import Settings
from calibrary.calib.synthesis.sheet import Pose, seen_corners
from calibrary.calibration import Calibration


class Truth(Struct, frozen=True, kw_only=True, eq=False):
    """True values of a set of synthetic images.

    Attributes:
        board: nominal board.
        calibration: the camera.
        poses: pose of the board in each image.
        settings: settings of the images.
    """

    board: Board
    calibration: Calibration
    poses: tuple[Pose, ...]
    settings: Settings = field(default_factory=Settings)

    def corners(self, frame: int) -> FloatArray:
        """Return the corners in an image, (N, 2) px in the canonical origin, ordered as :attr:`Board.points`."""
        return seen_corners(
            self.board, self.calibration, self.poses[frame], self.settings.sheet, self.settings.shutter
        )
