"""A camera like a Phantom 4 RTK's, and what can happen to it."""

from __future__ import annotations

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Distortion
from calibrary.records import replace

LENS = BrownConrady(k1=-0.2687, k2=0.1147, p1=0.00081, p2=-0.00012, k3=-0.035)


def camera(
    *, size: ImageSize = (5472, 3648), distortion: Distortion | None = LENS, focal_mm: float | None = 8.8
) -> Calibration:
    intrinsics = Intrinsics(fx=3678.9, fy=3678.1, cx=2731.5, cy=1846.8, image_size=(5472, 3648))
    return Calibration(
        camera=CameraKey(make="DJI", model="FC6310R", focal_mm=focal_mm, image_size=(5472, 3648)),
        intrinsics=intrinsics,
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="checkerboard"),
    ).scaled(size)


def changed(calibration: Calibration, **numbers: float) -> Calibration:
    """The same with some of K's numbers replaced."""
    return replace(calibration, intrinsics=replace(calibration.intrinsics, **numbers))
