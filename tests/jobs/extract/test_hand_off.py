"""What each solver is given, checked by that solver's own arithmetic."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pycolmap
import pytest

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.distortion import (
    Distortion,
    FisheyePolynomial,
    NoDistortion,
    ThinPrism,
)
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.evidence.metadata import FocalPlaneUnit
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.hand_off import nearest
from calibrary.jobs.extract.targets import TARGETS, seed_command
from calibrary.records import replace
from calibrary.validation import Use
from tests.imagery import ExifTags, Namespace, XmpDescription, XmpPacket, attributes, write_jpeg
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, picture, plan
from tests.jobs.extract.handed import (
    BROWN,
    BROWN_5,
    FISHEYE,
    FIXED,
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

CAMERA = Namespace("Camera", "http://pix4d.com/camera/1.0/")


class TestColmap:
    @pytest.mark.parametrize(
        ("distortion", "model"),
        [
            (None, "OPENCV"),
            (NoDistortion(), "PINHOLE"),
            (BROWN, "OPENCV"),
            (BROWN_5, "FULL_OPENCV"),
            (RATIONAL, "FULL_OPENCV"),
            (FISHEYE, "OPENCV_FISHEYE"),
        ],
        ids=["unknown", "none", "brown 4", "brown 5", "rational", "fisheye"],
    )
    def test_it_sees_every_point_where_calibrary_sees_it(
        self, distortion: Distortion | None, model: str
    ) -> None:
        calibration = calibrated(distortion)
        given = calibration.to_colmap()
        camera = pycolmap.Camera(**given._asdict())
        assert given.model == model
        assert_same_px(camera.img_from_cam(POINTS), calibration)

    @pytest.mark.parametrize(
        "calibration",
        [
            calibrated(NoDistortion(), skew=0.5),
            calibrated(ThinPrism(**dict.fromkeys(ThinPrism.names(), 0.001))),
        ],
        ids=["skew", "thin prism"],
    )
    def test_what_it_has_no_model_for_is_refused(self, calibration: Calibration) -> None:
        with pytest.raises(UnsupportedModelError, match="COLMAP"):
            files_of("colmap", candidate(calibration))

    def test_every_camera_is_a_run_of_its_own_over_its_own_images(self, tmp_path: Path) -> None:
        cameras = [
            candidate(calibrated(BROWN), allowed=FIXED),
            candidate(calibrated(None), slug="two"),
            candidate(slug="none"),
        ]
        calls = self.calls_of(tmp_path, files_of("colmap", *cameras))
        lists = ["./colmap.dji-fc6310r.txt", "./colmap.two.txt"]
        assert [call["--image_list_path"] for call in calls] == lists
        assert all(call["--ImageReader.single_camera"] == "1" for call in calls)
        assert all(call["--image_path"] == "my images" for call in calls)
        assert [call["--ImageReader.camera_model"] for call in calls] == ["OPENCV", "OPENCV"]
        read = [list(map(float, call["--ImageReader.camera_params"].split(","))) for call in calls]
        assert read[0] == [3660.5, 3655.25, 2731.5, 1846.75, -0.031, 0.012, 0.0008, -0.0004]
        assert read[1] == [3660.5, 3655.25, 2731.5, 1846.75, 0.0, 0.0, 0.0, 0.0]
        script = (tmp_path / "colmap.sh").read_text()
        assert "keep fixed: known to 0.1 px" in script
        assert "refine focal length and distortion: the distortion is unknown and starts from zero" in script
        assert "--Mapper.ba_refine_extra_params 1" in script
        assert "for all cameras at once" in script
        assert (tmp_path / "colmap.two.txt").read_text() == "100/a.jpg\n100/b c.jpg\n"

    def test_no_name_from_a_tag_is_run_as_a_command(self, tmp_path: Path) -> None:
        key = CameraKey(make="$(touch pwned)", model="`touch pwned`; touch pwned")
        hostile = replace(calibrated(BROWN), camera=key)
        calls = self.calls_of(tmp_path, files_of("colmap", candidate(hostile)))
        assert len(calls) == 1
        assert not (tmp_path / "pwned").exists()

    def test_the_seeds_command_starts_from_the_seed_and_refines_it(self, tmp_path: Path) -> None:
        seed = replace(calibrated(None), grade=Grade.SEED)
        extractor, _, mapper = self.calls_of(tmp_path, {"colmap.sh": seed_command(seed).encode()})
        assert extractor["--ImageReader.camera_params"] == "3660.5,3655.25,2731.5,1846.75"
        assert mapper["--Mapper.ba_refine_focal_length"] == "1"

    def calls_of(self, folder: Path, files: Mapping[str, bytes]) -> list[dict[str, str]]:
        """Run the script with a ``colmap`` that only notes down how it is called."""
        for name, content in files.items():
            (folder / name).write_bytes(content)
        (folder / "bin").mkdir()
        fake = folder / "bin/colmap"
        fake.write_text('#!/bin/sh\nprintf "%s\\n" "$@" >> calls\nprintf "\\0\\n" >> calls\n')
        fake.chmod(0o755)
        environment = {"PATH": f"{folder / 'bin'}:/usr/bin:/bin"}
        subprocess.run(
            ["sh", "colmap.sh", "my images", "database.db"], cwd=folder, env=environment, check=True
        )
        calls = []
        for call in (folder / "calls").read_text().split("\0\n")[:-1]:
            _command, *words = call.splitlines()
            calls.append(dict(zip(words[::2], words[1::2], strict=True)))
        return calls


class TestOpenSfm:
    @pytest.mark.parametrize("distortion", [None, NoDistortion(), BROWN, BROWN_5, FISHEYE])
    def test_it_sees_every_point_where_calibrary_sees_it(self, distortion: Distortion | None) -> None:
        calibration = calibrated(distortion)
        model = document("opensfm", candidate(calibration))["all"]
        assert (model["width"], model["height"]) == SIZE
        assert_same_px(opensfm_sees(model, POINTS), calibration)

    @pytest.mark.parametrize(
        "calibration", [calibrated(RATIONAL), calibrated(BROWN, skew=0.5)], ids=["rational", "skew"]
    )
    def test_what_it_has_no_model_for_is_refused(self, calibration: Calibration) -> None:
        with pytest.raises(UnsupportedModelError, match="OpenSfM"):
            files_of("opensfm", candidate(calibration))

    def test_all_is_said_only_where_there_is_no_other_camera(self) -> None:
        alone = document("opensfm", candidate(calibrated(BROWN)))
        assert list(alone) == ["all"]
        beside = document("opensfm", candidate(calibrated(BROWN)), candidate(slug="rejected", model="FC330"))
        assert "all" not in beside
        assert list(beside) == ["v2 dji fc6310r 5472 3648 perspective 0.6666"]

    @pytest.mark.parametrize(
        ("told", "name"),
        [
            ({}, "v2 dji fc6310r 5472 3648 perspective 0.6666"),
            ({"focal_35mm": 26.0}, "v2 dji fc6310r 5472 3648 perspective 0.7222"),
            ({"make": "Canon", "model": "Canon SX260"}, "v2 canon sx260 5472 3648 perspective 0.6666"),
            ({"lens": "XT 35"}, "v2 dji xt 35 5472 3648 perspective 0.6666"),
            ({"make": None, "model": None}, "v2 unknown unknown 5472 3648 perspective 0.6666"),
            ({"focal_35mm": None}, "v2 dji fc6310r 5472 3648 perspective 0.0"),
            (
                {
                    "focal_35mm": None,
                    "focal_mm": 8.8,
                    "focal_plane_resolution": (4150.0, 4150.0),
                    "focal_plane_unit": FocalPlaneUnit.CENTIMETRE,
                },
                "v2 dji fc6310r 5472 3648 perspective 0.6673",
            ),
        ],
    )
    def test_a_camera_goes_by_opensfms_name_for_it(self, told: dict[str, Any], name: str) -> None:
        cameras = (candidate(calibrated(BROWN), **told), candidate(slug="other", model="Other"))
        assert list(document("opensfm", *cameras)) == [name]

    def test_a_frame_of_four_to_three_has_the_names_of_old_and_new_releases(self) -> None:
        camera = candidate(calibrated(BROWN), size=(4000, 3000))
        names = document("opensfm", camera, candidate(slug="other", model="Other"))
        assert {name.split()[-1] for name in names} == {"0.6666", "0.7058"}

    def test_a_resized_frame_goes_by_its_size_in_exif_as_well(self) -> None:
        camera = candidate(calibrated(BROWN), size=(2736, 1824), exif_size=SIZE)
        names = document("opensfm", camera, candidate(slug="other", model="Other"))
        assert {" ".join(name.split()[3:5]) for name in names} == {"2736 1824", "5472 3648"}

    @pytest.mark.parametrize("rejected", [False, True])
    def test_of_two_cameras_of_one_name_each_image_is_told_its_camera(self, rejected: bool) -> None:
        two = replace(
            candidate(None if rejected else calibrated(None), slug="dji-fc6310r-sn-222222"),
            names=("101/z.jpg",),
        )
        files = files_of("opensfm", candidate(calibrated(BROWN)), two)
        models = json.loads(files["camera_models_overrides.json"])
        images = json.loads(files["exif_overrides.json"])
        assert set(models) == {"dji-fc6310r"} | (set() if rejected else {two.slug})
        assert images == {
            "a.jpg": {"camera": "dji-fc6310r"},
            "b c.jpg": {"camera": "dji-fc6310r"},
            "z.jpg": {"camera": "dji-fc6310r-sn-222222"},
        }

    def test_images_of_one_name_in_two_folders_are_refused(self) -> None:
        two = replace(candidate(calibrated(None), slug="two"), names=("101/a.jpg",))
        with pytest.raises(InputError, match="--task DIR"):
            files_of("opensfm", candidate(calibrated(BROWN)), two)

    def test_exif_that_only_gdal_reads_makes_an_unknown_camera(self) -> None:
        cameras = (candidate(calibrated(BROWN), exif_in_text=True), candidate(slug="other", model="Other"))
        assert list(document("opensfm", *cameras)) == ["v2 unknown unknown 5472 3648 perspective 0.0"]


SOLVERS = list(TARGETS)
LENSES = {
    "unknown": None,
    "none": NoDistortion(),
    "brown 4": BROWN,
    "brown 5": BROWN_5,
    "rational": RATIONAL,
    "fisheye": FISHEYE,
}


def states_focal(text: str) -> bool:
    """Whether a number is fx or fy of the unit or their mean, in px, widths, 36 mm or mm, but for a refit."""
    numbers = [float(word) for word in re.findall(r"\d+\.\d+", text)]
    focal = [
        f * unit for f in (3660.5, 3655.25, 3657.875) for unit in (1, 1 / SIZE[0], 36 / SIZE[0], 8.8 / 3660.5)
    ]
    return any(abs(number / f - 1) < 2e-3 for number in numbers for f in focal)


def test_each_program_of_the_flag_has_a_row() -> None:
    assert set(TARGETS) == set(get_args(Program))


def test_ros_takes_an_unknown_lens_for_none_so_it_gets_it_on_the_users_word_only() -> None:
    K = calibrated(None)
    with pytest.raises(UnsupportedModelError, match=r"would say that there is none; .* --drop-distortion"):
        nearest("ros", K)
    said = str(nearest("ros", K, drop_distortion=True))
    assert said.startswith("K is exact (0.000 px); dropped: that the distortion is unknown (the file says")


def test_how_exact_what_a_program_gets_is_said_in_one_line() -> None:
    assert str(nearest("colmap", calibrated(BROWN))) == "exact (0.000 px)"
    free = "its coefficients are zero, for the program to find"
    assert free in str(nearest("colmap", calibrated(None)))


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("solver", SOLVERS)
def test_its_files_have_the_k_of_a_lens_that_it_holds_and_names_of_its_patterns(
    solver: Program, lens: str
) -> None:
    """With one focal length and with two; the nearest is held where the lens itself is not."""
    K = calibrated(LENSES[lens])
    square = replace(K, intrinsics=replace(K.intrinsics, fy=K.intrinsics.fx))
    for given in (K, square):
        held = nearest(solver, given, drop_distortion=lens == "unknown")
        one = held.calibration
        moved = np.abs(one.project(POINTS) - given.project(POINTS)).max()
        assert moved <= (held.fit.max_px if held.fit is not None else 0.0)
        files = files_of(solver, candidate(one))
        named = {pattern for name in files for pattern in TARGETS[solver].reads if fnmatchcase(name, pattern)}
        assert named, f"{solver} reads {TARGETS[solver].reads}, and gets {[*files]}"
        assert states_focal(b"".join(files.values()).decode())


def test_what_is_too_far_off_even_for_a_start_is_refused_without_advice_that_extract_cannot_take() -> None:
    K = calibrated(BROWN)
    far = replace(K, intrinsics=replace(K.intrinsics, fy=1.03 * K.intrinsics.fx))
    with pytest.raises(UnsupportedModelError, match="no place for an fx − fy") as refused:
        nearest("pix4d", far)
    assert "--max-error-px" not in refused.value.message


@pytest.mark.parametrize("solver", SOLVERS)
def test_where_no_k_may_be_used_nothing_is_written(solver: Program) -> None:
    assert files_of(solver, candidate(), candidate(slug="two")) == {}
    assert files_of(solver) == {}


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_run_hands_over_valid_ks_only_and_names_the_others(tmp_path: Path, solver: Program) -> None:
    flight = tmp_path / "flight"
    picture(flight / "valid.jpg", **P4R, dewarp=DEWARP, focal_35mm=24)
    picture(flight / "unproven.jpg", **NOBODY)
    picture(flight / "rejected.jpg", (4000, 3000))
    found = gate(flight)
    report = plan(found, tmp_path / "K.npy", solver)
    assert report.hand_off is not None
    written = "".join(content.decode() for content in report.hand_off.files.values())
    said = {one.camera: (one.into is not None, one.why) for one in report.hand_off.cameras}
    assert said["example-one-5472x3648"] == (False, "unproven; --include-unproven hands it on as a start")
    assert said["unknown-camera-4000x3000"] == (False, "it has no K")
    assert said["dji-fc6310r-5472x3648"][0]
    assert states_focal(written)
    assert "5472.0" not in written
    assert "unproven.jpg" not in written
    assert "4000" not in written
    assert tmp_path / "K_unproven.example-one-5472x3648.npy" in report.outputs.files


def test_an_unproven_k_is_handed_on_as_a_start_where_it_is_asked_for(tmp_path: Path) -> None:
    picture(tmp_path / "flight/a.jpg", **NOBODY)
    plans = [
        plan(gate(tmp_path / "flight"), tmp_path / "K.npy", "odm", include_unproven=asked).hand_off
        for asked in (False, True)
    ]
    assert [bool(one.files) for one in plans if one is not None] == [False, True]
    [row] = plans[1].cameras if plans[1] is not None else ()
    assert row.use is Use.START
    assert "its K is unproven, and was asked for" in row.why


def test_a_camera_the_solver_has_no_model_for_is_left_out_and_does_not_keep_the_others_back(
    tmp_path: Path,
) -> None:
    flight = tmp_path / "flight"
    picture(flight / "known.jpg", **P4R, dewarp=DEWARP, focal_35mm=24)
    picture(flight / "dome.jpg", (4000, 3000))
    (flight / "dome.yaml").write_text(
        "image_width: 4000\nimage_height: 3000\ncamera_name: dome\ndistortion_model: equidistant\n"
        "camera_matrix: {rows: 3, cols: 3, data: [1100, 0, 2000, 0, 1100, 1500, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 4, data: [0.01, 0, 0, 0]}\n"
    )
    report = plan(gate(flight), tmp_path / "K.npy", "pix4d")
    assert report.hand_off is not None
    [dome] = [one for one in report.hand_off.cameras if one.camera == "unknown-camera-4000x3000"]
    assert dome.into is None
    assert "no counterpart" in dome.why
    assert tmp_path / "dji-fc6310r-5472x3648.pix4d.cam" in report.outputs.files
    assert b"no counterpart" in report.outputs.files[tmp_path / "K.json"]


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_fisheye_that_its_maker_calibrated_is_handed_to_every_program_with_the_error_stated(
    tmp_path: Path, solver: Program
) -> None:
    """Numbers as of a Sequoia's band: no program but Pix4D has the polynomial, and its .cam file has no fisheye."""
    lens = {"FisheyeAffineMatrix": "1659.16,0,0,1659.16", "FisheyePolynomial": "0,1,0.0137,-0.152"}
    camera = XmpDescription(
        items=attributes(CAMERA, ModelType="fisheye", BandName="NIR", PrincipalPoint="2.437,1.8784", **lens)
    )
    tags = ExifTags(
        make="Example",
        model="Band",
        focal_mm=(398, 100),
        focal_plane_resolution=((26667, 100), (26667, 100)),
        focal_plane_unit=4,
        pixel_size=(1280, 960),
    )
    write_jpeg(tmp_path / "flight" / "nir.jpg", (1280, 960), exif=tags, xmp=XmpPacket(descriptions=(camera,)))
    found = gate(tmp_path / "flight")
    handed = plan(found, tmp_path / "K.npy", solver).hand_off
    [K] = [one.calibration for one in found.judged]
    assert K is not None
    assert isinstance(K.distortion, FisheyePolynomial)
    assert handed is not None
    assert all(one.into for one in handed.cameras)
    held = nearest(solver, K)
    assert held.fit is not None
    assert held.fit.max_px < 0.6
    assert held.fit.exact or str(held) in handed.cameras[0].why


def test_a_k_that_is_farther_off_than_it_is_known_to_is_not_kept_fixed() -> None:
    """Pix4D's file has one focal length, and this unit two, 5 px apart."""
    held = nearest("pix4d", calibrated(BROWN))
    assert held.fit is not None
    assert held.fit.max_px > 0.5
    assert held.allows(FIXED).use is Use.START
    assert nearest("metashape", calibrated(BROWN)).allows(FIXED) is FIXED
