"""On which day an image was taken, against Pillow's own reading of the same tags."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest
from PIL import Image

from calibrary.errors import InputError
from calibrary.parsers.imagery.taken import taken_on
from tests.imagery import ExifField, ExifTags, write_jpeg

SIZE = (64, 48)


def jpeg(path: Path, taken: str | None, *overrides: ExifField) -> Path:
    return write_jpeg(path, SIZE, exif=ExifTags(make="Example", date_time=taken, overrides=overrides))


def test_the_shutters_day_is_told_as_pillow_reads_it(tmp_path: Path) -> None:
    path = jpeg(tmp_path / "a.jpg", "2024:05:17 23:59:59")
    with Image.open(path) as image:
        text = image.getexif().get_ifd(0x8769)[0x9003]
    assert taken_on(path) == date(2024, 5, 17)
    assert text.startswith("2024:05:17")


def test_the_shutter_comes_before_the_editor(tmp_path: Path) -> None:
    path = jpeg(tmp_path / "a.jpg", "2024:05:17 10:00:00", ExifField("DateTime", "2025:01:01 10:00:00"))
    assert taken_on(path) == date(2024, 5, 17)


def test_a_tiffs_own_date_counts_where_there_is_no_other(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with Image.new("L", SIZE) as image:
        image.save(path, tiffinfo={306: "2023:11:02 08:00:00"})
    assert taken_on(path) == date(2023, 11, 2)


@pytest.mark.parametrize(
    "text", ["0000:00:00 00:00:00", "1970:01:01 00:00:00", "2024:13:40 00:00:00", "yesterday", ""]
)
def test_a_day_that_cannot_be_is_none(tmp_path: Path, text: str) -> None:
    assert taken_on(jpeg(tmp_path / "a.jpg", text)) is None


def test_an_image_without_one_says_none(tmp_path: Path) -> None:
    assert taken_on(write_jpeg(tmp_path / "bare.jpg", SIZE)) is None
    (tmp_path / "torn.jpg").write_bytes(b"\xff\xd8\xff\xe1\x00\x40Exif\0\0II*\0\xff\xff\xff\xff")
    assert taken_on(tmp_path / "torn.jpg") is None


def test_what_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        taken_on(tmp_path / "missing.jpg")
