"""JPEG files decode, have the size they were given, and hold their segments in the order they were given."""

from __future__ import annotations

import io
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageOps

from calibrary.errors import InputError
from tests.imagery import ExifTags, Segment, XmpDescription, XmpPacket, attributes, write_jpeg
from tests.imagery.jpeg import JFIF, assemble, flat_scan, icc_segments, pixel_scan, xmp_segments
from tests.imagery.xmp import DRONE_DJI
from tests.thorough import examples

PACKET = XmpPacket(descriptions=(XmpDescription(items=attributes(DRONE_DJI, DewarpFlag="0")),))


@settings(deadline=None, max_examples=examples(12))
@given(width=st.integers(1, 70), height=st.integers(1, 70))
def test_a_flat_frame_of_any_size_is_mid_grey(width: int, height: int) -> None:
    image = Image.open(io.BytesIO(assemble([], flat_scan((width, height)))))
    assert image.size == (width, height)
    assert image.getextrema() == (128, 128)


def test_a_flat_frame_of_twenty_megapixels_decodes_and_is_small() -> None:
    file = assemble([], flat_scan((5472, 3648)))
    image = Image.open(io.BytesIO(file))
    image.load()
    assert image.size == (5472, 3648)
    assert len(file) < 80_000


@pytest.mark.parametrize("size", [(0, 10), (10, 65_536)])
def test_a_frame_no_jpeg_can_hold_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=r"expected sides of 1 … 65535"):
        flat_scan(size)


def test_exif_and_xmp_stand_first_and_pillow_finds_both(tmp_path: Path) -> None:
    further = Segment(0xE7, b"DEBUG\0")
    path = write_jpeg(
        tmp_path / "a" / "b.JPG", (640, 512), exif=ExifTags(make="Acme"), xmp=PACKET, segments=(further,)
    )
    with Image.open(path) as image:
        assert image.size == (640, 512)
        assert image.getexif()[0x010F] == "Acme"
        assert image.info["xmp"] == PACKET.encode()
        assert [name for name, _ in image.applist] == ["APP1", "APP1", "APP7"]  # type: ignore[attr-defined]


def test_a_file_without_metadata_has_no_application_segment(tmp_path: Path) -> None:
    with Image.open(write_jpeg(tmp_path / "stripped.jpg", (64, 48))) as image:
        assert image.applist == []  # type: ignore[attr-defined]
        assert len(image.getexif()) == 0


def test_pixels_come_back_and_bring_no_segments_of_their_own() -> None:
    ramp = np.tile(np.arange(256, dtype=np.uint8), (64, 1))
    image = Image.open(io.BytesIO(assemble([], pixel_scan(ramp, quality=95))))
    assert np.abs(np.asarray(image).astype(int) - ramp).max() <= 4
    assert image.applist == []  # type: ignore[attr-defined]


def test_pixels_may_be_coloured(tmp_path: Path) -> None:
    red = np.zeros((48, 64, 3), dtype=np.uint8)
    red[..., 0] = 200
    with Image.open(write_jpeg(tmp_path / "red.jpg", (64, 48), pixels=red, quality=90)) as image:
        assert image.mode == "RGB"
        assert ImageOps.grayscale(image).getextrema() == (60, 60)


def test_pixels_of_another_size_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected those of 64×48"):
        write_jpeg(tmp_path / "a.jpg", (64, 48), pixels=np.zeros((64, 48), dtype=np.uint8))


def test_any_segments_may_stand_in_any_order() -> None:
    thermal = Segment(0xE3, bytes(65_533))
    file = assemble([JFIF, thermal, *xmp_segments(PACKET)], flat_scan((64, 48)))
    image = Image.open(io.BytesIO(file))
    assert [name for name, _ in image.applist] == ["APP0", "APP3", "APP1"]  # type: ignore[attr-defined]
    assert image.info["xmp"] == PACKET.encode()


def test_a_payload_too_long_for_a_segment_is_refused() -> None:
    with pytest.raises(InputError, match=r"0xFFE3.*expected at most 65533"):
        Segment(0xE3, bytes(65_534)).encode()


def test_a_block_may_be_given_as_it_shall_stand_there(tmp_path: Path) -> None:
    path = write_jpeg(tmp_path / "a.jpg", (8, 8), exif=b"not a TIFF structure", xmp=b"<not xml")
    file = path.read_bytes()
    assert b"Exif\0\0not a TIFF structure\xff\xe1" in file
    assert b"http://ns.adobe.com/xap/1.0/\0<not xml\xff\xdb" in file


def test_extended_xmp_comes_in_chunks_that_join_to_it() -> None:
    extension = (XmpDescription(items=attributes(DRONE_DJI, DewarpData="0.5," * 2000)),)
    both = XmpPacket(descriptions=(), extended=extension)
    main, *chunks = xmp_segments(both, chunk=3000)
    assert main.payload.endswith(both.encode())
    whole = both.encode_extended()
    joined = bytearray(len(whole))
    for chunk in chunks:
        name, rest = chunk.payload.split(b"\0", 1)
        assert name == b"http://ns.adobe.com/xmp/extension/"
        assert rest[:32] == both.guid().encode()
        total, start = struct.unpack(">II", rest[32:40])
        assert total == len(whole)
        joined[start : start + len(rest) - 40] = rest[40:]
    assert bytes(joined) == whole
    assert len(chunks) == 3


def test_a_colour_profile_in_two_segments_is_joined_by_pillow() -> None:
    profile = bytes(range(256)) * 300
    file = assemble(icc_segments(profile, chunk=40_000), flat_scan((8, 8)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Image.open(io.BytesIO(file)).info["icc_profile"] == profile
