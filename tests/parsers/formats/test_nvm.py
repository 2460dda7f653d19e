"""VisualSFM's .nvm, against its documentation's formula written down here once more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import InverseBrown, NoDistortion
from calibrary.errors import MissingTagError, ParseError
from tests.parsers.samples import Sample

SIZE = (1600, 1063)
POSE = "-0.03 -0.21 0.12 0.97 738.038 -6.17 -41.84"
TAIL = "\n1\n769.6 14.6 19.7 64 57 51 1 0 333 980.9 247.7\n"


def nvm(*cameras: str, heading: str = "NVM_V3 ", count: int | None = None) -> bytes:
    rows = "".join(f"{camera}\n" for camera in cameras)
    return f"{heading}\n\n{len(cameras) if count is None else count}\n{rows}{TAIL}".encode()


def image(name: str = "db/1.jpg", f: str = "1084.59", r: str = "0.0811") -> str:
    return f"{name} {f} {POSE} {r} 0"


def decoded(data: bytes) -> Sequence[Calibration]:
    return parsers.decode(data, name="a.nvm", image_size=SIZE)


SAMPLES = {"nvm": Sample(nvm(image()))}


def test_the_measured_point_is_corrected_by_visualsfms_own_formula() -> None:
    [item] = decoded(nvm(image()))
    u, v = np.meshgrid(np.linspace(30.0, 1570.0, 25), np.linspace(20.0, 1040.0, 25))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    m = (pixels - [SIZE[0] / 2, SIZE[1] / 2]) / 1084.59
    ideal = (1 + 0.0811 * (m**2).sum(axis=1, keepdims=True)) * m
    expected = np.column_stack([ideal, np.ones(len(ideal))])
    back = item.project(expected)
    np.testing.assert_allclose(back, pixels, rtol=0, atol=1e-9)
    rays = item.unproject(pixels)
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:], ideal, rtol=0, atol=1e-13)
    assert item.distortion == InverseBrown(k1=0.0811, k2=0, p1=0, p2=0)
    assert item.grade is Grade.ADJUSTED


def test_images_with_the_same_numbers_are_one_camera() -> None:
    found = decoded(nvm(image("a.jpg"), image('with"space.jpg', "1556.98", "0"), image("c.jpg")))
    assert [item.camera.sub_camera for item in found] == ["a.jpg", "with space.jpg"]
    assert [item.quality.views for item in found if item.quality] == [2, 1]
    assert found[1].distortion == NoDistortion()


def test_a_name_may_hold_spaces_and_a_rotation_nine_numbers() -> None:
    nine = "1 0 0 0 1 0 0 0 1 0.1 0.2 0.3"
    [item] = decoded(nvm(f"my images/1.jpg 1084.59 {nine} 0.0811 0", heading="NVM_V3_R9T"))
    assert item.provenance.tag == "my images/1.jpg"
    assert item.intrinsics.fx == 1084.59


def test_fixedk_gives_one_k_to_all_images() -> None:
    [item] = decoded(nvm(image("a"), image("b"), heading="NVM_V3 FixedK 1084.6 801.3 1083.2 530.9"))
    K = item.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (1084.6, 1083.2, 801.3, 530.9)
    assert "FixedK" in item.notes[0]


def test_without_a_size_it_asks_for_one() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(nvm(image()), name="a.nvm")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (nvm(image(), heading="NVM_V3 FreeK"), "FixedK or nothing"),
        (nvm(image(), heading="NVM_V3 FixedK 1 2 3"), "3 numbers, expected 4 or 5"),
        (nvm(image(), count=0), "0 cameras"),
        (nvm(image(), count=10**8), "cameras, expected"),
        (nvm("a.jpg 1084.59 0 0"), "expected a name and 10"),
        (nvm(image(f="x")), "not a number"),
        (nvm(image(f="0")), "focal length"),
        (nvm(image(), count=2), "expected a name and 10"),
        (nvm(image())[:40], "cut short"),
    ],
)
def test_a_broken_file_names_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        decoded(data)
