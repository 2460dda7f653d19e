"""What a comparison measures and decides; the verdicts of every labelled pair are in test_labelled_pairs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary.calibration import Calibration, Covariance, Grade, Quality
from calibrary.distortion import BrownConrady, KannalaBrandt, Rational
from calibrary.jobs.diff.comparison import ChangeVerdict, DiffReport, compare
from calibrary.jobs.diff.numbers import Numbers
from calibrary.jobs.diff.uncertainty import Basis
from calibrary.jobs.diff.verdicts import Kind, Use
from calibrary.policy import FLEET
from calibrary.records import replace
from tests.jobs.diff.cameras import LENS, camera, changed
from tests.jobs.diff.made import NAMES, STD, as_rational, drawn, lens, on, silent


def measured(calibration: Calibration, kappa2: float | None = None) -> Calibration:
    correlation = np.eye(9)
    correlation[0, 1] = correlation[1, 0] = 0.95
    correlation[4, 5] = correlation[5, 4] = -0.9
    covariance = Covariance.from_matrix(NAMES, correlation * np.outer(STD, STD))
    return replace(calibration, quality=Quality(covariance=covariance, kappa2=kappa2))


def with_focal(change: float) -> Calibration:
    """Every number a little different, as another measurement has it, and the focal length by this much."""
    lens = replace(LENS, **{name: value * (1 + 1e-6) for name, value in LENS.coefficients.items()})
    return changed(
        camera(distortion=lens), fx=3678.9 * (1 + change), fy=3678.1 * (1 + change), cx=2731.501, cy=1846.801
    )


def between(a: Calibration, b: Calibration) -> DiffReport:
    return compare(measured(a), measured(b))


def numbers_of(a: Calibration, b: Calibration) -> Numbers:
    numbers = compare(a, b).detail
    assert numbers is not None
    return numbers


def by_scipy(a: Calibration, b: Calibration, pixels: np.ndarray) -> np.ndarray:
    """(N, 2) px: OpenCV's projections of the same directions, the rotation found by scipy's least squares."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    K, D, rays = [], [], None
    for one in (a, b):
        matrix, coefficients = one.to_opencv()
        assert coefficients is not None
        K.append(matrix)
        D.append(coefficients)
    patient = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 2000, 1e-14)
    counted = (pixels - 0.5).reshape(-1, 1, 2)
    if hasattr(cv2, "undistortPointsIter"):  # OpenCV 4, whose undistortPoints takes no criteria
        xy = cv2.undistortPointsIter(counted, K[0], D[0], np.eye(3), np.eye(3), patient).reshape(-1, 2)
    else:
        xy = cv2.undistortPoints(counted, K[0], D[0], criteria=patient).reshape(-1, 2)
    rays = np.column_stack([xy, np.ones(len(xy))])

    def apart(turn: np.ndarray) -> np.ndarray:
        turned = Rotation.from_rotvec(turn).apply(rays)
        seen = cv2.projectPoints(turned.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), K[1], D[1])[0].reshape(
            -1, 2
        )
        return np.asarray(seen - counted.reshape(-1, 2), dtype=np.float64).ravel()

    return np.asarray(
        apart(least_squares(apart, np.zeros(3), x_scale=1e-3, xtol=1e-14, ftol=1e-14).x)
    ).reshape(-1, 2)


@pytest.mark.parametrize(
    "later",
    [
        with_focal(0.001),
        changed(camera(), cx=2738.5),
        lens(k1=LENS.k1 + 0.005),
        camera(distortion=replace(as_rational(camera()), k4=-0.01)),
    ],
    ids=["f", "cx", "k1", "rational"],
)
def test_the_difference_over_the_frame_is_opencvs_with_the_rotation_of_scipys_least_squares(
    later: Calibration,
) -> None:
    seen = numbers_of(camera(), later).difference
    assert seen.region.all()
    theirs = by_scipy(camera(), later, seen.pixels.reshape(-1, 2))
    np.testing.assert_allclose(seen.vectors.reshape(-1, 2), theirs, atol=2e-4)
    assert seen.rms_px == pytest.approx(float(np.sqrt(np.mean((theirs**2).sum(axis=1)))), rel=1e-4)


def test_it_is_as_far_from_a_to_b_as_from_b_to_a() -> None:
    for later in (with_focal(0.1), lens(k1=LENS.k1 + 0.05)):
        there, back = numbers_of(camera(), later), numbers_of(later, camera())
        assert (there.difference.rms_px, there.difference.max_px) == (
            back.difference.rms_px,
            back.difference.max_px,
        )
        np.testing.assert_array_equal(there.difference.vectors, -back.difference.vectors)
        assert (1.0 + there.scale.change) * (1.0 + back.scale.change) == pytest.approx(1.0)


def test_the_propagated_noise_is_that_of_draws_from_both_covariances() -> None:
    a, b = camera(), with_focal(0.0)
    numbers = numbers_of(drawn(a, 1), drawn(b, 2))
    std = numbers.difference.std_px
    assert std is not None
    lengths = np.array(
        [
            numbers_of(silent(drawn(a, seed)), silent(drawn(b, seed + 500))).difference.vectors
            for seed in range(10, 60)
        ]
    )
    worst = [
        np.sqrt(np.linalg.eigvalsh(np.cov(lengths[:, *at].T))[-1])
        for at in ((12, 4), (3, 16), (12, 16), (20, 28))
    ]
    np.testing.assert_allclose(worst, [std[at] for at in ((12, 4), (3, 16), (12, 16), (20, 28))], rtol=0.35)


@pytest.mark.thorough
def test_the_noise_of_repeated_calibrations_is_explained_as_often_as_it_should_be() -> None:
    found = [
        numbers_of(drawn(camera(), seed), drawn(camera(), seed + 1000)).significance for seed in range(40)
    ]
    assert sum(not one.explains for one in found) <= 2
    p = np.sort([one.p for one in found if one.p is not None])
    assert len(p) == 40
    # Twice the smaller of two probabilities: between 0.25, if the tests always agree, and 1 − 0.75² of the draws.
    assert np.mean(p < 0.5) == pytest.approx(0.35, abs=0.1)


@pytest.mark.parametrize("lean", [False, True])
def test_what_a_model_fixes_is_exact_and_not_unknown(lean: bool) -> None:
    names = ("fx", "fy", "cx", "cy", "k1", "k2") if lean else NAMES
    one = drawn(camera(distortion=BrownConrady(k1=LENS.k1, k2=LENS.k2, p1=0, p2=0, k3=0)), 5, names=names)
    numbers = numbers_of(one, on(drawn(with_focal(0.0), 6), "2026-01-01"))
    assert numbers.significance.basis is Basis.BOTH
    assert numbers.spread_a.covariance is not None
    assert numbers.spread_a.covariance.std["k3"] == (0.0 if lean else pytest.approx(6e-4))


def test_one_side_that_states_no_uncertainty_is_taken_to_be_half_again_as_uncertain_as_the_other() -> None:
    a, b = on(drawn(camera(), 1), "2026-01-01"), on(silent(drawn(camera(), 2)), "2026-02-01")
    numbers, both = numbers_of(a, b), numbers_of(a, on(drawn(camera(), 2), "2026-02-01"))
    assert numbers.significance.basis is Basis.ONE
    assert numbers.difference.std_px is not None
    assert both.difference.std_px is not None
    factor = np.sqrt((1 + 1.5**2) / 2)
    np.testing.assert_allclose(numbers.difference.std_px, factor * both.difference.std_px, rtol=0.02)
    assert numbers_of(a, replace(b, provenance=a.provenance)).significance.basis is Basis.NONE


def test_copies_of_one_measurement_have_no_noise_between_them() -> None:
    numbers = numbers_of(measured(camera()), measured(changed(camera(), cx=2735.0)))
    assert (numbers.significance.basis, numbers.significance.explains) == (Basis.COPY, None)
    assert numbers.common.changed == ("cx",)
    assert set(numbers.common.same) == set(NAMES) - {"cx"}


def test_a_fisheye_is_compared_as_far_as_it_sees() -> None:
    one = camera(distortion=KannalaBrandt(k1=0.02, k2=-0.01, k3=0.002, k4=-0.0005))
    numbers = numbers_of(
        one, replace(one, distortion=KannalaBrandt(k1=0.021, k2=-0.01, k3=0.002, k4=-0.0005))
    )
    assert numbers.difference.max_px > 1
    assert numbers.difference.region.all()


def test_where_only_one_lens_projects_nothing_is_agreed() -> None:
    # A rational lens whose denominator has a root inside the frame sees nothing beyond it.
    blind = camera(
        distortion=Rational(k1=LENS.k1, k2=LENS.k2, p1=LENS.p1, p2=LENS.p2, k3=LENS.k3, k4=0, k5=0, k6=-1.5)
    )
    comparison = compare(camera(), blind)
    assert comparison.detail is not None
    assert 0.05 < float(comparison.detail.blind.mean()) < 0.9
    assert comparison.alarm
    assert any("only one of the two projects" in warning for warning in comparison.warnings)


def test_the_grades_spread_still_shows_a_wrong_sensor_width() -> None:
    design = replace(camera(), grade=Grade.DESIGN)
    assert compare(design, on(replace(with_focal(0.029), grade=Grade.DESIGN), "2026-01-01")).alarm


def test_a_frame_on_its_side_is_named_though_nothing_can_be_subtracted() -> None:
    turned = changed(camera(), image_size=(3648, 5472), cx=1846.8, cy=2731.5)  # type: ignore[arg-type]  # a size
    comparison = compare(camera(), turned)
    assert (comparison.verdict, comparison.numbers) == (ChangeVerdict.STRUCTURAL, None)
    assert comparison.use is Use.EACH


def test_frames_that_have_nothing_to_do_with_one_another_are_of_two_cameras() -> None:
    wide = changed(camera(), image_size=(4000, 1000))  # type: ignore[arg-type]  # a size
    tall = changed(camera(), image_size=(1500, 1600))  # type: ignore[arg-type]  # a size
    found = compare(wide, tall)
    assert [one.kind for one in found.structural] == [Kind.OTHER_CAMERA]
    assert found.numbers is None


@pytest.mark.parametrize(
    ("limits", "alarm"),
    [
        ({}, True),
        ({"drift_focal": 0.01, "drift_rms_px": 10.0, "drift_max_px": 10.0}, False),
        ({"drift_focal": 0.01, "drift_rms_px": 10.0}, True),
        ({"drift_focal": 0.01, "drift_max_px": 10.0}, True),
        ({"drift_rms_px": 10.0, "drift_max_px": 10.0}, True),
    ],
)
def test_each_limit_is_the_policys(limits: dict[str, float], alarm: bool) -> None:
    comparison = compare(
        drawn(camera(), 51, 0.1), drawn(with_focal(0.001), 52, 0.1), replace(FLEET, **limits)
    )
    assert comparison.alarm is alarm
    assert (comparison.verdict is ChangeVerdict.DRIFT) is alarm


def test_a_tenth_of_a_percent_of_focal_length_is_ten_centimetres_of_height_from_a_hundred_metres() -> None:
    ground = numbers_of(camera(), with_focal(0.001)).ground(100.0)
    assert ground.height_cm == pytest.approx(10.0, rel=1e-3)
    assert ground.gsd_cm == pytest.approx(100 * 100 / 3678.9)


def test_a_shift_of_the_principal_point_is_a_turn_of_the_camera() -> None:
    numbers = numbers_of(camera(), changed(camera(), cx=2733.5))
    assert numbers.difference.centre_rms_px < 0.15
    assert numbers.difference.rotation_deg == pytest.approx(np.degrees(2 / 3678.9), rel=0.05)
    assert not compare(camera(), changed(camera(), cx=2733.5)).alarm


def test_the_focal_length_that_changed_more_is_stated_whichever_way_it_went() -> None:
    for fx, fy, printed in ((-0.004, 0.001, -0.004), (0.001, -0.004, -0.004), (0.004, -0.001, 0.004)):
        numbers = numbers_of(camera(), changed(camera(), fx=3678.9 * (1 + fx), fy=3678.1 * (1 + fy)))
        assert numbers.focal_change == pytest.approx(printed)
        assert numbers.scale.change == pytest.approx(printed, rel=0.02)


def test_a_focal_length_that_the_distortion_makes_up_for_changes_no_scale() -> None:
    numbers = numbers_of(camera(), changed(lens(k1=LENS.k1 - 0.0033), fx=3678.9 * 1.0015, fy=3678.1 * 1.0015))
    assert numbers.focal_change == pytest.approx(0.0015)
    assert abs(numbers.scale.change) < 0.0015 / 1.4


def test_where_noise_is_large_the_parts_that_are_unknown_are_shown() -> None:
    a, b = drawn(camera(), 7, 8), drawn(camera(), 8, 8)
    comparison = compare(a, b)
    assert comparison.detail is not None
    assert comparison.detail.is_noise_large
    share = float(comparison.detail.unknown.mean())
    assert share > 0.5
    assert any(warning.startswith(f"in {share:.0%} of the frame") for warning in comparison.warnings)


@pytest.mark.parametrize(
    ("later", "kind", "use"),
    [
        (camera().cropped((0, 285, 5472, 3078)), Kind.CROP, Use.EACH),
        (lens(k3=0.0), Kind.COEFFICIENT_LOST, Use.A),
        (changed(camera(), cx=2731.0, cy=1846.3), Kind.HALF_PIXEL, Use.A),
        (lens(p1=LENS.p2, p2=LENS.p1), Kind.TANGENTIAL_SWAP, Use.A),
    ],
)
def test_a_change_of_kind_is_named_and_says_which_to_use(later: Calibration, kind: Kind, use: Use) -> None:
    comparison = between(camera(), later)
    assert (comparison.verdict, comparison.alarm, comparison.use) == (ChangeVerdict.STRUCTURAL, True, use)
    assert [one.kind for one in comparison.structural] == [kind]


def test_the_better_known_of_two_is_recommended() -> None:
    a, b = drawn(camera(), 41, 0.3), drawn(camera(), 42, 0.1)
    assert compare(a, b).use is Use.B
    assert "3.0 times better" in compare(b, a).advice
    assert compare(b, a).use is Use.A


def test_halves_of_one_session_are_one_camera_as_far_as_their_noise_goes() -> None:
    a, b = drawn(camera(), 43, 120), drawn(camera(), 44, 120)
    found = compare(a, b)
    assert found.numbers is not None
    assert found.numbers.projection.rms_px > 0.01 * 5472 / 10
    assert (found.structural, found.alarm) == ((), False)
