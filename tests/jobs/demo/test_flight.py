"""The demonstration flight holds what its records say, and texts that must never come out again."""

from __future__ import annotations

from pathlib import Path

import exifread
import pytest
from PIL import Image

from calibrary.cli.main import main
from calibrary.jobs.demo.flight import DemoImage, Expectation
from tests.jobs.demo.conftest import Flight


def named(flight: Flight, name: str) -> tuple[Path, DemoImage]:
    out, images = flight
    return out / name, next(image for image in images if image.name == name)


def size_of(path: Path) -> tuple[int, int]:
    with Image.open(path) as image:
        return image.size


def exif_of(path: Path) -> dict[str, object]:
    with path.open("rb") as file:
        return {name: tag.values for name, tag in exifread.process_file(file, details=False).items()}


def test_every_file_has_one_record_and_every_record_its_file(flight: Flight) -> None:
    out, images = flight
    files = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert files == {image.name for image in images}
    assert len(files) == len(images)


def test_the_flight_is_light(flight: Flight) -> None:
    out, images = flight
    assert sum((out / image.name).stat().st_size for image in images) < 60e6


def test_whatever_is_not_broken_decodes(flight: Flight) -> None:
    out, images = flight
    for image in images:
        if image.outcome is not Expectation.UNREADABLE:
            with Image.open(out / image.name) as opened:
                opened.draft("L", (640, 480))
                opened.load()


def test_a_file_with_a_k_has_its_focal_length_and_its_grade_and_no_other_has(flight: Flight) -> None:
    _, images = flight
    for image in images:
        has_k = image.outcome in {Expectation.VALID, Expectation.UNPROVEN}
        assert (image.fx_px is not None) is has_k
        assert (image.grade is not None) is has_k


def test_the_zoomed_frame_and_those_without_a_focal_length_are_left_unproven(flight: Flight) -> None:
    _, images = flight
    unproven = [image.name for image in images if image.outcome is Expectation.UNPROVEN]
    assert sorted(unproven) == ["phantom4/DJI_0007.JPG", "phantom4pro/DJI_0102.JPG", "phone/DJI_0105.jpg"]


def test_the_rtk_frames_carry_their_lenses_calibration(flight: Flight) -> None:
    path, image = named(flight, "100_0001/100_0001_0001.JPG")
    assert image.fx_px == 3659.41
    assert b'drone-dji:DewarpData="2018-09-07;3659.41' in path.read_bytes()


def test_wide_and_thermal_share_one_model(flight: Flight) -> None:
    out, images = flight
    paths = [out / image.name for image in images if image.camera.startswith("Mavic 3T")]
    assert {str(exif_of(path)["Image Model"]) for path in paths} == {"M3T"}
    assert {size_of(path) for path in paths} == {(8000, 6000), (640, 512)}


def test_the_bands_count_in_millimetres_and_say_so(flight: Flight) -> None:
    for number, name in ((1, "Blue"), (4, "NIR")):
        path, _ = named(flight, f"micasense/0000SET/000/IMG_0000_{number}.tif")
        file = path.read_bytes()
        assert f"<Camera:BandName>{name}</Camera:BandName>".encode() in file
        assert b"<Camera:PerspectiveFocalLengthUnits>mm</Camera:PerspectiveFocalLengthUnits>" in file


def test_the_zoomed_frame_is_of_native_size(flight: Flight) -> None:
    path, _ = named(flight, "phantom4pro/DJI_0102.JPG")
    assert size_of(path) == (5472, 3648)
    assert exif_of(path)["EXIF DigitalZoomRatio"] == [2]


def test_the_phone_kept_only_the_equivalent(flight: Flight) -> None:
    exif = exif_of(named(flight, "phone/DJI_0105.jpg")[0])
    assert exif["EXIF FocalLengthIn35mmFilm"] == [24]
    assert "EXIF FocalLength" not in exif


def test_the_cloud_kept_nothing(flight: Flight) -> None:
    path, image = named(flight, "cloud/IMG_0412.jpg")
    assert exif_of(path) == {}
    assert image.private == ()


def test_the_broken_file_ends_within_its_exif(flight: Flight) -> None:
    path, image = named(flight, "100_0001/100_0001_0005.JPG")
    file = path.read_bytes()
    assert image.outcome is Expectation.UNREADABLE
    assert len(file) < 4 + int.from_bytes(file[4:6], "big")
    with pytest.raises(OSError, match="Truncated"):
        size_of(path)


def test_private_texts_are_in_the_files_that_list_them(flight: Flight) -> None:
    out, images = flight
    for image in images:
        if image.outcome is not Expectation.UNREADABLE:
            file = (out / image.name).read_bytes()
            absent = [text for text in image.private if text.encode() not in file]
            # MicaSense has no XMP of the position; EXIF tells it in degrees, minutes and seconds.
            assert len(absent) == (2 if image.camera.startswith("RedEdge") else 0), absent


def test_rtk_hosts_are_among_the_private_texts(flight: Flight) -> None:
    _, images = flight
    assert any("caster.survey.example" in image.private for image in images)


def test_the_command_prints_a_row_for_every_story(
    flight: Flight, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, images = flight
    monkeypatch.setattr(
        "calibrary.jobs.demo.flight.write_demo", lambda _out, *, seed: images if seed == 3 else []
    )
    assert main(["demo", str(out), "--seed", "3"]) == 0
    printed = capsys.readouterr().out
    assert f"{len(images)} files" in printed
    assert all(image.camera in printed for image in images)
    assert not any(text in printed for image in images for text in image.private)


def test_where_there_is_no_terminal_no_file_name_is_broken(
    flight: Flight, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, images = flight
    monkeypatch.setattr("calibrary.jobs.demo.flight.write_demo", lambda _out, **_flags: images)
    assert main(["demo", str(out)]) == 0
    printed = capsys.readouterr().out
    first = {image.camera + image.story: image.name for image in reversed(images)}
    assert all(name in printed for name in first.values())


def test_a_folder_that_cannot_be_made_is_said_without_a_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert main(["demo", str(blocked / "flight")]) == 3
    assert "cannot write the flight" in capsys.readouterr().err
