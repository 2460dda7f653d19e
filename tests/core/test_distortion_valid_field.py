"""Where a lens stops being one-to-one: known cases, an independent determinant, and NaN on both sides."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from calibrary.arrays import FloatArray
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
)
from tests.strategies import DISTORTIONS, brown, perspective_distortions
from tests.thorough import examples

NOTHING = dict.fromkeys(Tilted.names(), 0.0)
TURN = np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)


def lens(**coefficients: float) -> Tilted:
    """The largest of the perspective models, which holds all others."""
    return Tilted(**{**NOTHING, **coefficients})


def circle(radius: float) -> FloatArray:
    return radius * np.column_stack([np.cos(TURN), np.sin(TURN)])


def mapped(model: Distortion, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """OpenCV's formula as its documentation prints it, term by term, with nothing said about limits."""
    c = {**NOTHING, **model.coefficients}
    r2 = x**2 + y**2
    gain = (1 + c["k1"] * r2 + c["k2"] * r2**2 + c["k3"] * r2**3) / (
        1 + c["k4"] * r2 + c["k5"] * r2**2 + c["k6"] * r2**3
    )
    u = x * gain + 2 * c["p1"] * x * y + c["p2"] * (r2 + 2 * x**2) + c["s1"] * r2 + c["s2"] * r2**2
    v = y * gain + c["p1"] * (r2 + 2 * y**2) + 2 * c["p2"] * x * y + c["s3"] * r2 + c["s4"] * r2**2
    return u, v


def determinant(model: Distortion, xy: FloatArray) -> FloatArray:
    """By complex steps, so without a formula for any derivative and without cancellation."""
    x, y = xy.T.astype(complex)
    h = 1e-30
    with np.errstate(all="ignore"):
        ux, vx = (part.imag / h for part in mapped(model, x + 1j * h, y))
        uy, vy = (part.imag / h for part in mapped(model, x, y + 1j * h))
        return np.asarray(ux * vy - uy * vx)


@pytest.mark.parametrize(
    ("model", "radius"),
    [
        (NoDistortion(), math.inf),
        (lens(), math.inf),
        (BrownConrady(k1=0.1, k2=0, p1=0, p2=0), math.inf),
        (BrownConrady(k1=-0.3, k2=0, p1=0, p2=0), math.sqrt(1 / 0.9)),
        (BrownConrady(k1=-0.3, k2=0.12, p1=0, p2=0), math.inf),
        (BrownConrady(k1=0, k2=0, p1=0, p2=0, k3=-1e-3), (1 / 7e-3) ** (1 / 6)),
        # 6·q·r = 1: the direction against (p2, p1) ends first.
        (BrownConrady(k1=0, k2=0, p1=3e-3, p2=-4e-3), 1 / 0.03),
        # The denominator vanishes before the numerator of the slope does.
        (lens(k4=-0.25), 2.0),
        (lens(k4=0.25), 2.0),
        (lens(s1=0.03, s3=0.04), 10.0),
        # 4·s·r³ = 1.
        (lens(s2=2e-3), 5.0),
        # Rays that meet the tilted sensor's plane at infinity.
        (lens(tau_x=0.5), 1 / math.tan(0.5)),
        (lens(tau_y=-0.25), 1 / math.tan(0.25)),
        (KannalaBrandt(k1=0.1, k2=0, k3=0, k4=0), math.inf),
        (KannalaBrandt(k1=-0.3, k2=0, k3=0, k4=0), math.tan(math.sqrt(1 / 0.9))),
    ],
)
def test_ends_that_can_be_worked_out_by_hand(model: Distortion, radius: float) -> None:
    assert model.valid_radius() == pytest.approx(radius, rel=1e-14)


@settings(max_examples=examples(20))
@given(brown(radial=0.5, tangential=0.05))
def test_the_closed_form_and_the_search_agree(model: BrownConrady) -> None:
    # The least tilt there is sends the same lens through the search without moving a digit.
    searched = lens(**model.coefficients, tau_x=1e-300)
    # It looks a million lengths of the lens far, no farther.
    assert min(searched.valid_radius(), 1e5) == pytest.approx(min(model.valid_radius(), 1e5), rel=1e-12)


def upright(model: Distortion) -> Distortion:
    """The same lens before an upright sensor, whose determinant has the same sign."""
    if not isinstance(model, Tilted):
        return model
    return ThinPrism(**{n: v for n, v in model.coefficients.items() if n in ThinPrism.names()})


@settings(max_examples=examples(20))
@given(perspective_distortions())
def test_the_determinant_is_positive_inside_and_gone_at_the_limit(model: Distortion) -> None:
    radius = model.valid_radius()
    reach = min(radius, 30.0)
    inside = np.concatenate([circle(reach * part) for part in np.linspace(0.01, 0.9999, 80)])
    assert (determinant(model, inside) > 0).all()
    k4, k5, k6 = (model.coefficients.get(name, 0.0) for name in ("k4", "k5", "k6"))
    at_a_pole = abs(1 + k4 * radius**2 + k5 * radius**4 + k6 * radius**6) < 1e-6 if radius < 30 else False
    if upright(model).valid_radius() == radius < 30 and not at_a_pole:
        # The least determinant may lie between two of the directions.
        assert determinant(model, circle(radius)).min() <= 1e-3 * np.abs(determinant(model, inside)).max()
        assert determinant(model, circle(radius * 1.001)).min() < 0


@settings(max_examples=examples(20))
@given(perspective_distortions())
def test_what_is_seen_beyond_the_rim_has_no_ray(model: Distortion) -> None:
    radius = model.valid_radius()
    assume(radius < 1e3)
    reach = np.hypot(*model.distort(circle(radius * (1 - 1e-9))).T)
    # At a pole, instead of a limit, the rim lies at infinity.
    assume(reach.max() < 1e3)
    beyond = circle(1.001 * float(reach.max()))
    assert np.isnan(model.undistort(beyond)).all()
    assert np.isnan(model.undistort_to_rays(beyond)).all()


@given(brown(tangential=0.0))
def test_the_image_radius_grows_all_the_way_to_the_limit(model: BrownConrady) -> None:
    radii = np.linspace(0, min(model.valid_radius(), 10.0) * (1 - 1e-9), 300)
    seen = model.distort(np.column_stack([radii * 0.6, radii * -0.8]))
    assert (np.diff(np.hypot(*seen.T)) > 0).all()


def test_the_ends_of_a_limit_are_both_told_apart() -> None:
    # r = 0.86 and r = 1.3 are seen at almost the same place: only the first is an answer.
    model = BrownConrady(k1=-0.3, k2=0, p1=0, p2=0)
    inner, outer = 0.8, 1.27
    seen = model.distort(np.array([[inner, 0.0], [outer, 0.0]]))
    assert seen[0, 0] == pytest.approx(inner * (1 - 0.3 * inner**2))
    assert np.isnan(seen[1]).all()
    assert model.undistort(seen[:1])[0, 0] == pytest.approx(inner, abs=1e-15)


def test_the_angle_of_a_perspective_limit_is_its_arc_tangent() -> None:
    model = BrownConrady(k1=-0.1034, k2=-0.0153, p1=0, p2=0, k3=-0.0053)
    assert model.max_angle_rad() == math.atan(model.valid_radius())
    assert math.degrees(model.max_angle_rad()) == pytest.approx(53.1, abs=0.05)
    assert NoDistortion().max_angle_rad() == math.pi / 2


def test_a_fisheye_that_never_ends_reaches_to_the_point_behind_it() -> None:
    assert KannalaBrandt(k1=0, k2=0, k3=0, k4=0).max_angle_rad() == math.pi


def test_a_fisheye_may_end_behind_the_camera() -> None:
    model = KannalaBrandt(k1=-0.1, k2=0, k3=0, k4=0)
    assert model.max_angle_rad() == pytest.approx(math.sqrt(1 / 0.3), rel=1e-15)
    assert model.max_angle_rad() > math.pi / 2
    assert model.valid_radius() == math.inf


@given(DISTORTIONS["kannala-brandt"])
def test_a_fisheyes_limit_is_where_its_slope_vanishes(model: KannalaBrandt) -> None:
    limit = model.max_angle_rad()
    theta = np.linspace(0, limit * (1 - 1e-6), 2000)
    k1, k2, k3, k4 = model.coefficients.values()
    slope = 1 + 3 * k1 * theta**2 + 5 * k2 * theta**4 + 7 * k3 * theta**6 + 9 * k4 * theta**8
    assert (slope > 0).all()


@given(DISTORTIONS["kannala-brandt"])
def test_what_a_fisheye_sees_beyond_its_limit_has_no_ray(model: KannalaBrandt) -> None:
    edge = model.max_angle_rad() * (1 - 1e-12)
    rim = model.distort_rays(np.array([[math.sin(edge), 0.0, math.cos(edge)]]))[0, 0]
    assert np.isnan(model.undistort_to_rays(circle(1.001 * float(rim)))).all()


def test_a_lens_may_end_sideways_to_its_tangential_term() -> None:
    # A' stays just above 6·q·r, so nothing happens against q = (p2, p1); the limit is 6° to either side of it.
    model = BrownConrady(
        k1=10.40524185867064, k2=-9.0955802051267, p1=0, p2=1.8139754993879809, k3=3.592289753896421
    )
    assert model.valid_radius() == pytest.approx(0.8801364243799904, rel=1e-9)
    assert (determinant(model, circle(0.8801)) > 0).all()
    assert (determinant(model, circle(0.8805)) < 0).any()
    assert determinant(model, np.array([[-0.8805, 0.0]])) > 0


def test_a_vanishing_leading_coefficient_hides_no_limit() -> None:
    assert BrownConrady(k1=0, k2=-0.125, p1=0, p2=0, k3=1e-60).valid_radius() == pytest.approx(1.6**0.25)
    fisheye = KannalaBrandt(k1=0, k2=0, k3=-1 / 64, k4=1.4e-45)
    assert fisheye.max_angle_rad() == pytest.approx((64 / 7) ** (1 / 6))


def test_a_rational_lens_that_nearly_cancels_keeps_its_limit() -> None:
    # As calibrations come out: large coefficients above and below, and hardly any distortion left.
    model = Rational(k1=12.3, k2=6.1, p1=3e-4, p2=-5e-4, k3=0.4, k4=12.6, k5=9.8, k6=1.9)
    inside = circle(model.valid_radius() * (1 - 1e-6))
    assert (determinant(model, inside) > 0).all()
    assert (determinant(model, circle(model.valid_radius() * (1 + 1e-6))) < 0).any()


@given(brown(), st.floats(0.01, 3.0))
def test_what_the_quick_test_is_certain_of_has_an_answer_everywhere(
    model: BrownConrady, radius: float
) -> None:
    if model.covers(radius):
        reached = np.hypot(*model.undistort(circle(radius)).T)
        assert (reached < model.valid_radius()).all()


@pytest.mark.parametrize(
    ("radius", "covers"),
    [(0.3, True), (0.6, True), (0.75, True), (1.2, False), (math.inf, False), (math.nan, False)],
)
def test_the_quick_test_is_certain_of_a_common_lens(radius: float, covers: bool) -> None:
    model = BrownConrady(k1=-0.2671, k2=0.1102, p1=8.1e-4, p2=-1.2e-4, k3=-0.0334)
    assert model.covers(radius) is covers


def test_other_models_leave_it_to_the_inverse() -> None:
    assert not lens().covers(0.1)
