"""Files that are recognised and refused: each is named for what it is, with what to do instead."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnknownFormatError, UnsupportedModelError
from calibrary.parsers.content import Content
from calibrary.parsers.discovery import format_named
from calibrary.parsers.refused import REFUSED
from tests.parsers.samples import Sample

LADYBUG = """\
camera_model=Ladybug5 LD5
camera_serialBase=1
camera0_rotX=-2.1
camera0_FocalLen=457.3
camera0_CameraCenterX=1234.7
"""
CASES = [
    *(
        (
            "opf_document",
            f'{{"format": "application/opf-{kind}+json", "version": "1.0"}}',
            r"OPF document.*calibrated_cameras\.json",
        )
        for kind in ("camera-list", "projected-input-cameras")
    ),
    *(
        (
            "cahvor",
            f"# a comment\nDimensions = 1024 768\nModel = {model} = perspective\nC = 0 0 0\nA = 0 0 1\n",
            "mrcal-from-cahvor",
        )
        for model in ("CAHV", "CAHVOR", "CAHVORE")
    ),
    ("calcam_cal", "CalCam calibration\n1 2 3\n", "export Agisoft XML"),
    ("ladybug_cal", LADYBUG, "Ladybug SDK"),
    ("ladybug_cal", LADYBUG.partition("\n")[2], "Ladybug SDK"),
    ("ladybug_cal", "Triclops 3.2 configuration\n\n0 1 2\n", "Ladybug SDK"),
    (
        "image_pro_cal",
        "[SPATIAL]\r\nCalibName=Lens 4x\r\nUnitName=um\r\nPixPerUnit=1.3,1.3\r\n",
        r"Image-Pro.*board",
    ),
    ("image_pro_cal", "[INTENSITY]\nImageClass=1\nName=Grey\nInputRange=0,255\n", r"Image-Pro.*board"),
    ("ptgui_project", "# ptGui project file\np w1000 h500\n", "Hugin"),
    ("ptgui_project", '{"contenttype": "x", "project": {"globallenses": [{}]}}', "Hugin"),
    ("python_pickle", "\x80\x04\x95\x0b\0\0\0\0\0\0\0}\x94\x8c\x03mtx\x94K\x01s.", "numpy.savez"),
    (
        "calibrary_document",
        '{"schema": "calibrary/truth-1", "calibration": {"K": [], "distortion": {}}}',
        "calibrary calibrate",
    ),
    (
        "ale_isd",
        '{"name_model": "USGS_ASTRO_FRAME_SENSOR_MODEL", "focal2pixel_lines": [0, 0, 200], "focal_length_model": {}}',
        "cam_gen",
    ),
    (
        "svo_settings",
        "max_fts: 180\nmax_n_kfs: 10\nquality_min_fts: 40\nmap_scale: 1.5\nuse_imu: True\n",
        "calib_name",
    ),
    ("sensor_cal", "accel_bias = 0.01 0.02 -0.01\ngyro_bias = 0.001 0 0\n", "geometric calibration"),
    ("sensor_cal", "[MAG]\nmag_offset_x: 12\nmag_offset_y: -3\n", "geometric calibration"),
    ("sensor_cal", "dark_current 113\nradiance_gain 0.013\nirradiance_gain 0.2\n", "geometric calibration"),
    ("sensor_cal", 'CAL    \n\nDESCRIPTOR "Argyll"\nDEVICE_CLASS "DISPLAY"\n', "geometric calibration"),
]
SAMPLES = {name: Sample(text.encode("latin-1")) for name, text, _ in reversed(CASES)}


def test_every_row_has_a_case() -> None:
    assert {record.name for record in REFUSED} == SAMPLES.keys()


@pytest.mark.parametrize(("name", "text", "message"), CASES)
def test_it_is_recognised_and_refused_with_what_to_do(name: str, text: str, message: str) -> None:
    data = text.encode("latin-1")
    with pytest.raises(UnsupportedModelError, match=message):
        parsers.decode(data, name="x.cal")
    with pytest.raises(UnsupportedModelError, match=message):
        parsers.decode(data, name="x.cal", format=name)
    claim = format_named(name).sniff(Content(data, "x.cal"))
    assert claim is not None
    assert claim.reason


@pytest.mark.parametrize(
    "text",
    [
        "notes\nseen with a ladybug\n",
        "one\ntwo\nthree\nfour\nfive\nsix of CalCam\n",
        "[SPATIAL]\nreference = here\n",
        "gyro_bias = 0.001\n",
        "K_nirL: 800 0 320\ngyro: 0.1\nimu: 0.2\n",
        '<document dbat_script_version="1.0"><cameras><camera><sensor>36 24</sensor></camera></cameras></document>',
        "accel_noise: 0.01\ngyro_noise: 0.02\nintrinsics: see below\n",
    ],
    ids=[
        "a word farther down",
        "a name farther down",
        "a section alone",
        "one key",
        "MS2's cameras",
        "DBAT's project",
        "a rig with a lens",
    ],
)
def test_what_only_resembles_one_is_not_claimed(text: str) -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(text.encode(), name="x.cal")
