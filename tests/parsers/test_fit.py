"""From one lens model to another: closed forms, and fits against numpy's own least squares."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    OffCentreBrown,
    Rational,
    ThinPrism,
    Tilted,
    exact,
    required,
)
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.parsers.fit import adapt, compare, refit
from calibrary.parsers.format import Capacity
from calibrary.records import replace
from tests.parsers.cameras import BROWN, camera, distortions
from tests.thorough import examples

FIVE_TERMS = MetashapeFrame(k1=-0.1131, k2=0.0247, k3=-0.0062, k4=0.0121, p1=8.1e-4, p2=-3.7e-4)
RATIONAL = Rational(k1=0.31, k2=0.05, p1=-0.0004, p2=0.0008, k3=-0.002, k4=0.42, k5=0.02, k6=0.001)


@pytest.mark.parametrize("target", [BrownConrady, Rational, ThinPrism, Tilted, MetashapeFrame])
@settings(max_examples=examples(10), deadline=None)
@given(lens=distortions((BrownConrady, NoDistortion)))
def test_a_richer_model_holds_a_plainer_one_exactly(target: type[Distortion], lens: Distortion) -> None:
    same = exact(lens, target)
    assert type(same) is target
    xy = np.random.default_rng(5).uniform(-0.5, 0.5, (50, 2))
    np.testing.assert_allclose(same.distort(xy), lens.distort(xy), rtol=0, atol=1e-15)
    assert exact(same, type(lens)) == lens


def test_a_plainer_model_holds_a_richer_one_whose_own_terms_are_zero() -> None:
    zeros = dict.fromkeys(Tilted.names(), 0.0) | {"k1": -0.1}
    assert exact(Tilted(**zeros), BrownConrady) == BrownConrady(k1=-0.1, k2=0.0, p1=0.0, p2=0.0)
    assert exact(Tilted(**zeros | {"tau_x": 0.01}), ThinPrism) is None


def test_a_writer_gets_the_model_it_needs_or_an_error() -> None:
    for unbent in (None, NoDistortion()):
        assert set(required(unbent, Rational).coefficients.values()) == {0.0}
    assert required(RATIONAL, Rational) is RATIONAL
    with pytest.raises(UnsupportedModelError, match="Rational cannot be written as BrownConrady"):
        required(RATIONAL, BrownConrady)


def test_metashapes_lens_reaches_opencvs_models_through_browns() -> None:
    plain = replace(FIVE_TERMS, k4=0.0)
    assert exact(plain, Rational) == exact(
        BrownConrady(k1=-0.1131, k2=0.0247, p1=-3.7e-4, p2=8.1e-4, k3=-0.0062), Rational
    )
    assert exact(Tilted(**dict.fromkeys(Tilted.names(), 0.0)), MetashapeFrame) == MetashapeFrame(
        k1=0, k2=0, k3=0
    )
    assert exact(FIVE_TERMS, BrownConrady) is None


def test_a_denominator_is_never_taken_for_a_fourth_radial_term() -> None:
    assert exact(RATIONAL, MetashapeFrame) is None
    assert exact(FIVE_TERMS, Rational) is None


def test_a_fisheye_without_coefficients_is_not_a_lens_without_distortion() -> None:
    assert exact(KannalaBrandt(k1=0, k2=0, k3=0, k4=0), NoDistortion) is None


def independent_fit(lens: MetashapeFrame) -> NDArray[np.float64]:
    """Brown's coefficients by numpy's linear least squares over the same 25×25 pixels."""
    item = camera(lens)
    u, v = np.meshgrid(np.linspace(0, 5472, 25), np.linspace(0, 3648, 25))
    rays = item.unproject(np.column_stack([u.ravel(), v.ravel()]))
    x, y = (rays[:, :2] / rays[:, 2:]).T
    K = item.intrinsics
    r2 = x * x + y * y
    A = np.column_stack(
        [
            np.concatenate([K.fx * x * r2, K.fy * y * r2]),
            np.concatenate([K.fx * x * r2**2, K.fy * y * r2**2]),
            np.concatenate([K.fx * 2 * x * y, K.fy * (r2 + 2 * y * y)]),
            np.concatenate([K.fx * (r2 + 2 * x * x), K.fy * 2 * x * y]),
            np.concatenate([K.fx * x * r2**3, K.fy * y * r2**3]),
        ]
    )
    b = np.concatenate([u.ravel() - K.cx - K.fx * x, v.ravel() - K.cy - K.fy * y])
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0])


def test_a_fit_of_a_linear_model_is_the_linear_least_squares_solution() -> None:
    found = refit(camera(FIVE_TERMS), BrownConrady)
    assert found is not None
    assert found[0].distortion is not None
    np.testing.assert_allclose(
        list(found[0].distortion.coefficients.values()), independent_fit(FIVE_TERMS), rtol=1e-6, atol=1e-10
    )


def test_the_error_is_measured_over_the_whole_image_corners_included() -> None:
    found = refit(camera(FIVE_TERMS), BrownConrady)
    assert found is not None
    copy, fit = found
    item = camera(FIVE_TERMS)
    rays = item.unproject(np.random.default_rng(3).uniform([0, 0], [5472, 3648], (20_000, 2)))
    missed = np.linalg.norm(copy.project(rays) - item.project(rays), axis=1)
    assert missed.max() <= fit.max_px
    assert fit.rms_px == pytest.approx(np.sqrt(np.mean(missed**2)), rel=0.2)
    assert fit.radius_px == pytest.approx(np.hypot(2741.3, 3648 - 1815.9))
    assert (fit.covered, fit.exact) == (1.0, False)


@settings(max_examples=examples(4), deadline=None)
@given(lens=distortions((KannalaBrandt,)), target=st.sampled_from([BrownConrady, Rational]))
def test_a_fisheye_of_ordinary_width_can_be_fitted(lens: KannalaBrandt, target: type[Distortion]) -> None:
    found = refit(camera(lens), target)
    assert found is not None
    assert found[1].max_px < 10.0


class Capped(OpenCVDistortion):
    """A model that allows less than the lens would need."""

    model: ClassVar[str] = "capped"

    k1: float

    def __post_init__(self) -> None:
        if abs(self.k1) > 0.05:
            raise InputError("k1 is over 0.05")


def test_a_fit_stays_within_what_the_model_allows() -> None:
    fitted = refit(camera(BROWN), Capped)
    assert fitted is not None
    assert isinstance(fitted[0].distortion, Capped)
    assert 0 < abs(fitted[0].distortion.k1) <= 0.05


def test_one_focal_length_is_fitted_where_the_format_has_no_two() -> None:
    """The mean of fx and fy is not the best single one: the image is wider than high, so x weighs more."""
    oblong = camera(BROWN)
    oblong = replace(oblong, intrinsics=replace(oblong.intrinsics, fx=3650.0, fy=3649.0))
    capacity = Capacity(models=(BrownConrady,), two_focals=False)
    with pytest.raises(
        UnsupportedModelError, match=r"fx − fy of 1 px.*--max-error-px 0\.\d+ to accept"
    ) as refused:
        adapt(oblong, capacity, max_error_px=0.05)
    value = float(str(refused.value).rpartition("--max-error-px ")[2].split()[0])
    item = adapt(oblong, capacity, max_error_px=value)
    K = item.intrinsics
    mean = replace(oblong, intrinsics=replace(K, fx=3649.5, fy=3649.5))
    assert K.fx == K.fy
    assert K.fx != 3649.5
    assert compare(oblong, item).rms_px < compare(oblong, mean).rms_px


def test_affine_terms_of_a_lens_hold_what_k_cannot() -> None:
    item = camera(BROWN)
    odd = replace(item, intrinsics=replace(item.intrinsics, fx=3650.0, fy=3649.0, skew=-0.5))
    found = adapt(odd, Capacity(models=(OffCentreBrown,), two_focals=False), max_error_px=0.05)
    assert (found.intrinsics.skew, found.intrinsics.fx) == (0.0, found.intrinsics.fy)
    assert compare(odd, found).max_px < 0.05


def test_k_is_not_fitted_where_the_format_can_hold_it() -> None:
    item = adapt(camera(RATIONAL), Capacity(models=(BrownConrady,)), max_error_px=1.0)
    assert item.intrinsics == camera().intrinsics


def test_a_fisheye_that_sees_past_the_side_has_no_perspective_counterpart() -> None:
    item = camera(KannalaBrandt(k1=0.0, k2=0.0, k3=0.0, k4=0.0))
    wide = replace(item, intrinsics=replace(item.intrinsics, fx=1200.0, fy=1200.0))
    assert refit(wide, BrownConrady) is None
    with pytest.raises(UnsupportedModelError, match="none shows all that it does"):
        adapt(wide, Capacity(models=(BrownConrady,)), max_error_px=1e9)


def test_the_preferred_model_is_taken_where_it_is_good_enough() -> None:
    nearly_brown = replace(FIVE_TERMS, k4=1e-5)
    capacity = Capacity(models=(BrownConrady, Rational))
    assert isinstance(adapt(camera(nearly_brown), capacity, max_error_px=10.0).distortion, BrownConrady)


def test_where_more_error_is_allowed_the_nearest_model_is_taken_and_not_the_first() -> None:
    capacity = Capacity(models=(NoDistortion, BrownConrady, Rational))
    assert isinstance(adapt(camera(FIVE_TERMS), capacity, max_error_px=1000.0).distortion, Rational)


def test_a_refusal_says_how_far_off_the_best_is_and_what_to_do() -> None:
    with pytest.raises(
        UnsupportedModelError,
        match=r"nearest brown projections are off by rms .* px, max .* px; give --max-error-px",
    ):
        adapt(camera(FIVE_TERMS), Capacity(models=(BrownConrady,)), max_error_px=1e-6)


def test_a_copy_that_folds_inside_the_image_is_infinitely_wrong() -> None:
    folding = BrownConrady(k1=-0.9, k2=0.0, p1=0.0, p2=0.0)
    assert compare(camera(BROWN), camera(folding)).max_px == np.inf


def test_what_the_original_cannot_show_is_left_out_and_said() -> None:
    folding = BrownConrady(k1=-0.9, k2=0.0, p1=0.0, p2=0.0)
    fit = compare(camera(folding), camera(replace(folding, p1=1e-6)))
    assert fit.covered < 0.7
    assert fit.radius_px < 3000


def test_swapped_tangential_terms_are_seen() -> None:
    swapped = replace(BROWN, p1=BROWN.p2, p2=BROWN.p1)
    assert compare(camera(BROWN), camera(swapped)).max_px > 1


def test_the_last_digit_is_no_difference_but_the_tenth_is() -> None:
    assert compare(camera(BROWN), camera(replace(BROWN, k1=BROWN.k1 * (1 + 1e-14)))).exact
    assert not compare(camera(BROWN), camera(replace(BROWN, k1=BROWN.k1 * (1 + 1e-10)))).exact
