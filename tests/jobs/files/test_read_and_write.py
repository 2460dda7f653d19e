"""calibrary.read, read_all, write and refit: every kind of source, and errors that say how to choose."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibrary
from calibrary import Calibration
from calibrary.arguments import Reading
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.jobs.files import read_arguments, read_file
from calibrary.quality import Covariance, Quality
from calibrary.records import replace
from tests.sfm.flights import Plan, fly
from tests.sfm.reconstructions import write_colmap, write_opensfm
from tests.workshop import CAMERA


@pytest.mark.parametrize("name", ["camera.xml", "survey/DJI_0001.JPG"])
def test_path_bytes_and_open_file_give_the_same_camera(furnished: Path, name: str) -> None:
    path = furnished / name
    by_path = calibrary.read(path)
    assert by_path.intrinsics == CAMERA.intrinsics
    with path.open("rb") as file:
        assert calibrary.read(file) == calibrary.read(str(path)) == by_path
    by_bytes = calibrary.read(path.read_bytes())
    assert (by_bytes.intrinsics, by_bytes.distortion) == (by_path.intrinsics, by_path.distortion)
    assert by_bytes.provenance.source == "bytes"


def test_a_stream_without_a_name_is_called_by_what_it_is() -> None:
    with pytest.raises(ParseError, match="bytes: "):
        calibrary.read(io.BytesIO(b"{"), format="opencv_storage")


def test_a_file_open_as_text_is_refused(furnished: Path) -> None:
    with (
        (furnished / "camera.xml").open(encoding="utf-8") as file,
        pytest.raises(InputError, match=r"camera\.xml: is open as text, open it in binary mode"),
    ):
        calibrary.read(file)  # type: ignore[arg-type]


def test_a_file_longer_than_allowed_is_not_taken_in(furnished: Path) -> None:
    with (
        (furnished / "camera.xml").open("rb") as file,
        pytest.raises(InputError, match="longer than 100 bytes, raise max_bytes"),
    ):
        calibrary.read(file, max_bytes=100)


def test_several_cameras_are_listed_with_how_to_choose(furnished: Path) -> None:
    path = furnished / "stereo.yml"
    with pytest.raises(InputError) as error:
        calibrary.read(path)
    assert "holds 2 cameras" in str(error.value)
    assert "camera=N" in str(error.value)
    assert "calibrary.read_all" in str(error.value)
    assert "1 unknown camera left" in str(error.value)
    assert calibrary.read(path, camera=2) == calibrary.read_all(path)[1]
    with pytest.raises(InputError, match=r"has no camera 3; it holds 2, counted from 1"):
        calibrary.read(path, camera=3)


def test_the_camera_of_two_files_is_that_of_the_one_with_several(furnished: Path) -> None:
    both, one = furnished / "stereo.yml", furnished / "left.yml"
    calibrary.write([calibrary.read_all(both)[0]], one, format="opencv_storage")
    left, right = (read_arguments(one, both, Reading(camera=name))[1] for name in ("1", "right"))
    assert [left.calibration, right.calibration] == calibrary.read_all(both)
    with pytest.raises(InputError, match=r"left\.yml: has no camera 2"):
        read_arguments(one, both, Reading(camera="2,1"))


def test_a_camera_is_chosen_by_its_name_too(furnished: Path) -> None:
    path = furnished / "stereo.yml"
    assert calibrary.read(path, camera="right") == calibrary.read_all(path)[1]
    with pytest.raises(InputError, match=r"has no camera nadir; it holds 2"):
        calibrary.read(path, camera="nadir")
    with pytest.raises(InputError, match=r"has 2 times a camera unknown; it holds 2"):
        calibrary.read(path, camera="unknown")


def test_what_only_the_owner_knows_is_passed_on(tmp_path: Path) -> None:
    np.save(tmp_path / "K.npy", CAMERA.intrinsics.matrix)
    for source in (tmp_path / "K.npy", (tmp_path / "K.npy").read_bytes()):
        own = calibrary.read(source, image_size=(5472, 3648), format="k_npy", options={"origin": "corner"})
        assert own.intrinsics == CAMERA.intrinsics


def test_the_suffix_tells_the_format_where_it_is_one(tmp_path: Path) -> None:
    verdict = calibrary.write(CAMERA, tmp_path / "camera.cameramodel")
    assert calibrary.read(tmp_path / "camera.cameramodel").intrinsics == CAMERA.intrinsics
    assert verdict.outcome == "exact"
    assert verdict.max_px == 0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "camera.xml",
            r"camera\.xml: several formats are written as \.xml; say which, one of agisoft_xml, .*opencv",
        ),
        (
            "camera.doc",
            r"camera\.doc: no format is written as \.doc; say which, as 'calibrary formats' lists",
        ),
        ("camera", "no format is written as a file without a suffix"),
    ],
)
def test_a_suffix_that_does_not_tell_lists_the_formats(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        calibrary.write(CAMERA, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_several_cameras_are_written_together(furnished: Path, tmp_path: Path) -> None:
    pair = calibrary.read_all(furnished / "stereo.yml")
    calibrary.write(pair, tmp_path / "pair.yaml", format="opencv_storage")
    assert [own.camera.sub_camera for own in calibrary.read_all(tmp_path / "pair.yaml")] == ["left", "right"]


def test_what_a_format_cannot_hold_is_refused_unless_allowed(tmp_path: Path) -> None:
    def bent(k4: float) -> Calibration:
        return calibrary.refit(replace(CAMERA, distortion=replace(CAMERA.distortion, k3=k4)), "metashape")

    strange = replace(bent(-0.033), distortion=replace(bent(-0.033).distortion, k4=0.4))
    with pytest.raises(UnsupportedModelError, match="--max-error-px"):
        calibrary.write(strange, tmp_path / "camera.cameramodel")
    verdict = calibrary.write(strange, tmp_path / "camera.cameramodel", max_error_px=50.0)
    assert 0.05 < verdict.max_px <= 50


class TestRefit:
    def test_an_equal_map_is_converted_exactly_with_its_uncertainty(self) -> None:
        known = replace(CAMERA, quality=Quality(std={"fx": 0.4, "k1": 1e-4}))
        own = calibrary.refit(known, "metashape")
        assert own.distortion is not None
        assert own.distortion.model == "metashape"
        assert calibrary.refit(own, "brown").distortion == CAMERA.distortion

    def test_a_fit_stays_within_what_was_allowed(self, furnished: Path) -> None:
        own = calibrary.read(furnished / "AutoCal.xml")
        fitted = calibrary.refit(own, "opencv", max_error_px=0.05)
        width, height = own.intrinsics.image_size
        x, y = np.meshgrid(np.linspace(0, width, 23), np.linspace(0, height, 17))
        pixels = np.column_stack([x.ravel(), y.ravel()])
        off = fitted.project(own.unproject(pixels)) - pixels
        assert np.hypot(*off.T).max() < 0.05

    def test_of_the_uncertainty_only_that_of_k_stays_after_a_fit(self, furnished: Path) -> None:
        names = ("fx", "fy", "k1")
        covariance = Covariance.from_matrix(names, np.diag([0.16, 0.25, 1e-8]))
        own = replace(
            calibrary.read(furnished / "AutoCal.xml"),
            quality=Quality(rms_px=0.3, std=covariance.std, covariance=covariance),
        )
        quality = calibrary.refit(own, "opencv").quality
        assert quality is not None
        assert quality.rms_px == 0.3
        assert quality.std == {"fx": 0.4, "fy": 0.5}
        assert quality.covariance is not None
        assert quality.covariance.names == ("fx", "fy")

    def test_a_lens_that_already_fits_is_left_alone(self) -> None:
        assert calibrary.refit(CAMERA, "opencv") == CAMERA

    def test_what_is_not_near_enough_says_by_how_much(self) -> None:
        strong = replace(CAMERA, distortion=BrownConrady(k1=-0.3, k2=0.1, p1=0.0, p2=0.0))
        with pytest.raises(UnsupportedModelError, match=r"off by rms .* px, max .* px; give --max-error-px"):
            calibrary.refit(strong, "division", max_error_px=0.01)

    def test_a_model_that_is_not_there_is_refused_with_those_that_are(self) -> None:
        with pytest.raises(InputError, match="'fisheye2'; expected one of opencv, colmap, none, brown"):
            calibrary.refit(CAMERA, "fisheye2")


class TestNotebook:
    def test_it_shows_what_a_person_asks_for(self) -> None:
        known = replace(CAMERA, quality=Quality(rms_px=0.31, std={"fx": 0.4}, kappa2=4.0))
        html = known._repr_html_()
        for text in (
            "DJI FC6310R",
            "3659.500 ± 0.8",
            "5472 × 3648 px",
            "brown",
            "calibrated",
            "0.31 px",
            "test",
        ):
            assert text in html

    def test_everything_is_escaped(self) -> None:
        hostile = replace(
            CAMERA,
            camera=replace(CAMERA.camera, model="<script>&"),
            provenance=replace(CAMERA.provenance, source="<b>.xml"),
        )
        html = hostile._repr_html_()
        assert "<script>" not in html
        assert "&lt;script&gt;&amp;" in html
        assert "&lt;b&gt;.xml" in html

    def test_an_unknown_lens_is_not_shown_as_none(self) -> None:
        assert ">unknown<" in replace(CAMERA, distortion=None)._repr_html_()
        assert ">none<" in replace(CAMERA, distortion=NoDistortion())._repr_html_()


@pytest.mark.parametrize("wrapped", [None, "calibration", "calibrations", "cameras"])
def test_what_calibrary_printed_is_read_whole(tmp_path: Path, wrapped: str | None) -> None:
    std = {"fx": 0.4, "fy": 0.4, "cx": 0.3, "cy": 0.3}
    made = replace(CAMERA, quality=Quality(std=std), notes=("start: not good enough to be kept fixed",))
    own = made.to_dict()
    inside = {"calibration": own, "calibrations": [own], "cameras": [{"slug": "a", "calibration": own}]}
    document = own if wrapped is None else {wrapped: inside[wrapped], "model": "brown"}
    path = tmp_path / "printed.json"
    path.write_text(json.dumps(document))
    assert read_file(path, Reading()) == [made]


def test_a_printed_document_that_lost_a_part_is_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "printed.json"
    path.write_text(json.dumps(CAMERA.to_dict()).replace('"fx"', '"f"'))
    with pytest.raises(InputError, match=r"printed\.json: .*fx"):
        read_file(path, Reading())


@pytest.mark.parametrize("write", [write_colmap, write_opensfm])
def test_a_folder_with_a_reconstruction_is_read_by_its_cameras(tmp_path: Path, write: Any) -> None:
    folder = write(tmp_path / "project", *fly(Plan(rows=1, columns=3, points=80), 1))
    cameras = read_file(folder, Reading())
    assert any(one.intrinsics.fx == pytest.approx(1130.0) for one in cameras)
    assert read_arguments(folder, cameras[0], Reading(camera=1))[0].calibration == cameras[0]
    with pytest.raises(InputError, match="not a regular file"):
        read_arguments(tmp_path, cameras[0], Reading())
