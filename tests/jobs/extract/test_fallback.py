"""What stands in where images yield no valid K: the order, the record of each step, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calibrary import check
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.errors import InputError, MissingTagError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.convert import convert
from calibrary.jobs.extract.calibration_files import Rightness
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.fallback import Fallback, Sources, StepName, fall_back
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.files import write
from calibrary.jobs.k import k
from calibrary.parsers import read
from calibrary.policy import FLEET
from calibrary.records import encoded, replace
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import (
    KNOWLEDGE,
    NOBODY,
    P4R,
    entry,
    files,
    gate,
    judged,
    matrix,
    only,
    picture,
)

STRIPPED = ImageMetadata(size=(5472, 3648))
METASHAPE = (
    "<calibration><projection>frame</projection><width>5472</width><height>3648</height>"
    "<f>3660.5</f><cx>-4.5</cx><cy>22.75</cy><k1>0.01</k1></calibration>"
)


def steps_of(camera: JudgedCamera) -> list[tuple[str, str]]:
    assert camera.fallback is not None
    return [(step.step.value, step.outcome.value) for step in camera.fallback.steps]


def why(camera: JudgedCamera, step: StepName) -> str:
    assert camera.fallback is not None
    return next(taken.why for taken in camera.fallback.steps if taken.step is step)


def focal_px(camera: JudgedCamera) -> float:
    assert camera.calibration is not None
    return camera.calibration.intrinsics.fx


def opencv_file(
    path: Path, fx: float = 3660.5, size: tuple[int, int] = (5472, 3648), k1: float = 0.01
) -> None:
    """As OpenCV's own calibration program writes one."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", size[0])
    storage.write("image_height", size[1])
    K = np.array([[fx, 0, size[0] / 2 - 5.0], [0, fx, size[1] / 2 + 20.0], [0, 0, 1]])
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", np.array([[k1, 0.0, 0.0, 0.0, 0.0]]))
    storage.release()


class TestTheOrder:
    def test_a_camera_with_a_valid_k_tries_nothing(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", **P4R)
        assert only(gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 4000.0))).fallback is None

    def test_an_explicit_k_comes_first_and_ends_the_chain(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        (tmp_path / "camera.xml").write_text(METASHAPE)
        camera = only(gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.25)))
        assert steps_of(camera) == [("fallback-k", "taken")]
        assert focal_px(camera) == 3700.25

    def test_a_file_beside_the_images_comes_second(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", make="DJI", model="FC6310R")
        (tmp_path / "camera.xml").write_text(METASHAPE)
        approved = entry(tmp_path / "registry")
        lens = "k1: 0.01, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0}"
        approved.write_text(re.sub("k1: .*}", lens, approved.read_text()))
        camera = only(gate(tmp_path, registry=files(tmp_path / "registry")))
        assert steps_of(camera) == [("fallback-k", "not there"), ("calibration-file", "taken")]

    def test_a_file_that_contradicts_the_approved_entry_does_not_displace_it(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", make="DJI", model="FC6310R")
        (tmp_path / "camera.xml").write_text(METASHAPE.replace("3660.5", "3850.5"))
        entry(tmp_path / "registry")
        camera = only(gate(tmp_path, registry=files(tmp_path / "registry")))
        assert (camera.verdict, focal_px(camera)) == (Verdict.VALID, 3661.25)
        assert steps_of(camera)[1] == ("calibration-file", "refused")
        assert "states fx = 3666.2 px, -4.8%" in why(camera, StepName.CALIBRATION_FILE)

    def test_a_seed_is_kept_aside_and_the_registry_comes_last(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", make="DJI", model="FC6310R")
        entry(tmp_path / "registry")
        camera = only(gate(tmp_path, registry=files(tmp_path / "registry")))
        assert steps_of(camera) == [
            ("fallback-k", "not there"),
            ("calibration-file", "not there"),
            ("self-calibration-seed", "kept as a seed"),
            ("registry", "taken"),
        ]
        assert focal_px(camera) == 3661.25
        assert camera.fallback is not None
        assert camera.fallback.seed is None

    def test_where_nothing_helps_every_step_says_why_and_a_seed_remains(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        camera = only(gate(tmp_path))
        assert (camera.verdict, camera.calibration) == (Verdict.REJECTED, None)
        assert camera.fallback is not None
        assert all(step.why for step in camera.fallback.steps)
        assert camera.fallback.seed is not None
        assert camera.fallback.seed.grade is Grade.SEED
        assert camera.fallback.seed.intrinsics.matrix.tolist() == [
            [0.8 * 5472, 0, 2736],
            [0, 0.8 * 5472, 1824],
            [0, 0, 1],
        ]

    def test_what_stands_in_is_said_beside_what_was_wrong(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        camera = only(gate(tmp_path, fallback_k=matrix(tmp_path / "unit 7.npy", 3700.0)))
        assert camera.verdict is Verdict.VALID
        assert camera.reason is not None
        assert "unit 7.npy" in camera.reason
        assert "no EXIF" in camera.reason


class TestAnExplicitK:
    def test_it_is_taken_as_it_stands_counted_as_opencv_counts(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        given = matrix(tmp_path / "K.npy", 3700.123456789, 2731.1, 1830.3, fy=3701.3)
        camera = only(gate(tmp_path, fallback_k=given))
        assert camera.calibration is not None
        half = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
        assert (camera.calibration.intrinsics.matrix == np.load(given) + half).all()
        assert camera.calibration.distortion is None
        assert camera.calibration.provenance.source == "K.npy"

    @pytest.mark.parametrize(
        "array",
        [
            np.eye(4),
            np.array([[np.nan, 0, 1], [0, 1, 1], [0, 0, 1]]),
            np.zeros((3, 3)),
            np.array([{"fx": 1}], dtype=object),
        ],
        ids=["shape", "not finite", "no K", "pickled"],
    )
    def test_it_must_be_a_k(
        self, tmp_path: Path, array: np.ndarray[tuple[int, ...], np.dtype[np.generic]]
    ) -> None:
        picture(tmp_path / "a.jpg")
        np.save(tmp_path / "K.npy", array)
        with pytest.raises(InputError, match=r"K\.npy"):
            gate(tmp_path, fallback_k=tmp_path / "K.npy")

    def test_a_k_of_another_frame_is_refused(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        camera = only(gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 2700.0, 2000.0, 1500.0)))
        assert camera.verdict is Verdict.REJECTED
        assert "principal point" in why(camera, StepName.FALLBACK_K)

    def test_a_k_unlike_the_known_camera_is_refused(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", make="DJI", model="FC6310R")
        camera = only(gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3900.0)))
        assert "catalogue" in why(camera, StepName.FALLBACK_K)

    def test_it_is_refused_when_two_cameras_of_its_frame_need_it(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        picture(tmp_path / "b.jpg", make="Example", model="Two")
        outcome = gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.0))
        for camera in outcome.judged:
            assert camera.calibration is None
            assert "2 cameras" in why(camera, StepName.FALLBACK_K)

    def test_a_camera_of_the_same_frame_with_a_k_of_its_own_is_no_rival(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        picture(tmp_path / "b.jpg", **P4R)
        outcome = gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.0))
        assert sorted(map(focal_px, outcome.judged)) == [pytest.approx(8800 / 2.4), 3700.0]


class TestAFileBesideTheImages:
    @pytest.mark.parametrize("name", ["camera.yml", "camera.yaml", "camera.xml"])
    def test_opencvs_principal_point_comes_half_a_pixel_further(self, tmp_path: Path, name: str) -> None:
        picture(tmp_path / "a.jpg")
        opencv_file(tmp_path / name)
        camera = only(gate(tmp_path))
        assert camera.calibration is not None
        K = camera.calibration.intrinsics
        assert (K.fx, K.cx, K.cy) == (3660.5, 2736.0 - 4.5, 1824.0 + 20.5)
        assert camera.calibration.distortion == BrownConrady(k1=0.01, k2=0.0, p1=0.0, p2=0.0)
        assert camera.calibration.provenance.source == name

    def test_agisofts_counts_from_the_middle(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        (tmp_path / "camera.xml").write_text(METASHAPE)
        camera = only(gate(tmp_path))
        assert camera.calibration is not None
        assert (camera.calibration.intrinsics.cx, camera.calibration.intrinsics.cy) == (2731.5, 1846.75)

    def test_it_is_scaled_with_the_frame(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", (2736, 1824))
        (tmp_path / "camera.xml").write_text(METASHAPE)
        camera = only(gate(tmp_path))
        assert camera.calibration is not None
        K = camera.calibration.intrinsics
        assert (K.fx, K.cx, K.cy, K.image_size) == (3660.5 / 2, 2731.5 / 2, 1846.75 / 2, (2736, 1824))

    def test_one_of_another_frame_is_not_used_and_its_frame_is_told(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", (4000, 3000))
        (tmp_path / "camera.xml").write_text(METASHAPE)
        found = gate(tmp_path)
        assert only(found).calibration is None
        assert found.warnings == (
            "beside the images, but not used: camera.xml: it is for 5472×3648, and no camera here has such images",
        )

    def test_one_that_cannot_be_read_is_told_and_other_files_are_left_alone(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        (tmp_path / "camera.xml").write_text(METASHAPE.replace("3660.5", "wide"))
        (tmp_path / "notes.txt").write_text("windy")
        (tmp_path / "flight.json").write_text("{}")
        [printed] = gate(tmp_path).warnings
        assert printed.startswith("beside the images, but not used: camera.xml: ")

    def test_files_with_one_cause_share_a_sentence_however_many_images_there_are(
        self, tmp_path: Path
    ) -> None:
        for name in "abc":
            picture(tmp_path / f"{name}.jpg", (4000, 3000))
            (tmp_path / f"{name}.xml").write_text(METASHAPE)
        [printed] = gate(tmp_path).warnings
        assert printed.startswith("beside the images, but not used: a.xml, b.xml, c.xml: ")

    def test_a_measured_one_beside_images_with_a_derived_k_is_told(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", **P4R)
        (tmp_path / "camera.xml").write_text(METASHAPE)
        found = gate(tmp_path)
        assert only(found).verdict is Verdict.VALID
        assert found.warnings == (
            "beside the images, but not used: camera.xml: the K of the images is valid without it, but not "
            "measured; a registry puts this one in its place",
        )

    def test_a_k_without_an_image_size_is_offered_to_fallback_k(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        off_centre = np.array([[3660.5, 0.0, 2700.0], [0.0, 3660.5, 1830.0], [0.0, 0.0, 1.0]])
        np.save(tmp_path / "K.npy", off_centre)
        assert "--fallback-k takes it" in f"{only(gate(tmp_path)).reason} {gate(tmp_path).warnings}"

    def test_it_is_looked_for_in_sub_folders_only_where_images_are(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        (tmp_path / "office").mkdir()
        (tmp_path / "office/camera.xml").write_text(METASHAPE)
        assert only(gate(tmp_path)).calibration is None
        assert focal_px(only(gate(tmp_path, recursive=True))) == 3660.5

    def test_two_that_differ_are_refused(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        opencv_file(tmp_path / "a.yml", fx=3660.0)
        opencv_file(tmp_path / "b.yml", fx=3665.0)
        assert str(only(gate(tmp_path)).reason).endswith(
            "; a.yml, b.yml is not used: 2 different calibrations fit images of this size; keep one"
        )

    def test_of_many_that_differ_three_are_named(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        for number in range(9):
            opencv_file(tmp_path / f"{number}.yml", fx=3660.0 + number)
        assert "0.yml, 1.yml, 2.yml and 6 more is not used: 9 different" in str(only(gate(tmp_path)).reason)

    def test_two_that_differ_in_their_distortion_alone_are_refused_as_well(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        opencv_file(tmp_path / "a.yml", k1=0.01)
        opencv_file(tmp_path / "b.yml", k1=-0.2)
        assert only(gate(tmp_path)).calibration is None

    def test_two_that_agree_are_one(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        opencv_file(tmp_path / "a.yml")
        opencv_file(tmp_path / "b.xml")
        assert focal_px(only(gate(tmp_path))) == 3660.5

    def test_one_that_names_no_camera_cannot_be_two_cameras(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg", make="Example", model="One")
        picture(tmp_path / "b.jpg", make="Example", model="Two")
        (tmp_path / "camera.xml").write_text(METASHAPE)
        for camera in gate(tmp_path).judged:
            assert camera.calibration is None
            assert "2 cameras" in why(camera, StepName.CALIBRATION_FILE)


def measured(model: str | None, fx: float = 3700.0) -> Calibration:
    return Calibration(
        camera=CameraKey(model=model),
        intrinsics=Intrinsics(fx=fx, fy=fx, cx=2736.0, cy=1824.0, image_size=(5472, 3648)),
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="calibration-file", source="cameras.xml"),
    )


def chain(camera: Camera, *files: Calibration, rivals: int = 1) -> Fallback:
    sources = Sources(
        matrix=None,
        files=tuple(("cameras.xml", calibration) for calibration in files),
        knowledge=KNOWLEDGE,
        rivals={(5472, 3648): rivals},
    )
    return fall_back(camera, FLEET, sources)


class TestAFileThatNamesItsCamera:
    def test_it_serves_that_model_only(self) -> None:
        [camera] = judged({replace(STRIPPED, make="Example", model="Two"): ["a.jpg"]})
        assert chain(camera, measured("One")).calibration is None
        taken = chain(camera, measured("One"), measured("TWO", 3705.0)).calibration
        assert taken is not None
        assert taken.intrinsics.fx == 3705.0

    def test_a_measured_one_serves_beside_what_an_earlier_run_wrote(self) -> None:
        [camera] = judged({STRIPPED: ["a.jpg"]})
        written = replace(measured(None, 3650.0), grade=Grade.DERIVED)
        taken = chain(camera, written, measured(None)).calibration
        assert taken is not None
        assert taken.intrinsics.fx == 3700.0
        assert chain(camera, written).calibration is None

    def test_it_may_serve_where_two_cameras_of_its_frame_need_one(self) -> None:
        [camera] = judged({replace(STRIPPED, make="Example", model="Two"): ["a.jpg"]})
        assert chain(camera, measured("Two"), rivals=2).calibration is not None
        assert chain(camera, measured(None), rivals=2).calibration is None

    def test_what_is_taken_is_of_the_camera_that_took_it(self) -> None:
        [camera] = judged({STRIPPED: ["a.jpg"]})
        taken = chain(camera, measured("Two")).calibration
        assert taken is not None
        assert taken.camera == camera.key


class TestAnUnprovenK:
    """A K that only lacks proof yields to a valid one, and to nothing less."""

    def unproven(self, folder: Path, **request: Path) -> ExtractReport:
        picture(folder / "a.jpg", **(NOBODY | {"focal_mm": (132, 10)}))
        return gate(folder, **request)

    def test_it_stays_where_there_is_no_better_one(self, tmp_path: Path) -> None:
        camera = only(self.unproven(tmp_path))
        assert (camera.verdict, focal_px(camera)) == (Verdict.UNPROVEN, 5472.0)
        assert camera.fallback is not None
        assert len(camera.fallback.steps) == 4
        assert camera.fallback.seed is None

    def test_it_yields_to_a_valid_one(self, tmp_path: Path) -> None:
        camera = only(self.unproven(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.0)))
        assert (camera.verdict, focal_px(camera)) == (Verdict.VALID, 3700.0)

    def test_it_does_not_yield_to_a_rejected_one(self, tmp_path: Path) -> None:
        camera = only(self.unproven(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.0, fy=4500.0)))
        assert (camera.verdict, focal_px(camera)) == (Verdict.UNPROVEN, 5472.0)
        assert steps_of(camera)[0] == ("fallback-k", "refused")

    def test_it_does_not_yield_to_an_unproven_one(self, tmp_path: Path) -> None:
        camera = only(self.unproven(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.0, fy=3800.0)))
        assert (camera.verdict, focal_px(camera)) == (Verdict.UNPROVEN, 5472.0)

    def test_a_rejected_k_yields_to_an_unproven_one(self, tmp_path: Path) -> None:
        picture(tmp_path / "a.jpg")
        camera = only(gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.0, fy=3800.0)))
        assert (camera.verdict, focal_px(camera)) == (Verdict.UNPROVEN, 3700.0)


def test_a_stand_in_is_not_held_against_the_k_that_failed(tmp_path: Path) -> None:
    """The images' K fails the 15 %; what replaces it need not be near it."""
    picture(tmp_path / "a.jpg", (3840, 2160), **(NOBODY | {"focal_mm": (88, 10)}))
    given = matrix(tmp_path / "K.npy", 4000.0, 1920.0, 1080.0)
    camera = only(gate(tmp_path, sensor_mm=(13.2, 8.8), fallback_k=given))
    assert (camera.verdict, focal_px(camera)) == (Verdict.VALID, 4000.0)


def test_a_stand_in_is_held_against_the_35_mm_equivalent(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", make="Example", model="One", focal_35mm=24)
    camera = only(gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 7000.0)))
    assert camera.verdict is Verdict.UNPROVEN
    assert camera.report is not None
    assert "FocalLengthIn35mmFilm" in camera.report.failures[0].message


def test_a_calibrated_stand_in_takes_the_camera_out_of_the_uncalibrated(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg")
    assert gate(tmp_path).uncalibrated
    assert not gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3700.0)).uncalibrated


def test_a_k_that_a_program_wrote_from_the_images_tags_proves_nothing_beside_them(tmp_path: Path) -> None:
    plane: dict[str, Any] = {"focal_plane_resolution": ((9697, 100), (9697, 100)), "focal_plane_unit": 4}
    image = picture(tmp_path / "a.jpg", (1280, 960), make="Example", model="One", focal_mm=(10, 1), **plane)
    alone = only(gate(tmp_path))
    assert alone.verdict is Verdict.UNPROVEN
    convert(image, tmp_path / "camera.xml", to="agisoft_xml")
    found = only(gate(tmp_path))
    assert (found.verdict, found.calibration) == (Verdict.UNPROVEN, alone.calibration)
    [checked] = check(tmp_path).files
    assert checked.verdict is Rightness.UNKNOWN
    assert "computed, and not measured" in checked.message


def test_what_extract_does_not_believe_of_an_image_is_no_k_of_the_image_as_a_file(tmp_path: Path) -> None:
    """17 791 px/in over 4608 px would be a sensor 6.58 mm wide; two lists state 6.16 mm of this camera."""
    plane: dict[str, Any] = {"focal_plane_resolution": ((17791, 1), (17791, 1)), "focal_plane_unit": 2}
    named: dict[str, Any] = {"make": "Canon", "model": "Canon PowerShot A3300 IS", "focal_mm": (5, 1)}
    image = picture(tmp_path / "a.jpg", (4608, 3456), **named, **plane)
    found = only(gate(tmp_path)).calibration
    assert found is not None
    assert found.intrinsics.fx == pytest.approx(5 / 6.16 * 4608)
    with pytest.raises(MissingTagError, match=r"would be a sensor 6\.58 mm wide"):
        read(image)


def test_what_is_only_inferred_of_an_unknown_sensor_is_no_k_of_the_image_as_a_file(tmp_path: Path) -> None:
    image = picture(tmp_path / "a.jpg", make="Example", model="One", focal_mm=(35, 1), focal_35mm=35)
    with pytest.raises(MissingTagError, match="nothing in the image gives K"):
        read(image)


class TestAGivenFileOfAnyFormat:
    def test_its_k_and_distortion_are_used(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg")
        opencv_file(tmp_path / "given.yml")
        camera = only(gate(tmp_path / "flight", fallback_k=tmp_path / "given.yml"))
        assert focal_px(camera) == pytest.approx(3660.5)
        assert camera.calibration is not None
        assert camera.calibration.distortion is not None
        assert camera.calibration.distortion.coefficients["k1"] == 0.01

    def test_one_for_another_frame_is_refused_with_the_two_sizes(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg")
        opencv_file(tmp_path / "given.yml", size=(4000, 2250))
        camera = only(gate(tmp_path / "flight", fallback_k=tmp_path / "given.yml"))
        assert camera.calibration is None
        assert why(camera, StepName.FALLBACK_K) == "it is for 4000×2250, and these images are 5472×3648"

    def test_a_bad_one_ends_the_run_with_its_readers_reason(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg")
        (tmp_path / "given.yml").write_text("<<<<<<< mine\nK: 1\n=======\nK: 2\n>>>>>>> theirs\n")
        with pytest.raises(InputError, match="unresolved merge of git"):
            gate(tmp_path / "flight", fallback_k=tmp_path / "given.yml")

    def test_a_folder_is_answered_with_the_files_in_it(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg")
        (tmp_path / "given").mkdir()
        opencv_file(tmp_path / "given/left.yml")
        with pytest.raises(InputError, match=r"is a folder .* choose one of left\.yml"):
            gate(tmp_path / "flight", fallback_k=tmp_path / "given")

    def test_a_document_of_ours_is_read(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg")
        opencv_file(tmp_path / "given.yml")
        (tmp_path / "k.json").write_bytes(encoded(k(tmp_path / "given.yml")))
        found = only(gate(tmp_path / "flight", fallback_k=tmp_path / "k.json"))
        assert focal_px(found) == pytest.approx(3660.5)

    def test_of_several_cameras_one_is_chosen_by_number_or_name(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg")
        opencv_file(tmp_path / "one.yml", fx=3660.5)
        left = read(tmp_path / "one.yml")[0]
        both = [
            replace(
                left, camera=CameraKey(sub_camera=name), intrinsics=replace(left.intrinsics, fx=fx, fy=fx)
            )
            for name, fx in (("left", 3660.5), ("right", 3670.5))
        ]
        write(both, tmp_path / "two.json", format="opensfm")
        told = why(only(gate(tmp_path / "flight", fallback_k=tmp_path / "two.json")), StepName.FALLBACK_K)
        assert told.startswith("it holds 2 cameras, choose one with --fallback-camera N: 1 ")
        for which in ("2", "right"):
            found = gate(tmp_path / "flight", fallback_k=tmp_path / "two.json", fallback_camera=which)
            assert focal_px(only(found)) == pytest.approx(3670.5)
