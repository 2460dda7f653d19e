"""The compiled geometry gives the models' own answers: NumPy's formulas are the reference, and decide the rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary import kernel
from calibrary.arrays import FloatArray
from calibrary.calib.undistort import Undistorter
from calibrary.calib.undistort_plan import plan
from calibrary.calibration import Calibration, plan_of
from calibrary.distortion import (
    MODELS,
    Distortion,
    Division,
    DoubleSphere,
    ExtendedUnified,
    KannalaBrandt,
    NoDistortion,
    Tilted,
    Unified,
)
from calibrary.records import replace
from tests.core.lens_models import LENS_MODELS

pytestmark = pytest.mark.skipif(not kernel.compiled, reason="the geometry is not compiled here")

LENSES = st.one_of([row.lenses for row in LENS_MODELS.values()])
FOCALS = st.floats(80.0, 2000.0)
PIXELS = np.stack(np.meshgrid(np.linspace(-60, 700, 13), np.linspace(-60, 540, 11)), axis=-1).reshape(-1, 2)
RAYS = np.random.default_rng(1).normal(size=(500, 3)) * (1.0, 1.0, 2.0)


def camera(lens: Distortion | None, focal: float = 400.0, skew: float = 0.0) -> Calibration:
    K = [[focal, 0.0, 319.5], [0.0, focal * 1.01, 239.5], [0.0, 0.0, 1.0]]
    made = Calibration.from_opencv(K, image_size=(640, 480))
    return replace(made, distortion=lens, intrinsics=replace(made.intrinsics, skew=skew))


def same(ours: FloatArray, reference: FloatArray, tolerance: float) -> bool:
    size = np.maximum(1.0, np.abs(reference))
    return np.array_equal(np.isnan(ours), np.isnan(reference)) and bool(
        np.nanmax(np.abs(ours - reference) / size, initial=0.0) <= tolerance
    )


@given(LENSES, FOCALS, st.sampled_from([0.0, 2.5]))
def test_every_lens_projects_as_its_own_formula_says(lens: Distortion, focal: float, skew: float) -> None:
    made = camera(lens, focal, skew)
    assert same(made.project(RAYS), made._projected(RAYS), 1e-9)


@given(LENSES, FOCALS, st.sampled_from([0.0, 2.5]))
def test_every_pixel_has_the_direction_that_the_model_solves_for(
    lens: Distortion, focal: float, skew: float
) -> None:
    made = camera(lens, focal, skew)
    assert same(made.unproject(PIXELS), made._unprojected(PIXELS), 1e-11)


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 63, 64, 65, 127, 2500])
def test_any_number_of_points_is_the_same_points(count: int) -> None:
    made = camera(KannalaBrandt(k1=0.02, k2=-0.01, k3=0.0, k4=0.0))
    rays = np.resize(RAYS, (count, 3))
    assert np.array_equal(made.project(rays)[-1], made.project(rays[-1:])[0], equal_nan=True)
    pixels = np.resize(PIXELS[47:], (count, 2))
    assert np.allclose(made.unproject(pixels)[-1], made.unproject(pixels[-1:])[0], rtol=0, atol=1e-15)


def test_rows_of_a_larger_array_and_whole_numbers_are_points_too() -> None:
    made = camera(NoDistortion())
    wide = np.column_stack([RAYS, RAYS])
    assert np.array_equal(made.project(wide[::2, :3]), made.project(RAYS[::2].copy()), equal_nan=True)
    assert made.project([[0, 0, 1]]).tolist() == [[320.0, 240.0]]
    assert made.project(np.empty((0, 3))).shape == (0, 2)


@pytest.mark.parametrize(
    "row", [[np.nan, 0, 1], [0, 0, 0], [np.inf, 1, 1], [1e200, 0, 1e200], [1e-200, 0, 1e-200]]
)
@pytest.mark.parametrize("lens", [NoDistortion(), KannalaBrandt(k1=0.0, k2=0.0, k3=0.0, k4=0.0)])
def test_odd_directions_are_left_to_the_model(lens: Distortion, row: list[float]) -> None:
    made = camera(lens)
    ray = np.array([row])
    assert np.allclose(made.project(ray), made._projected(ray), equal_nan=True)


def test_points_at_any_byte_of_a_packet_are_points_too() -> None:
    made, packet = camera(NoDistortion()), bytearray(1 + 24 * 64)
    rays = np.frombuffer(packet, dtype=np.float64, offset=1).reshape(-1, 3)
    rays[:] = RAYS[:64]
    assert not rays.flags.aligned
    assert kernel._laid(rays).flags.aligned
    assert np.array_equal(made.project(rays), made.project(RAYS[:64]), equal_nan=True)


@pytest.mark.parametrize(
    ("lens", "row"),
    [
        (ExtendedUnified(alpha=0.5, beta=1e-12), [0.0169, 11.565, -908.26]),
        (Unified(xi=-0.9999999, k1=0.0, k2=0.0, p1=0.0, p2=0.0), [-0.134, -0.0042, 315.4]),
        (DoubleSphere(xi=1.0, alpha=0.0), [-0.019, 0.00017, -359.5]),
    ],
)
def test_where_a_divisor_cancels_the_model_decides(lens: Distortion, row: list[float]) -> None:
    made = camera(lens)
    assert np.array_equal(made.project([row]), made._projected(np.array([row])), equal_nan=True)


@pytest.mark.parametrize(
    "lens",
    [Division(k=-1e234), ExtendedUnified(alpha=0.5, beta=1e250), DoubleSphere(xi=1.0, alpha=0.0)],
)
def test_a_direction_is_one_even_where_squares_overflow_or_subtraction_tells_nothing(
    lens: Distortion,
) -> None:
    made, pixels = camera(lens, 100.0), np.array([[4155.0, 6536.0], [3e11, 1e12]])
    assert same(made.unproject(pixels), made._unprojected(pixels), 1e-12)


@pytest.mark.parametrize("shape", [(1 << 62, 4), (1 << 33, 1 << 31), (-1, -4)])
def test_a_map_larger_than_any_memory_is_refused(shape: tuple[int, int]) -> None:
    made, none = np.zeros(kernel.SIZE), np.empty(0, np.float32)
    with pytest.raises(ValueError, match="so many pixels"):
        kernel._kernel.map(made, np.zeros(5), 0, *shape, 1.0, 1.0, none, none, np.empty(0, np.bool_))


@pytest.mark.parametrize(("rays", "pixels"), [((4, 3), (3, 2)), ((4, 2), (4, 2))])
def test_arrays_that_do_not_fit_are_refused_before_they_are_written(
    rays: tuple[int, int], pixels: tuple[int, int]
) -> None:
    made = plan_of(camera(None).intrinsics, NoDistortion())
    assert made is not None
    with pytest.raises(ValueError, match="bytes, expected"):
        kernel._kernel.project(made, np.zeros(rays), np.zeros(pixels))
    with pytest.raises(ValueError, match="the plan has"):
        kernel._kernel.project(made[:-1].copy(), np.zeros((4, 3)), np.zeros((4, 2)))


def test_a_tilted_sensor_is_not_one_of_its_maps() -> None:
    lens = Tilted(**dict.fromkeys(Tilted.names(), 0.0) | {"tau_x": 0.1})
    assert plan_of(camera(lens).intrinsics, lens) is None


@pytest.mark.parametrize(
    "model", ["brown", "rational", "kannala-brandt", "unified", "double-sphere", "fisheye624"]
)
def test_maps_are_those_that_are_made_without_it(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lens = MODELS[model](**dict.fromkeys(MODELS[model].names(), 0.0) | dict(MODELS[model].example))
    made = plan(camera(lens))
    x, y = Undistorter(made).maps()
    monkeypatch.setattr(kernel, "compiled", False)
    other_x, other_y = Undistorter(made).maps()
    assert np.array_equal(x == -1, other_x == -1)
    assert np.abs(x - other_x).max() < 1e-3
    assert np.abs(y - other_y).max() < 1e-3
