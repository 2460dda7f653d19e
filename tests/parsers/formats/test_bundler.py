"""Bundler's bundle.out, against its manual's formula written down here once more."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import MissingTagError, ParseError
from tests.parsers.samples import Sample

POSE = "1 0 0\n0 1 0\n0 0 1\n0.1 0.2 -0.3\n"
SIZE = (1200, 901)


def bundle(*cameras: str, heading: str = "# Bundle file v0.3", count: int | None = None) -> bytes:
    lines = "".join(f"{camera}\n{POSE}" for camera in cameras)
    count = len(cameras) if count is None else count
    return f"{heading}\n{count} 1\n{lines}1 2 3\n255 255 255\n1 0 12 1.5 -2.5\n".encode()


def decoded(data: bytes) -> Sequence[Calibration]:
    return parsers.decode(data, name="bundle.out", image_size=SIZE)


SAMPLES = {"bundler": Sample(bundle("6.8865481090e+02 -3.13e-02 5.19e-02"))}


def test_a_camera_projects_by_bundlers_own_formula() -> None:
    [item] = decoded(bundle("6.8865481090e+02 -3.13e-02 5.19e-02"))
    u, v = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.6, 0.6, 25))
    points = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    # Bundler's camera frame has y up and looks along -z.
    bundlers = points * [1, -1, -1]
    p = -bundlers[:, :2] / bundlers[:, 2:]
    n2 = (p**2).sum(axis=1, keepdims=True)
    seen = 6.8865481090e02 * (1 - 3.13e-02 * n2 + 5.19e-02 * n2**2) * p
    expected = np.stack([SIZE[0] / 2 + seen[:, 0], SIZE[1] / 2 - seen[:, 1]], axis=1)
    np.testing.assert_allclose(item.project(points), expected, rtol=0, atol=1e-9)
    assert item.grade is Grade.ADJUSTED
    assert "middle of the image" in item.provenance.assumptions[0]


def test_images_with_the_same_numbers_are_one_camera_and_unplaced_ones_none() -> None:
    found = decoded(bundle("700 -0.01 0", "0 0 0", "701 0 0", "700 -0.01 0"))
    assert [item.camera.sub_camera for item in found] == ["image 0", "image 2"]
    assert found[0].distortion == BrownConrady(k1=-0.01, k2=0, p1=0, p2=0)
    assert found[1].distortion == NoDistortion()
    assert [item.quality.views for item in found if item.quality] == [2, 1]


def test_names_come_from_the_list_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "bundle.out").write_bytes(bundle("700 0 0", "701 0 0"))
    listed = tmp_path / "list.txt"
    listed.write_text("left.jpg 0 700.1\nright.jpg\n")
    found = parsers.read(tmp_path / "bundle.out", image_size=SIZE)
    assert [item.camera.sub_camera for item in found] == ["left.jpg", "right.jpg"]
    listed.write_text("left.jpg\n")
    found = parsers.read(tmp_path / "bundle.out", image_size=SIZE)
    assert [item.camera.sub_camera for item in found] == ["image 0", "image 1"]


def test_without_a_size_it_asks_for_one() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(bundle("700 0 0"), name="bundle.out")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (bundle("700 0 0", heading="# Bundle file v9.9"), "9.9"),
        (bundle("700 0 0", count=0), "0 cameras"),
        (bundle("700 0 0", count=10**9), "cameras, expected"),
        (bundle("700 0"), "2 numbers, expected 3"),
        (bundle("700 nan 0"), "not finite"),
        (bundle("-700 0 0"), "focal length"),
        (bundle("0 0 0"), "no image of it was placed"),
        (bundle("700 0 0", count=40), "numbers, expected|ends before"),
        (b"# Bundle file v0.3\n1 1\n700 0 0\n1 0 0\n0 1 0\n0 0 1\n0.1 0.2", "2 numbers.*not ended"),
    ],
)
def test_a_broken_file_names_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        decoded(data)
