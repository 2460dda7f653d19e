"""Hypothesis strategies for the geometry: cameras as they fly, with lenses of every model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from hypothesis import strategies as st

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Distortion
from tests.core.lens_models import LENS_MODELS, terms


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


DISTORTIONS: Mapping[str, st.SearchStrategy[Distortion]] = {
    name: row.lenses for name, row in LENS_MODELS.items()
}
"""Lenses of every model by its name, from plausible to strong: some end inside a wide image, some see behind."""


def brown(radial: float = 0.3, tangential: float = 2e-3) -> st.SearchStrategy[BrownConrady]:
    """Lenses of aerial cameras, some of which end inside a wide image."""
    return st.builds(
        BrownConrady,
        **terms(radial, "k1"),
        **terms(radial / 2, "k2"),
        **terms(radial / 4, "k3"),
        **terms(tangential, "p1", "p2"),
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
