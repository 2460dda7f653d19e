"""A K of another image size has every reading that the two sizes allow, each with what it takes for granted."""

from __future__ import annotations

import pytest

from calibrary.calibration import Intrinsics
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.readings import CENTRED, NOTHING_CUT, TURNED, Prior, Reading, readings

FULL = Intrinsics(fx=3660.0, fy=3655.0, cx=2731.5, cy=1846.75, image_size=(5472, 3648))


def read(size: tuple[int, int]) -> list[tuple[float, Prior]]:
    return [(round(one.intrinsics.fx, 1), one.prior) for one in readings(FULL, ImageMetadata(size=size))]


def only(size: tuple[int, int]) -> Reading:
    [one] = readings(FULL, ImageMetadata(size=size))
    return one


def test_the_same_size_is_the_same_frame() -> None:
    assert only((5472, 3648)) == Reading(intrinsics=FULL, prior=Prior.CERTAIN)


@pytest.mark.parametrize("share", [0.9, 0.8, 0.75])
def test_a_smaller_frame_of_the_same_shape_was_scaled_or_cut(share: float) -> None:
    width = round(5472 * share)
    scaled, cut = readings(FULL, ImageMetadata(size=(width, round(3648 * share))))
    assert scaled.intrinsics.fx == pytest.approx(3660.0 * share, rel=1e-3)
    assert cut.intrinsics.fx == 3660.0
    assert (scaled.assumes, cut.assumes) == ((NOTHING_CUT,), (CENTRED,))
    assert {scaled.prior, cut.prior} == {Prior.POSSIBLE}


def test_a_whole_factor_is_usually_a_scale() -> None:
    assert read((2736, 1824)) == [(1830.0, Prior.USUAL), (3660.0, Prior.POSSIBLE)]


def test_a_smaller_crop_may_have_been_joined_as_well() -> None:
    assert read((2462, 1642)) == [
        (1646.7, Prior.POSSIBLE),
        (3660.0, Prior.POSSIBLE),
        (1830.0, Prior.POSSIBLE),
    ]


def test_a_thumbnail_that_shows_the_whole_frame_leaves_no_doubt() -> None:
    metadata = ImageMetadata(size=(4924, 3282), exif_size=(5472, 3648), whole_frame=True)
    first, *_ = readings(FULL, metadata)
    assert (first.prior, first.is_scaled, first.assumes) == (Prior.CERTAIN, True, ())


def test_the_whole_width_at_less_height_is_usually_a_crop() -> None:
    first, *_ = readings(FULL, ImageMetadata(size=(5472, 3078)))
    K = first.intrinsics
    assert (K.fx, K.cx, K.cy) == (3660.0, 2731.5, 1846.75 - 285)
    assert (first.prior, first.assumes) == (Prior.USUAL, (CENTRED,))


def test_of_a_turned_image_the_principal_point_is_in_the_middle() -> None:
    one = only((3648, 5472))
    K = one.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (3655.0, 3660.0, 1824.0, 2736.0)
    assert (one.prior, one.assumes) == (Prior.USUAL, (TURNED,))


def test_no_part_of_a_frame_is_larger_than_it_at_another_shape() -> None:
    assert [one.is_cut for one in readings(FULL, ImageMetadata(size=(6000, 3000)))] == [False]
