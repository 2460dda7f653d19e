"""Cameras for the tests of this room: one fixed, and hypothesis strategies for random ones."""

from __future__ import annotations

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    SplinedStereographic,
    exact,
)
from calibrary.parsers.format import Capacity, UnknownLens
from calibrary.records import replace
from tests.core.lens_models import splined_lens

SIZE = (5472, 3648)
BROWN = BrownConrady(k1=-0.1131, k2=0.0247, p1=-0.00037, p2=0.00081, k3=-0.0062)

# How strong a coefficient may be on a lens that sees 45° off its axis without folding.
STRENGTH = {
    "k1": 0.05, "k2": 0.02, "k3": 0.01, "k4": 0.01, "k5": 0.01, "k6": 0.01, "p1": 1e-3, "p2": 1e-3,
    "p3": 1e-2, "p4": 1e-2, "s1": 1e-4, "s2": 1e-4, "s3": 1e-4, "s4": 1e-4, "tau_x": 0.02, "tau_y": 0.02,
    "b1": 1e-3, "b2": 1e-3, "x0": 0.02, "y0": 0.02,
    "k": 0.1, "k0": 0.02, "p0": 1e-3, "s0": 1e-4, "sx1": 1e-4, "sy1": 1e-4,
}  # fmt: skip
# Those that are no small numbers around zero.
SPAN = {"alpha": (0.1, 0.7), "beta": (0.7, 1.4), "xi": (0.0, 0.9), "omega": (0.1, 1.2)}


def camera(
    distortion: Distortion | None = BROWN, *, skew: float = 0.0, grade: Grade = Grade.CALIBRATED
) -> Calibration:
    """A 20 MP camera; its numbers are no short binary fractions, so a lost digit shows."""
    return Calibration(
        camera=CameraKey(image_size=SIZE),
        intrinsics=Intrinsics(fx=3650.1, fy=3648.7, cx=2741.3, cy=1815.9, skew=skew, image_size=SIZE),
        distortion=distortion,
        grade=grade,
        provenance=Provenance(kind="test"),
    )


def numbers(calibration: Calibration) -> tuple[object, ...]:
    """All that a reconstruction would take from a calibration."""
    return calibration.intrinsics, calibration.distortion


@st.composite
def rays(draw: st.DrawFn, count: int = 16) -> NDArray[np.float64]:
    """Directions up to some 30° off the axis."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), np.ones(count)])


@st.composite
def distortions(draw: st.DrawFn, models: tuple[type[Distortion], ...]) -> Distortion:
    """A lens of one of the models, folding nowhere near the image."""
    model = draw(st.sampled_from(models))
    strength = 0.3 if model is KannalaBrandt else 1.0
    if model is SplinedStereographic:
        seed = draw(st.integers(0, 2**32 - 1))
        return splined_lens(draw(st.sampled_from([2, 3])), 9, 9, 130, draw(st.floats(1e-6, 0.05)), seed)
    spans = {name: (-strength * most, strength * most) for name, most in STRENGTH.items()} | SPAN
    lens = model(**{name: draw(st.floats(*spans[name])) for name in model.names()})
    # A lens without terms has no centre that a file could keep.
    assume("x0" not in model.names() or exact(lens, NoDistortion) is None)
    return lens


@st.composite
def calibrations(draw: st.DrawFn, capacity: Capacity) -> Calibration:
    """A camera that a format of that capacity holds exactly."""
    width, height = draw(st.integers(64, 20_000)), draw(st.integers(64, 20_000))
    longer = max(width, height)
    fx = longer * draw(st.floats(0.6, 8.0))
    fy = fx * draw(st.floats(0.97, 1.03)) if capacity.two_focals else fx
    drift = st.floats(-0.05, 0.05) if capacity.off_centre else st.just(0.0)
    intrinsics = Intrinsics(
        fx=fx,
        fy=fy,
        cx=width * (0.5 + draw(drift)),
        cy=height * (0.5 + draw(drift)),
        skew=fx * draw(st.floats(-0.01, 0.01)) if capacity.skew else 0.0,
        image_size=(width, height),
    )
    known = distortions(capacity.models) if capacity.models else st.none()
    plain: list[st.SearchStrategy[NoDistortion | None]] = []
    if capacity.unknown_lens is not UnknownLens.NEVER:
        plain.append(st.just(NoDistortion()))
    if capacity.unknown_lens is UnknownLens.STATED:
        plain.append(st.none())
    lens = draw(st.one_of(known, *plain)) if capacity.models else None
    return replace(camera(lens), camera=CameraKey(image_size=intrinsics.image_size), intrinsics=intrinsics)
