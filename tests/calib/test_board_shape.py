"""Boards that are no planes: seen, solved for, and nothing made up where a board is flat."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.assessment import assess, shift_by_warp
from calibrary.calib.board_shape import _hats, board_shape, stretch
from calibrary.calib.estimation import estimate, solved_views
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import warp_test
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations
from calibrary.calib.solve import Solution, solve
from calibrary.records import replace
from calibrary.validation import Use
from tests.thorough import every

from .faults import bumped, flexing, twisted
from .solving import SIZE, Session, camera, shoot


def _solved(seen: Observations) -> Solution:
    return solve(Network.of(seen), SIZE, model=Solvable.BROWN)


def test_a_flat_board_has_no_shape() -> None:
    for seed in range(4):
        found = board_shape(_solved(shoot(how=Session(views=12), seed=seed)).adjusted)
        assert found is not None
        assert not found.is_bent
        assert found.largest_mm < 0.15


@pytest.mark.parametrize(("make", "lift_mm"), every(2, [(twisted, 1.0), (bumped, 0.5)]))
def test_a_bent_board_is_seen_and_the_camera_before_it_is_the_true_one(make: object, lift_mm: float) -> None:
    assert callable(make)
    result = estimate(make(3))
    found = result.evidence.shape
    assert found is not None
    assert result.evidence.is_lifted
    assert found.largest_mm == pytest.approx(lift_mm, rel=0.5)
    assert "board-shape" in result.rules
    quality, K, truth = result.calibration.quality, result.calibration.intrinsics, camera().intrinsics
    assert quality is not None
    assert quality.kappa2 is not None
    assert quality.kappa2 < 2.0
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(K, name) - getattr(truth, name)) < 3 * quality.std[name]


def test_a_shape_that_may_not_be_solved_for_widens_the_standard_deviation() -> None:
    flat, solved = (estimate(twisted(3, 0.2), "brown", warp=warp) for warp in (False, True))
    found = next(finding for finding in flat.findings if finding.rule == "board-shape")
    assert "the standard deviations allow for it" in found.message
    assert flat.verdict is Use.START
    assert flat.calibration.quality is not None
    assert solved.calibration.quality is not None
    flat_std, solved_std = (
        one.std["fx"] * one.inflation**0.5 for one in (flat.calibration.quality, solved.calibration.quality)
    )
    assert flat_std > 2 * solved_std
    off = flat.calibration.intrinsics.fx - camera().intrinsics.fx
    assert abs(off) < 3 * flat.calibration.quality.std["fx"] * flat.calibration.quality.inflation**0.5


def test_where_views_contradict_one_another_sigma_contains_what_the_warp_has_moved() -> None:
    seen = flexing(5)
    solved = solved_views(seen)
    quality, moved = assess(solved).calibration.quality, shift_by_warp(solved.solution.adjusted)
    assert quality is not None
    assert (quality.kappa2 or 0) > 2
    assert (np.array([*quality.std.values()]) * np.sqrt(quality.inflation) > np.abs(moved)).all()


def test_what_a_warp_moves_is_the_difference_to_a_flat_board() -> None:
    _, flat, warped = warp_test(_solved(shoot(how=Session(views=20, bow_mm=0.1))).adjusted)
    moved = flat.state.parameters - warped.state.parameters
    assert np.abs(moved[:2]).min() > 0.3
    assert moved == pytest.approx(shift_by_warp(warped), rel=0.05, abs=0.02)


def test_a_print_that_is_longer_down_than_across_is_measured_and_moves_the_lens() -> None:
    found = stretch(_solved(shoot(how=Session(views=20, stretch=(1.0, 1.001)))).adjusted)
    assert found is not None
    measured, shift = found
    assert measured.value == pytest.approx(1e-3, abs=4 * measured.std)
    assert abs(shift[0]) > 0.1


def test_points_on_no_board_have_neither() -> None:
    network = Network.of(shoot(how=Session(views=6)))
    adjusted = solve(network, SIZE, model=Solvable.BROWN, warp=False).adjusted
    loose = replace(adjusted, network=replace(network, is_planar=False))
    assert board_shape(loose) is None
    assert stretch(loose) is None


def test_a_board_of_few_lines_bends_at_each_and_one_of_many_at_equal_distances() -> None:
    lines = np.array([-1.0, -0.2, 0.4, 1.0])
    np.testing.assert_allclose(_hats(lines, 4), np.eye(4))
    many = np.linspace(-1, 1, 41)
    hats = _hats(many, 5)
    assert hats.shape == (41, 5)
    np.testing.assert_allclose(hats.sum(axis=1), 1.0)
    np.testing.assert_allclose(hats @ np.linspace(-1, 1, 5), many, atol=1e-12)
