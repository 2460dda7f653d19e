"""Other sensors' calibrations are known and refused, and no camera is taken for one."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnknownFormatError, UnsupportedModelError
from calibrary.parsers.content import Content
from calibrary.parsers.formats.sensor_cal import sniff
from tests.parsers.samples import Sample

SAMPLES = {"sensor_cal": Sample(b"accel_bias = 0.01 0.02 -0.01\ngyro_bias = 0.001 0 0\n")}


@pytest.mark.parametrize(
    "text",
    [
        "accel_bias = 0.01 0.02 -0.01\ngyro_bias = 0.001 0 0\n",
        "[MAG]\nmag_offset_x: 12\nmag_offset_y: -3\n",
        "dark_current 113\nradiance_gain 0.013\nirradiance_gain 0.2\n",
        'CAL    \n\nDESCRIPTOR "Argyll"\nDEVICE_CLASS "DISPLAY"\n',
    ],
    ids=["imu", "magnetometer", "radiometric", "display"],
)
def test_it_is_no_lens(text: str) -> None:
    with pytest.raises(UnsupportedModelError, match="geometric calibration"):
        parsers.decode(text.encode(), name="x.cal")


def test_one_word_is_not_enough() -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(b"gyro_bias = 0.001\n", name="x.cal")


def test_a_rig_of_camera_and_inertial_unit_is_not_claimed() -> None:
    text = b"accel_noise: 0.01\ngyro_noise: 0.02\nfocal_length_px: 1104\n"
    assert sniff(Content(text, "x.cal")) is None
