"""What a rendered frame states of its camera, as the camera's own software would."""

from __future__ import annotations

import pytest

from calibrary.calib.synthesis.cameras import example_camera, head
from calibrary.records import replace


@pytest.mark.parametrize(
    ("make", "sub_camera", "said"),
    [
        ("DJI", "wide", "WideCamera"),
        ("dji", "thermal", "InfraredCamera"),
        ("DJI", None, None),
        ("Parrot", "wide", None),
        (None, "wide", None),
    ],
)
def test_dji_alone_names_the_camera_of_several_in_one_drone(
    make: str | None, sub_camera: str | None, said: str | None
) -> None:
    unit = example_camera(1)
    xmp = head(replace(unit, camera=replace(unit.camera, make=make, sub_camera=sub_camera)), None, 0).xmp
    assert (xmp is None) is (said is None)
    assert said is None or f'ImageSource="{said}"'.encode() in (xmp or b"")


def test_frames_follow_one_another_by_four_seconds() -> None:
    times = [head(example_camera(1), None, number).exif["DateTimeOriginal"] for number in (0, 1, 15)]
    assert times == ["2024:05:17 09:30:12", "2024:05:17 09:30:16", "2024:05:17 09:31:12"]
