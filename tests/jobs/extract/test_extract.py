"""calibrary.extract: a folder, an image or a list in; cameras, what was skipped and why, and progress out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import calibrary
from calibrary.errors import InputError, ValidationError
from calibrary.policy import SOURCE
from calibrary.records import replace
from calibrary.schemas import require
from tests.imagery import ExifTags, write_jpeg
from tests.workshop import CAMERA, survey

UNKNOWN = ExifTags(make="Nobody", model="Knows It", focal_mm=(12, 1))


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """A good camera, one that nobody knows, and a file that is no image."""
    survey(tmp_path / "flight")
    write_jpeg(tmp_path / "flight/sub/odd.jpg", (5184, 3896), exif=UNKNOWN)
    (tmp_path / "flight/broken.jpg").write_bytes(b"no image at all")
    return tmp_path / "flight"


def test_a_folder_gives_every_camera_with_its_verdict_and_what_to_do(mixed: Path) -> None:
    result = calibrary.extract(mixed, recursive=True)
    good, odd = sorted(result.cameras, key=lambda camera: camera.verdict)[::-1]
    assert good.verdict is calibrary.Verdict.VALID
    assert good.calibration is not None
    assert good.calibration.intrinsics == CAMERA.intrinsics
    assert good.images == ("DJI_0001.JPG", "DJI_0002.JPG")
    assert (good.why, good.what_to_do) == (None, None)
    assert odd.verdict is not calibrary.Verdict.VALID
    assert odd.images == ("sub/odd.jpg",)
    assert odd.why
    assert odd.what_to_do
    assert [one.name for one in result.rejected] == ["broken.jpg"]
    assert "JPEG, TIFF" in result.rejected[0].reason
    assert not result.is_good


def test_a_list_of_images_is_named_from_where_they_all_lie(mixed: Path) -> None:
    result = calibrary.extract([str(mixed / "DJI_0001.JPG"), mixed / "sub/odd.jpg"])
    assert sorted(name for camera in result.cameras for name in camera.images) == [
        "DJI_0001.JPG",
        "sub/odd.jpg",
    ]
    assert result.rejected == result.skipped == ()


def test_images_and_folders_may_be_mixed_and_none_is_read_twice(mixed: Path) -> None:
    result = calibrary.extract([mixed / "DJI_0001.JPG", mixed], sensor_width_mm=13.2, sensor_height_mm=8.8)
    [camera] = result.cameras
    assert camera.images == ("DJI_0001.JPG", "DJI_0002.JPG")


def test_one_image_is_enough(mixed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(mixed)
    result = calibrary.extract("DJI_0001.JPG")
    assert result.is_good
    assert result.cameras[0].images == ("DJI_0001.JPG",)


def test_a_calibration_beside_a_listed_image_is_found(mixed: Path) -> None:
    own = replace(
        CAMERA,
        intrinsics=replace(
            CAMERA.intrinsics, fx=4400.0, fy=4400.0, cx=2592.0, cy=1948.0, image_size=(5184, 3896)
        ),
        camera=replace(CAMERA.camera, image_size=None),
    )
    calibrary.write(own, mixed / "sub/lab.xml", format="agisoft_xml")
    [camera] = calibrary.extract([mixed / "sub/odd.jpg"]).cameras
    assert camera.why is not None
    assert "lab.xml" in camera.why


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ([], "no image was given"),
        ("nowhere", "nowhere: does not exist"),
        (["DJI_0001.JPG", "DJI_0009.JPG"], r"DJI_0009\.JPG: does not exist"),
        ("sub/empty", r"sub/empty: contains no images"),
    ],
)
def test_what_is_not_there_is_said(
    mixed: Path, monkeypatch: pytest.MonkeyPatch, images: str | list[str], message: str
) -> None:
    (mixed / "sub/empty").mkdir()
    monkeypatch.chdir(mixed)
    with pytest.raises(InputError, match=message):
        calibrary.extract(images)


def test_progress_is_told_as_so_many_of_so_many(mixed: Path) -> None:
    steps: list[tuple[int, int, str]] = []
    calibrary.extract(mixed, progress=lambda done, total, what: steps.append((done, total, what)))
    assert steps == [(0, 3, "images"), (3, 3, "images")]


def test_the_policy_is_one_a_name_or_a_file(mixed: Path, tmp_path: Path) -> None:
    (tmp_path / "house.yaml").write_text("schema: calibrary/policy-1\nname: house\nbase: source\n")
    printed = [calibrary.extract(mixed, policy=one) for one in (SOURCE, "source", tmp_path / "house.yaml")]
    assert [result.to_dict()["policy"] for result in printed] == ["source", "source", "house"]


def test_strict_validation_raises_with_the_report(mixed: Path) -> None:
    with pytest.raises(ValidationError) as error:
        calibrary.extract(mixed / "sub", strict_validation=True)
    assert error.value.report.verdict is not calibrary.Verdict.VALID


def test_it_is_plain_data_by_the_commands_schema(mixed: Path, capfd: pytest.CaptureFixture[str]) -> None:
    document = calibrary.extract(mixed, recursive=True).to_dict()
    require(json.loads(json.dumps(document, allow_nan=False)), "report-1", source="to_dict")
    assert capfd.readouterr() == ("", "")
