"""The camera of the labelled pairs, and what can happen to its calibration on the way."""

from __future__ import annotations

import numpy as np

from calibrary.calibration import Calibration, Covariance, Grade, Intrinsics, Quality
from calibrary.distortion import BrownConrady, Rational
from calibrary.records import replace
from tests.jobs.diff.cameras import LENS, camera, changed

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
STD = np.array([0.4, 0.4, 0.3, 0.3, 2e-4, 6e-4, 8e-6, 8e-6, 6e-4])
"""What 25 views of a good board give: 0.01 % of the focal length."""
W, H = 5472, 3648


def covariance(factor: float = 1.0, names: tuple[str, ...] = NAMES) -> Covariance:
    """Of a good calibration, fx with fy and the radial terms correlated as a board leaves them."""
    correlation = np.eye(9)
    for one, other, rho in (
        (0, 1, 0.95),
        (4, 5, -0.95),
        (5, 8, -0.97),
        (4, 8, 0.88),
        (2, 7, -0.8),
        (3, 6, -0.8),
    ):
        correlation[one, other] = correlation[other, one] = rho
    values, vectors = np.linalg.eigh(correlation)
    correlation = vectors @ np.diag(np.maximum(values, 1e-3)) @ vectors.T
    C = correlation * np.outer(STD, STD) * factor**2
    at = [NAMES.index(name) for name in names]
    return Covariance.from_matrix(names, C[np.ix_(at, at)])


def measured(
    calibration: Calibration,
    factor: float = 1.0,
    *,
    names: tuple[str, ...] = NAMES,
    kappa2: float | None = None,
) -> Calibration:
    """With a covariance, as many times larger than a good one's."""
    return replace(calibration, quality=Quality(covariance=covariance(factor, names), kappa2=kappa2))


def drawn(
    calibration: Calibration, seed: int, factor: float = 1.0, *, names: tuple[str, ...] = NAMES
) -> Calibration:
    """One more calibration of the same camera: with noise and the covariance of it."""
    C = covariance(factor, names)
    error = dict(
        zip(
            names,
            # By the one factor that every LAPACK gives alike: singular vectors have either sign, by processor.
            np.random.default_rng(seed).multivariate_normal(
                np.zeros(len(names)), C.matrix, method="cholesky"
            ),
            strict=True,
        )
    )
    moved = {name: getattr(calibration.intrinsics, name) + error.get(name, 0.0) for name in NAMES[:4]}
    assert isinstance(calibration.distortion, BrownConrady)
    coefficients = {
        name: value + error.get(name, 0.0) for name, value in calibration.distortion.coefficients.items()
    }
    noisy = replace(changed(calibration, **moved), distortion=BrownConrady(**coefficients))
    return measured(noisy, factor, names=names)


def lens(**coefficients: float) -> Calibration:
    """The camera with some coefficients replaced."""
    return camera(distortion=replace(LENS, **coefficients))


def on(calibration: Calibration, date: str) -> Calibration:
    """Made on a day."""
    return replace(calibration, provenance=replace(calibration.provenance, date=date))


def silent(calibration: Calibration) -> Calibration:
    """The same without its uncertainty."""
    return replace(calibration, quality=None)


def focal(share: float, of: Calibration | None = None) -> Calibration:
    """With a focal length that much longer."""
    K = (of or camera()).intrinsics
    return changed(of or camera(), fx=K.fx * (1 + share), fy=K.fy * (1 + share))


def turned_180() -> Calibration:
    K = camera().intrinsics
    return changed(lens(p1=-LENS.p1, p2=-LENS.p2), cx=W - K.cx, cy=H - K.cy)


def quarter(*, clockwise: bool) -> Calibration:
    K = camera().intrinsics
    cx, cy = (H - K.cy, K.cx) if clockwise else (K.cy, W - K.cx)
    p1, p2 = (LENS.p2, -LENS.p1) if clockwise else (-LENS.p2, LENS.p1)
    return replace(
        lens(p1=p1, p2=p2), intrinsics=Intrinsics(fx=K.fy, fy=K.fx, cx=cx, cy=cy, image_size=(H, W))
    )


def mirrored(*, sideways: bool = True) -> Calibration:
    K = camera().intrinsics
    if sideways:
        return changed(lens(p2=-LENS.p2), cx=W - K.cx)
    return changed(lens(p1=-LENS.p1), cy=H - K.cy)


def divided(by: float) -> Calibration:
    K = camera().intrinsics
    return changed(camera(), fx=K.fx / by, fy=K.fy / by, cx=K.cx / by, cy=K.cy / by)


def rational() -> Rational:
    return Rational(k1=LENS.k1, k2=LENS.k2, p1=LENS.p1, p2=LENS.p2, k3=LENS.k3, k4=0, k5=0, k6=0)


def same_projection_as_rational() -> Calibration:
    """A rational lens with other coefficients that projects within 0.2 px as the polynomial one: k4 traded for k1."""
    xy = np.column_stack([np.linspace(0.01, 1.2, 60), np.zeros(60)])
    r2 = xy[:, 0] ** 2
    target = 1 + LENS.k1 * r2 + LENS.k2 * r2**2 + LENS.k3 * r2**3
    k4 = 0.01
    A = np.column_stack([r2, r2**2, r2**3])
    k = np.linalg.lstsq(A, target * (1 + k4 * r2) - 1, rcond=None)[0]
    return camera(distortion=Rational(k1=k[0], k2=k[1], p1=LENS.p1, p2=LENS.p2, k3=k[2], k4=k4, k5=0, k6=0))


def other_lens() -> Calibration:
    """A wide-angle lens on another camera of the same image size."""
    return replace(
        changed(
            camera(distortion=BrownConrady(k1=0.13, k2=-0.1, p1=-1e-4, p2=2e-4, k3=0.02)),
            fx=4310.2,
            fy=4309.1,
            cx=2702.4,
            cy=1811.0,
        ),
    )


def of_model(calibration: Calibration, model: str) -> Calibration:
    return replace(calibration, camera=replace(calibration.camera, model=model))


def graded(calibration: Calibration, grade: Grade, date: str | None = None) -> Calibration:
    return replace(calibration, grade=grade, provenance=replace(calibration.provenance, date=date))


def scattered(seed: int, share: float) -> Calibration:
    """Another day's self-calibration: every number moved."""
    rng = np.random.default_rng(seed)
    K = camera().intrinsics
    f = 1 + share
    return changed(
        lens(
            **{name: value * (1 + 0.002 * rng.standard_normal()) for name, value in LENS.coefficients.items()}
        ),
        fx=K.fx * f,
        fy=K.fy * f,
        cx=K.cx + 1.3,
        cy=K.cy - 0.7,
    )


def as_rational(calibration: Calibration) -> Rational:
    assert isinstance(calibration.distortion, BrownConrady)
    return Rational(**calibration.distortion.coefficients, k4=0, k5=0, k6=0)
