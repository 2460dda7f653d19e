from __future__ import annotations

import numpy as np
import pytest

from calibrary.calibration import Calibration, Covariance, Grade, Quality
from calibrary.distortion import NoDistortion, Rational
from calibrary.errors import FrameError
from calibrary.jobs.diff.comparison import ChangeVerdict, Comparison, compare
from calibrary.jobs.diff.structure import Kind
from calibrary.policy import FLEET
from calibrary.records import replace
from tests.jobs.diff.cameras import LENS, camera, changed

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
STD = np.array([0.4, 0.4, 0.3, 0.3, 2e-4, 6e-4, 8e-6, 8e-6, 6e-4])
"""What 25 views of a good board give a 20 MP camera: 0.01 % of the focal length."""


def measured(calibration: Calibration, kappa2: float | None = None) -> Calibration:
    correlation = np.eye(9)
    correlation[0, 1] = correlation[1, 0] = 0.95
    correlation[4, 5] = correlation[5, 4] = -0.9
    covariance = Covariance.from_matrix(NAMES, correlation * np.outer(STD, STD))
    return replace(calibration, quality=Quality(covariance=covariance, kappa2=kappa2))


def with_focal(change: float) -> Calibration:
    return changed(camera(), fx=3678.9 * (1 + change), fy=3678.1 * (1 + change))


def between(a: Calibration, b: Calibration) -> Comparison:
    return compare(measured(a), measured(b))


def test_one_calibration_is_identical_to_itself() -> None:
    comparison = between(camera(), camera())
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.IDENTICAL, False)


def test_a_change_within_the_noise_raises_no_alarm() -> None:
    comparison = between(camera(), changed(camera(), fx=3679.2, fy=3678.4, cx=2731.9))
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.NOISE, False)


def test_a_focal_length_that_moved_by_a_thousandth_is_a_drift() -> None:
    comparison = between(camera(), with_focal(0.001))
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.DRIFT, True)


def test_a_change_that_shows_only_in_the_numbers_is_negligible() -> None:
    quality = Quality(covariance=Covariance.from_matrix(NAMES, np.diag((STD / 50) ** 2)))
    a, b = replace(camera(), quality=quality), replace(with_focal(0.00002), quality=quality)
    comparison = compare(a, b)
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.NEGLIGIBLE, False)


def test_covariances_that_do_not_tell_the_truth_are_inflated_before_they_judge() -> None:
    comparison = compare(measured(camera(), kappa2=80.0), measured(with_focal(0.001), kappa2=80.0))
    assert comparison.verdict is ChangeVerdict.NOISE


def test_a_calibration_without_spread_is_given_its_grades() -> None:
    comparison = compare(camera(), with_focal(0.001))
    assert comparison.verdict is ChangeVerdict.NOISE
    assert comparison.numbers is not None
    assert "states none of its own" in comparison.numbers.spread_a.source


def test_the_grades_spread_still_tells_a_wrong_sensor_width() -> None:
    design = replace(camera(), grade=Grade.DESIGN)
    assert compare(design, replace(with_focal(0.029), grade=Grade.DESIGN)).alarm


def test_chi_squared_is_that_of_the_textbook() -> None:
    a, b = measured(camera()), measured(changed(camera(), fx=3680.0, cx=2731.0))
    numbers = compare(a, b).numbers
    assert numbers is not None
    d = np.array([1.1, 0, -0.5, 0, 0, 0, 0, 0, 0])
    assert a.quality is not None
    assert a.quality.covariance is not None
    C = 2 * a.quality.covariance.matrix
    assert numbers.chi2[0].value == pytest.approx(d @ np.linalg.solve(C, d), rel=1e-6)
    assert [test.dof for test in numbers.chi2] == [9, 4, 2]


def test_another_model_of_the_same_lens_is_compared_by_what_it_projects() -> None:
    same_lens = Rational(k1=LENS.k1, k2=LENS.k2, p1=LENS.p1, p2=LENS.p2, k3=LENS.k3, k4=0, k5=0, k6=0)
    comparison = compare(camera(), camera(distortion=same_lens))
    assert comparison.verdict is ChangeVerdict.IDENTICAL
    assert comparison.numbers is not None
    assert comparison.numbers.chi2 == ()


def test_an_unknown_distortion_leaves_k_to_be_compared() -> None:
    numbers = compare(camera(), camera(distortion=None)).numbers
    assert numbers is not None
    assert not numbers.lens_compared
    assert numbers.difference.max_px < 1e-9


def test_a_resized_frame_is_a_change_of_kind_without_an_alarm() -> None:
    comparison = between(camera(), camera(size=(2736, 1824)))
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.STRUCTURAL, False)
    assert comparison.steps == ("A scaled 5472×3648 → 2736×1824",)


@pytest.mark.parametrize(
    ("later", "kind"),
    [
        (camera().cropped((0, 285, 5472, 3078)), Kind.CROP),
        (camera(distortion=NoDistortion()), Kind.DEWARP_ON),
        (changed(camera(), cx=2731.0, cy=1846.3), Kind.HALF_PIXEL),
        (camera(distortion=replace(LENS, p1=LENS.p2, p2=LENS.p1)), Kind.TANGENTIAL_SWAP),
    ],
)
def test_a_change_of_kind_is_named_and_raises_an_alarm(later: Calibration, kind: Kind) -> None:
    comparison = between(camera(), later)
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.STRUCTURAL, True)
    assert [one.kind for one in comparison.structural] == [kind]


def test_a_frame_on_end_is_named_though_nothing_can_be_subtracted() -> None:
    turned = changed(camera(), image_size=(3648, 5472), cx=1846.8, cy=2731.5)  # type: ignore[arg-type]  # a size
    comparison = compare(camera(), turned)
    assert (comparison.verdict, comparison.numbers) == (ChangeVerdict.STRUCTURAL, None)


def test_frames_that_have_nothing_to_do_with_one_another_are_refused() -> None:
    wide = changed(camera(), image_size=(4000, 1000))  # type: ignore[arg-type]  # a size
    tall = changed(camera(), image_size=(1500, 1600))  # type: ignore[arg-type]  # a size
    with pytest.raises(FrameError):
        compare(wide, tall)


def test_the_limits_are_the_policys() -> None:
    tolerant = replace(FLEET, drift_focal=0.01, drift_px=10.0)
    comparison = compare(measured(camera()), measured(with_focal(0.001)), tolerant)
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.NEGLIGIBLE, False)


def test_a_tenth_of_a_percent_of_focal_length_is_ten_centimetres_of_height_from_a_hundred_metres() -> None:
    numbers = between(camera(), with_focal(0.001)).numbers
    assert numbers is not None
    ground = numbers.ground(100.0)
    assert ground.height_cm == pytest.approx(10.0)
    assert ground.gsd_cm == pytest.approx(100 * 100 / 3678.9)


def test_a_shift_of_the_principal_point_is_a_turn_of_the_camera() -> None:
    numbers = between(camera(), changed(camera(), cx=2733.5)).numbers
    assert numbers is not None
    assert numbers.difference.centre_rms_px < 0.15
    assert numbers.difference.rotation_deg == pytest.approx(np.degrees(2 / 3678.9), rel=0.05)


def test_a_principal_point_that_surely_moved_is_no_drift_where_a_turn_undoes_it() -> None:
    comparison = between(camera(), changed(camera(), cx=2734.0))
    assert comparison.numbers is not None
    assert comparison.numbers.p < FLEET.drift_significance
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.NEGLIGIBLE, False)


def test_noise_of_the_corners_is_not_what_a_significant_change_moved() -> None:
    numbers = between(camera(), changed(camera(), cx=2734.0)).numbers
    assert numbers is not None
    assert numbers.sure_px < FLEET.drift_px


def test_a_change_that_may_be_as_large_as_the_limit_is_taken_to_be() -> None:
    surer = Quality(covariance=Covariance.from_matrix(NAMES, np.diag((STD / 2) ** 2)))
    a, b = (replace(one, quality=surer) for one in (camera(), with_focal(0.00047)))
    comparison = compare(a, b, replace(FLEET, drift_px=10.0))
    assert (comparison.verdict, comparison.alarm) == (ChangeVerdict.DRIFT, True)
    assert "0.05% cannot be ruled out" in comparison.reasons[0]


def test_a_lens_that_bends_more_is_a_drift_by_its_pixels() -> None:
    more = camera(distortion=replace(LENS, k1=LENS.k1 * 1.02))
    numbers = between(camera(), more).numbers
    assert numbers is not None
    assert numbers.focal_change == 0
    assert numbers.sure_px > FLEET.drift_px
    assert between(camera(), more).alarm


def test_the_focal_length_that_changed_more_is_told_whichever_way_it_went() -> None:
    for fx, fy, told in ((-0.004, 0.001, -0.004), (0.001, -0.004, -0.004), (0.004, -0.001, 0.004)):
        numbers = between(camera(), changed(camera(), fx=3678.9 * (1 + fx), fy=3678.1 * (1 + fy))).numbers
        assert numbers is not None
        assert numbers.focal_change == pytest.approx(told)


def test_the_chance_is_that_of_the_least_likely_test_times_how_many_were_made() -> None:
    numbers = between(camera(), with_focal(0.0003)).numbers
    assert numbers is not None
    assert len(numbers.chi2) == 3
    assert numbers.p == pytest.approx(3 * min(test.p for test in numbers.chi2))
    assert 1e-12 < numbers.p < 1


def test_pixels_that_noise_explains_move_nothing() -> None:
    # The corners differ by more than the limit, and by no more than they are known.
    loose = Quality(
        covariance=Covariance.from_matrix(NAMES, np.diag((STD * np.array([1] * 4 + [60] * 5)) ** 2))
    )
    a = replace(camera(), quality=loose)
    b = replace(changed(camera(), fx=3681.4, fy=3680.6), quality=loose)
    b = replace(b, distortion=replace(LENS, k1=LENS.k1 + 0.008))
    comparison = compare(a, b)
    assert comparison.numbers is not None
    assert comparison.numbers.difference.max_px > FLEET.drift_px > comparison.numbers.sure_px
