"""The two wider models from the measured point, against their formulas written down here once more."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.distortion import (
    Australis,
    Distortion,
    InverseBrown,
    InversePolynomial,
    NoDistortion,
    distortion_from,
)
from calibrary.distortion.equivalence import exact

SMALL = {name: st.floats(-0.005, 0.005) for name in ("p1", "p2", "s1", "s2", "s3", "s4")}
RADIAL = {name: st.floats(-0.2, 0.2) for name in ("k1", "k2", "k3", "k4")}
WIDE = st.builds(InversePolynomial, **RADIAL, **SMALL, p3=st.floats(-0.4, 0.4), p4=st.floats(-0.4, 0.4))
TEN = st.builds(
    Australis,
    **{name: RADIAL[name] for name in ("k1", "k2", "k3")},
    **{name: SMALL[name] for name in ("p1", "p2")},
    **{name: st.floats(-0.05, 0.05) for name in ("b1", "b2")},
)
ZERO = InversePolynomial(**dict.fromkeys(InversePolynomial.names(), 0.0))


def formula(lens: Distortion, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    c = {**dict.fromkeys(("k4", "p3", "p4", "s1", "s2", "s3", "s4", "b1", "b2"), 0.0), **lens.coefficients}
    x, y = xy.T
    r = np.hypot(x, y)
    radial = 1 + c["k1"] * r**2 + c["k2"] * r**4 + c["k3"] * r**6 + c["k4"] * r**8
    growth = 1 + c["p3"] * r**2 + c["p4"] * r**4
    along_x = 2 * c["p1"] * x * y + c["p2"] * (r**2 + 2 * x**2)
    along_y = c["p1"] * (r**2 + 2 * y**2) + 2 * c["p2"] * x * y
    return np.stack(
        [
            x * radial + along_x * growth + c["s1"] * r**2 + c["s2"] * r**4 + c["b1"] * x + c["b2"] * y,
            y * radial + along_y * growth + c["s3"] * r**2 + c["s4"] * r**4,
        ],
        axis=1,
    )


def disc(radius: float) -> NDArray[np.float64]:
    r, angle = np.meshgrid(np.linspace(0.05, 1, 20) * radius, np.linspace(0, 2 * np.pi, 61))
    return np.column_stack([(r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])


@settings(max_examples=30, deadline=None)
@given(lens=st.one_of(WIDE, TEN))
def test_the_observed_point_is_corrected_by_the_formula(lens: Distortion) -> None:
    undistorted = disc(0.98 * min(lens.valid_radius(), 1.5))
    distorted = lens.distort(undistorted)
    assert np.isfinite(distorted).all()
    np.testing.assert_allclose(formula(lens, distorted), undistorted, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(lens.undistort(distorted), undistorted, rtol=1e-11, atol=1e-12)


def test_its_prism_is_opencvs() -> None:
    lens = InversePolynomial(
        **{**ZERO.coefficients, "k1": 0.1, "s1": 1e-3, "s2": -2e-3, "s3": 3e-4, "s4": 5e-4}
    )
    D = np.array([0.1, 0, 0, 0, 0, 0, 0, 0, 1e-3, -2e-3, 3e-4, 5e-4])
    points = np.column_stack([disc(0.6), np.ones(len(disc(0.6)))])
    by_cv2 = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), D)[0].reshape(-1, 2)
    np.testing.assert_allclose(lens.undistort(disc(0.6)), by_cv2, rtol=0, atol=1e-14)


def test_both_are_browns_model_where_their_own_terms_are_absent() -> None:
    brown = InverseBrown(k1=0.1, k2=-0.02, p1=3e-4, p2=-1e-4, k3=0.005)
    ten = exact(brown, Australis)
    wide = exact(brown, InversePolynomial)
    assert ten is not None
    assert wide is not None
    assert exact(ten, InverseBrown) == exact(wide, InverseBrown) == brown
    assert exact(ten, InversePolynomial) == wide
    assert exact(wide, Australis) == ten


@pytest.mark.parametrize("term", ["k4", "k5", "x0"])
def test_what_the_ten_parameters_lack_is_not_dropped(term: str) -> None:
    brown = InverseBrown(**{"k1": 0.1, "k2": 0.0, "p1": 0.0, "p2": 0.0, term: 0.01})
    assert exact(brown, Australis) is None


def test_an_affinity_and_a_prism_have_no_place_in_one_another() -> None:
    ten = Australis(**{**dict.fromkeys(Australis.names(), 0.0), "b1": 1e-3})
    assert exact(ten, InversePolynomial) is None
    assert exact(InversePolynomial(**{**ZERO.coefficients, "s1": 1e-3}), InverseBrown) is None
    growing = InversePolynomial(**{**ZERO.coefficients, "p1": 1e-3, "p3": 0.1})
    assert exact(growing, InverseBrown) is None


def test_growth_of_tangential_terms_that_are_zero_changes_nothing() -> None:
    assert exact(InversePolynomial(**{**ZERO.coefficients, "p3": 0.1}), NoDistortion) == NoDistortion()


def test_no_distortion_is_every_coefficient_zero() -> None:
    nothing = exact(NoDistortion(), Australis)
    assert nothing is not None
    assert not any(nothing.coefficients.values())
    assert exact(nothing, NoDistortion) == NoDistortion()


@pytest.mark.parametrize("model", ["australis", "observed-polynomial"])
def test_files_and_reports_know_them_by_name(model: str) -> None:
    assert distortion_from(model, dict.fromkeys(distortion_names(model), 0.01)).model == model


def distortion_names(model: str) -> tuple[str, ...]:
    return {"australis": Australis.names(), "observed-polynomial": InversePolynomial.names()}[model]
