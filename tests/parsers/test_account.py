"""What a file states of a lens is used, or the distortion is unknown and the key is named: never silently none."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.format import LOST_LENS
from tests.parsers.mutants import LOST, mutated
from tests.thorough import examples

K = {"fl_x": 1000.5, "fl_y": 1001.5, "cx": 640.5, "cy": 360.5, "w": 1280, "h": 720}
TRANSFORMS = {"camera_model": "OPENCV", **K, "frames": []}
ROWS = [[1000.5, 0.0, 640.5], [0.0, 1001.5, 360.5], [0.0, 0.0, 1.0]]
ROS = """\
image_width: 1280
image_height: 720
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [1000.5, 0, 640.5, 0, 1001.5, 360.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1131, 0.0247, 0.0002, -0.0004, 0]}
"""


def read(data: bytes | str | object, name: str = "camera.json") -> Sequence[Calibration]:
    if not isinstance(data, bytes | str):
        data = json.dumps(data)
    return parsers.decode(data.encode() if isinstance(data, str) else data, name=name, image_size=(1280, 720))


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"distortion_model": "equidistant", "D": [-0.1131, 0.0247, 0.0002, -0.0004]}, "'D' (-0.1131"),
        ({"distortion": {"radial_terms": [-0.1131, 0.0247]}}, "'distortion.radial_terms'"),
        ({"warp": [-0.1131, 0.0247, 0.0002, -0.0004]}, "'warp'"),
        ({"lens_model": "fisheye"}, "'lens_model' (fisheye)"),
    ],
)
def test_a_lens_in_other_words_makes_the_distortion_unknown_and_is_named(more: object, named: str) -> None:
    assert isinstance(more, dict)
    [item] = read({**TRANSFORMS, **more})
    assert item.distortion is None
    assert any("not understood" in note and named in note for note in item.notes)


@pytest.mark.parametrize(
    "more",
    [
        {"distortion_params": "-0.1131, 0.0247, 0.0002, -0.0004"},
        {"camera_calibration": {"dist_coefs": [[-0.1131, 0.0247, 0.0002, -0.0004]]}},
    ],
)
def test_a_lens_in_words_of_people_is_read(more: object) -> None:
    assert isinstance(more, dict)
    [item] = read({**TRANSFORMS, **more})
    assert item.distortion == BrownConrady(k1=-0.1131, k2=0.0247, p1=0.0002, p2=-0.0004)


@pytest.mark.parametrize(
    "more",
    [
        {"D": [0.0, 0.0, 0.0, 0.0]},
        {"k1_std": 0.0123},
        {"distortion_error": 0.31},
        {"use_distortion": True},
        {"fix_k3": 1},
        {"undistorted": [0.1, 0.2, 0.3, 0.4]},
        {"rotation": [0.1, 0.2, 0.3, 0.4]},
        {"attitude": [0.5, 0.5, 0.5, 0.5]},
        {"axes": [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]},
        {"area": [0, 0, 640, 480]},
        {"lens": "Sigma 24 mm", "camera": "brownie"},
    ],
)
def test_what_is_no_geometry_changes_nothing(more: object) -> None:
    assert isinstance(more, dict)
    [item] = read({**TRANSFORMS, **more})
    assert item.distortion == NoDistortion()


def test_a_part_of_a_lens_beside_a_lens_is_refused_by_its_key() -> None:
    with pytest.raises(
        ParseError, match=r"'K3' \(0\.02\).*could be a part of the lens.*expected k1, k2, p1, p2, k3"
    ):
        read({**TRANSFORMS, "k1": -0.1131, "k2": 0.0247, "K3": 0.02})
    with pytest.raises(ParseError, match="radial_distortion_extra"):
        read(ROS + "radial_distortion_extra: [0.0123]\n", "camera.yaml")


def test_a_misspelt_coefficient_beside_others_is_refused() -> None:
    with pytest.raises(ParseError, match="'kk3'"):
        read({**TRANSFORMS, "k1": -0.1131, "k2": 0.0247, "kk3": 0.02})


def test_a_number_is_used_if_changing_it_changes_what_is_read() -> None:
    xml = """<calibration><projection>frame</projection><width>1280</width><height>720</height><f>1000.5</f>
      <cx>0.5</cx><cy>0.5</cy><k1>-0.1131</k1>{}<date>2024-05-17T00:00:00Z</date></calibration>"""
    [item] = read(xml.format("<b1>1.5</b1>"), "camera.xml")
    assert item.distortion is not None
    with pytest.raises(ParseError, match="radial"):
        read(xml.format("<radial><c4>0.0021</c4></radial>"), "camera.xml")


@pytest.mark.parametrize("key", ["k1_px", "K1", "my_k1", "distortion_vector"])
def test_a_number_is_not_used_because_another_is_equal(key: str) -> None:
    xml = (
        "<calibration><projection>frame</projection><width>1280</width><height>720</height><f>1000.5</f><cx>0.5</cx>"
        f"<cy>0.5</cy><{key}>0.1</{key}><k2>-0.1</k2><k3>0.01</k3><p1>0.01</p1><p2>-0.01</p2></calibration>"
    )
    with pytest.raises(ParseError, match=key):
        read(xml, "camera.xml")


def test_a_model_under_a_key_of_coefficients_counts() -> None:
    [item] = read(ROS.replace("distortion_model: plumb_bob", "distortion_vector: equidistant"), "camera.yaml")
    assert isinstance(item.distortion, KannalaBrandt)


def test_the_name_of_another_lens_that_contains_the_name_of_the_one_read_counts() -> None:
    xml = (
        "<opencv_storage><camera_type>inverse_brown_conrady</camera_type>"
        "<image_width>1280</image_width><image_height>720</image_height>"
        '<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>'
        "<data>1000.5 0. 640.5 0. 1001.5 360.5 0. 0. 1.</data></camera_matrix>"
        '<distortion_coefficients type_id="opencv-matrix"><rows>1</rows><cols>4</cols><dt>d</dt>'
        "<data>-0.1131 0.0247 0.0002 -0.0004</data></distortion_coefficients></opencv_storage>"
    )
    with pytest.raises(UnsupportedModelError, match=r"camera_type.*inverse_brown_conrady"):
        read(xml, "camera.xml")


def test_arrays_under_other_names_are_named() -> None:
    buffer = io.BytesIO()
    np.savez(
        buffer, mtx=np.array(ROWS), lens_distortion_vec=np.array([-0.1131, 0.0247, 0.0002, -0.0004, 0.0])
    )
    [item] = read(buffer.getvalue(), "camera.npz")
    assert item.distortion is None
    assert any("lens_distortion_vec" in note for note in item.notes)


def test_a_text_of_keys_and_values_is_accounted_for_as_well() -> None:
    sheet = "image size: 1280 x 720\nfx_px = 1000.5\nfy_px = 1001.5\ncx_px = 640.5\ncy_px = 360.5\n{}\n"
    [item] = read(sheet.format("lens warp = 0.1131 0.0247 0.0002 0.0004"), "sheet.txt")
    assert item.distortion is None
    assert any("lens warp" in note for note in item.notes)


def test_of_several_cameras_the_one_with_a_lens_keeps_it() -> None:
    document = {
        "cam0": {"K": ROWS, "dist": [-0.1131, 0.0247, 0.0002, -0.0004, 0.0], "image_size": [1280, 720]},
        "cam1": {
            "K": ROWS,
            "dist": [0.0],
            "warp": [-0.1131, 0.0247, 0.0002, -0.0004, 0.1],
            "image_size": [1280, 720],
        },
    }
    with pytest.raises(ParseError):
        read(document)
    document["cam1"]["dist"] = [0.0] * 5
    first, second = read(document)
    assert first.distortion is not None
    assert second.distortion is None


def test_the_document_is_as_it_was_after_the_account() -> None:
    document = {**TRANSFORMS, "lens_model": "fisheye", "warp": [0.1, 0.2, 0.3, 0.4]}
    once, twice = read(document), read(document)
    assert once == twice
    assert dict(once[0].extras)["transforms_json/warp"] == "[0.1, 0.2, 0.3, 0.4]"


def test_no_file_of_any_format_loses_its_lens_by_a_changed_key_or_value() -> None:
    found = list(mutated(examples(150), seed=2024))
    assert {outcome for _, _, outcome in found} >= {"refused", "the same", "unknown, named"}
    assert [(name, what) for name, what, outcome in found if outcome == LOST] == []


STATED = "distortion: {k1: -0.1131, k2: 0.0247, p1: 0.0002, p2: -0.0004}\n"


@pytest.mark.parametrize(
    "more",
    [
        STATED,
        "distortion_vector: [-0.1131, 0.0247, 0.0002, -0.0004, 0.0]\n",
        "radial: [-0.1131, 0.0247]\ntangential: [0.0002, -0.0004]\n",
        "distortion_vector: [-0.11310004, 0.02470003, 0.0002, -0.0004, 0.0]\n",
        "imu: {k1: 0.0123, distortion: [0.1, 0.2]}\n",
        "board: {k1: 0.0123, dx: 30.5}\n",
        "dX_1: 30.5\n",
        "estimationErrors: {radialDistortion: [0.0123, 0.0031]}\n",
    ],
)
def test_what_states_the_lens_again_or_is_of_something_else_changes_nothing(more: str) -> None:
    assert read(ROS + more, "camera.yaml")[0].distortion == read(ROS, "camera.yaml")[0].distortion


@pytest.mark.parametrize(
    "more",
    [
        STATED.replace("0.0247", "0.0248"),
        STATED.replace("k2", "my_k2").replace("0.0247", "0.0248"),
        "radial: [-0.1131, -0.0247]\n",
    ],
)
def test_what_states_another_lens_is_refused(more: str) -> None:
    with pytest.raises(ParseError, match="could be a part of the lens"):
        read(ROS + more, "camera.yaml")


def test_the_remedy_for_a_name_of_another_lens_is_to_state_the_model() -> None:
    with pytest.raises(ParseError, match=r"camera_model.*read as brown; state the model where ROS"):
        read(ROS + "camera_model: fisheye\n", "camera.yaml")


def test_projections_and_camera_matrices_beside_k_are_no_lens() -> None:
    more = {"P": [[900.5, 0.0, 640.5, 0.0], [0.0, 900.5, 360.5, 0.0], [0.0, 0.0, 1.0, 0.0]]}
    [item] = read(
        {**TRANSFORMS, "warped": more["P"], "new_mtx": [[900.5, 0, 640.5], [0, 900.5, 360.5], [0, 0, 1]]}
    )
    assert item.distortion == NoDistortion()


def test_a_lens_that_was_not_understood_is_written_as_none_only_on_request() -> None:
    cameras = read({**TRANSFORMS, "warp": [-0.1131, 0.0247, 0.0002, -0.0004]})
    with pytest.raises(UnsupportedModelError, match=r"'warp' \(-0\.1131 .*would be lost.*--drop-distortion"):
        parsers.encode(cameras, "colmap_text")
    _, verdict = parsers.encode(cameras, "colmap_text", drop_distortion=True)
    assert LOST_LENS in verdict.dropped
    assert str(verdict).startswith("K only")
