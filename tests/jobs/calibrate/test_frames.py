"""Which frames are meant, and what they agree on."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.jobs.calibrate.frames import Told, describe_frames, find_frames, without_resaved
from calibrary.records import replace
from tests.imagery import (
    ExifField,
    ExifTags,
    Namespace,
    XmpDescription,
    XmpPacket,
    attributes,
    write_jpeg,
)
from tests.jobs.calibrate.boards import FIRMWARE, MAKE, MODEL, exif

CRS = Namespace("crs", "http://ns.adobe.com/camera-raw-settings/1.0/")
DJI = Namespace("drone-dji", "http://www.dji.com/drone-dji/1.0/")


def shot(path: Path, tags: ExifTags | None = None, xmp: XmpPacket | None = None) -> Path:
    return write_jpeg(path, (64, 64), exif=tags or exif(), xmp=xmp)


def test_files_folders_and_patterns_are_taken_once_and_in_order(tmp_path: Path) -> None:
    b, a = shot(tmp_path / "set/b.jpg"), shot(tmp_path / "set/a.jpg")
    (tmp_path / "set/notes.txt").write_text("no image")
    shot(tmp_path / "set/.hidden.jpg")
    (tmp_path / "set/folder.jpg").mkdir()
    assert find_frames([b, tmp_path / "set", tmp_path / "set/*.jpg"]) == (b, a)


@pytest.mark.parametrize(
    ("operand", "said"),
    [("missing.jpg", "no such file"), ("*.png", "fits no file"), ("empty", "without images")],
)
def test_a_word_that_means_no_frame_is_named(tmp_path: Path, operand: str, said: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=said):
        find_frames([tmp_path / operand])


def test_camera_focus_and_firmware_are_what_the_frames_say(tmp_path: Path) -> None:
    setting = describe_frames([shot(tmp_path / "a.jpg"), shot(tmp_path / "b.jpg")], Told()).setting
    assert setting is not None
    assert (setting.camera.make, setting.camera.model) == (MAKE, MODEL)
    assert (setting.camera.firmware, setting.focus, setting.image_size) == (FIRMWARE, "1.5 m", (64, 64))
    assert setting.camera.serial is not None
    assert "A123" not in setting.camera.serial


def test_what_is_said_of_focus_stands_above_what_the_frames_say(tmp_path: Path) -> None:
    paths = [
        shot(tmp_path / "a.jpg", exif(focus_m=(15, 10))),
        shot(tmp_path / "b.jpg", exif(focus_m=(16, 10))),
    ]
    setting = describe_frames(paths, Told(focus="locked at infinity")).setting
    assert setting is not None
    assert setting.focus == "locked at infinity"


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (exif(model="Board Two"), "of 2 cameras"),
        (exif(firmware="02.00"), "firmware 02.00"),
        (exif(focus_m=(16, 10)), "of 2 focus settings"),
    ],
)
def test_frames_that_differ_are_told_apart_in_one_line(tmp_path: Path, other: ExifTags, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        describe_frames([shot(tmp_path / "a.jpg"), shot(tmp_path / "b.jpg", other)], Told())
    assert "\n" not in str(caught.value)


def test_a_frame_that_an_editor_bent_is_refused(tmp_path: Path) -> None:
    applied = attributes(CRS, AlreadyApplied="True", LensProfileEnable="1")
    edited = shot(tmp_path / "a.jpg", xmp=XmpPacket(descriptions=(XmpDescription(items=applied),)))
    with pytest.raises(InputError, match="lens-corrected by an editor"):
        describe_frames([edited], Told())


def test_a_frame_that_the_camera_straightened_is_a_mode_of_its_own(tmp_path: Path) -> None:
    straight = XmpPacket(descriptions=(XmpDescription(items=attributes(DJI, DewarpFlag="1")),))
    setting = describe_frames([shot(tmp_path / "a.jpg", xmp=straight)], Told()).setting
    assert setting is not None
    assert setting.camera.capture_mode == "dewarped"


def test_a_frame_that_was_made_smaller_is_noted(tmp_path: Path) -> None:
    tags = ExifTags(make=MAKE, model=MODEL, pixel_size=(640, 640))
    printed = describe_frames([shot(tmp_path / "a.jpg", tags)], Told())
    assert "640×640" in printed.notes[0]


def test_the_days_of_the_frames_are_the_first_and_the_last(tmp_path: Path) -> None:
    days = ("2019:05:18 08:00:00", "2019:05:17 23:59:59", None, "0000:00:00 00:00:00")
    paths = [shot(tmp_path / f"{n}.jpg", exif(date_time=day)) for n, day in enumerate(days)]
    assert describe_frames(paths, Told()).taken == (date(2019, 5, 17), date(2019, 5, 18))
    assert describe_frames(paths[2:], Told()).taken is None


def test_the_day_of_an_editor_is_not_that_of_the_frame(tmp_path: Path) -> None:
    tags = replace(exif(), overrides=(ExifField("DateTime", "2024:01:02 10:00:00"),))
    assert describe_frames([shot(tmp_path / "a.jpg", tags)], Told()).taken is None


def test_files_that_cannot_be_read_are_left_to_the_search(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"nothing")
    assert describe_frames([tmp_path / "a.jpg"], Told()).setting is None


def test_frames_that_a_viewer_saved_are_named_and_left_out(tmp_path: Path) -> None:
    ours = [shot(tmp_path / f"{n}.jpg") for n in range(3)]
    saved = shot(tmp_path / "s.jpg", exif(firmware="Microsoft Windows Photo Viewer 10.0"))
    tagged = shot(tmp_path / "t.jpg", exif(firmware="exiftool 12.4"))
    kept, skipped = without_resaved([*ours, saved, tagged])
    assert kept == (*ours, tagged)
    assert [one.name for one in skipped.remarks] == ["s.jpg"]
    assert "1 of 5 images were saved by Microsoft Windows Photo Viewer" in skipped.notes[0]
    assert without_resaved([ours[0], saved])[0] == (ours[0], saved), "nothing says which of the two is odd"
