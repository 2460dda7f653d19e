"""A program that uses the door, for mypy --strict to read: every ignored error must be one, every other none."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import calibrary


def read() -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    camera: calibrary.Calibration = calibrary.read(
        "camera.xml", camera=1, format=None, image_size=(4000, 3000)
    )
    cameras: list[calibrary.Calibration] = list(calibrary.read_all(b"...", options={"distortion": "fisheye"}))
    with Path("camera.xml").open("rb") as file:
        cameras.append(calibrary.read(file))
    name: str = camera.to_colmap().model
    params: tuple[float, ...] = camera.to_colmap(name).params
    version: str = calibrary.__version__
    sys.stdout.write(f"{params} {version}")
    return calibrary.refit(camera, "opencv", max_error_px=0.1).to_opencv()


def write(camera: calibrary.Calibration) -> float:
    again = calibrary.Calibration.from_opencv(
        np.eye(3), [0.1, 0.0, 0.0, 0.0], image_size=(4, 3), fisheye=True
    )
    return calibrary.write([camera, again], "cameras.txt", format="colmap_text", max_error_px=0.1).max_px


def jobs(camera: calibrary.Calibration) -> None:
    def progress(done: int, total: int, what: str) -> None:
        sys.stdout.write(f"{done} of {total} {what}")

    found = calibrary.extract(["a.jpg", Path("b.jpg")], policy="source", progress=progress)
    usable: list[calibrary.Calibration] = [
        one.calibration for one in found.cameras if one.calibration is not None
    ]
    solved = calibrary.calibrate(
        "frames", square_mm=40, camera=calibrary.CameraKey(model="X"), progress=progress
    )
    alarm: bool = calibrary.compare(usable[0], solved.calibration, policy=calibrary.SOURCE).alarm
    json.dumps([alarm, found.to_dict(), calibrary.Calibration.from_dict(camera.to_dict()).to_dict()])


def fleet(camera: calibrary.Calibration) -> float | None:
    answer: calibrary.FleetAnswer = calibrary.open_registry("fleet", at="v1.0").resolve(camera)
    return answer.calibration.intrinsics.fx if answer.calibration is not None else None


def misuse(camera: calibrary.Calibration) -> None:
    calibrary.read(1)  # type: ignore[arg-type]
    calibrary.read("camera.xml", "agisoft_xml")  # type: ignore[call-arg]
    calibrary.write(camera, "camera.xml", format=7)  # type: ignore[arg-type]
    _ = calibrary.reed  # type: ignore[attr-defined]
