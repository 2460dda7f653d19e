"""A tag's frame is brought to the file's by a scale, a centred 1:1 crop, or not at all."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calibration import Intrinsics
from calibrary.errors import FrameError
from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.readings import usual
from calibrary.records import replace
from tests.strategies import calibration

FULL = Intrinsics(fx=3660.0, fy=3655.0, cx=2731.5, cy=1846.75, image_size=(5472, 3648))


def test_the_same_frame_is_left_alone() -> None:
    adapted = usual(FULL, ImageMetadata(size=(5472, 3648)))
    assert adapted.intrinsics == FULL
    assert adapted.steps == ()


def test_the_same_aspect_is_a_scale() -> None:
    K = usual(FULL, ImageMetadata(size=(1368, 912))).intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (3660.0 / 4, 3655.0 / 4, 2731.5 / 4, 1846.75 / 4)


def test_less_width_at_the_same_height_is_a_centred_crop_that_keeps_the_focal_length() -> None:
    adapted = usual(FULL, ImageMetadata(size=(4864, 3648)))
    K = adapted.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (3660.0, 3655.0, 2731.5 - (5472 - 4864) / 2, 1846.75)
    assert "the crop is centred" in adapted.assumes


@pytest.mark.parametrize(
    ("size", "cropped"), [((5470, 3000), True), ((5469, 3000), False), ((5474, 3000), False)]
)
def test_a_side_may_be_two_pixels_short_for_the_codecs_blocks_and_no_more(
    size: tuple[int, int], cropped: bool
) -> None:
    if cropped:
        K = usual(FULL, ImageMetadata(size=size)).intrinsics
        assert (K.fx, K.cx, K.cy) == (3660.0, 2731.5 - 1, 1846.75 - 324)
    else:
        with pytest.raises(FrameError, match="register the camera at this size"):
            usual(FULL, ImageMetadata(size=size))


def test_exifs_frame_stands_between_a_crop_and_a_scale() -> None:
    sensor = Intrinsics(fx=2378.5, fy=2378.5, cx=2029.2, cy=1520.3, image_size=(4056, 3040))
    K = usual(sensor, ImageMetadata(size=(1500, 844), exif_size=(4056, 2282))).intrinsics
    assert K.fx == pytest.approx(2378.5 * 1500 / 4056)
    assert K.cy == pytest.approx((1520.3 - 379) * 844 / 2282)


@pytest.mark.parametrize(
    ("size", "whole", "part"), [((3840, 2160), 2568.4, 3660.0), ((512, 512), 513.7, 3660.0)]
)
def test_what_would_stretch_k_is_refused_with_what_it_would_be_of_either_part(
    size: tuple[int, int], whole: float, part: float
) -> None:
    with pytest.raises(FrameError, match="which part of its 5472×3648") as refused:
        usual(FULL, ImageMetadata(size=size))
    assert f"fx = {whole} px if" in str(refused.value)
    assert f"fx = {part} px if" in str(refused.value)


def test_of_what_is_larger_than_the_frame_no_part_is_offered() -> None:
    with pytest.raises(FrameError, match="no part of 5472×3648 is 9000×3000"):
        usual(FULL, ImageMetadata(size=(9000, 3000)))


def test_a_zoomed_frame_of_full_size_was_enlarged_about_its_middle() -> None:
    adapted = usual(FULL, ImageMetadata(size=(5472, 3648), digital_zoom=2.0))
    K = adapted.intrinsics
    assert (K.fx, K.fy) == (7320.0, 7310.0)
    assert (K.cx, K.cy) == (2736 + 2 * (2731.5 - 2736), 1824 + 2 * (1846.75 - 1824))
    assert K.image_size == (5472, 3648)
    assert any("zoom" in step for step in adapted.steps)


def test_a_zoomed_frame_of_the_zoomed_size_was_cropped_one_to_one() -> None:
    K = usual(FULL, ImageMetadata(size=(2736, 1824), digital_zoom=2.0)).intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (3660.0, 3655.0, 2731.5 - 1368, 1846.75 - 912)
    assert K.image_size == (2736, 1824)


@pytest.mark.parametrize("size", [(2736, 3648), (5472, 1824)])
def test_a_frame_that_is_short_by_the_zoom_one_way_only_was_enlarged_and_then_cropped(
    size: tuple[int, int],
) -> None:
    adapted = usual(FULL, ImageMetadata(size=size, digital_zoom=2.0))
    assert (adapted.intrinsics.fx, adapted.intrinsics.fy) == (7320.0, 7310.0)
    assert len(adapted.steps) == 2


def test_what_a_zoom_enlarges_is_seen_where_the_unzoomed_frame_shows_it() -> None:
    # A ray that the full frame shows at p is shown by the enlarged one at middle + zoom·(p − middle), skew and all.
    zoom = 1.6
    whole = calibration(replace(FULL, skew=3.5), None)
    zoomed = usual(whole.intrinsics, ImageMetadata(size=(5472, 3648), digital_zoom=zoom)).intrinsics
    rays = np.array([[0.11, -0.07, 1.0], [-0.2, 0.13, 1.0], [0.0, 0.0, 1.0]])
    middle = np.array([2736.0, 1824.0])
    expected = middle + zoom * (whole.project(rays) - middle)
    np.testing.assert_allclose(calibration(zoomed, None).project(rays), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("size", "exif_size"), [((8, 8), (4000, 3000)), ((16, 16), (1280, 720))])
def test_exif_of_another_frame_is_a_contradiction(size: tuple[int, int], exif_size: tuple[int, int]) -> None:
    contradiction = exif_contradiction(ImageMetadata(size=size, exif_size=exif_size))
    assert contradiction is not None
    assert f"{exif_size[0]}×{exif_size[1]}" in contradiction


@pytest.mark.parametrize(
    ("size", "exif_size"),
    [((640, 512), (1280, 1024)), ((40, 30), (4864, 3648)), ((4000, 2250), (4000, 3000))],
)
def test_a_resized_or_cropped_file_does_not_contradict_its_exif(
    size: tuple[int, int], exif_size: tuple[int, int]
) -> None:
    assert exif_contradiction(ImageMetadata(size=size, exif_size=exif_size)) is None


@pytest.mark.parametrize(
    ("size", "exif_size"),
    [((3648, 5472), None), ((3648, 5472), (5472, 3648)), ((1824, 2736), None)],
)
def test_fx_and_fy_are_exchanged_where_the_image_is_turned(
    size: tuple[int, int], exif_size: tuple[int, int] | None
) -> None:
    metadata = ImageMetadata(size=size, exif_size=exif_size)
    adapted = usual(FULL, metadata)
    by = size[1] / 5472
    K = adapted.intrinsics
    assert (K.fx, K.fy) == (3655.0 * by, 3660.0 * by)
    assert (K.cx, K.cy) == (size[0] / 2, size[1] / 2)
    assert adapted.assumes[-1].startswith("which way the image was turned is not stated")
    assert exif_contradiction(metadata) is None


def test_a_turned_mode_of_the_camera_is_cropped_and_turned() -> None:
    adapted = usual(FULL, ImageMetadata(size=(3078, 5472)))
    assert adapted.intrinsics.image_size == (3078, 5472)
    assert adapted.intrinsics.fx == 3655.0
    assert len(adapted.steps) == 2
