"""JPEG heads: the size from the frame header, EXIF and XMP wherever they stand, and nothing else read."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from calibrary.calibration import ImageSize
from calibrary.errors import ParseError
from calibrary.parsers.imagery import read_metadata, read_source
from calibrary.parsers.imagery.head import MAX_XMP_BYTES
from tests.imagery import ExifTags, XmpDescription, XmpPacket, attributes, write_jpeg
from tests.imagery.jpeg import (
    JFIF,
    Segment,
    assemble,
    exif_segment,
    flat_scan,
    icc_segments,
    xmp_segments,
)
from tests.imagery.xmp import DRONE_DJI
from tests.parsers.imagery.build import SCAN, SIZE, jpeg, packet, read, source_of

EXIF = exif_segment(ExifTags(make="DJI", model="FC6310R", focal_mm=(88, 10)))
XMP = xmp_segments(packet(*attributes(DRONE_DJI, DewarpFlag="0")))
DEWARP = XmpDescription(
    items=attributes(DRONE_DJI, DewarpData="2021-03-04;3656.1,3652.9,-5.5,20.25,-0.26,0.1,0,0,-0.02")
)


def pillow_size(data: bytes) -> ImageSize:
    with Image.open(io.BytesIO(data)) as image:
        return image.size


@given(width=st.integers(1, 65535), height=st.integers(1, 65535))
def test_the_size_is_the_frame_headers(width: int, height: int) -> None:
    # A whole scan of such a size is not needed for the head.
    data = assemble([EXIF], flat_scan((8, 8)))
    data = data.replace(struct.pack(">BHH", 8, 8, 8), struct.pack(">BHH", 8, height, width))
    assert read(data).size == (width, height)


@pytest.mark.parametrize(
    "options", [{"progressive": True}, {"subsampling": 0}, {"quality": 30, "optimize": True}]
)
@pytest.mark.parametrize("mode", ["L", "RGB", "CMYK"])
def test_the_size_is_pillows(mode: str, options: dict[str, object]) -> None:
    stream = io.BytesIO()
    Image.fromarray(np.zeros((37, 53, 3), np.uint8)).convert(mode).save(stream, "JPEG", **options)
    assert read(stream.getvalue()).size == pillow_size(stream.getvalue()) == (53, 37)


def test_the_size_is_not_what_exif_claims(tmp_path: Path) -> None:
    path = write_jpeg(tmp_path / "a.jpg", (640, 512), exif=ExifTags(pixel_size=(1280, 1024)))
    metadata = read_metadata(path)
    assert (metadata.size, metadata.exif_size) == ((640, 512), (1280, 1024))


def test_orientation_does_not_turn_the_size(tmp_path: Path) -> None:
    metadata = read_metadata(write_jpeg(tmp_path / "a.jpg", (64, 48), exif=ExifTags(orientation=6)))
    assert (metadata.size, metadata.orientation) == ((64, 48), 6)


@pytest.mark.parametrize(
    "segments",
    [
        (EXIF, *XMP),
        (*XMP, EXIF),
        (JFIF, *icc_segments(bytes(200_000)), EXIF, *XMP),
        (JFIF, Segment(0xED, bytes(60_000)), *XMP, Segment(0xFE, b"comment"), EXIF),
    ],
)
def test_exif_and_xmp_are_found_in_any_order(segments: tuple[Segment, ...]) -> None:
    metadata = read(jpeg(*segments))
    assert (metadata.model, metadata.xmp_text("drone-dji", "DewarpFlag")) == ("FC6310R", "0")


def test_metadata_between_frame_header_and_scan_are_found() -> None:
    scan = SCAN.index(b"\xff\xda")
    data = b"\xff\xd8" + SCAN[:scan] + EXIF.encode() + SCAN[scan:]
    assert read(data).model == "FC6310R"


def test_metadata_of_an_embedded_picture_behind_the_scan_are_not_the_images() -> None:
    assert read(jpeg() + jpeg(EXIF)).has_exif is False


def test_raw_temperatures_before_the_frame_header_are_stepped_over() -> None:
    # A radiometric 1280×1024 frame of DJI: forty APP3 of 64 kB, tables and JFIF behind them.
    raw = (Segment(0xE3, bytes([0xFF]) * 65_532),) * 40
    data = jpeg(EXIF, *XMP, *raw, JFIF)
    source = source_of(data)
    assert read_source(source).size == SIZE
    assert source.bytes_read < 64 * 1024 < len(data)


def test_a_thumbnail_is_not_read() -> None:
    exif = exif_segment(ExifTags(make="DJI", focal_mm=(88, 10), thumbnail=jpeg(Segment(0xFE, bytes(55_000)))))
    source = source_of(jpeg(exif, *XMP))
    assert read_source(source).focal_mm == 8.8
    assert source.bytes_read < 32 * 1024


def test_of_two_exif_segments_the_first_counts() -> None:
    assert read(jpeg(EXIF, exif_segment(ExifTags(model="second")))).model == "FC6310R"


def test_an_app1_that_is_neither_is_stepped_over() -> None:
    flir = Segment(0xE1, b"FLIR\0\1\0\0" + bytes(60_000))
    assert read(jpeg(flir, EXIF)).model == "FC6310R"
    assert read(jpeg(Segment(0xE1, b""), EXIF)).model == "FC6310R"


def test_fill_bytes_and_junk_between_segments_are_stepped_over_as_pillow_does() -> None:
    data = b"\xff\xd8" + b"\xff\xff\xff" + EXIF.encode() + bytes(1000) + SCAN
    assert read(data).size == pillow_size(data) == SIZE
    assert read(data).model == "FC6310R"


def test_a_file_without_metadata_has_a_size_and_nothing_else(tmp_path: Path) -> None:
    metadata = read_metadata(write_jpeg(tmp_path / "still.jpg", (1920, 1080)))
    assert metadata.size == (1920, 1080)
    assert (metadata.has_exif, metadata.make, metadata.focal_mm, metadata.xmp, metadata.faults) == (
        False,
        None,
        None,
        (),
        (),
    )


@pytest.mark.parametrize("keep", [3, 10, 100, 170])
def test_a_file_that_ends_before_its_frame_header_is_a_parse_error(keep: int) -> None:
    with pytest.raises(ParseError, match="frame header"):
        read(jpeg(EXIF)[:keep])


def test_a_frame_of_no_lines_is_a_parse_error() -> None:
    data = jpeg().replace(struct.pack(">BHH", 8, *reversed(SIZE)), struct.pack(">BHH", 8, 0, 40))
    with pytest.raises(ParseError, match="40 × 0 pixels"):
        read(data)


def test_endless_junk_and_endless_segments_are_parse_errors() -> None:
    with pytest.raises(ParseError, match="without a marker"):
        read(b"\xff\xd8\xff\xfe\0\2" + bytes(200_000))
    with pytest.raises(ParseError, match="more than 5000 segments"):
        read(b"\xff\xd8" + b"\xff\xfe\0\2" * 10_000 + SCAN)


def extended(length: int = 0) -> XmpPacket:
    filler = XmpDescription(items=attributes(DRONE_DJI, SelfData="x" * length))
    return XmpPacket(
        descriptions=(XmpDescription(items=attributes(DRONE_DJI, DewarpFlag="1")),), extended=(DEWARP, filler)
    )


def test_extended_xmp_is_joined_whatever_its_order() -> None:
    main, *parts = xmp_segments(extended(100_000), chunk=30_000)
    assert len(parts) > 3
    metadata = read(jpeg(main, *reversed(parts), EXIF))
    assert metadata.faults == ()
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "1"
    assert str(metadata.xmp_text("drone-dji", "DewarpData")).startswith("2021-03-04;3656.1,")


def test_extended_xmp_that_the_main_packet_does_not_name_is_not_this_images() -> None:
    _, *parts = xmp_segments(extended(), chunk=30_000)
    metadata = read(jpeg(*XMP, *parts))
    assert metadata.xmp_text("drone-dji", "DewarpData") is None
    assert metadata.faults == ()


@pytest.mark.parametrize("what", ["missing", "duplicate", "changed", "huge"])
def test_broken_extended_xmp_is_a_fault_and_the_main_packet_counts(what: str) -> None:
    main, *parts = xmp_segments(extended(100_000), chunk=30_000)
    if what == "missing":
        del parts[1]
    elif what == "duplicate":
        parts.append(parts[1])
    elif what == "changed":
        parts[1] = Segment(0xE1, parts[1].payload[:-1] + b"?")
    else:
        claim = struct.pack(">I", MAX_XMP_BYTES + 1)
        parts = [Segment(0xE1, part.payload[:67] + claim + part.payload[71:]) for part in parts]
    metadata = read(jpeg(main, *parts, EXIF))
    assert [fault.tag for fault in metadata.faults] == ["XMP extension"]
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "1"
    assert metadata.xmp_text("drone-dji", "DewarpData") is None
