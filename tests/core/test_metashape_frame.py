"""Metashape's frame camera, against its formula written down here once more and against OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.distortion import BrownConrady, MetashapeFrame
from tests.thorough import examples

MILD = MetashapeFrame(k1=-0.1131, k2=0.0247, k3=-0.0062, k4=0.0021, p1=8.1e-4, p2=-3.7e-4, p3=-0.31, p4=0.12)
LENSES = st.builds(
    MetashapeFrame,
    **{f"k{i}": st.floats(-0.3, 0.3) for i in (1, 2, 3, 4)},
    **{f"p{i}": st.floats(-0.02, 0.02) for i in (1, 2)},
    **{f"p{i}": st.floats(-0.5, 0.5) for i in (3, 4)},
)


def formula(lens: MetashapeFrame, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = xy.T
    r = np.hypot(x, y)
    radial = 1 + lens.k1 * r**2 + lens.k2 * r**4 + lens.k3 * r**6 + lens.k4 * r**8
    growth = 1 + lens.p3 * r**2 + lens.p4 * r**4
    return np.stack(
        [
            x * radial + (lens.p1 * (r**2 + 2 * x**2) + 2 * lens.p2 * x * y) * growth,
            y * radial + (lens.p2 * (r**2 + 2 * y**2) + 2 * lens.p1 * x * y) * growth,
        ],
        axis=1,
    )


def determinant(lens: MetashapeFrame, xy: NDArray[np.float64], step: float = 1e-6) -> NDArray[np.float64]:
    right, down = step * np.eye(2)
    along_x = formula(lens, xy + right) - formula(lens, xy - right)
    along_y = formula(lens, xy + down) - formula(lens, xy - down)
    return (along_x[:, 0] * along_y[:, 1] - along_x[:, 1] * along_y[:, 0]) / (4 * step**2)


def disc(radius: float, rings: int = 40) -> NDArray[np.float64]:
    r, angle = np.meshgrid(np.linspace(1 / rings, 1, rings) * radius, np.linspace(0, 2 * np.pi, 73))
    return np.column_stack([(r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])


@settings(max_examples=examples(24), deadline=None)
@given(lens=LENSES)
def test_it_folds_where_the_determinant_first_vanishes(lens: MetashapeFrame) -> None:
    radius = lens.valid_radius()
    if radius > 2.0:
        assert (determinant(lens, disc(2.0)) > 0).all()
        return
    assert (determinant(lens, disc(0.999 * radius)) > 0).all()
    angle = np.linspace(0, 2 * np.pi, 3601)
    rim = 1.001 * radius * np.column_stack([np.cos(angle), np.sin(angle)])
    assert determinant(lens, rim).min() < 1e-3
    assert np.isnan(lens.distort(rim)).all()


def test_without_its_own_terms_it_is_opencvs_model_with_p1_and_p2_changed_round() -> None:
    xy = disc(0.8)
    lens = MetashapeFrame(k1=-0.1131, k2=0.0247, k3=-0.0062, p1=8.1e-4, p2=-3.7e-4)
    D = np.array([-0.1131, 0.0247, -3.7e-4, 8.1e-4, -0.0062])
    points = np.column_stack([xy, np.ones(len(xy))])
    by_cv2 = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), D)[0].reshape(-1, 2)
    np.testing.assert_allclose(lens.distort(xy), by_cv2, rtol=0, atol=1e-14)


def test_it_says_which_of_its_values_are_browns() -> None:
    brown = BrownConrady(k1=-0.1131, k2=0.0247, p1=-3.7e-4, p2=8.1e-4, k3=-0.0062)
    same = MetashapeFrame.from_equivalent(brown)
    assert same is not None
    assert same.equivalents() == (brown,)
    assert MILD.equivalents() == ()


def test_growth_of_tangential_terms_that_are_zero_changes_nothing() -> None:
    assert MetashapeFrame(k1=0.1, k2=0.0, k3=0.0, p3=0.3).equivalents() != ()


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_fold_scales_with_the_lens(scale: float) -> None:
    lens = MetashapeFrame(k1=-0.3 / scale**2, k2=0.0, k3=0.0, k4=1e-9 / scale**8)
    assert lens.valid_radius() == pytest.approx(scale * np.sqrt(1 / 0.9), rel=1e-6)
