"""stella_vslam's settings, against OpenCV, which the program itself hands its cameras to."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Division, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.cameras import camera
from tests.parsers.peers import assert_projects_as_opencv

FILE = """# a monocular model
Camera:
  name: "our monocular"
  setup: "monocular"
  model: "perspective"

  fx: 433.2
  fy: 432.9
  cx: 371.6
  cy: 238.3

  k1: -0.2131
  k2: 4.47e-02
  p1: -0.00037
  p2: 8.1e-04
  k3: 0.0062

  fps: 20.0
  cols: 752
  rows: 480

  color_order: "Gray"

Feature:
  scale_factor: 1.2
"""
FLAT = "%YAML:1.0\n" + "".join(f"Camera.{line.strip()}\n" for line in FILE.splitlines()[2:20] if line.strip())
FISHEYE = (
    FILE.replace("perspective", "fisheye")
    .replace("p1: -0.00037", "k3: -0.0019")
    .replace("p2: 8.1e-04", "k4: -0.0006")
    .replace("  k3: 0.0062\n", "")
)


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="euroc.yaml")
    return calibration


@pytest.mark.parametrize("text", [FILE, FLAT])
def test_perspective_is_opencvs_first_five(text: str) -> None:
    assert_projects_as_opencv(
        read(text), (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062)
    )
    assert read(text).intrinsics.image_size == (752, 480)


def test_fisheye_is_opencvs_fisheye() -> None:
    assert_projects_as_opencv(
        read(FISHEYE), (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.0019, -0.0006), fisheye=True
    )


def test_radial_division_undistorts_as_the_program_does() -> None:
    item = read(FILE.replace("perspective", "radial_division").replace("k1: -0.2131", "distortion: -0.11"))
    x, y = 0.31, -0.22
    u, v = item.project(
        np.array([[x / (1 - 0.11 * (x * x + y * y)), y / (1 - 0.11 * (x * x + y * y)), 1.0]])
    )[0]
    assert (u, v) == pytest.approx((433.2 * x + 371.6 + 0.5, 432.9 * y + 238.3 + 0.5), abs=1e-9)


def test_a_panorama_is_refused_with_the_reason() -> None:
    with pytest.raises(UnsupportedModelError, match="each pixel an angle"):
        read(FILE.replace("perspective", "equirectangular"))
    with pytest.raises(UnsupportedModelError, match=r"no K describes them$"):
        read(FILE.replace("perspective", "equirectangular").rstrip("\n"))
    with pytest.raises(UnsupportedModelError, match="radial_division"):
        read(FILE.replace("perspective", "omni"))


def test_what_the_program_needs_is_written_and_comes_back() -> None:
    data, verdict = parsers.encode([camera(Division(k=-0.05))], "stella_vslam", name="camera.yaml")
    text = data.decode()
    assert '  setup: "monocular"\n' in text
    assert '  model: "radial_division"\n' in text
    assert "  fps: 30.0\n" in text
    assert verdict.dropped == ()
    again, _ = parsers.encode([read(FILE)], "stella_vslam", name="camera.yaml")
    assert '  color_order: "Gray"\n' in again.decode()
    assert read(again.decode()).distortion == read(FILE).distortion


@pytest.mark.parametrize("lens", [NoDistortion(), BrownConrady(k1=0.1, k2=0.0, p1=0.0, p2=0.0)])
def test_every_perspective_has_all_five(lens: NoDistortion | BrownConrady) -> None:
    data, _ = parsers.encode([camera(lens)], "stella_vslam", name="camera.yaml")
    assert data.decode().count("  k3: 0.0\n") == 1


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("  cols: 752\n", "", "no 'cols'"),
        ("  k3: 0.0062\n", "", "no 'k3'"),
        ("433.2", "-433.2", "focal"),
        ("rows: 480", "rows: 480.5", "image size"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        parsers.decode(FILE.replace(old, new).encode(), name="x", format="stella_vslam")
