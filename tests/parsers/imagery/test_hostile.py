"""Whatever the bytes, reading ends soon, within its budget, in a record or in one of our errors."""

from __future__ import annotations

import struct
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.errors import CalibraryError
from calibrary.parsers.imagery import read_source
from calibrary.parsers.imagery.source import READ_BUDGET
from tests.imagery import (
    ExifTags,
    TiffPage,
    XmpDescription,
    XmpPacket,
    attributes,
    elements,
    encode_tiff,
)
from tests.imagery.jpeg import Segment, exif_segment, xmp_segments
from tests.imagery.xmp import DRONE_DJI, PIX4D_1
from tests.parsers.imagery.build import SCAN, box, heif, jpeg, jpeg_with_exif, packet, png, rdf, source_of
from tests.thorough import examples
from tests.work import calls

EXIF = ExifTags(
    make="DJI",
    model="FC6310R",
    focal_mm=(88, 10),
    focal_35mm=24,
    pixel_size=(40, 30),
    focal_plane_resolution=((3749, 1), (3750, 1)),
    focal_plane_unit=3,
    body_serial="0123456789",
    thumbnail=jpeg(),
)
ITEMS = (
    *attributes(DRONE_DJI, DewarpData="2021-03-04;3656.1,3652.9,-5.5,20.25,-0.26,0.1,0,0,-0.02"),
    *elements(PIX4D_1, PerspectiveDistortion=("-0.1", "0.14", "-0.02", "0.0003", "0.0007")),
)
XMP = packet(*ITEMS)
EXTENDED = XmpPacket(descriptions=(XmpDescription(items=ITEMS),), extended=(XmpDescription(items=ITEMS),))
PLAIN = ExifTags(make="MicaSense", focal_mm=(55, 10))
GDAL = (("EXIF_Make", "DJI"), ("EXIF_FocalLength", "(8.8)"))

SEEDS = {
    "jpeg": jpeg(exif_segment(EXIF), *xmp_segments(XMP)),
    "extended": jpeg(exif_segment(EXIF), *xmp_segments(EXTENDED, chunk=200)),
    "tiff": encode_tiff([TiffPage(size=(40, 30))], exif=PLAIN, xmp=XMP, gdal_metadata=GDAL),
    "png": png((40, 30), (b"eXIf", PLAIN.encode()), (b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP)),
    "heif": heif((40, 30), exif=PLAIN.encode(), xmp=XMP, in_idat=True),
}


def survives(data: bytes) -> None:
    """Read it: a record of a possible size, or an error of one line that names the file."""
    source = source_of(data, "hostile.jpg")
    try:
        width, height = read_source(source).size
    except CalibraryError as error:
        message = str(error)
        width, height = 1, 1
    else:
        message = "hostile.jpg: "
    assert source.bytes_read <= READ_BUDGET
    assert min(width, height) > 0
    assert message.startswith("hostile.jpg: ")
    assert "\n" not in message


@given(st.binary(max_size=400))
def test_any_bytes(data: bytes) -> None:
    survives(data)


@given(
    start=st.sampled_from([b"\xff\xd8\xff\xe1", b"II*\0", b"MM\0*", b"II+\0", b"\x89PNG\r\n\x1a\n"]),
    rest=st.binary(max_size=400),
)
def test_any_bytes_behind_a_signature(start: bytes, rest: bytes) -> None:
    survives(start + rest)


@given(st.binary(max_size=300))
def test_any_bytes_as_exif(block: bytes) -> None:
    survives(jpeg_with_exif(b"II*\0\x08\0\0\0" + block))


@given(
    st.lists(
        st.sampled_from(
            [b"ftyp", b"meta", b"iinf", b"infe", b"iloc", b"pitm", b"iprp", b"ipco", b"ipma", b"ispe"]
        ),
        max_size=8,
    ),
    st.binary(max_size=60),
)
def test_any_boxes(kinds: list[bytes], body: bytes) -> None:
    inner = body
    for kind in kinds:
        inner = box(kind, inner) + body
    survives(box(b"ftyp", b"heic", bytes(4)) + box(b"meta", bytes(4), inner))


@given(seed=st.sampled_from(sorted(SEEDS)), data=st.data())
@settings(max_examples=examples(100))
def test_mutated_heads(seed: str, data: st.DataObject) -> None:
    whole = bytearray(SEEDS[seed])
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(whole) - 1))
        change = data.draw(
            st.sampled_from([b"\0", b"\xff", b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff", b"<", b"\x80"])
        )
        whole[place : place + len(change)] = change
    survives(bytes(whole))


@pytest.mark.parametrize("seed", sorted(SEEDS))
def test_heads_cut_off_anywhere(seed: str) -> None:
    whole = SEEDS[seed]
    for keep in {*range(0, len(whole), 7), len(whole) - 1}:
        survives(whole[:keep])


def overlapping_directories(count: int) -> bytes:
    """An EXIF block whose directories are a chain of thousands, each full of tags of a thousand values."""
    entry = struct.pack("<HHII", 0x920A, 5, 999, 8)
    return b"II*\0\x08\0\0\0" + struct.pack("<H", count) + entry * count + struct.pack("<I", 10) + bytes(64)


def test_a_block_built_to_keep_a_decoder_busy_is_read_at_once() -> None:
    # About one call for a tag of four million values in all.
    for count in (4000, 5400):
        image = jpeg_with_exif(overlapping_directories(count))
        assert calls(partial(survives, image)) < 3 * count


def test_thousands_of_pages_and_sub_directories_are_not_all_followed() -> None:
    # Directories four bytes apart, every one with a successor and with pointers to the others.
    links = struct.pack("<HHII", 0x014A, 4, 4000, 200)
    body = struct.pack("<H", 1) + links
    page = b"".join(body + struct.pack("<I", 8 + 18 * (number + 1)) for number in range(3000))
    survives(b"II*\0\x08\0\0\0" + page)


def test_a_hundred_thousand_chunks_boxes_and_segments_end() -> None:
    survives(png((40, 30), *(((b"tEXt", b""),) * 120_000)))
    survives(box(b"ftyp", b"heic", bytes(4)) + box(b"free") * 100_000)
    survives(b"\xff\xd8\xff\xe1\0\2" + b"\0\xff\xe1\0\2" * 200_000 + SCAN)
    survives(b"\xff\xd8\xff\xe1\0\2" + (b"\0" * 60_000 + b"\xff\xe1\0\2") * 300 + SCAN)


def test_an_array_of_a_hundred_thousand_items_is_a_fault() -> None:
    items = "<rdf:li>1</rdf:li>" * 100_000
    bands = f"<c:BandName><rdf:Seq>{items}</rdf:Seq></c:BandName>"
    xmp = rdf(f'<rdf:Description xmlns:c="Camera/">{bands}</rdf:Description>')
    data = encode_tiff([TiffPage(size=(40, 30))], xmp=xmp)
    assert [fault.tag for fault in read_source(source_of(data)).faults] == ["XMP Camera:BandName"]
    survives(data)


def test_a_thousand_broken_packets_are_few_faults() -> None:
    broken = jpeg(*(Segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0<a"),) * 1000)
    assert len(read_source(source_of(broken)).faults) <= 4
