"""Cameras as pycolmap writes and reads them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from tests.parsers.cameras import SIZE

Array = NDArray[np.float64]
PEER_MODELS = [name for name in pycolmap.CameraModelId.__members__ if name != "INVALID"]
WITH_K = [name for name in PEER_MODELS if name != "EQUIRECTANGULAR"]
FOCAL = {"f": 3650.1, "fx": 3650.1, "fy": 3648.7, "cx": 2741.3, "cy": 1815.9}
LENS = {
    "k": -0.0213, "k1": -0.0213, "k2": 0.0231, "k3": -0.0172, "k4": 0.0083, "k5": -0.0061, "k6": 0.0042,
    "p1": -0.00037, "p2": 0.00081, "omega": 0.93, "alpha": 0.61, "beta": 1.13, "sx1": 0.0012, "sy1": -0.0007,
    "k0": 0.0313, "p0": 0.00031, "s0": 0.0012, "s1": -0.00021, "s2": -0.0007, "s3": 0.00017,
}  # fmt: skip


def peer(model: str, number: int = 1, size: tuple[int, int] = SIZE) -> pycolmap.Camera:
    """A camera of pycolmap's, its parameters named by pycolmap itself."""
    item = pycolmap.Camera.create_from_model_name(number, model, 3650.1, *size)
    names = [name.strip() for name in item.params_info.split(",")]
    item.params = [(FOCAL | LENS)[name] for name in names] if model in WITH_K else list(size)
    return item


def read(data: bytes, name: str = "cameras.txt", **more: str) -> Sequence[Calibration]:
    return parsers.decode(data, name=name, format=more.get("format"))


def rays() -> Array:
    u, v = np.meshgrid(np.linspace(-0.75, 0.75, 25), np.linspace(-0.5, 0.5, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
