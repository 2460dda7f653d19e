"""Hypothesis strategies for the geometry: cameras as they fly, with lenses of every model."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
)

__all__ = [
    "any_distortions",
    "brown",
    "calibration",
    "cameras",
    "fisheyes",
    "grid",
    "image_sizes",
    "perspective_distortions",
]


def calibration(intrinsics: Intrinsics, distortion: Distortion | None) -> Calibration:
    """A calibration with nothing to it but its geometry."""
    return Calibration(
        camera=CameraKey(image_size=intrinsics.image_size),
        intrinsics=intrinsics,
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )


def grid(size: ImageSize, columns: int = 33, rows: int = 23) -> FloatArray:
    """(N, 2) pixels spread evenly over an image, its four outer corners included."""
    x, y = np.meshgrid(np.linspace(0, size[0], columns), np.linspace(0, size[1], rows))
    return np.column_stack([x.ravel(), y.ravel()])


def image_sizes() -> st.SearchStrategy[ImageSize]:
    """Frames from a thermal core's to a survey camera's."""
    return st.sampled_from([(640, 512), (1280, 960), (4000, 2250), (5472, 3648), (9504, 6336)])


def _within(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit, allow_nan=False, width=64)


def brown(radial: float = 0.3, tangential: float = 2e-3) -> st.SearchStrategy[BrownConrady]:
    """Lenses of aerial cameras, some of which fold inside a wide image."""
    return st.builds(
        BrownConrady,
        k1=_within(radial),
        k2=_within(radial / 2),
        p1=_within(tangential),
        p2=_within(tangential),
        k3=_within(radial / 4),
    )


def _rational_terms() -> dict[str, st.SearchStrategy[float]]:
    terms = {name: _within(0.2) for name in ("k1", "k2", "k3", "k4", "k5", "k6")}
    return {**terms, "p1": _within(2e-3), "p2": _within(2e-3)}


def _prism_terms() -> dict[str, st.SearchStrategy[float]]:
    return {name: _within(2e-3) for name in ("s1", "s2", "s3", "s4")}


def perspective_distortions() -> st.SearchStrategy[Distortion]:
    """Lenses of OpenCV's perspective models, from plausible to strong."""
    return st.one_of(
        st.builds(NoDistortion),
        brown(),
        brown(radial=0.3, tangential=0.0),
        st.builds(Rational, **_rational_terms()),
        st.builds(ThinPrism, **_rational_terms(), **_prism_terms()),
        st.builds(Tilted, **_rational_terms(), **_prism_terms(), tau_x=_within(0.05), tau_y=_within(0.05)),
    )


def fisheyes() -> st.SearchStrategy[KannalaBrandt]:
    """Fisheye lenses; some fold before 90°, some see behind themselves."""
    return st.builds(KannalaBrandt, k1=_within(0.1), k2=_within(0.05), k3=_within(0.02), k4=_within(0.005))


def any_distortions() -> st.SearchStrategy[Distortion]:
    """Lenses of every model there is."""
    return st.one_of(perspective_distortions(), fisheyes())


@st.composite
def cameras(draw: st.DrawFn, distortions: st.SearchStrategy[Distortion] | None = None) -> Calibration:
    """A camera whose focal length is 0.6 to 1.5 of its width, its principal point within 3 % of the middle."""
    width, height = size = draw(image_sizes())
    fx = width * draw(st.floats(0.6, 1.5))
    intrinsics = Intrinsics(
        fx=fx,
        fy=fx * draw(st.floats(0.99, 1.01)),
        cx=width * draw(st.floats(0.47, 0.53)),
        cy=height * draw(st.floats(0.47, 0.53)),
        skew=fx * draw(st.sampled_from([0.0, 0.0, 1e-4, -3e-3])),
        image_size=size,
    )
    return calibration(intrinsics, draw(distortions if distortions is not None else any_distortions()))
