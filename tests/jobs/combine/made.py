"""Calibrations of a known camera, each off the truth by what a covariance says."""

from __future__ import annotations

from functools import cache

import numpy as np

from calibrary.calib.lens_models import Solvable
from calibrary.calibration import (
    Calibration,
    CameraKey,
    Covariance,
    Grade,
    ImageSize,
    Provenance,
    Quality,
    SourceFile,
)
from calibrary.jobs.combine.sources import Source
from calibrary.records import replace
from calibrary.sfm.adjust import adjust
from calibrary.sfm.sigma import covariance
from tests.sfm.flights import CAMERA, SIZE, Plan, fly

NAMES = Solvable.BROWN.parameters
TRUTH = Solvable.BROWN.values(CAMERA.intrinsics, CAMERA.distortion)
OTHER = TRUTH + np.array([9.0, 9.0, -6.0, 4.0, 0.01, 0, 0, 0, 0])
"""Another unit of the model: 0.8 % and a few px away, as units of one model are."""
UNIT = CameraKey(make="Example", model="Flight One", image_size=SIZE)


@cache
def spread() -> np.ndarray:
    """(9, 9) of the lens, from a simulated flight of oblique images: σ of fx is 0.6 px."""
    plan = Plan(
        relief=0.05,
        heights=(1.0, 1.2),
        cross=True,
        oblique_deg=30.0,
        rows=3,
        columns=4,
        points=300,
        outliers=0,
    )
    # As of four times as many points.
    return covariance(adjust(*fly(plan, 5), model=Solvable.BROWN).bundle) / 4


def made(
    name: str,
    seed: int,
    *,
    truth: np.ndarray = TRUTH,
    wider: float = 1.0,
    stated: float = 1.0,
    size: ImageSize = SIZE,
    date: str | None = None,
    focus: str | None = None,
    kappa2: float | None = 1.0,
    notes: tuple[str, ...] = (),
    frames: tuple[str, ...] = (),
    camera: CameraKey = UNIT,
    model: Solvable = Solvable.BROWN,
) -> Source:
    """A calibration that is off by ``wider`` times the σ of a flight, and states ``stated`` times it."""
    C = spread()
    x = np.random.default_rng((9, seed)).multivariate_normal(truth, C * wider**2)
    values = dict(zip(NAMES, x.tolist(), strict=True))
    names = tuple(name for name in NAMES if name in model.parameters)
    at = [NAMES.index(name) for name in names]
    matrix = C[np.ix_(at, at)] * stated**2
    known = Covariance.from_matrix(names, (matrix + matrix.T) / 2)
    calibration = Calibration(
        camera=replace(camera, image_size=size),
        intrinsics=model.intrinsics(values, size),
        distortion=model.distortion({name: values[name] for name in names}),
        grade=Grade.ADJUSTED,
        quality=Quality(rms_px=0.5, points=4000, views=30, std=known.std, covariance=known, kappa2=kappa2),
        provenance=Provenance(
            kind="flight",
            date=date,
            focus=focus,
            sources=tuple(SourceFile(name="x.jpg", sha256=frame * 64) for frame in frames),
        ),
        notes=notes,
    )
    return Source(
        label=name,
        calibration=calibration,
        file=SourceFile(name=name, sha256=f"{abs(hash(name)):064x}"[-64:]),
    )
