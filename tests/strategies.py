"""Hypothesis strategies for the geometry: cameras as they fly, with lenses of every model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from hypothesis import strategies as st

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import (
    Australis,
    BrownConrady,
    Distortion,
    Division,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    Fisheye624,
    FisheyePolynomial,
    InverseBrown,
    InversePolynomial,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    OffCentreBrown,
    RadTanThinPrismFisheye,
    Rational,
    Scaramuzza,
    ThinPrism,
    ThinPrismFisheye,
    Tilted,
    Unified,
)

__all__ = [
    "DISTORTIONS",
    "any_distortions",
    "brown",
    "calibration",
    "cameras",
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


def _terms(limit: float, *names: str) -> dict[str, st.SearchStrategy[float]]:
    return dict.fromkeys(names, _within(limit))


_TANGENTIAL = _terms(2e-3, "p1", "p2")
_RATIONAL = {**_terms(0.2, "k1", "k2", "k3", "k4", "k5", "k6"), **_TANGENTIAL}
_PRISM = _terms(2e-3, "s1", "s2", "s3", "s4")
_CENTRED = {**_terms(0.3, "k1"), **_terms(0.15, "k2", "k3", "k4", "k5"), **_terms(5e-3, "p1", "p2")}
_OFF_CENTRE = {**_CENTRED, **_terms(0.02, "b1", "b2"), **_terms(0.05, "x0", "y0")}
_FISHEYE = {**_terms(0.05, "k1", "k2"), **_terms(0.01, "k3", "k4")}
_FISHEYE_PRISM = _terms(4e-3, "s0", "s1", "s2", "s3")

DISTORTIONS: Mapping[str, st.SearchStrategy[Distortion]] = {
    "none": st.builds(NoDistortion),
    "brown": st.builds(
        BrownConrady, **_terms(0.3, "k1"), **_terms(0.15, "k2"), **_terms(0.075, "k3"), **_TANGENTIAL
    ),
    "rational": st.builds(Rational, **_RATIONAL),
    "thin-prism": st.builds(ThinPrism, **_RATIONAL, **_PRISM),
    "tilted": st.builds(Tilted, **_RATIONAL, **_PRISM, **_terms(0.05, "tau_x", "tau_y")),
    "kannala-brandt": st.builds(
        KannalaBrandt, **_terms(0.1, "k1"), **_terms(0.05, "k2"), **_terms(0.02, "k3"), **_terms(5e-3, "k4")
    ),
    "metashape": st.builds(
        MetashapeFrame,
        **_terms(0.3, "k1", "k2", "k3", "k4"),
        **_terms(0.02, "p1", "p2"),
        **_terms(0.5, "p3", "p4"),
    ),
    "observed-brown": st.builds(InverseBrown, **_OFF_CENTRE),
    "off-centre-brown": st.builds(OffCentreBrown, **_OFF_CENTRE),
    "australis": st.builds(
        Australis, **_terms(0.2, "k1", "k2", "k3"), **_terms(5e-3, "p1", "p2"), **_terms(0.05, "b1", "b2")
    ),
    "observed-polynomial": st.builds(
        InversePolynomial,
        **_terms(0.2, "k1", "k2", "k3", "k4"),
        **_terms(5e-3, "p1", "p2", "s1", "s2", "s3", "s4"),
        **_terms(0.4, "p3", "p4"),
    ),
    # Below that the formula is rounded off behind the camera, and no lens is there.
    "division": st.builds(Division, k=_within(0.5).filter(lambda k: not 0 < abs(k) < 1e-12)),
    "unified": st.builds(
        Unified, xi=st.floats(-0.8, 2.5), **_terms(0.2, "k1", "k2"), **_terms(0.01, "p1", "p2")
    ),
    "extended-unified": st.builds(ExtendedUnified, alpha=st.floats(0.0, 1.0), beta=st.floats(0.05, 3.0)),
    "double-sphere": st.builds(DoubleSphere, xi=st.floats(-0.9, 1.5), alpha=st.floats(0.0, 1.0)),
    "field-of-view": st.builds(FieldOfView, omega=_within(2.5)),
    "fisheye-polynomial": st.builds(FisheyePolynomial, **_terms(0.1, "k2", "k3"), **_terms(0.05, "k4")),
    "fisheye624": st.builds(Fisheye624, **_FISHEYE, **_terms(4e-3, "k5", "k6", "p1", "p2"), **_FISHEYE_PRISM),
    "rad-tan-thin-prism-fisheye": st.builds(
        RadTanThinPrismFisheye,
        **_terms(0.02, "k0", "k1"),
        **_terms(5e-3, "k2", "k3", "k4", "k5"),
        **_terms(4e-3, "p0", "p1"),
        **_FISHEYE_PRISM,
    ),
    "thin-prism-fisheye": st.builds(ThinPrismFisheye, **_FISHEYE, **_terms(4e-3, "p1", "p2", "sx1", "sy1")),
    "scaramuzza": st.builds(
        Scaramuzza, c2=st.floats(-0.6, 0.3), c3=st.floats(-0.1, 0.1), c4=st.floats(-0.3, 0.05)
    ),
}
"""Lenses of every model by its name, from plausible to strong: some end inside a wide image, some see behind."""


def brown(radial: float = 0.3, tangential: float = 2e-3) -> st.SearchStrategy[BrownConrady]:
    """Lenses of aerial cameras, some of which end inside a wide image."""
    return st.builds(
        BrownConrady,
        **_terms(radial, "k1"),
        **_terms(radial / 2, "k2"),
        **_terms(radial / 4, "k3"),
        **_terms(tangential, "p1", "p2"),
    )


def perspective_distortions() -> st.SearchStrategy[Distortion]:
    """Lenses of OpenCV's perspective models, from plausible to strong."""
    models = ("none", "brown", "rational", "thin-prism", "tilted")
    return st.one_of(brown(tangential=0.0), *(DISTORTIONS[model] for model in models))


def any_distortions() -> st.SearchStrategy[Distortion]:
    """Lenses of every model there is."""
    return st.one_of(*DISTORTIONS.values())


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
