"""What each solver is given, checked by that solver's own arithmetic."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

import calibrary
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
)
from calibrary.errors import UnsupportedModelError
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.jobs.extract.hand_off import Candidate, Solver, colmap_camera, hand_off, notes, seed_command
from calibrary.jobs.extract.outputs import plan
from calibrary.records import replace
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, picture

SIZE = (5472, 3648)
BROWN = BrownConrady(k1=-0.031, k2=0.012, p1=0.0008, p2=-0.0004)
BROWN_5 = replace(BROWN, k3=-0.0034)
RATIONAL = Rational(k1=0.31, k2=0.02, p1=0.0008, p2=-0.0004, k3=0.001, k4=0.33, k5=0.04, k6=0.002)
FISHEYE = KannalaBrandt(k1=0.021, k2=-0.004, k3=0.0011, k4=-0.0002)
ANGLES = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.5, 0.5, 25)), axis=-1).reshape(-1, 2)
POINTS = np.column_stack([ANGLES, np.ones(len(ANGLES))])

Json = dict[str, Any]


def calibrated(distortion: Distortion | None, *, skew: float = 0.0) -> Calibration:
    K = Intrinsics(fx=3660.5, fy=3655.25, cx=2731.5, cy=1846.75, skew=skew, image_size=SIZE)
    return Calibration(
        camera=CameraKey(make="DJI", model="FC6310R", image_size=SIZE),
        intrinsics=K,
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="image-metadata"),
    )


def candidate(calibration: Calibration | None = None, slug: str = "dji-fc6310r", **told: Any) -> Candidate:
    """A camera of the run; ``told`` is what its images say beyond make, Model and frame."""
    base = ImageMetadata(size=SIZE, make="DJI", model="FC6310R", focal_35mm=24.0, has_exif=True)
    return Candidate(
        slug=slug,
        calibration=calibration,
        states=(replace(base, **told),),
        names=("100/a.jpg", "100/b c.jpg"),
    )


def assert_same_px(seen: Any, calibration: Calibration) -> None:
    expected = calibration.project(POINTS)
    assert np.isfinite(expected).all()
    assert np.abs(np.asarray(seen) - expected).max() <= 1e-9


def document(solver: Solver, *cameras: Candidate) -> Json:
    [content] = hand_off(solver, cameras).values()
    parsed: Json = json.loads(content)
    return parsed


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
        given = colmap_camera(calibration)
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
            hand_off(Solver.COLMAP, [candidate(calibration)])

    def test_every_camera_is_a_run_of_its_own_over_its_own_images(self, tmp_path: Path) -> None:
        cameras = [
            candidate(calibrated(BROWN)),
            candidate(calibrated(None), slug="two"),
            candidate(slug="none"),
        ]
        calls = self.calls_of(tmp_path, hand_off(Solver.COLMAP, cameras))
        assert [call["--image_list_path"] for call in calls] == ["colmap.dji-fc6310r.txt", "colmap.two.txt"]
        assert all(call["--ImageReader.single_camera"] == "1" for call in calls)
        assert all(call["--image_path"] == "my images" for call in calls)
        assert [call["--ImageReader.camera_model"] for call in calls] == ["OPENCV", "OPENCV"]
        read = [list(map(float, call["--ImageReader.camera_params"].split(","))) for call in calls]
        assert read[0] == [3660.5, 3655.25, 2731.5, 1846.75, -0.031, 0.012, 0.0008, -0.0004]
        assert read[1] == [3660.5, 3655.25, 2731.5, 1846.75, 0.0, 0.0, 0.0, 0.0]
        script = (tmp_path / "colmap.sh").read_text()
        assert "keep fixed: it was measured" in script
        assert "refine focal length and distortion: the distortion is unknown and starts from zero" in script
        assert "--Mapper.ba_refine_extra_params 1" in script
        assert "for all cameras at once" in script
        assert (tmp_path / "colmap.two.txt").read_text() == "100/a.jpg\n100/b c.jpg\n"

    def test_no_name_from_a_tag_is_run_as_a_command(self, tmp_path: Path) -> None:
        key = CameraKey(make="$(touch pwned)", model="`touch pwned`; touch pwned")
        hostile = replace(calibrated(BROWN), camera=key)
        calls = self.calls_of(tmp_path, hand_off(Solver.COLMAP, [candidate(hostile)]))
        assert len(calls) == 1
        assert not (tmp_path / "pwned").exists()

    def test_the_seeds_command_starts_from_the_seed_and_refines_it(self, tmp_path: Path) -> None:
        seed = replace(calibrated(None), grade=Grade.SEED)
        extractor, _, mapper = self.calls_of(tmp_path, {"colmap.sh": seed_command(seed).encode()})
        assert extractor["--ImageReader.camera_params"] == "3660.5,3655.25,2731.5,1846.75"
        assert mapper["--Mapper.ba_refine_focal_length"] == "1"

    def calls_of(self, folder: Path, files: dict[str, bytes]) -> list[dict[str, str]]:
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


def opensfm_sees(model: Json, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels from the outer corner, by OpenSfM's brown and fisheye_opencv cameras.

    A point is bent, scaled by focal_x and focal_y and moved by c_x and c_y, all in units of the longer side
    from the middle of the image.
    """
    x, y = (points[:, :2] / points[:, 2:]).T
    if model["projection_type"] == "brown":
        r2 = x * x + y * y
        radial = 1 + r2 * (model["k1"] + r2 * (model["k2"] + r2 * model["k3"]))
        bent_x = x * radial + 2 * model["p1"] * x * y + model["p2"] * (r2 + 2 * x * x)
        bent_y = y * radial + 2 * model["p2"] * x * y + model["p1"] * (r2 + 2 * y * y)
    else:
        r = np.hypot(x, y)
        t = np.arctan(r)
        bent = t * (
            1 + t**2 * (model["k1"] + t**2 * (model["k2"] + t**2 * (model["k3"] + t**2 * model["k4"])))
        )
        factor = np.divide(bent, r, out=np.ones_like(r), where=r > 0)
        bent_x, bent_y = x * factor, y * factor
    longer = max(model["width"], model["height"])
    return np.column_stack(
        [
            (model["focal_x"] * bent_x + model["c_x"]) * longer + model["width"] / 2,
            (model["focal_y"] * bent_y + model["c_y"]) * longer + model["height"] / 2,
        ]
    )


class TestOpenSfm:
    @pytest.mark.parametrize("distortion", [None, NoDistortion(), BROWN, BROWN_5, FISHEYE])
    def test_it_sees_every_point_where_calibrary_sees_it(self, distortion: Distortion | None) -> None:
        calibration = calibrated(distortion)
        model = document(Solver.OPENSFM, candidate(calibration))["all"]
        assert (model["width"], model["height"]) == SIZE
        assert_same_px(opensfm_sees(model, POINTS), calibration)

    @pytest.mark.parametrize(
        "calibration", [calibrated(RATIONAL), calibrated(BROWN, skew=0.5)], ids=["rational", "skew"]
    )
    def test_what_it_has_no_model_for_is_refused(self, calibration: Calibration) -> None:
        with pytest.raises(UnsupportedModelError, match="OpenSfM"):
            hand_off(Solver.OPENSFM, [candidate(calibration)])

    def test_all_is_said_only_where_there_is_no_other_camera(self) -> None:
        alone = document(Solver.OPENSFM, candidate(calibrated(BROWN)))
        assert list(alone) == ["all"]
        beside = document(
            Solver.OPENSFM, candidate(calibrated(BROWN)), candidate(slug="rejected", model="FC330")
        )
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
        assert list(document(Solver.OPENSFM, *cameras)) == [name]

    def test_a_frame_of_four_to_three_has_the_names_of_old_and_new_releases(self) -> None:
        camera = candidate(calibrated(BROWN), size=(4000, 3000))
        names = document(Solver.OPENSFM, camera, candidate(slug="other", model="Other"))
        assert {name.split()[-1] for name in names} == {"0.6666", "0.7058"}

    def test_a_resized_frame_goes_by_its_size_in_exif_as_well(self) -> None:
        camera = candidate(calibrated(BROWN), size=(2736, 1824), exif_size=SIZE)
        names = document(Solver.OPENSFM, camera, candidate(slug="other", model="Other"))
        assert {" ".join(name.split()[3:5]) for name in names} == {"2736 1824", "5472 3648"}

    @pytest.mark.parametrize("rejected", [False, True])
    def test_of_two_cameras_of_one_name_each_image_is_told_its_camera(self, rejected: bool) -> None:
        two = replace(
            candidate(None if rejected else calibrated(None), slug="dji-fc6310r-sn-222222"),
            names=("101/z.jpg",),
        )
        files = hand_off(Solver.OPENSFM, [candidate(calibrated(BROWN)), two])
        models = json.loads(files["camera_models_overrides.json"])
        images = json.loads(files["exif_overrides.json"])
        assert set(models) == {"dji-fc6310r"} | (set() if rejected else {two.slug})
        assert images == {
            "a.jpg": {"camera": "dji-fc6310r"},
            "b c.jpg": {"camera": "dji-fc6310r"},
            "z.jpg": {"camera": "dji-fc6310r-sn-222222"},
        }
        [note] = notes(Solver.OPENSFM, files)
        assert "exif_overrides.json" in note

    def test_images_of_one_name_in_two_folders_are_refused(self) -> None:
        two = replace(candidate(calibrated(None), slug="two"), names=("101/a.jpg",))
        with pytest.raises(UnsupportedModelError, match="folder of its own"):
            hand_off(Solver.OPENSFM, [candidate(calibrated(BROWN)), two])

    def test_exif_that_only_gdal_reads_makes_an_unknown_camera(self) -> None:
        cameras = (candidate(calibrated(BROWN), exif_in_text=True), candidate(slug="other", model="Other"))
        assert list(document(Solver.OPENSFM, *cameras)) == ["v2 unknown unknown 5472 3648 perspective 0.0"]


class TestOdm:
    def test_it_sees_every_point_where_calibrary_sees_it(self) -> None:
        calibration = calibrated(BROWN_5)
        for model in document(Solver.ODM, candidate(calibration)).values():
            assert_same_px(opensfm_sees(model, POINTS), calibration)
            assert model["focal"] == pytest.approx((3660.5 + 3655.25) / 2 / 5472, rel=1e-15)

    def test_its_names_are_opensfms_without_the_version(self) -> None:
        names = document(Solver.ODM, candidate(calibrated(BROWN), exif_size=(4000, 3000)))
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
        assert name in document(Solver.ODM, candidate(calibrated(BROWN), **told))

    def test_cameras_that_differ_in_their_lens_alone_are_one_to_odm(self) -> None:
        two = candidate(calibrated(None), slug="two", lens="XT 24")
        files = hand_off(Solver.ODM, [candidate(calibrated(BROWN), lens="XT 35"), two])
        assert set(files) == {"cameras.dji-fc6310r.json", "cameras.two.json"}

    def test_a_coefficient_it_would_drop_is_refused(self) -> None:
        with pytest.raises(UnsupportedModelError, match="k4"):
            hand_off(Solver.ODM, [candidate(calibrated(FISHEYE))])

    def test_two_cameras_of_one_name_have_a_file_each_for_a_run_of_their_own(self) -> None:
        files = hand_off(Solver.ODM, [candidate(calibrated(BROWN)), candidate(calibrated(None), slug="two")])
        assert set(files) == {"cameras.dji-fc6310r.json", "cameras.two.json"}
        for content in files.values():
            assert "dji fc6310r 5472 3648 brown 0.6666" in json.loads(content)
        [note] = notes(Solver.ODM, files)
        assert "--cameras" in note


class TestOpenCv:
    @pytest.mark.parametrize("distortion", [BROWN, BROWN_5, RATIONAL])
    def test_it_reads_its_own_file_and_sees_every_point_half_a_pixel_nearer(
        self, tmp_path: Path, distortion: Distortion
    ) -> None:
        calibration = calibrated(distortion)
        [(name, content)] = hand_off(Solver.OPENCV, [candidate(calibration)]).items()
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
        assert set(hand_off(Solver.OPENCV, cameras)) == {"dji-fc6310r.opencv.yml", "two.opencv.yml"}


class TestTheOthers:
    @pytest.mark.parametrize("solver", [Solver.METASHAPE, Solver.PIX4D])
    def test_each_camera_has_a_file_that_reads_back(self, tmp_path: Path, solver: Solver) -> None:
        square = replace(calibrated(BROWN_5), intrinsics=replace(calibrated(BROWN_5).intrinsics, fy=3660.5))
        [(name, content)] = hand_off(solver, [candidate(square)]).items()
        (tmp_path / name).write_bytes(content)
        back = calibrary.read(tmp_path / name, image_size=SIZE)
        assert_same_px(back.project(POINTS), square)

    def test_realityscan_has_a_row_for_each_image(self, tmp_path: Path) -> None:
        radial = BrownConrady(k1=-0.031, k2=0.012, p1=0.0, p2=0.0, k3=0.001)
        square = replace(calibrated(radial), intrinsics=replace(calibrated(radial).intrinsics, fy=3660.5))
        [(name, content)] = hand_off(Solver.REALITYSCAN, [candidate(square)]).items()
        (tmp_path / name).write_bytes(content)
        assert [row.split(",")[0] for row in content.decode().splitlines()[1:]] == ["a.jpg", "b c.jpg"]
        for back in calibrary.read_all(tmp_path / name, image_size=SIZE):
            assert_same_px(back.project(POINTS), square)


SOLVERS = [solver for solver in Solver if solver is not Solver.NONE]


@pytest.mark.parametrize("solver", SOLVERS)
def test_where_no_k_may_be_used_nothing_is_written(solver: Solver) -> None:
    assert hand_off(solver, [candidate(), candidate(slug="two")]) == {}
    assert hand_off(solver, []) == {}


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_run_hands_over_valid_ks_only_and_names_the_others(tmp_path: Path, solver: Solver) -> None:
    flight = tmp_path / "flight"
    picture(flight / "valid.jpg", **P4R, dewarp=DEWARP, focal_35mm=24)
    picture(flight / "unproven.jpg", **NOBODY)
    picture(flight / "rejected.jpg", (4000, 3000))
    outputs = plan(gate(flight), tmp_path / "K.npy", solver)
    written = "".join(
        content.decode() for path, content in outputs.files.items() if not re.match(r"K[._]", path.name)
    )
    assert set(outputs.not_handed_over) >= {"example-one-5472x3648", "unknown-camera-4000x3000"}
    if solver in {Solver.PIX4D, Solver.REALITYSCAN}:
        # They have one focal length, and this unit has two.
        assert "dji-fc6310r-5472x3648" in outputs.not_handed_over
        return
    assert "3660.5" in written or str(3660.5 / 5472) in written or solver is Solver.METASHAPE
    assert "5472.0" not in written
    assert "unproven.jpg" not in written
    assert "4000" not in written
    assert tmp_path / "K_unproven.example-one-5472x3648.npy" in outputs.files


def test_a_camera_the_solver_has_no_model_for_is_left_out_and_does_not_keep_the_others_back(
    tmp_path: Path,
) -> None:
    flight = tmp_path / "flight"
    picture(flight / "known.jpg", **P4R, dewarp=DEWARP, focal_35mm=24)
    picture(flight / "skewed.jpg", (4000, 3000))
    (flight / "skewed.xml").write_text(
        "<calibration><projection>frame</projection><width>4000</width><height>3000</height>"
        "<f>3000</f><cx>0</cx><cy>0</cy><b2>1.5</b2></calibration>"
    )
    outputs = plan(gate(flight), tmp_path / "K.npy", Solver.COLMAP)
    assert "no skew" in outputs.not_handed_over["unknown-camera-4000x3000"]
    assert b"3660.5" in outputs.files[tmp_path / "colmap.sh"]
    assert any("not handed to colmap" in warning for warning in outputs.warnings)
    assert b"not handed to colmap" in outputs.report
