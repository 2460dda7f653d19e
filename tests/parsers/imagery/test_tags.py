"""All EXIF tags of an image as exifread reads them, without what is private, and within limits."""

from __future__ import annotations

import logging
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibrary.errors import CalibraryError, ParseError
from calibrary.parsers.imagery import tags as module
from calibrary.parsers.imagery.tags import MAX_VALUE, list_tags
from tests.imagery import ExifField, ExifTags, FieldType, GpsPosition, TiffPage, encode_tiff
from tests.imagery.structure import Field, Ifd, encode
from tests.parsers.imagery.build import big_tiff, heif, jpeg, jpeg_with_exif, png
from tests.thorough import examples

DJI_NOTE = struct.pack("<H", 2) + struct.pack("<HHI4s", 1, 2, 4, b"DJI\0")
DJI_NOTE += struct.pack("<HHIf", 9, 11, 1, -90.0) + bytes(4)
"""A MakerNote as DJI writes it: its own directory, with the maker and the pitch of the camera."""

CAMERA = ExifTags(
    make="DJI",
    model="FC9999",
    focal_mm=(88, 10),
    focal_35mm=24,
    body_serial="SERIAL-7",
    maker_note=DJI_NOTE,
    thumbnail=jpeg(),
    position=GpsPosition(latitude_deg=48.137154, longitude_deg=11.576124, altitude_m=519.73),
    overrides=(ExifField("Artist", "A. Pilot"), ExifField("LensSerialNumber", "SERIAL-8")),
)


def listed(folder: Path, data: bytes) -> tuple[dict[str, str], int]:
    path = folder / "image.bin"
    path.write_bytes(data)
    return list_tags(path)


def error_of(folder: Path, data: bytes) -> str:
    """Message of the one error, which has one line and names the file."""
    with pytest.raises(ParseError) as caught:
        listed(folder, data)
    message = str(caught.value)
    assert message.startswith("image.bin: ")
    assert "\n" not in message
    return message


def test_every_tag_is_listed_as_exifread_prints_it_with_those_of_the_maker_note(tmp_path: Path) -> None:
    tags, _ = listed(tmp_path, jpeg_with_exif(CAMERA.encode()))
    assert tags["Image Make"] == "DJI"
    assert tags["Image Model"] == "FC9999"
    assert tags["EXIF FocalLength"] == "44/5"
    assert tags["EXIF FocalLengthIn35mmFilm"] == "24"
    assert tags["MakerNote Make"] == "DJI"
    assert tags["MakerNote CameraPitch"] == "(-90.0,)"


def test_positions_serial_numbers_names_and_thumbnails_are_counted_not_listed(tmp_path: Path) -> None:
    tags, left_out = listed(tmp_path, jpeg_with_exif(CAMERA.encode()))
    shown = repr(tags)
    for private in ("GPS", "Serial", "SERIAL", "Artist", "Pilot", "Thumbnail", "48", "519"):
        assert private not in shown, private
    gps, pointer, serials, artist, thumbnail = 8, 1, 2, 1, 3
    assert left_out == gps + pointer + serials + artist + thumbnail


def test_a_tag_without_a_known_name_may_be_a_serial_number(tmp_path: Path) -> None:
    unnamed = Field(tag=0xBB96, type=FieldType.ASCII, values="5v25BtsZ|DL03-1706120-SC|")
    dng = Field(tag=0xC62F, type=FieldType.ASCII, values="SERIAL-9")
    make = Field(tag=0x010F, type=FieldType.ASCII, values="MicaSense")
    assert listed(tmp_path, encode([Ifd(fields=(make, unnamed, dng))])) == ({"Image Make": "MicaSense"}, 2)


@pytest.mark.parametrize(
    "data",
    [
        encode_tiff([TiffPage(size=(40, 30))], exif=replace(CAMERA, thumbnail=None)),
        png((40, 30), (b"eXIf", CAMERA.encode())),
        heif((40, 30), exif=CAMERA.encode()),
        heif((40, 30), exif=CAMERA.encode(), in_idat=True),
    ],
    ids=["tiff", "png", "heif", "heif-idat"],
)
def test_other_containers_have_the_same_tags(tmp_path: Path, data: bytes) -> None:
    expected, _ = listed(tmp_path, jpeg_with_exif(CAMERA.encode()))
    tags, _ = listed(tmp_path, data)
    values = {name: value for name, value in expected.items() if not name.endswith("Offset")}
    assert values.items() <= tags.items()


def test_values_are_short_and_printable_and_long_bytes_are_left_out(tmp_path: Path) -> None:
    fields = (
        ExifField("ImageDescription", "x" * 5000),
        ExifField("Software", b"v1\x1b[31m\xb5\0", type=FieldType.ASCII),
        ExifField("XPComment", b"\1" * 500),
    )
    tags, left_out = listed(tmp_path, jpeg_with_exif(ExifTags(overrides=fields).encode()))
    assert tags == {"Image ImageDescription": "x" * (MAX_VALUE - 1) + "…", "Image Software": "v1[31mµ"}
    assert left_out == 1


def test_a_file_without_tags_is_one_line(tmp_path: Path) -> None:
    assert "not a JPEG, TIFF, DNG, PNG or HEIF image" in error_of(tmp_path, b"<calibration/>")
    assert "no EXIF block" in error_of(tmp_path, jpeg())
    assert "TIFF header was expected" in error_of(tmp_path, jpeg_with_exif(b"\0" * 50))
    assert "BigTIFF" in error_of(tmp_path, big_tiff(">", [(0x0100, 3, 1, b"\0\x28")]))


def test_an_error_within_exifread_is_one_line(tmp_path: Path) -> None:
    focal = ExifField("FocalLength", (8.8,), type=FieldType.DOUBLE, offset=60_000)
    message = error_of(tmp_path, jpeg_with_exif(ExifTags(overrides=(focal,)).encode()))
    assert "exifread cannot read its EXIF block (IndexError)" in message


def test_a_block_of_many_long_values_is_not_read_to_its_end(tmp_path: Path) -> None:
    count = 4500
    entries = b"".join(struct.pack("<HHII", number, 1, 999, 8) for number in range(count))
    block = struct.pack("<2sHIH", b"II", 42, 8, count) + entries + bytes(4)
    assert "too large or refers to itself" in error_of(tmp_path, jpeg_with_exif(block))
    texts = b"".join(struct.pack("<HHII", number, 2, 60_000, 8) for number in range(count))
    block = struct.pack("<2sHIH", b"II", 42, 8, count) + texts + bytes(4)
    assert "too large or refers to itself" in error_of(tmp_path, jpeg_with_exif(block))


def test_a_limit_that_is_reached_within_a_maker_note_is_not_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = jpeg_with_exif(CAMERA.encode())
    expected, reads = listed(tmp_path, data), 0
    while True:  # the smallest limit that the block satisfies
        monkeypatch.setattr(module, "MAX_READS", reads)
        try:
            assert listed(tmp_path, data) == expected
        except ParseError as error:
            assert "too large or refers to itself" in str(error)  # noqa: PT017  every smaller one is an error
        else:
            break
        reads += 1
    assert reads > len(DJI_NOTE)


@given(block=st.binary(max_size=300), cut=st.integers(0, 600))
@settings(max_examples=examples(25, 2000), suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_give_tags_or_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, block: bytes, cut: int
) -> None:
    monkeypatch.setattr(module, "MAX_READS", 4000)  # to be quick
    whole = CAMERA.encode()
    for data in (b"II*\0\x08\0\0\0" + block, whole[:cut] + block + whole[cut + len(block) :]):
        path = tmp_path / "hostile.jpg"
        path.write_bytes(jpeg_with_exif(data))
        try:
            lines = list(list_tags(path)[0].values())
        except CalibraryError as error:
            lines = [str(error)[:MAX_VALUE]]
        assert all(line.isprintable() and len(line) <= MAX_VALUE for line in lines)


def test_nothing_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG):
        listed(tmp_path, jpeg_with_exif(CAMERA.encode()))
    assert caplog.records == []
