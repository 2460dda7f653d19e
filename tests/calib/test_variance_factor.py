import numpy as np
import pytest
from scipy import special

from calibrary.calib.adjustment import adjust, lens_covariance
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network
from calibrary.calib.solve import solve
from calibrary.calib.variance_factor import compared, split_half
from calibrary.records import replace

from .solving import SIZE, Session, shoot


def _kappa2(how: Session, seed: int) -> float:
    solved = solve(Network.of(shoot(how=how, seed=seed)), SIZE, model=Solvable.BROWN, warp=False)
    halves = split_half(solved.adjusted)
    assert halves is not None
    return halves.kappa2


def test_halves_of_clean_views_agree_as_they_say_they_do() -> None:
    found = [_kappa2(Session(), seed) for seed in range(4)]
    assert max(found) < 2.5
    assert 0.4 < np.median(found) < 1.6


def test_it_is_chi_square_over_its_degrees_of_freedom() -> None:
    """Noise alone on a known linear model: n·κ² of one split is χ² with n = 9, Brown's lens having nine parameters."""
    adjusted = solve(Network.of(shoot()), SIZE, model=Solvable.BROWN, warp=False).adjusted
    seen, random = np.repeat(adjusted.network.seen, 2, axis=1), np.random.default_rng(1)
    found = []
    for seed in range(300):
        noise = np.where(seen, random.normal(0.0, 0.2, seen.shape), 0.0)
        drawn = replace(adjusted, linear=replace(adjusted.linear, residuals=noise))
        halves = split_half(drawn, splits=1, seed=seed)
        assert halves is not None
        found.append(9 * halves.kappa2)
    # The mean of 300 has a standard deviation of √(2 · 9 / 300) = 0.24.
    assert np.mean(found) == pytest.approx(9, abs=0.9)
    shares = np.sort(special.chdtr(9, found))
    steps = np.arange(len(found) + 1) / len(found)
    off = max((steps[1:] - shares).max(), (shares - steps[:-1]).max())
    assert special.kolmogorov(off * np.sqrt(len(found))) > 0.01


def test_a_bow_of_a_two_thousandth_that_is_not_solved_for_is_noticed() -> None:
    assert min(_kappa2(Session(bow_mm=0.2), seed) for seed in range(3)) > 4


def test_the_same_seed_deals_the_same_halves() -> None:
    solved = solve(Network.of(shoot(seed=3)), SIZE, model=Solvable.K1K2).adjusted
    first, second, other = split_half(solved), split_half(solved), split_half(solved, seed=1)
    assert first is not None
    assert second is not None
    assert other is not None
    assert first.by_split == second.by_split != other.by_split


def test_how_the_views_are_dealt_hardly_matters() -> None:
    solved = solve(
        Network.of(shoot(how=Session(views=13, bow_mm=0.1))), SIZE, model=Solvable.BROWN, warp=False
    )
    halves = [split_half(solved.adjusted, seed=seed) for seed in range(6)]
    found = [half.kappa2 for half in halves if half is not None]
    assert len(found) == 6
    assert max(found) / min(found) < 1.4


def test_a_half_is_where_solving_it_alone_ends() -> None:
    adjusted = solve(Network.of(shoot(seed=3)), SIZE, model=Solvable.BROWN, warp=False).adjusted
    halves = split_half(adjusted, splits=1)
    assert halves is not None
    dealt = np.random.default_rng(0).permutation(np.flatnonzero(adjusted.network.used))
    for rows, near in zip((dealt[::2], dealt[1::2]), halves.halves, strict=True):
        alone = adjust(adjusted.network.views(rows), adjusted.state.views(rows))
        miss = near - alone.state.parameters
        assert (np.abs(miss) < 0.1 * np.array(list(lens_covariance(alone).std.values()))).all()


def test_a_half_states_the_covariance_that_it_has_alone() -> None:
    """All of κ² from two solutions of their own: its scale is theirs, degrees of freedom included."""
    adjusted = solve(Network.of(shoot(seed=3)), SIZE, model=Solvable.BROWN, warp=False).adjusted
    halves = split_half(adjusted, splits=1)
    assert halves is not None
    dealt = np.random.default_rng(0).permutation(np.flatnonzero(adjusted.network.used))
    alone = [
        adjust(adjusted.network.views(rows), adjusted.state.views(rows)) for rows in (dealt[::2], dealt[1::2])
    ]
    covariance = np.sum([lens_covariance(half).matrix for half in alone], axis=0)
    apart = halves.halves[0] - halves.halves[1]
    assert halves.kappa2 == pytest.approx(apart @ np.linalg.solve(covariance, apart) / len(apart), rel=0.01)


def test_five_views_have_no_halves() -> None:
    solved = solve(Network.of(shoot(how=Session(views=5))), SIZE, model=Solvable.K1K2).adjusted
    assert split_half(solved) is None


def test_a_split_whose_halves_do_not_determine_a_parameter_counts_for_nothing() -> None:
    C, none = np.diag([4.0, 1e-12]), np.zeros((2, 2))
    apart = (np.array([2.0, 1e-6]), C / 2), (np.zeros(2), C / 2)
    unknown = (np.ones(2), none), (np.zeros(2), none)
    found = compared([apart, unknown, apart], np.zeros(2), 3)
    assert found is not None
    assert found.by_split == pytest.approx([1.0, 1.0])
    assert compared([apart, unknown], np.zeros(2), 2) is None
