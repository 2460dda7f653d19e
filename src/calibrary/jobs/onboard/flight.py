"""The flight in a payload's folder: whether K can be calibrated from it, and that calibration."""

from __future__ import annotations

import math
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import CameraKey
from calibrary.errors import CalibrationError, InputError
from calibrary.extras import SFM
from calibrary.jobs.calibrate_flight.run import FlightRequest, calibrate_flight_from
from calibrary.jobs.onboard.cameras import PayloadCamera
from calibrary.jobs.onboard.classify import Payload
from calibrary.jobs.onboard.records import ImageSolve, Request
from calibrary.records import replace
from calibrary.sfm.pixel_judging import FEWEST_IMAGES

__all__ = ["flight_hint", "flight_of", "solved_flight"]

SECONDS_AN_IMAGE: Final = 7
"""Duration per image from features to adjustment, on two cores (docs/flight.md)."""


def flight_of(camera: PayloadCamera, payload: Payload) -> tuple[Path, ...]:
    """The images of the folder with the most images, without frames of a board; empty if there are too few."""
    names = camera.judged.names if camera.judged is not None else ()
    by_folder = Counter(name.rpartition("/")[0] for name in names if name not in payload.frames)
    folder, count = max(by_folder.items(), key=lambda one: (one[1], one[0]), default=("", 0))
    if count < FEWEST_IMAGES:
        return ()
    return tuple(
        payload.folder / name
        for name in sorted(names)
        if name.rpartition("/")[0] == folder and name not in payload.frames
    )


def flight_hint(images: int) -> str | None:
    """Sentence on a possible calibration from so many images, with its duration; None if it is not possible."""
    if images < FEWEST_IMAGES or any(find_spec(module) is None for module in SFM):
        return None
    minutes = math.ceil(min(images, FlightRequest().images) * SECONDS_AN_IMAGE / 60)
    return f"{images} images may be a flight: --flight also calibrates from them, about {minutes} min on two cores"


def solved_flight(camera: PayloadCamera, images: tuple[Path, ...], request: Request) -> ImageSolve:
    """Calibrate the camera from the images of its flight."""

    def said(known: CameraKey) -> CameraKey:
        return replace(camera.key, firmware=known.firmware or camera.firmware)

    try:
        result, collected = calibrate_flight_from(
            images, FlightRequest(operator=request.stated.operator), said, progress=request.progress
        )
    except (CalibrationError, InputError) as error:
        return ImageSolve(images=len(images), reason=str(error))
    refused = result.verdict is BoardVerdict.REFUSE
    reason = "; ".join(finding.message for finding in result.findings[:2]) if refused else None
    return ImageSolve(images=len(images), collected=collected, result=result, reason=reason)
