"""mrcal's splined model, against numbers that mrcal gives, and where it is valid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.arrays import FloatArray
from calibrary.distortion import SplinedStereographic
from calibrary.errors import InputError
from tests.core.lens_models import splined_lens
from tests.thorough import examples

QUICK = settings(max_examples=examples(12), deadline=None)
LENSES = st.builds(
    splined_lens,
    st.sampled_from([2, 3]),
    st.integers(4, 12),
    st.integers(4, 12),
    st.integers(30, 300),
    st.floats(0, 0.3),
    st.integers(0, 2**32 - 1),
)
"""Some turn back near the axis already."""

RAYS = np.array([[0, 0, 1], [0.3, -0.2, 1], [-0.61, 0.34, 1], [0.05, 0.41, 0.7], [-0.5, -0.25, 0.9]])
OF_MRCAL = {
    (2, 7, 5, 100): [
        [957.8109375, 641.582859375],
        [1236.13003622109, 449.367267277384],
        [398.576730855092, 948.294523557596],
        [1011.154278245352, 1193.150335772903],
        [436.565225095003, 385.44246760961],
    ],
    (3, 8, 6, 200): [
        [950.931206597222, 640.073645833333],
        [1239.828690465585, 446.757009877507],
        [398.998344785618, 946.613573053998],
        [1017.296970636968, 1186.856572407809],
        [442.259593711775, 379.951085752476],
    ],
}
"""mrcal 2.2's project() of the rays, by order, Nx, Ny, fov_x_deg; fx, fy, cx, cy are 1000, 1010, 950, 640."""


def of_mrcal(order: int, nx: int, ny: int, fov_x_deg: int) -> SplinedStereographic:
    knots = tuple(round(0.02 * math.sin(1.7 * at), 4) for at in range(2 * nx * ny))
    return SplinedStereographic(order=order, nx=nx, ny=ny, fov_x_deg=fov_x_deg, knots=knots)


def field(lens: SplinedStereographic, beyond: float = 1.0) -> FloatArray:
    """Directions spread over the whole grid, and so many times as far."""
    edge = 2 * math.tan(math.radians(lens.fov_x_deg) / 4) * beyond
    down = edge * (lens.ny - lens.order) / (lens.nx - lens.order)
    u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(-edge, edge, 41), np.linspace(-down, down, 41)))
    across = u * u + v * v
    return np.column_stack([4 * u, 4 * v, 4 - across]) / (4 + across)[:, None]


@pytest.mark.parametrize("grid", OF_MRCAL)
def test_it_projects_as_mrcal_does(grid: tuple[int, int, int, int]) -> None:
    lens = of_mrcal(*grid)
    seen = lens.distort_rays(RAYS) * [1000, 1010] + [950, 640]
    np.testing.assert_allclose(seen, OF_MRCAL[grid], rtol=0, atol=2e-12)


@QUICK
@given(LENSES)
def test_two_directions_never_share_a_point(lens: SplinedStereographic) -> None:
    rays = field(lens, 0.999)
    seen = lens.distort_rays(rays)
    is_seen = np.isfinite(seen).all(axis=1)
    back = lens.undistort_to_rays(seen)
    np.testing.assert_allclose(back[is_seen], rays[is_seen], rtol=0, atol=1e-11)
    assert np.isnan(back[~is_seen]).all()


@QUICK
@given(LENSES)
def test_an_answer_is_a_direction_that_is_seen_there(lens: SplinedStereographic) -> None:
    asked = np.random.default_rng(1).uniform(-4, 4, (400, 2))
    rays = lens.undistort_to_rays(asked)
    found = np.isfinite(rays).all(axis=1)
    np.testing.assert_allclose(lens.distort_rays(rays[found]), asked[found], rtol=0, atol=1e-11)


def test_beyond_its_cells_nothing_is_seen() -> None:
    lens = of_mrcal(3, 8, 6, 200)
    seen = np.isfinite(lens.distort_rays(field(lens, 0.999))).all(axis=1)
    assert seen.all()
    assert np.isnan(lens.distort_rays(field(lens, 1.001)).reshape(41, 41, 2)[[0, -1]]).all()
    assert np.isfinite(lens.distort_unlimited(field(lens, 1.5))).all()


def test_a_place_where_it_turns_back_is_cut_off_and_the_other_side_is_not() -> None:
    lens = of_mrcal(3, 12, 12, 120)
    knots = np.reshape(lens.knots, (12, 12, 2))
    knots[2, 2] -= 3.0
    cut = SplinedStereographic(order=3, nx=12, ny=12, fov_x_deg=120, knots=tuple(knots.ravel().tolist()))
    seen = np.isfinite(cut.distort_rays(field(cut, 0.999))).all(axis=1).reshape(41, 41)
    assert not seen[:5, :5].any()
    assert seen[24:, 24:].all()
    assert seen[20, 20]


def test_where_the_axis_itself_turns_back_nothing_is_seen() -> None:
    lens = SplinedStereographic(
        order=2, nx=4, ny=4, fov_x_deg=90, knots=tuple(np.linspace(9, -9, 32).tolist())
    )
    assert lens.max_angle_rad() == 0
    assert np.isnan(lens.distort_rays(RAYS)).all()
    assert np.isnan(lens.undistort_to_rays(RAYS[:, :2])).all()


def test_knots_that_overflow_leave_nothing_seen() -> None:
    knots = tuple(np.tile([1.7e308, -1.7e308, -1.7e308], 32).tolist())
    lens = SplinedStereographic(order=3, nx=8, ny=6, fov_x_deg=150, knots=knots)
    assert lens.max_angle_rad() == 0
    assert np.isnan(lens.undistort_to_rays(RAYS[:, :2])).all()


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"order": 4}, "order of the .* model is 4, expected a whole number from 2 to 3"),
        ({"order": 3.0}, "order of the .* model is 3.0"),
        ({"nx": 3, "knots": (0.0,) * 36}, "3 by 6.*more than 3 either way"),
        ({"nx": 4096, "ny": 4096}, "4096 by 4096.*at most 4096 together"),
        ({"fov_x_deg": 360}, "fov_x_deg of the .* model is 360"),
        ({"knots": (0.0,) * 95}, "95 numbers.*x and y of 8·6 knots"),
        ({"knots": (0.0,) * 95 + (math.nan,)}, "nan.*finite numbers"),
    ],
)
def test_a_grid_that_no_lens_has_is_refused(changes: dict[str, object], match: str) -> None:
    fields: dict[str, object] = {"order": 3, "nx": 8, "ny": 6, "fov_x_deg": 90, "knots": (0.0,) * 96}
    with pytest.raises(InputError, match=match):
        SplinedStereographic(**{**fields, **changes})  # type: ignore[arg-type]


def test_people_are_shown_its_grid_and_not_its_knots() -> None:
    lens = of_mrcal(2, 7, 5, 100)
    assert lens.shown == {"order": 2, "nx": 7, "ny": 5, "fov_x_deg": 100}
    assert len(lens.coefficients) == 74
    assert lens.coefficients["y_6_4"] == lens.knots[-1]
