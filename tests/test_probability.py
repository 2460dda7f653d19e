"""Chances against SciPy's, over all that is asked of them and beyond."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special

from calibrary.probability import chi_square_tail, f_tail, normal_tails

DOF = st.floats(0.05, 2e5)
SHARE = st.floats(-6.0, 12.0)
"""How many of its own standard deviations a value is above its mean."""


@given(DOF, SHARE)
def test_the_tail_of_chi_square_is_scipys(dof: float, share: float) -> None:
    value = max(dof + share * math.sqrt(2 * dof), dof * 1e-3)
    assert chi_square_tail(dof, value) == pytest.approx(special.chdtrc(dof, value), rel=1e-9, abs=1e-15)


@given(st.integers(1, 60), st.integers(1, 200_000), st.floats(1e-3, 60.0))
def test_the_tail_of_f_is_scipys(dof: int, dof_below: int, value: float) -> None:
    assert f_tail(dof, dof_below, value) == pytest.approx(
        special.fdtrc(dof, dof_below, value), rel=2e-7, abs=1e-14
    )


@given(st.floats(-38.0, 38.0))
def test_the_tails_of_the_normal_distribution_are_scipys(z: float) -> None:
    assert normal_tails(z) == pytest.approx(2 * special.ndtr(-abs(z)), rel=1e-12)


def test_a_tail_starts_at_one_and_ends_at_nothing() -> None:
    assert (chi_square_tail(3, 0), chi_square_tail(3, math.inf), chi_square_tail(3, 1e6)) == (1, 0, 0)
    assert (f_tail(3, 9, 0), f_tail(3, 9, math.inf)) == (1, 0)


@pytest.mark.parametrize("dof", [0.0, -1.0, math.nan])
def test_without_a_degree_of_freedom_there_is_no_chance(dof: float) -> None:
    assert math.isnan(chi_square_tail(dof, 1))
    assert math.isnan(f_tail(dof, 5, 1))
    assert math.isnan(f_tail(5, dof, 1))
