"""OpenCV files of a known camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from calibrary import parsers
from calibrary.calibration import Calibration

K_CV = np.array([[3650.1234, 0.0, 2745.31], [0.0, 3648.7651, 1819.87], [0.0, 0.0, 1.0]])
D14 = (
    -0.0125,
    0.0231,
    -3.7e-4,
    8.1e-4,
    -0.0172,
    0.0083,
    -0.0061,
    0.0042,
    1.1e-4,
    -2.3e-5,
    -7e-5,
    1.9e-5,
    0.01,
    -0.02,
)
SYNTAXES = (".yml", ".xml", ".json")
WRITE = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
READ = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
YAML = """%YAML:1.0
---
image_width: 5472
image_height: 3648
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 3650.1, 0., 2736.2, 0., 3649.8, 1824.7, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -1.25e-02, .0231, -4e-04,
       8.0000000000000004e-04, -0.0172 ]
"""


def by_opencv(suffix: str, **values: Any) -> bytes:
    """A file that OpenCV itself wrote."""
    storage = cv2.FileStorage(f"any{suffix}", WRITE)
    for key, value in values.items():
        storage.write(key, value)
    text: str = storage.releaseAndGetString()
    return text.encode()


def read(data: bytes | str, **arguments: Any) -> Sequence[Calibration]:
    raw = data.encode() if isinstance(data, str) else data
    return parsers.decode(raw, name="file", **arguments)
