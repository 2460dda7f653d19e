"""Which images are of one camera."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.extract.cameras import group_cameras
from calibrary.jobs.images.accumulator import undated
from calibrary.records import replace
from tests.evidence.scenes import micasense, p4_rtk, xmp
from tests.jobs.extract.fleet import KNOWLEDGE, judged

BASE = replace(p4_rtk(), serial="5f1d0c7a9be24d3c", lens="8.8 mm f/2.8")


def groups(*states: ImageMetadata) -> list[int]:
    """How many states each camera has."""
    named = {state: [f"{number}.jpg"] for number, state in enumerate(states)}
    return [len(group) for group in group_cameras(undated(named), KNOWLEDGE).values()]


def m3t(focal_mm: float, size: tuple[int, int], source: str | None) -> ImageMetadata:
    tags = xmp("drone-dji", ImageSource=source) if source is not None else ()
    return ImageMetadata(size=size, make="DJI", model="M3T", focal_mm=focal_mm, xmp=tags, has_exif=True)


def test_one_model_is_two_cameras_when_a_tag_says_wide_and_thermal() -> None:
    states = (m3t(4.4, (8000, 6000), "WideCamera"), m3t(9.1, (640, 512), "InfraredCamera"))
    assert groups(*states) == [1, 1]


def test_the_bands_of_one_head_are_cameras_of_their_own() -> None:
    assert groups(micasense("5.44"), micasense("5.44", band="Green")) == [1, 1]


@pytest.mark.parametrize(
    "other",
    [
        {"serial": "00ab34cd56ef7890"},
        {"focal_mm": 10.2},
        {"lens": "another lens"},
        {"digital_zoom": 2.0},
        {"size": (4864, 3648), "exif_size": None},
        {"make": "Hasselblad"},
        {"xmp": xmp("drone-dji", DewarpFlag="1")},
    ],
    ids=["serial", "focal length", "lens", "digital zoom", "frame", "make", "dewarped in the camera"],
)
def test_equal_model_is_not_one_camera_when_this_differs(other: dict[str, Any]) -> None:
    assert groups(BASE, replace(BASE, **other)) == [1, 1]


@pytest.mark.parametrize(
    "other",
    [
        {"software": "v01.10.0000"},
        {"focal_35mm": None},
        {"orientation": 8},
        {"digital_zoom": 1.0},
        {"focal_mm": 8.8004},
        {"xmp": ()},
    ],
    ids=["firmware", "35 mm equivalent", "orientation", "no zoom", "rounding", "XMP lost on the way"],
)
def test_an_equal_key_is_one_camera_though_this_differs(other: dict[str, Any]) -> None:
    assert groups(BASE, replace(BASE, **other)) == [2]


def test_an_image_without_its_sub_camera_tag_joins_the_camera_it_must_be_of() -> None:
    assert groups(m3t(9.1, (640, 512), "InfraredCamera"), m3t(9.1, (640, 512), None)) == [2]


def test_the_firmware_is_told_where_all_images_agree_on_it() -> None:
    [camera] = judged({BASE: ["a.jpg"], replace(BASE, orientation=8): ["b.jpg"]})
    assert camera.calibration is not None
    assert camera.calibration.camera.firmware == "v01.09.1691"
    [camera] = judged({BASE: ["a.jpg"], replace(BASE, software="v2"): ["b.jpg"]})
    assert camera.calibration is not None
    assert camera.calibration.camera.firmware is None


def test_the_state_with_most_images_stands_first() -> None:
    rare, common = replace(BASE, orientation=8), BASE
    [group] = group_cameras(undated({rare: ["a.jpg"], common: ["b.jpg", "c.jpg"]}), KNOWLEDGE).values()
    assert [state.metadata for state in group] == [common, rare]


STATES = st.builds(
    replace,
    st.just(BASE),
    serial=st.sampled_from([None, "a" * 16, "b" * 16]),
    focal_mm=st.sampled_from([None, 8.8, 10.2]),
    digital_zoom=st.sampled_from([None, 2.0]),
    software=st.sampled_from(["v1", "v2"]),
    orientation=st.sampled_from([1, 6, 8]),
)


@given(st.lists(STATES, unique=True, min_size=1, max_size=12))
def test_every_image_is_of_exactly_one_camera_and_each_camera_has_one_key(
    states: list[ImageMetadata],
) -> None:
    named = {state: [f"{number}.jpg"] for number, state in enumerate(states)}
    cameras = group_cameras(undated(named), KNOWLEDGE)
    images = [name for group in cameras.values() for state in group for name in state.names]
    assert sorted(images) == sorted(name for names in named.values() for name in names)
    for key, group in cameras.items():
        assert {(s.metadata.serial, s.metadata.focal_mm) for s in group} == {(key.serial, key.focal_mm)}
        assert {s.metadata.digital_zoom is not None for s in group} == {key.capture_mode is not None}
