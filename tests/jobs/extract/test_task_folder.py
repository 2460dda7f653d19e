"""A task that ODM, WebODM or OpenSfM takes as it is: images in one folder, cameras, options."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

import calibrary
from calibrary import FLEET
from calibrary.errors import InputError
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.hand_off import _flat_names, hand_off, lay_out
from calibrary.jobs.extract.outputs import check_task_place
from calibrary.jobs.extract.targets import Candidate
from calibrary.records import replace
from tests.jobs.extract.fleet import DEWARP, P4R, picture
from tests.jobs.extract.handed import BROWN, FIXED, calibrated, candidate

MAPPED: dict[str, Any] = {**P4R, "focal_35mm": 24, "dewarp": DEWARP}


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Two folders of images of one measured camera, two of one name."""
    for name in ("1/a.jpg", "1/b.jpg", "2/a.jpg"):
        picture(tmp_path / "flight" / name, **MAPPED)
    return tmp_path / "flight"


GRANTING = replace(FLEET, name="granting", maker_sigma_px=0.3)
"""The house trusts what its makers write, so it is kept fixed."""


def made(
    flight: Path, folder: Path, solver: Program = "odm", *, copy_images: bool = False
) -> calibrary.ExtractReport:
    place = folder.parent / "K.npy"
    return calibrary.extract(
        flight, recursive=True, out=place, to=solver, task=folder, copy_images=copy_images, policy=GRANTING
    )


def test_odm_gets_every_image_in_one_folder_and_its_cameras_and_options(flight: Path, tmp_path: Path) -> None:
    task = tmp_path / "survey"
    result = made(flight, task)
    names = sorted(path.name for path in (task / "images").iterdir())
    assert names == ["1_a.jpg", "1_b.jpg", "2_a.jpg"]
    assert (task / "images/2_a.jpg").samefile(flight / "2/a.jpg")
    cameras = json.loads((task / "cameras.json").read_text())
    assert "dji fc6310r 5472 3648 brown 0.6666" in cameras
    [camera] = result.cameras
    assert camera.calibration is not None
    read = calibrary.read_all(task / "cameras.json")[0]
    assert read.intrinsics.fx == pytest.approx(camera.calibration.intrinsics.fx, rel=1e-12)
    # As POST /task/new of NodeODM takes them: a list of names and values, JSON within JSON.
    options = {one["name"]: one["value"] for one in json.loads((task / "options.json").read_text())}
    assert options.keys() == {"cameras", "use-fixed-camera-params"}
    assert json.loads(options["cameras"]) == cameras


def test_odms_container_is_called_with_the_folder_above_the_task(flight: Path, tmp_path: Path) -> None:
    task = tmp_path / "my survey"
    made(flight, task)
    (tmp_path / "bin").mkdir()
    docker = tmp_path / "bin/docker"
    docker.write_text('#!/bin/sh\nprintf "%s\\n" "$@" > "$CALLS"\n')
    docker.chmod(0o755)
    environment = {"PATH": f"{tmp_path / 'bin'}:/usr/bin:/bin", "CALLS": str(tmp_path / "calls")}
    subprocess.run(["sh", task / "odm.sh", "--fast-orthophoto"], env=environment, check=True)
    assert (tmp_path / "calls").read_text().splitlines() == [
        *("run", "--rm", "-v", f"{tmp_path}:/datasets", "opendronemap/odm"),
        *("--project-path", "/datasets", "my survey"),
        *("--cameras", "/datasets/my survey/cameras.json"),
        *("--use-fixed-camera-params", "--fast-orthophoto"),
    ]


def test_copies_are_files_of_their_own(flight: Path, tmp_path: Path) -> None:
    made(flight, tmp_path / "survey", copy_images=True)
    copy = tmp_path / "survey/images/1_b.jpg"
    assert copy.read_bytes() == (flight / "1/b.jpg").read_bytes()
    assert not copy.samefile(flight / "1/b.jpg")


def test_opensfm_finds_its_files_by_their_names(flight: Path, tmp_path: Path) -> None:
    made(flight, tmp_path / "survey", "opensfm")
    assert sorted(path.name for path in (tmp_path / "survey").iterdir()) == [
        *("camera_models_overrides.json", "config.yaml", "images"),
    ]
    assert (tmp_path / "survey/config.yaml").read_text() == "optimize_camera_parameters: no\n"


def test_of_cameras_that_opensfm_calls_alike_each_image_in_the_task_names_its_own(tmp_path: Path) -> None:
    names = [("1/a.jpg",), ("2/a.jpg",)]
    cameras = [
        Candidate(slug=slug, calibration=calibrated(lens), states=candidate().states, names=images)
        for slug, lens, images in zip(("one", "two"), (BROWN, None), names, strict=True)
    ]
    for (name,) in names:
        picture(tmp_path / "flight" / name)
    task = hand_off("opensfm", cameras, root=tmp_path / "flight", folder=tmp_path, task=tmp_path / "survey")
    images = json.loads(task.files[tmp_path / "survey/exif_overrides.json"])
    assert images == {"1_a.jpg": {"camera": "one"}, "2_a.jpg": {"camera": "two"}}
    assert {path.name for path in task.images} == set(images)
    # One of the two was not measured, so adjustment is to find its distortion.
    assert tmp_path / "survey/config.yaml" not in task.files


def test_cameras_that_odm_calls_alike_have_a_folder_each(tmp_path: Path) -> None:
    cameras = [
        candidate(calibrated(BROWN), allowed=FIXED),
        Candidate(slug="two", calibration=calibrated(None), states=candidate().states, names=("z.jpg",)),
    ]
    for name in (*cameras[0].names, "z.jpg"):
        picture(tmp_path / "flight" / name)
    task = hand_off("odm", cameras, root=tmp_path / "flight", folder=tmp_path, task=tmp_path / "survey")
    assert {str(path.relative_to(tmp_path / "survey")) for path in task.images} == {
        *("dji-fc6310r/images/a.jpg", "dji-fc6310r/images/b c.jpg", "two/images/z.jpg"),
    }
    options = {
        path.parent.name: content for path, content in task.files.items() if path.name == "options.json"
    }
    assert {name: b"use-fixed-camera-params" in content for name, content in options.items()} == {
        "dji-fc6310r": True,
        "two": False,
    }
    assert [one.why.partition(";")[0] for one in task.cameras] == [
        "alone, for ODM does not tell it from two",
        "alone, for ODM does not tell it from dji-fc6310r",
    ]


def test_an_image_that_odm_does_not_read_is_left_out_with_a_note(tmp_path: Path) -> None:
    camera = Candidate(
        slug="one", calibration=calibrated(BROWN), states=candidate().states, names=("a.jpg", "b.DNG")
    )
    picture(tmp_path / "a.jpg")
    task = hand_off("odm", [camera], root=tmp_path, folder=tmp_path, task=tmp_path / "survey")
    assert [path.name for path in task.images] == ["a.jpg"]
    [row] = task.cameras
    assert row.images == 1
    assert row.why.endswith("1 more stay out, for odm does not read .dng")


@pytest.mark.parametrize("name", ["s3://bucket/a.jpg", "gone.jpg"])
def test_what_is_no_file_of_this_machine_cannot_be_in_a_task(tmp_path: Path, name: str) -> None:
    camera = Candidate(slug="one", calibration=calibrated(BROWN), states=candidate().states, names=(name,))
    with pytest.raises(InputError, match="not a file of this machine"):
        hand_off("odm", [camera], root=tmp_path, folder=tmp_path, task=tmp_path / "survey")


def test_a_task_that_cannot_be_finished_leaves_no_image_behind(tmp_path: Path) -> None:
    camera = Candidate(
        slug="one", calibration=calibrated(BROWN), states=candidate().states, names=("a.jpg", "b.jpg")
    )
    for name in camera.names:
        picture(tmp_path / name)
    task = hand_off("odm", [camera], root=tmp_path, folder=tmp_path, task=tmp_path / "survey")
    (tmp_path / "b.jpg").unlink()
    with pytest.raises(InputError, match="cannot be linked"):
        lay_out(task)
    assert not [*(tmp_path / "survey/images").iterdir()]


def test_a_folder_with_something_in_it_is_refused_before_any_image_is_read(tmp_path: Path) -> None:
    check_task_place(tmp_path / "new")
    (tmp_path / "old").mkdir()
    check_task_place(tmp_path / "old")
    (tmp_path / "old/images").mkdir()
    with pytest.raises(InputError, match="new or empty folder"):
        check_task_place(tmp_path / "old")


@pytest.mark.parametrize(
    ("names", "flat"),
    [
        ([], []),
        (["/f/a.jpg", "/f/b.jpg"], ["a.jpg", "b.jpg"]),
        (["/f/a.jpg", "/g/a.jpg"], ["f_a.jpg", "g_a.jpg"]),
    ],
)
def test_in_one_folder_images_have_their_names_and_their_folders_only_if_two_are_alike(
    names: list[str], flat: list[str]
) -> None:
    assert _flat_names(names) == dict(zip(names, flat, strict=True))


def test_two_images_whose_names_are_alike_even_with_their_folders_are_refused() -> None:
    with pytest.raises(InputError, match=r"would have the name of /f/g/a\.jpg in the task"):
        _flat_names(["/f/g/a.jpg", "/f_g/a.jpg", "/h/b.jpg"])
