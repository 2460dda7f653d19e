"""kapture's sensors, whose models are COLMAP's: against COLMAP itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pycolmap
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import KannalaBrandt
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera

FILE = """# kapture format: 1.1
# sensor_id, name, sensor_type, [sensor_params]+
front, the front one, camera, OPENCV, 752, 480, 433.2, 432.9, 371.6, 238.3, -0.2131, 0.0447, -0.00037, 0.00081
imu0, , imu
rear, , camera, SIMPLE_RADIAL, 640, 512, 402.5, 320, 256, -0.03
phone, , camera, UNKNOWN_CAMERA, 640, 512
"""


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="sensors.txt")


def test_the_cameras_project_as_colmaps() -> None:
    rays = np.array([[0.3, -0.2, 1.0], [-0.4, 0.1, 1.0], [0.0, 0.0, 1.0]])
    front, rear = read(FILE)
    for item, model, params in (
        (front, "OPENCV", [433.2, 432.9, 371.6, 238.3, -0.2131, 0.0447, -0.00037, 0.00081]),
        (rear, "SIMPLE_RADIAL", [402.5, 320, 256, -0.03]),
    ):
        width, height = item.intrinsics.image_size
        peer = pycolmap.Camera(model=model, width=width, height=height, params=params)
        np.testing.assert_allclose(item.project(rays), peer.img_from_cam(rays), rtol=0, atol=1e-9)


def test_cameras_have_their_ids_and_those_without_k_are_named() -> None:
    assert [item.camera.sub_camera for item in read(FILE)] == ["front", "rear"]
    assert [item.provenance.tag for item in read(FILE)] == ["front", "rear"]
    assert "UNKNOWN_CAMERA" in read(FILE)[0].notes[0]
    with pytest.raises(UnsupportedModelError, match="no K"):
        read(
            "".join(
                line + "\n"
                for line in FILE.splitlines()
                if "K," not in line and "RADIAL" not in line and "OPENCV" not in line
            )
        )


def test_what_is_written_is_kaptures() -> None:
    lens = KannalaBrandt(k1=-0.0292, k2=0.0208, k3=-0.0319, k4=0.0166)
    item = replace(camera(lens), camera=replace(camera().camera, sub_camera="front, left"))
    data, verdict = parsers.encode([item], "kapture", name="sensors.txt")
    lines = data.decode().splitlines()
    assert lines[0] == "# kapture format: 1.1"
    assert lines[2].startswith(f"cam1, , camera, OPENCV_FISHEYE, {SIZE[0]}, {SIZE[1]}, 3650.1, ")
    assert verdict.dropped == ("sub camera",)


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("OPENCV,", "EUCM,", UnsupportedModelError, "EUCM"),
        (", 0.00081", "", ParseError, "7 parameters, expected 8"),
        ("433.2", "wide", ParseError, "'wide' is not a number"),
        ("rear,", "front,", ParseError, "duplicate sensor_id"),
        ("752, 480", "752, 0", ParseError, "image size"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(FILE.replace(old, new))


def test_a_file_that_counts_from_the_pixels_centre_is_noted_and_read_on_request() -> None:
    text = b"# kapture format: 1.1\n# sensor_id, name, sensor_type, [sensor_params]+\n"
    text += b"cam0, , camera, PINHOLE, 1920, 1080, 1371, 1371, 959.5, 539.5\n"
    [item] = parsers.decode(text, name="sensors.txt")
    assert (item.intrinsics.cx, item.intrinsics.cy) == (959.5, 539.5)
    assert any("--pixel-origin centre" in note for note in item.notes)
    [item] = parsers.decode(text, name="sensors.txt", options={"origin": "centre"})
    assert (item.intrinsics.cx, item.intrinsics.cy) == (960, 540)
    assert not any("origin" in note for note in item.notes)
