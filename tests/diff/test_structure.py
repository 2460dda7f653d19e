from __future__ import annotations

from dataclasses import replace

import pytest

from calibrary.calibration import Calibration
from calibrary.diff.structure import Kind, signatures
from calibrary.distortion import BrownConrady, NoDistortion
from tests.diff.cameras import LENS, camera, changed


def kinds(a: Calibration, b: Calibration) -> set[Kind]:
    return {structural.kind for structural in signatures(a, b)}


@pytest.mark.parametrize(
    "drift", [{}, {"fx": 3682.6, "fy": 3681.8}, {"cx": 2733.1}, {"cx": 2732.0, "cy": 1846.9}, {"fx": 3690.0}]
)
def test_a_camera_that_drifted_is_of_the_same_kind(drift: dict[str, float]) -> None:
    assert kinds(camera(), changed(camera(), **drift)) == set()


def test_a_frame_of_half_the_size_was_resampled() -> None:
    assert kinds(camera(), camera(size=(2736, 1824))) == {Kind.RESIZE}


@pytest.mark.parametrize("box", [(0, 285, 5472, 3078), (816, 544, 3840, 2560)])
def test_a_smaller_frame_with_the_same_focal_length_was_cropped(box: tuple[int, int, int, int]) -> None:
    assert kinds(camera(), camera().cropped(box)) == {Kind.CROP}


def test_a_crop_that_was_resampled_as_well_is_a_crop() -> None:
    assert kinds(camera(), camera().cropped((0, 285, 5472, 3078)).scaled((3840, 2160))) == {Kind.CROP}


def test_a_later_frame_that_shows_more_of_the_sensor_is_a_crop_of_the_earlier() -> None:
    assert kinds(camera().cropped((0, 285, 5472, 3078)), camera()) == {Kind.CROP}


def test_another_part_of_the_sensor_in_a_frame_of_the_same_size_is_a_crop() -> None:
    assert kinds(camera(), changed(camera(), fx=3678.9 * 1.16, fy=3678.1 * 1.16)) == {Kind.CROP}


def test_a_frame_on_end_is_a_portrait_and_nothing_else() -> None:
    turned = changed(camera(), image_size=(3648, 5472), cx=1846.8, cy=2731.5)  # type: ignore[arg-type]  # a size
    assert kinds(camera(), turned) == {Kind.PORTRAIT}


@pytest.mark.parametrize("lens", [NoDistortion(), BrownConrady(k1=1e-7, k2=0, p1=0, p2=0, k3=0)])
def test_a_lens_whose_distortion_is_gone_is_corrected_in_the_camera(
    lens: NoDistortion | BrownConrady,
) -> None:
    assert kinds(camera(), camera(distortion=lens)) == {Kind.DEWARP_ON}
    assert kinds(camera(distortion=lens), camera()) == {Kind.DEWARP_OFF}


def test_a_distortion_nobody_knows_is_not_a_distortion_that_is_gone() -> None:
    assert kinds(camera(), camera(distortion=None)) == set()


def test_a_principal_point_half_a_pixel_off_both_ways_is_counted_from_elsewhere() -> None:
    assert kinds(camera(), changed(camera(), cx=2731.0, cy=1846.3)) == {Kind.HALF_PIXEL}


def test_half_a_pixel_one_way_only_is_no_convention() -> None:
    assert kinds(camera(), changed(camera(), cx=2731.0)) == set()
    assert kinds(camera(), changed(camera(), cx=2731.0, cy=1847.3)) == set()


def test_tangential_terms_that_changed_places_are_named() -> None:
    assert kinds(camera(), camera(distortion=replace(LENS, p1=LENS.p2, p2=LENS.p1))) == {Kind.TANGENTIAL_SWAP}


def test_radial_terms_with_their_signs_turned_are_named() -> None:
    assert kinds(camera(), camera(distortion=replace(LENS, k1=0.27, k2=-0.05))) == {Kind.DIRECTION}


@pytest.mark.parametrize("focal35_mm", [24.0, 25.0])
def test_a_35_mm_equivalent_taken_for_the_focal_length_is_recognised(focal35_mm: float) -> None:
    leaked = focal35_mm / 8.8
    assert kinds(camera(), changed(camera(), fx=3678.9 * leaked, fy=3678.1 * leaked)) == {
        Kind.EQUIVALENT_LEAK
    }


def test_the_earlier_one_may_be_the_one_that_leaked() -> None:
    leaked = changed(camera(focal_mm=24.0), fx=3678.9 * 24 / 8.8, fy=3678.1 * 24 / 8.8)
    assert kinds(leaked, camera()) == {Kind.EQUIVALENT_LEAK}


def test_pixels_that_are_square_no_more_were_transcoded() -> None:
    assert kinds(camera(), changed(camera(), fy=3678.1 * 4 / 3)) == {Kind.STRETCH}


def test_the_reason_holds_the_numbers() -> None:
    (structural,) = signatures(camera(), camera(size=(2736, 1824)))
    assert (
        structural.reason == "5472×3648 became 2736×1824 and fx went with it, × 0.5: the frame was resampled"
    )
