"""What ODM, OpenCV and the other solvers are handed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calibrary
from calibrary.distortion import (
    BrownConrady,
    Distortion,
)
from calibrary.errors import UnsupportedModelError
from calibrary.jobs.extract import Program
from calibrary.records import replace
from tests.jobs.extract.handed import (
    BROWN,
    BROWN_5,
    FISHEYE,
    POINTS,
    RATIONAL,
    SIZE,
    assert_same_px,
    calibrated,
    candidate,
    document,
    files_of,
    opensfm_sees,
)


class TestOdm:
    def test_it_sees_every_point_where_calibrary_sees_it(self) -> None:
        calibration = calibrated(BROWN_5)
        for model in document("odm", candidate(calibration)).values():
            assert_same_px(opensfm_sees(model, POINTS), calibration)
            assert model["focal"] == pytest.approx((3660.5 + 3655.25) / 2 / 5472, rel=1e-15)

    def test_its_names_are_opensfms_without_the_version(self) -> None:
        names = document("odm", candidate(calibrated(BROWN), exif_size=(4000, 3000)))
        assert "dji fc6310r 5472 3648 brown 0.6666" in names
        assert all(len(name.split()) >= 6 for name in names)
        assert not any("4000" in name for name in names)

    @pytest.mark.parametrize(
        ("told", "name"),
        [
            ({"make": "Canon", "model": "Canon SX260"}, "canon canon sx260 5472 3648 brown 0.6666"),
            ({"lens": "XT 35"}, "dji fc6310r 5472 3648 brown 0.6666"),
            ({"size": (4000, 3000)}, "dji fc6310r 4000 3000 brown 0.6666"),
            ({"focal_35mm": None}, "dji fc6310r 5472 3648 brown 0.85"),
            ({"make": None, "model": None, "focal_35mm": None}, "  5472 3648 brown 0.85"),
        ],
    )
    def test_a_camera_goes_by_the_name_that_odm_itself_reads_from_exif(
        self, told: dict[str, Any], name: str
    ) -> None:
        # camera_id in opendm/photo.py: the make stays in the model, a lens is not looked at, 0.85 is no focal length.
        assert name in document("odm", candidate(calibrated(BROWN), **told))

    def test_cameras_that_differ_in_their_lens_alone_are_one_to_odm(self) -> None:
        two = candidate(calibrated(None), slug="two", lens="XT 24")
        files = files_of("odm", candidate(calibrated(BROWN), lens="XT 35"), two)
        assert set(files) == {"cameras.dji-fc6310r.json", "cameras.two.json"}

    def test_a_coefficient_it_would_drop_is_refused(self) -> None:
        with pytest.raises(UnsupportedModelError, match="k4"):
            files_of("odm", candidate(calibrated(FISHEYE)))

    def test_two_cameras_of_one_name_have_a_file_each_for_a_run_of_their_own(self) -> None:
        files = files_of("odm", candidate(calibrated(BROWN)), candidate(calibrated(None), slug="two"))
        assert set(files) == {"cameras.dji-fc6310r.json", "cameras.two.json"}
        for content in files.values():
            assert "dji fc6310r 5472 3648 brown 0.6666" in json.loads(content)


class TestOpenCv:
    @pytest.mark.parametrize("distortion", [BROWN, BROWN_5, RATIONAL])
    def test_it_reads_its_own_file_and_sees_every_point_half_a_pixel_nearer(
        self, tmp_path: Path, distortion: Distortion
    ) -> None:
        calibration = calibrated(distortion)
        [(name, content)] = files_of("opencv", candidate(calibration)).items()
        (tmp_path / name).write_bytes(content)
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
        K = storage.getNode("camera_matrix").mat()
        coefficients = storage.getNode("distortion_coefficients").mat()
        size = int(storage.getNode("image_width").real()), int(storage.getNode("image_height").real())
        storage.release()
        assert size == SIZE
        assert K.tolist() == [[3660.5, 0, 2731.0], [0, 3655.25, 1846.25], [0, 0, 1]]
        seen, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, coefficients)
        assert_same_px(seen.reshape(-1, 2) + 0.5, calibration)

    def test_each_camera_has_its_file(self) -> None:
        cameras = [
            candidate(calibrated(BROWN)),
            candidate(calibrated(None), slug="two"),
            candidate(slug="none"),
        ]
        assert set(files_of("opencv", *cameras)) == {"dji-fc6310r.opencv.yml", "two.opencv.yml"}


class TestTheOthers:
    @pytest.mark.parametrize("solver", ["metashape", "pix4d"])
    def test_each_camera_has_a_file_that_reads_back(self, tmp_path: Path, solver: Program) -> None:
        square = replace(calibrated(BROWN_5), intrinsics=replace(calibrated(BROWN_5).intrinsics, fy=3660.5))
        [(name, content)] = files_of(solver, candidate(square)).items()
        (tmp_path / name).write_bytes(content)
        back = calibrary.read(tmp_path / name, image_size=SIZE)
        assert_same_px(back.project(POINTS), square)

    def test_realityscan_has_a_row_for_each_image(self, tmp_path: Path) -> None:
        radial = BrownConrady(k1=-0.031, k2=0.012, p1=0.0, p2=0.0, k3=0.001)
        square = replace(calibrated(radial), intrinsics=replace(calibrated(radial).intrinsics, fy=3660.5))
        [(name, content)] = files_of("realityscan", candidate(square)).items()
        (tmp_path / name).write_bytes(content)
        assert [row.split(",")[0] for row in content.decode().splitlines()[1:]] == ["a.jpg", "b c.jpg"]
        for back in calibrary.read_all(tmp_path / name, image_size=SIZE):
            assert_same_px(back.project(POINTS), square)
