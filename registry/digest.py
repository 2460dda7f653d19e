"""A seal over the numbers that only make sense together: K, distortion, frame, sensor and uncertainty.

A text merge can join one branch's K with the other's distortion without a conflict, into a camera that nobody
measured. With this one line in the file both branches change it, and git asks; whoever puts the halves together
by hand is found out when the file is read.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, Covariance
from calibrary.records import Json

if TYPE_CHECKING:
    from calibrary.registry.entry import Sensor

__all__ = ["digest"]


def digest(calibration: Calibration, sensor: Sensor | None = None) -> str:
    """``sha256:`` and 64 digits over the numbers, whatever their order and spelling in a file.

    It is over compact JSON with sorted keys, each number as the shortest text of its double.
    """
    K, quality = calibration.intrinsics, calibration.quality
    lens = calibration.distortion
    covariance = quality.covariance if quality is not None else None
    block: dict[str, Json] = {
        "image_size": list(K.image_size),
        "intrinsics": _numbers({"fx": K.fx, "fy": K.fy, "cx": K.cx, "cy": K.cy, "skew": K.skew}),
        "distortion": {lens.model: _numbers(lens.coefficients)} if lens is not None else None,
        "sensor": _numbers(_sides(sensor)) if sensor is not None else None,
        "std": _numbers(quality.std) if quality is not None else {},
        "covariance": _numbers(_pairs(covariance)) if covariance is not None else None,
    }
    text = json.dumps(block, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def _numbers(values: Mapping[str, float]) -> dict[str, Json]:
    # Minus zero is zero.
    return {name: float(value) + 0.0 for name, value in values.items()}


def _sides(sensor: Sensor) -> dict[str, float]:
    sides = {"width_mm": sensor.width_mm, "height_mm": sensor.height_mm, "pitch_um": sensor.pitch_um}
    return {name: value for name, value in sides.items() if value is not None}


def _pairs(covariance: Covariance) -> dict[str, float]:
    """Each element by the names of its row and column, so that their order does not matter."""
    pairs = combinations_with_replacement(covariance.names, 2)
    return {",".join(sorted(pair)): value for pair, value in zip(pairs, covariance.upper, strict=True)}
