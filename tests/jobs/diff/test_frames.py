from __future__ import annotations

import numpy as np
import pytest

from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.jobs.diff.frames import check_units, common_frame
from calibrary.jobs.diff.verdicts import Kind
from tests.jobs.diff.cameras import camera, changed


def same(a: Calibration, b: Calibration) -> None:
    assert a.intrinsics.image_size == b.intrinsics.image_size
    np.testing.assert_allclose(a.intrinsics.matrix, b.intrinsics.matrix, rtol=1e-12)


def test_equal_frames_are_left_alone() -> None:
    assert common_frame(camera(), camera()).steps == ()


@pytest.mark.parametrize(
    ("later", "steps"),
    [
        (camera(size=(2736, 1824)), ("A scaled 5472×3648 → 2736×1824",)),
        (camera().cropped((0, 285, 5472, 3078)), ("A cropped 5472×3648 → 5472×3078 about its centre",)),
        (camera().cropped((816, 544, 3840, 2560)), ("A cropped 5472×3648 → 3840×2560 about its centre",)),
        (
            camera().cropped((0, 285, 5472, 3078)).scaled((3840, 2160)),
            ("A cropped 5472×3648 → 5472×3078 about its centre", "scaled to 3840×2160"),
        ),
    ],
)
def test_one_camera_is_itself_again_in_the_frame_of_its_mode(
    later: Calibration, steps: tuple[str, ...]
) -> None:
    frame = common_frame(camera(), later)
    assert frame.steps == steps
    same(frame.a, frame.b)
    back = common_frame(later, camera())
    assert back.steps == (steps[0].replace("A", "B", 1), *steps[1:])
    same(back.a, back.b)


def test_a_part_off_the_middle_is_compared_where_its_principal_point_puts_it() -> None:
    later = camera().cropped((1472, 648, 4000, 3000))
    frame = common_frame(camera(), later)
    assert frame.steps == ("A cropped 5472×3648 → 4000×3000 at (1472, 648)",)
    same(frame.a, frame.b)


def test_a_part_whose_principal_point_moved_by_less_than_its_noise_is_of_the_middle() -> None:
    later = camera().cropped((0, 285, 5472, 3078))
    frame = common_frame(camera(), changed(later, cy=later.intrinsics.cy + 2.0))
    assert frame.steps == ("A cropped 5472×3648 → 5472×3078 about its centre",)


def test_a_frame_turned_by_90_degrees_has_no_frame_in_common() -> None:
    turned = changed(camera(), image_size=(3648, 5472))  # type: ignore[arg-type]  # a size
    frame = common_frame(camera(), turned)
    assert frame.cause is not None
    assert (frame.cause.kind, frame.is_common) == (Kind.TURNED, False)


@pytest.mark.parametrize(
    ("cx", "guess"), [(0.0, "the unit is unknown"), (6.6, "in millimetres of a sensor 13.2 mm wide")]
)
def test_where_both_focal_lengths_are_no_pixels_the_principal_point_tells_the_unit(
    cx: float, guess: str
) -> None:
    small = changed(camera(), fx=8.8, fy=8.8, cx=cx, cy=cx)
    with pytest.raises(InputError, match=guess):
        check_units(small, small)
