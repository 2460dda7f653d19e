"""K of one image from focal length and sensor size; the basic method in one function."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from calibrary.errors import BadRationalError, InputError, MissingTagError
from calibrary.parsers.imagery import read_metadata

FOCAL_TAG = "EXIF FocalLength"


class MinimalReport(TypedDict):
    """Result of :func:`extract_intrinsic_matrix`.

    Deviations of the focal lengths are in per cent, that of the principal point is a fraction of the side.
    """

    image: str
    fx: float
    fy: float
    cx: float
    cy: float
    focal_deviation_pct: float
    pp_drift_frac: float
    passed: bool


def extract_intrinsic_matrix(
    image_path: str | os.PathLike[str],
    sensor_width_mm: float,
    sensor_height_mm: float,
    max_focal_dev_pct: float = 15.0,
    pp_tol_frac: float = 0.05,
    principal_point: tuple[float, float] | None = None,
) -> tuple[NDArray[np.float64], MinimalReport]:
    """Derive and validate the 3×3 intrinsic matrix of one image from its EXIF focal length.

    fx = f / sensor width · W and fy = f / sensor height · H, against the true output resolution. The 35 mm
    equivalent is never used.

    Args:
        image_path: JPEG or TIFF with EXIF.
        sensor_width_mm: width of the active area that fills the image.
        sensor_height_mm: its height.
        max_focal_dev_pct: largest |fx − fy| / max(fx, fy) that passes, in per cent.
        pp_tol_frac: largest offset of the principal point from the centre that passes, as a fraction of a side.
        principal_point: (cx, cy) px from a calibration; None for the image centre.

    Returns:
        K, (3, 3) float64 with the origin at the outer corner of the top-left pixel, and the report.

    Raises:
        MissingTagError: there is no EXIF FocalLength.
        BadRationalError: it has a zero denominator, or is not a positive number.
        ParseError: the file is not an image.
        InputError: the file cannot be read, or a sensor side is not positive.

    >>> K, report = calibrary.extract_intrinsic_matrix("survey/DJI_0001.JPG", 13.2, 8.8)
    >>> round(report["fx"], 3), K.shape, report["passed"]
    (3648.0, (3, 3), True)
    """
    name = Path(image_path).name
    for what, value in (("sensor width", sensor_width_mm), ("sensor height", sensor_height_mm)):
        if not (value > 0 and math.isfinite(value)):
            raise InputError(f"{what} is {value} mm, expected a positive number", source=name)
    focal_mm, (width_px, height_px) = _focal_and_size(Path(image_path))

    fx = (focal_mm / sensor_width_mm) * width_px
    fy = (focal_mm / sensor_height_mm) * height_px
    cx, cy = principal_point or (width_px / 2.0, height_px / 2.0)

    focal_dev = abs(fx - fy) / max(fx, fy) * 100.0
    pp_dev = max(abs(cx - width_px / 2.0) / width_px, abs(cy - height_px / 2.0) / height_px)
    report: MinimalReport = {
        "image": name,
        "fx": fx,
        "fy": fy,
        "cx": cx,
        "cy": cy,
        "focal_deviation_pct": focal_dev,
        "pp_drift_frac": pp_dev,
        "passed": bool(focal_dev <= max_focal_dev_pct and pp_dev <= pp_tol_frac),
    }
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], dtype=np.float64)
    return K, report


def _focal_and_size(path: Path) -> tuple[float, tuple[int, int]]:
    metadata = read_metadata(path)
    if metadata.focal_mm is not None:
        return metadata.focal_mm, metadata.size
    fault = metadata.fault(FOCAL_TAG)
    if fault is not None:
        raise BadRationalError(
            f"{FOCAL_TAG} is {fault.found}, expected {fault.expected}", source=path.name, place=FOCAL_TAG
        )
    if metadata.focal_35mm is not None:
        raise MissingTagError(
            f"Missing {FOCAL_TAG} in {path.name}; its 35 mm equivalent ({metadata.focal_35mm:g} mm) is not a focal "
            "length of this sensor and is not used",
            place=FOCAL_TAG,
        )
    raise MissingTagError(
        f"Missing {FOCAL_TAG} in {path.name}; provide the original file from the camera", place=FOCAL_TAG
    )
