"""The two wider models from the measured point, against their formulas written down here once more."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary.distortion import (
    Australis,
    InverseBrown,
    InversePolynomial,
    NoDistortion,
    exact,
)

ZERO = InversePolynomial(**dict.fromkeys(InversePolynomial.names(), 0.0))


def disc(radius: float) -> NDArray[np.float64]:
    r, angle = np.meshgrid(np.linspace(0.05, 1, 20) * radius, np.linspace(0, 2 * np.pi, 61))
    return np.column_stack([(r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])


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
    for prism in ("s1", "s2", "s3", "s4"):
        assert exact(InversePolynomial(**{**ZERO.coefficients, prism: 1e-3}), InverseBrown) is None
    growing = InversePolynomial(**{**ZERO.coefficients, "p1": 1e-3, "p3": 0.1})
    assert exact(growing, InverseBrown) is None


def test_growth_of_tangential_terms_that_are_zero_changes_nothing() -> None:
    assert exact(InversePolynomial(**{**ZERO.coefficients, "p3": 0.1}), NoDistortion) == NoDistortion()


def test_no_distortion_is_every_coefficient_zero() -> None:
    nothing = exact(NoDistortion(), Australis)
    assert nothing is not None
    assert not any(nothing.coefficients.values())
    assert exact(nothing, NoDistortion) == NoDistortion()
