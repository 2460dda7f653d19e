"""OpenCV storage files as they are written, and broken ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import CameraKey, Grade
from calibrary.distortion import (
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera
from tests.parsers.formats.opencv_storages import D14, K_CV, READ, SYNTAXES, YAML, by_opencv, read


def test_a_matrix_without_coefficients_leaves_the_lens_unknown() -> None:
    [calibration] = read(by_opencv(".xml", image_width=5472, image_height=3648, camera_matrix=K_CV))
    assert calibration.distortion is None


def test_coefficients_without_their_matrix_are_refused() -> None:
    with pytest.raises(ParseError, match="D2: there is no camera matrix beside"):
        read(by_opencv(".yml", M1=K_CV, D1=np.zeros(5), D2=np.zeros(5)), image_size=SIZE)


def test_coefficients_that_are_all_zero_are_no_distortion() -> None:
    data = by_opencv(
        ".json", image_width=9, image_height=9, camera_matrix=K_CV, distortion_coefficients=np.zeros(8)
    )
    assert read(data)[0].distortion == NoDistortion()


@pytest.mark.parametrize("suffix", SYNTAXES)
def test_opencv_opens_a_file_that_carries_the_points_of_its_views(suffix: str, tmp_path: Path) -> None:
    points = np.arange(24, dtype=np.float32).reshape(4, 3, 2)
    data = by_opencv(
        suffix,
        image_width=5472,
        image_height=3648,
        camera_matrix=K_CV,
        distortion_coefficients=D14[:5],
        image_points=points,
    )
    path = tmp_path / f"again{suffix}"
    parsers.write(read(data), path, "opencv_storage")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("image_points").mat(), points)
    np.testing.assert_allclose(storage.getNode("camera_matrix").mat(), K_CV)


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        ("3650.1", "-3650.1", "focal lengths"),
        ("3650.1", ".Nan", "finite"),
        ("3650.1", "3650,1", "10 numbers"),
        ("0., 0., 1. ]", "0., 0., 2. ]", "not a camera matrix"),
        ("0., 0., 1. ]", "0., 0.1, 1. ]", "not a camera matrix"),
        ("cols: 3", "cols: 2", "header says"),
        ("dt: d", "dt: 2d", "one number each"),
        ("image_width: 5472", "image_width: 5472.5", "image size"),
        ("image_width: 5472", "image_width: 0", "image size"),
        ("!!opencv-matrix", "!!python/object", "a Python object"),
        ("image_height", "image_width", "image_width"),
    ],
)
def test_a_broken_file_names_what_is_wrong(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(YAML.replace(was, is_now).encode(), name="file", format="opencv_storage")


def test_a_message_names_the_file_and_the_key() -> None:
    with pytest.raises(ParseError) as caught:
        read(YAML.replace("3650.1,", "x,"))
    assert (caught.value.source, caught.value.place) == ("file", "camera_matrix.data[0]")


def test_skew_is_kept_with_a_word_about_opencv() -> None:
    [calibration] = read(YAML.replace("3650.1, 0.", "3650.1, 4.26"))
    assert calibration.intrinsics.skew == 4.26
    assert "projectPoints does not look at it" in calibration.notes[0]


def test_metashapes_spelling_is_mentioned() -> None:
    text = YAML.replace("camera_matrix", "Camera_Matrix").replace("image_width", "image_Width")
    assert "Metashape" in read(text)[0].notes[0]


def test_python_programs_nested_lists_are_read_and_said_to_be_guessed() -> None:
    [calibration] = read(
        '{"cameraMatrix": [[3650.1, 0, 2736.2], [0, 3649.8, 1824.7], [0, 0, 1]],'
        ' "distCoeffs": [[-0.0125, 0.0231, -0.0004, 0.0008, -0.0172]], "image_size": [5472, 3648]}'
    )
    assert calibration == replace(
        read(YAML)[0],
        provenance=calibration.provenance,
        notes=calibration.notes,
    )
    assert "the file does not say where cx and cy count from" in calibration.notes[0]


@pytest.mark.parametrize("suffix", SYNTAXES)
def test_what_else_the_file_says_survives_in_every_syntax(suffix: str) -> None:
    data = by_opencv(
        suffix,
        remark='Tue "8" Oct <10:53> & on',
        flags=2,
        square_size=0.025,
        image_width=5472,
        image_height=3648,
        names=("a b", "c"),
        extrinsic_parameters=np.arange(12.0).reshape(2, 6) / 3,
        camera_matrix=K_CV,
        distortion_coefficients=np.array(D14[:5]),
    )
    [original] = read(data)
    assert len(original.extras) == 5
    for target in SYNTAXES:
        again, verdict = parsers.encode([original], "opencv_storage", name=f"copy{target}")
        assert verdict.dropped == ()
        assert read(again)[0].extras == original.extras
        storage = cv2.FileStorage(again.decode(), READ)
        assert storage.getNode("flags").real() == 2
        assert storage.getNode("remark").string() == 'Tue "8" Oct <10:53> & on'
        assert storage.getNode("names").at(0).string() == "a b"
        np.testing.assert_array_equal(
            storage.getNode("extrinsic_parameters").mat(), np.arange(12.0).reshape(2, 6) / 3
        )


def test_a_derived_k_does_not_come_back_as_a_calibrated_one() -> None:
    data, verdict = parsers.encode([replace(camera(), grade=Grade.DERIVED)], "opencv_storage")
    assert verdict.dropped == ()
    assert read(data)[0].grade is Grade.DERIVED
    with pytest.raises(ParseError, match="calibrary_grade: 'derved' is not a grade"):
        read(data.replace(b"derived", b"derved"))


def test_a_key_that_opencv_could_not_read_is_dropped_by_name() -> None:
    [original] = read(YAML + '"per view; px": [ 0.1, 0.2 ]\n')
    _, verdict = parsers.encode([original], "opencv_storage", name="copy.yml")
    assert verdict.dropped == ("opencv_storage/per view; px",)


def test_a_stereo_pair_keeps_its_names_and_a_cut_loses_no_camera() -> None:
    pair = [
        replace(camera(), camera=CameraKey(image_size=SIZE, sub_camera=side)) for side in ("left", "right")
    ]
    data, verdict = parsers.encode(pair, "opencv_storage", name="pair.yml")
    assert verdict.dropped == ()
    assert [item.camera.sub_camera for item in read(data)] == ["left", "right"]
    for end in range(len(data) - 1):
        with pytest.raises(ParseError):
            parsers.decode(data[:end], name="cut.yml", format="opencv_storage")


def test_cameras_of_two_sizes_do_not_share_a_file() -> None:
    other = camera().scaled((2736, 1824))
    with pytest.raises(UnsupportedModelError, match="one image size"):
        parsers.encode([camera(), other], "opencv_storage")


def test_a_fisheye_does_not_share_a_file_with_another_lens() -> None:
    fisheye = camera(KannalaBrandt(k1=0.01, k2=0.0, k3=0.0, k4=0.0))
    with pytest.raises(UnsupportedModelError, match="fisheye"):
        parsers.encode([camera(), fisheye], "opencv_storage")


def test_a_suffix_of_no_syntax_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match=r"\.yml, \.yaml, \.xml, \.json"):
        parsers.encode([camera()], "opencv_storage", name="camera.cal")


def test_a_metashape_lens_with_k4_is_refitted_and_the_verdict_is_what_opencv_sees() -> None:
    original = camera(MetashapeFrame(k1=-0.05, k2=0.02, k3=-0.01, k4=0.004, p1=0.0008, p2=-0.0003))
    data, verdict = parsers.encode([original], "opencv_storage")
    assert verdict.outcome is Fidelity.REFITTED
    assert 0 < verdict.max_px <= 0.05
    storage = cv2.FileStorage(data.decode(), READ)
    K, D = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    seen = original.unproject([[x, y] for x in np.linspace(0, 5472, 31) for y in np.linspace(0, 3648, 31)])
    by_cv2 = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2) + 0.5
    missed = np.linalg.norm(by_cv2 - original.project(seen), axis=1)
    assert missed.max() == pytest.approx(verdict.max_px, rel=0.05)


def test_matrices_that_were_pasted_without_their_root_are_read() -> None:
    def element(name: str, rows: int, cols: int, data: str) -> str:
        return f'<{name} type_id="opencv-matrix"><rows>{rows}</rows><cols>{cols}</cols><data>{data}</data></{name}>'

    text = element("camera_matrix", 3, 3, "3404.9 0. 1715.0\n0. 3409.1 2350.8\n0. 0. 1.")
    text += element("distortion_coefficients", 5, 1, "-0.031 0.399 0.0029 -0.0028 -0.543")
    for declaration in ("", '<?xml version="1.0"?>\n'):
        [item] = parsers.decode(
            (declaration + text).encode(), name="calibration.xml", image_size=(3456, 4608)
        )
        assert item.intrinsics.fx == 3404.9
        assert item.distortion is not None
        assert item.distortion.coefficients["k3"] == -0.543
    with pytest.raises(ParseError):
        parsers.decode(text[:-9].encode(), name="calibration.xml", image_size=(3456, 4608))
