from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.calibration import Calibration, Covariance, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.jobs.diff.causes import causes
from calibrary.jobs.diff.frames import common_frame
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.records import replace
from tests.jobs.diff.cameras import LENS, camera, changed
from tests.thorough import examples


def causes_of(a: Calibration, b: Calibration) -> tuple[Structural, ...]:
    return causes(a, b, common_frame(a, b))


def kinds(a: Calibration, b: Calibration) -> set[Kind]:
    return {structural.kind for structural in causes_of(a, b)}


def test_a_later_frame_that_shows_more_of_the_sensor_is_a_crop_of_the_earlier() -> None:
    assert kinds(camera().cropped((0, 285, 5472, 3078)), camera()) == {Kind.CROP}


def test_a_distortion_that_is_gone_while_k_stayed_was_lost_by_a_file() -> None:
    assert kinds(camera(), camera(distortion=NoDistortion())) == {Kind.DISTORTION_LOST}
    assert kinds(camera(distortion=NoDistortion()), camera()) == {Kind.DISTORTION_LOST}
    image = replace(camera(distortion=NoDistortion()), provenance=Provenance(kind="image-metadata"))
    assert kinds(camera(), image) == {Kind.DEWARP_ON}


def test_half_a_pixel_one_way_only_is_no_convention() -> None:
    assert kinds(camera(), changed(camera(), cx=2731.0)) == set()
    assert kinds(camera(), changed(camera(), cx=2731.0, cy=1847.3)) == set()


def test_the_earlier_one_may_be_the_one_that_leaked() -> None:
    leaked = changed(camera(focal_mm=24.0), fx=3678.9 * 24 / 8.8, fy=3678.1 * 24 / 8.8)
    assert kinds(leaked, camera()) == {Kind.EQUIVALENT_LEAK}


def anamorphic(**numbers: float) -> Calibration:
    """The same camera with pixels half as wide again as they are high."""
    return changed(camera(), **{"fy": 3678.1 * 1.5, **numbers})


@pytest.mark.parametrize("drift", [{}, {"fx": 3682.6, "fy": 3681.8 * 1.5}, {"cx": 2733.1}])
def test_pixels_that_never_were_square_are_no_change(drift: dict[str, float]) -> None:
    assert kinds(anamorphic(), anamorphic(**drift)) == set()
    assert kinds(anamorphic(), anamorphic().scaled((2736, 1824))) == {Kind.RESIZE}
    assert kinds(anamorphic(), anamorphic().cropped((816, 544, 3840, 2560))) == {Kind.CROP}


def test_pixels_that_change_from_one_shape_to_another_were_transcoded() -> None:
    (structural,) = causes_of(anamorphic(), anamorphic(fy=3678.1 * 1.2))
    assert structural.kind is Kind.STRETCH
    assert structural.reason.startswith("fx / fy was 0.6668 and is 0.8335: ")
    assert kinds(anamorphic(), camera()) == kinds(camera(), anamorphic()) == {Kind.STRETCH}


def test_both_focal_lengths_have_to_stay_for_half_a_pixel_to_be_a_convention() -> None:
    half = {"cx": 2731.0, "cy": 1846.3}
    assert kinds(anamorphic(), anamorphic(**half)) == {Kind.HALF_PIXEL}
    assert kinds(anamorphic(), anamorphic(**half, fx=3678.9 * 1.0003)) == set()
    assert kinds(anamorphic(), anamorphic(**half, fy=3678.1 * 1.5 * 1.0003)) == set()


def test_a_35_mm_equivalent_is_recognised_by_the_sensors_width_not_by_its_height() -> None:
    # 8.8 mm over fx is a sensor 13.09 mm wide, 5.82 mm high by fy; over fy it would be 8.73 mm wide.
    leaked = 36 / (8.8 * 5472 / 3678.9)
    (structural,) = causes_of(anamorphic(), anamorphic(fx=3678.9 * leaked, fy=3678.1 * 1.5 * leaked))
    assert structural.kind is Kind.EQUIVALENT_LEAK
    assert "a sensor 13.1 mm wide" in structural.reason


def test_what_a_lens_bends_is_counted_in_pixels_across_and_down() -> None:
    # The corner farthest from the centre, by OpenCV's own inverse of the distortion.
    K = anamorphic().intrinsics
    matrix, D = K.matrix, np.array(list(LENS.coefficients.values()))
    corners = np.array([[x, y] for x in (0.0, 5472.0) for y in (0.0, 3648.0)])
    patient = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-15)
    straight = cv2.undistortImagePoints(corners[:, None], matrix, D, None, patient)[:, 0]
    bend_px = float(np.hypot(*(np.asarray(straight, dtype=np.float64) - corners).T).max())
    (structural,) = causes_of(anamorphic(), replace(anamorphic(fx=3677.2), distortion=NoDistortion()))
    assert structural.reason.startswith(f"a lens that bends the frame by {bend_px:.1f} px has ")


STD = {"fx": 0.4, "fy": 0.4, "cx": 0.3, "cy": 0.3, "k1": 2e-4, "k2": 6e-4, "p1": 8e-6, "p2": 8e-6, "k3": 6e-4}


def measured(calibration: Calibration, seed: int, poorer: float = 1.0) -> Calibration:
    """As a board would show it: with noise, and the standard deviations of it."""
    std = {name: poorer * value for name, value in STD.items()}
    error = dict(zip(std, np.random.default_rng(seed).normal(0, list(std.values())), strict=True))
    K, lens = calibration.intrinsics, calibration.distortion
    values = (
        dict.fromkeys(LENS.names(), 0.0)
        if lens is None or isinstance(lens, NoDistortion)
        else lens.coefficients
    )
    return replace(
        changed(calibration, **{name: getattr(K, name) + error[name] for name in ("fx", "fy", "cx", "cy")}),
        distortion=BrownConrady(**{name: value + error[name] for name, value in values.items()}),
        quality=Quality(
            std=std, covariance=Covariance.from_matrix(tuple(std), np.diag(np.square(list(std.values()))))
        ),
    )


seeds = st.integers(0, 2**31)


@settings(max_examples=examples(10, 800), deadline=None)
@given(seeds, seeds, st.sampled_from([1.0, 3.0]))
def test_noise_is_no_change_of_kind(first: int, second: int, poorer: float) -> None:
    if first != second:
        assert kinds(measured(camera(), first, poorer), measured(camera(), second, poorer)) == set()


@settings(max_examples=examples(6, 480), deadline=None)
@given(st.integers(0, 400), st.floats(-0.004, 0.004), st.floats(-30, 30), st.floats(-30, 30))
def test_a_drift_of_any_direction_is_no_change_of_kind(seed: int, focal: float, dx: float, dy: float) -> None:
    K = camera().intrinsics
    moved = changed(camera(), fx=K.fx * (1 + focal), fy=K.fy * (1 + focal), cx=K.cx + dx, cy=K.cy + dy)
    assert kinds(measured(camera(), seed), measured(moved, seed + 1000)) == set()


@pytest.mark.parametrize("seed", range(examples(2)))
def test_a_corrected_lens_is_recognised_through_the_noise_of_its_calibration(seed: int) -> None:
    corrected = measured(camera(distortion=NoDistortion()), seed)
    assert kinds(measured(camera(), seed + 100), corrected) == {Kind.DEWARP_ON}
    assert kinds(corrected, measured(camera(), seed + 100)) == {Kind.DEWARP_OFF}


@pytest.mark.parametrize("poorer", [1.0, 10.0])
def test_swapped_tangential_terms_are_recognised_as_far_as_they_are_known(poorer: float) -> None:
    other = camera(distortion=replace(LENS, p1=LENS.p2, p2=LENS.p1))
    assert kinds(measured(camera(), 1, poorer), measured(other, 2, poorer)) == {Kind.TANGENTIAL_SWAP}


def test_a_turned_frame_swaps_its_tangential_terms_by_right() -> None:
    K = camera().intrinsics
    turned = replace(
        camera(distortion=replace(LENS, p1=0.0, p2=LENS.p1)),
        intrinsics=Intrinsics(fx=K.fy, fy=K.fx, cx=3648 - K.cy, cy=K.cx, image_size=(3648, 5472)),
    )
    assert kinds(camera(distortion=replace(LENS, p2=0.0)), turned) == {Kind.TURNED}


def test_half_a_pixel_between_two_solves_is_a_coincidence() -> None:
    assert kinds(camera(), changed(camera(), fx=3679.1, fy=3678.3, cx=2731.0, cy=1846.3)) == set()


def test_a_frame_squeezed_into_another_shape_was_transcoded() -> None:
    K = camera().intrinsics
    x, y = 3840 / 5472, 2160 / 3648
    squeezed = Intrinsics(fx=K.fx * x, fy=K.fy * y, cx=K.cx * x, cy=K.cy * y, image_size=(3840, 2160))
    assert kinds(camera(), replace(camera(), intrinsics=squeezed)) == {Kind.STRETCH}


def test_a_frame_of_another_shape_is_a_crop_though_correcting_it_moved_the_focal_length() -> None:
    wide = camera().cropped((0, 285, 5472, 3078)).scaled((3840, 2160))
    K = wide.intrinsics
    assert kinds(camera(), changed(wide, fx=K.fx * 0.975, fy=K.fy * 0.975)) == {Kind.CROP}


@pytest.mark.parametrize(("grade", "focal"), [(Grade.DERIVED, 1.03), (Grade.PRIOR, 0.92)])
def test_a_focal_length_from_tags_is_no_crop_for_being_as_far_off_as_tags_are(
    grade: Grade, focal: float
) -> None:
    K = camera().intrinsics
    tagged = replace(changed(camera(), fx=K.fx * focal, fy=K.fy * focal), grade=grade, distortion=None)
    assert kinds(camera(), tagged) == set()
    assert kinds(camera(), tagged.scaled((2736, 1824))) == {Kind.RESIZE}


@given(
    st.floats(3.0, 20.0), st.sampled_from([(13.2, 8.8), (6.3, 4.7), (17.3, 13.0), (9.6, 7.2)]), st.booleans()
)
def test_a_35_mm_equivalent_is_recognised_however_it_was_rounded(
    focal_mm: float, sensor_mm: tuple[float, float], by_width: bool
) -> None:
    width, height = 5472, round(5472 * sensor_mm[1] / sensor_mm[0])
    fx = focal_mm / sensor_mm[0] * width
    K = Intrinsics(fx=fx, fy=fx, cx=width / 2, cy=height / 2, image_size=(width, height))
    true = replace(camera(focal_mm=focal_mm), intrinsics=K, distortion=None)
    factor = 36 / sensor_mm[0] if by_width else float(np.hypot(36, 24) / np.hypot(*sensor_mm))
    leaked = fx * round(focal_mm * factor) / focal_mm
    assert Kind.EQUIVALENT_LEAK in kinds(true, changed(true, fx=leaked, fy=leaked))


def test_what_is_weighed_states_its_likelihood_and_the_evidence() -> None:
    other = camera(distortion=replace(LENS, p1=LENS.p2, p2=LENS.p1))
    (cause,) = causes_of(measured(camera(), 1), measured(other, 2))
    assert cause.likelihood == pytest.approx(1.0)
    assert cause.reason.startswith("p1 and p2 changed places: then A and B agree within σ (χ² ")


def test_causes_that_explain_every_number_alike_are_all_named() -> None:
    one = camera(distortion=replace(LENS, p1=0.0, p2=0.0))
    K = one.intrinsics
    (cause,) = causes_of(one, changed(one, cx=5472 - K.cx, cy=3648 - K.cy))
    assert (cause.kind, cause.likelihood) == (Kind.TURNED, 0.5)
    assert cause.reason.endswith("the frame was turned by 180°; or both count from the opposite corner")


def test_no_map_is_named_where_the_measured_noise_explains_the_difference() -> None:
    weak = camera(distortion=replace(LENS, p1=2e-5, p2=-2e-5))
    other = camera(distortion=replace(LENS, p1=-2e-5, p2=2e-5))
    assert kinds(measured(weak, 1, 10.0), measured(other, 2, 10.0)) == set()
