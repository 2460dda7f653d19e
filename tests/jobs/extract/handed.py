"""Candidates of a hand-off."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    Rational,
)
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.hand_off import hand_off
from calibrary.jobs.extract.targets import Candidate, Files
from calibrary.jobs.use import Allowed
from calibrary.records import replace
from calibrary.validation import Use

SIZE = (5472, 3648)
BROWN = BrownConrady(k1=-0.031, k2=0.012, p1=0.0008, p2=-0.0004)
BROWN_5 = replace(BROWN, k3=-0.0034)
RATIONAL = Rational(k1=0.31, k2=0.02, p1=0.0008, p2=-0.0004, k3=0.001, k4=0.33, k5=0.04, k6=0.002)
FISHEYE = KannalaBrandt(k1=0.021, k2=-0.004, k3=0.0011, k4=-0.0002)
ANGLES = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.5, 0.5, 25)), axis=-1).reshape(-1, 2)
POINTS = np.column_stack([ANGLES, np.ones(len(ANGLES))])
Json = dict[str, Any]


def calibrated(distortion: Distortion | None, *, skew: float = 0.0) -> Calibration:
    K = Intrinsics(fx=3660.5, fy=3655.25, cx=2731.5, cy=1846.75, skew=skew, image_size=SIZE)
    return Calibration(
        camera=CameraKey(make="DJI", model="FC6310R", image_size=SIZE),
        intrinsics=K,
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="image-metadata"),
    )


FIXED = Allowed(use=Use.FIXED, why="known to 0.1 px over the frame", sigma_px=0.1, sigma_focal=1e-4)
UNKNOWN = Allowed(use=Use.START, why="the distortion is unknown and starts from zero")


def candidate(
    calibration: Calibration | None = None,
    slug: str = "dji-fc6310r",
    allowed: Allowed = UNKNOWN,
    **told: Any,
) -> Candidate:
    """A camera of the run; ``told`` is what its images say beyond make, Model and frame."""
    base = ImageMetadata(size=SIZE, make="DJI", model="FC6310R", focal_35mm=24.0, has_exif=True)
    return Candidate(
        slug=slug,
        calibration=calibration,
        allowed=allowed,
        states=(replace(base, **told),),
        names=("100/a.jpg", "100/b c.jpg"),
    )


def assert_same_px(seen: Any, calibration: Calibration) -> None:
    expected = calibration.project(POINTS)
    assert np.isfinite(expected).all()
    assert np.abs(np.asarray(seen) - expected).max() <= 1e-9


def files_of(solver: Program, *cameras: Candidate) -> Files:
    """What is written for a program beside K, by name."""
    plan = hand_off(solver, cameras, root=Path("flight"), folder=Path("out"))
    return {path.name: content for path, content in plan.files.items()}


def document(solver: Program, *cameras: Candidate) -> Json:
    [content] = files_of(solver, *cameras).values()
    parsed: Json = json.loads(content)
    return parsed


def opensfm_sees(model: Json, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels from the outer corner, by OpenSfM's brown and fisheye_opencv cameras.

    A point is bent, scaled by focal_x and focal_y and moved by c_x and c_y, all in units of the longer side
    from the middle of the image.
    """
    x, y = (points[:, :2] / points[:, 2:]).T
    if model["projection_type"] == "brown":
        r2 = x * x + y * y
        radial = 1 + r2 * (model["k1"] + r2 * (model["k2"] + r2 * model["k3"]))
        bent_x = x * radial + 2 * model["p1"] * x * y + model["p2"] * (r2 + 2 * x * x)
        bent_y = y * radial + 2 * model["p2"] * x * y + model["p1"] * (r2 + 2 * y * y)
    else:
        r = np.hypot(x, y)
        t = np.arctan(r)
        bent = t * (
            1 + t**2 * (model["k1"] + t**2 * (model["k2"] + t**2 * (model["k3"] + t**2 * model["k4"])))
        )
        factor = np.divide(bent, r, out=np.ones_like(r), where=r > 0)
        bent_x, bent_y = x * factor, y * factor
    longer = max(model["width"], model["height"])
    return np.column_stack(
        [
            (model["focal_x"] * bent_x + model["c_x"]) * longer + model["width"] / 2,
            (model["focal_y"] * bent_y + model["c_y"]) * longer + model["height"] / 2,
        ]
    )
