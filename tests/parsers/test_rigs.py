"""Files of rigs: each says the same poses as its own program, and what is written is read again."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from numpy.typing import NDArray

from calibrary.calib.synthesis.cameras import example_camera
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers.rigs import RIG_FORMATS, encode_rig, format_of_name, read_rig
from calibrary.parsers.rigs.micasense import relatives_of, rotation_of_relatives
from calibrary.records import replace
from calibrary.rig import Rig, RigCamera, RigPose
from calibrary.rotations import rotation_matrix


def lens(seed: int) -> Calibration:
    """A camera that every format of a rig can hold."""
    camera = example_camera(seed)
    return replace(camera, distortion=BrownConrady(k1=-0.1, k2=0.02, p1=1e-4, p2=-2e-4, k3=0.0))


def pose(seed: int) -> RigPose:
    random = np.random.default_rng(seed)
    return RigPose.of(rotation_matrix(random.normal(0, 0.3, 3)), random.normal(0, 150, 3))


def rig(count: int) -> Rig:
    first = RigCamera(name="cam0", calibration=lens(1))
    return Rig(
        cameras=(
            first,
            *(RigCamera(name=f"cam{at}", pose=pose(at), calibration=lens(at + 1)) for at in range(1, count)),
        )
    )


NAMES = {
    "kalibr": ("camchain.yaml", 3),
    "opencv": ("extrinsics.yml", 2),
    "colmap": ("rig_config.json", 3),
    "micasense": ("micasense.json", 3),
}


@pytest.mark.parametrize("form", RIG_FORMATS)
def test_what_is_written_is_read_again(form: str, tmp_path: Path) -> None:
    name, count = NAMES[form]
    given, path = rig(count), tmp_path / name
    assert format_of_name(name) == form
    path.write_bytes(encode_rig(given, form, name))
    back = read_rig(path)
    assert len(back.cameras) == count
    for one, other in zip(given.cameras[1:], back.cameras[1:], strict=True):
        assert one.pose is not None
        assert other.pose is not None
        assert other.pose.rotation == pytest.approx(one.pose.rotation, abs=1e-9)
        assert other.pose.translation == pytest.approx(one.pose.translation, abs=1e-6)
    if form in {"kalibr", "opencv"}:
        for one, other in zip(given.cameras, back.cameras, strict=True):
            assert one.calibration is not None
            assert other.calibration is not None
            assert other.calibration.intrinsics.fx == pytest.approx(one.calibration.intrinsics.fx)
            assert other.calibration.intrinsics.cx == pytest.approx(one.calibration.intrinsics.cx)


def test_opencv_reads_the_stereo_file_as_its_own(tmp_path: Path) -> None:
    given = rig(2)
    path = tmp_path / "stereo.yml"
    path.write_bytes(encode_rig(given, "opencv", path.name))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    second = given.cameras[1]
    assert second.pose is not None
    assert second.calibration is not None
    assert storage.getNode("R").mat() == pytest.approx(second.pose.rotation)
    assert storage.getNode("T").mat().ravel() == pytest.approx(second.pose.translation)
    K, D = second.calibration.to_opencv()
    assert storage.getNode("M2").mat() == pytest.approx(K)
    assert D is not None
    assert storage.getNode("D2").mat().ravel() == pytest.approx(np.ravel(D))


def test_the_two_files_of_opencvs_sample_are_read_as_one_rig(tmp_path: Path) -> None:
    R, T = cv2.Rodrigues(np.array([0.01, -0.02, 0.03]))[0], np.array([[-83.2], [0.4], [1.1]])
    inside = cv2.FileStorage(str(tmp_path / "intrinsics.yml"), cv2.FILE_STORAGE_WRITE)
    K = np.array([[533.0, 0, 341], [0, 533, 235], [0, 0, 1]])
    for name, value in (("M1", K), ("D1", np.zeros((1, 5))), ("M2", K), ("D2", np.zeros((1, 5)))):
        inside.write(name, value)
    inside.release()
    outside = cv2.FileStorage(str(tmp_path / "extrinsics.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (("R", R), ("T", T), ("Q", np.eye(4))):
        outside.write(name, value)
    outside.release()
    second = read_rig(tmp_path / "extrinsics.yml").cameras[1]
    assert second.pose is not None
    assert second.pose.rotation == pytest.approx(R)
    assert second.pose.translation == pytest.approx(T.ravel())


def test_colmap_reads_the_configuration_as_its_own(tmp_path: Path) -> None:
    given = rig(3)
    path = tmp_path / "rig_config.json"
    path.write_bytes(encode_rig(given, "colmap", path.name))
    [found] = pycolmap.read_rig_config(path)
    for one, theirs in zip(given.cameras, found.cameras, strict=True):
        assert theirs.image_prefix == f"{one.name}/"
        assert theirs.ref_sensor is (one.pose is None)
        if one.pose is not None:
            assert theirs.cam_from_rig is not None
            assert theirs.cam_from_rig.rotation.matrix() == pytest.approx(one.pose.rotation, abs=1e-9)
            assert theirs.cam_from_rig.translation == pytest.approx(one.pose.translation / 1000)


def test_kalibrs_chain_goes_from_each_camera_to_the_next() -> None:
    given = rig(3)
    chain = yaml.safe_load(encode_rig(given, "kalibr", "camchain.yaml"))
    steps = [np.array(chain[f"cam{at}"]["T_cn_cnm1"]) for at in (1, 2)]
    whole = steps[1] @ steps[0]
    last = given.cameras[2].pose
    assert last is not None
    assert whole[:3, :3] == pytest.approx(last.rotation)
    assert whole[:3, 3] == pytest.approx(last.translation / 1000)
    assert "T_cn_cnm1" not in chain["cam0"]


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (np.eye(3), "four rows of four"),
        (np.diag([1.0, 1.0, 1.01, 1.0]), "not a rotation"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "not a rotation"),
    ],
)
def test_a_step_of_kalibrs_chain_that_is_no_pose_is_refused(
    tmp_path: Path, step: NDArray[np.float64], message: str
) -> None:
    chain = yaml.safe_load(encode_rig(rig(2), "kalibr", "camchain.yaml"))
    chain["cam1"]["T_cn_cnm1"] = step.tolist()
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(chain))
    with pytest.raises(ParseError, match=message):
        read_rig(tmp_path / "camchain.yaml")


def test_rig_relatives_are_the_turn_into_the_reference_band() -> None:
    # As micasense/imageprocessing composes them: Rx·Ry·Rz of degrees.
    about = [
        cv2.Rodrigues(np.radians(angle) * np.eye(3)[at])[0] for at, angle in enumerate((-0.13, 0.27, 0.055))
    ]
    expected = about[0] @ about[1] @ about[2]
    assert rotation_of_relatives(("-0.130000,0.270000,0.055000",)) == pytest.approx(expected)
    assert rotation_of_relatives(("-0.13", "0.27", "0.055")) == pytest.approx(expected)
    assert relatives_of(expected) == pytest.approx((-0.13, 0.27, 0.055))


@pytest.mark.parametrize("values", [("0.1, 0.2",), ("a, b, c",), ("nan, 0, 0",)])
def test_rig_relatives_that_are_none_are_refused(values: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="three angles"):
        rotation_of_relatives(values)


def test_micasenses_own_json_counts_pixels_from_the_first_ones_centre() -> None:
    given = rig(2)
    document = json.loads(encode_rig(given, "micasense", "x.json"))
    assert given.cameras[1].calibration is not None
    assert document["1"]["cx"] == pytest.approx(given.cameras[1].calibration.intrinsics.cx - 0.5)
    assert document["0"]["rig_relatives"] == pytest.approx([0, 0, 0])


def test_a_pair_is_all_that_opencvs_file_holds() -> None:
    with pytest.raises(UnsupportedModelError, match="two cameras"):
        encode_rig(rig(3), "opencv", "x.yml")


def test_a_lens_that_kalibr_has_not_is_refused() -> None:
    given = rig(2)
    first = replace(given.cameras[0], calibration=example_camera(1))
    with pytest.raises(UnsupportedModelError):
        encode_rig(replace(given, cameras=(first, given.cameras[1])), "kalibr", "camchain.yaml")


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("notes.txt", "no rig at all", InputError),
        ("rig_config.json", '[{"cameras": [{"image_prefix": "a/"}]}]', ParseError),
        ("rig_config.json", '[{"image_prefix": 1}]', ParseError),
        ("extrinsics.yml", "%YAML:1.0\n---\nR: [1, 0, 0, 0, 1, 0, 0, 0, 2]\nT: [0, 0, 1]\n", ParseError),
        ("camchain.yaml", "cam0: {camera_model: pinhole}\ncam1: {T_cn_cnm1: 3}\n", ParseError),
    ],
)  # fmt: skip
def test_a_broken_file_is_an_error_that_names_it(
    name: str, text: str, kind: type[Exception], tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(kind, match=name):
        read_rig(path)


def test_a_rig_has_one_reference() -> None:
    with pytest.raises(InputError, match="one reference"):
        Rig(cameras=(RigCamera(name="a"), RigCamera(name="b")))
    with pytest.raises(InputError, match="twice"):
        Rig(cameras=(RigCamera(name="a"), RigCamera(name="a", pose=pose(1))))


def test_a_pose_before_another_camera_than_the_reference() -> None:
    given = rig(3)
    R, t = given.pose("cam2", before="cam1")
    R1, t1 = given.pose("cam1")
    R2, t2 = given.pose("cam2")
    point = np.array([30.0, -20.0, 900.0])
    assert R @ (R1 @ point + t1) + t == pytest.approx(R2 @ point + t2)
