"""How the lens was focused, out of EXIF that may be anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.parsers.imagery.taken import focus_of
from tests.imagery import ExifField, ExifTags, write_jpeg, write_tiff


def photo(path: Path, *fields: ExifField) -> Path:
    return write_jpeg(path, (64, 64), exif=ExifTags(make="Example", overrides=fields))


@pytest.mark.parametrize(
    ("distance", "words"),
    [((15, 10), "1.5 m"), ((0xFFFFFFFF, 1), "infinity"), ((0, 1), None), ((5, 0), None), ((0, 0), None)],
)
def test_a_distance_is_told_in_metres(tmp_path: Path, distance: tuple[int, int], words: str | None) -> None:
    assert focus_of(photo(tmp_path / "a.jpg", ExifField("SubjectDistance", (distance,)))) == words


@pytest.mark.parametrize(
    ("number", "words"), [(0, None), (1, "macro"), (2, "close"), (3, "distant"), (9, None)]
)
def test_a_range_stands_in_for_a_distance(tmp_path: Path, number: int, words: str | None) -> None:
    assert focus_of(photo(tmp_path / "a.jpg", ExifField("SubjectDistanceRange", (number,)))) == words


def test_a_distance_says_more_than_a_range(tmp_path: Path) -> None:
    both = (ExifField("SubjectDistance", ((2, 1),)), ExifField("SubjectDistanceRange", (3,)))
    assert focus_of(photo(tmp_path / "a.jpg", *both)) == "2 m"


@pytest.mark.parametrize(
    "field",
    [
        ExifField("SubjectDistance", (7,), type=3),
        ExifField("SubjectDistance", ((1, 1), (2, 1))),
        ExifField("SubjectDistance", ((1, 1),), offset=1 << 30),
        ExifField("SubjectDistanceRange", (1, 2)),
    ],
)
def test_a_tag_that_lies_says_nothing(tmp_path: Path, field: ExifField) -> None:
    assert focus_of(photo(tmp_path / "a.jpg", field)) is None


def test_a_tiff_says_it_as_a_jpeg_does(tmp_path: Path) -> None:
    tags = ExifTags(make="Example", overrides=(ExifField("SubjectDistance", ((3, 2),)),))
    assert focus_of(write_tiff(tmp_path / "a.tif", (64, 64), exif=tags)) == "1.5 m"


def test_frames_without_exif_say_nothing(tmp_path: Path) -> None:
    assert focus_of(write_jpeg(tmp_path / "a.jpg", (64, 64))) is None
    assert focus_of(write_jpeg(tmp_path / "b.jpg", (64, 64), exif=b"no TIFF")) is None
    assert focus_of(write_tiff(tmp_path / "c.tif", (64, 64))) is None


def test_what_is_no_image_says_nothing_and_what_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff")
    assert focus_of(tmp_path / "a.jpg") is None
    with pytest.raises(InputError, match=r"b\.jpg"):
        focus_of(tmp_path / "b.jpg")
