"""Pix4D's camera database: millimetres over micrometres, from the corner."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Grade
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

CAMERA = """<camera name="{name}">
<imageWidth>5472</imageWidth><imageHeight>3648</imageHeight><pixelSize>2.41</pixelSize>
<principalPointXmm>6.61</principalPointXmm><principalPointYmm>4.38</principalPointYmm>
<lensType>{lens}</lensType><focalLengthmm>8.81</focalLengthmm><distortion>5</distortion>
<radialK1>-0.013</radialK1><radialK2>0.021</radialK2><radialK3>-0.017</radialK3>
<tangentialT1>0.0004</tangentialT1><tangentialT2>-0.0003</tangentialT2>
<cameraModelSource>internalDB</cameraModelSource>
</camera>
"""


def camera(name: str = "A_8.8_5472x3648", lens: str = "perspective") -> str:
    return CAMERA.format(name=name, lens=lens)


def database(*cameras: str) -> bytes:
    return f"<cameraModelDB><version>19</version><cameras>{''.join(cameras)}</cameras></cameraModelDB>\n".encode()


SAMPLES = {"pix4d_camera_database": Sample(database(camera()))}


def test_lengths_are_millimetres_from_the_corner() -> None:
    [item] = parsers.decode(camera().encode(), name="camera.xml")
    x, y = 0.31, -0.22
    r2 = x * x + y * y
    radial = 1 - 0.013 * r2 + 0.021 * r2**2 - 0.017 * r2**3
    seen = [
        x * radial + 2 * 0.0004 * x * y - 0.0003 * (r2 + 2 * x * x),
        y * radial + 0.0004 * (r2 + 2 * y * y) + 2 * -0.0003 * x * y,
    ]
    expected = (8.81 * np.array(seen) + [6.61, 4.38]) / 2.41e-3
    np.testing.assert_allclose(item.project(np.array([[x, y, 1.0]]))[0], expected, rtol=0, atol=1e-9)
    assert item.grade is Grade.DESIGN


def test_the_cameras_of_a_database_are_read_by_name() -> None:
    cameras = parsers.decode(database(camera("A"), camera("B")), name="camera_database.xml")
    assert [item.camera.sub_camera for item in cameras] == ["A", "B"]


def test_a_fisheye_and_a_pixel_without_size_are_refused() -> None:
    with pytest.raises(UnsupportedModelError, match=r"'fisheye'.*expected perspective"):
        parsers.decode(camera(lens="fisheye").encode(), name="camera.xml")
    with pytest.raises(ParseError, match="pixels of 0 micrometres"):
        parsers.decode(camera().replace("2.41", "0").encode(), name="camera.xml")
