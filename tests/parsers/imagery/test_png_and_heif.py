"""PNG and HEIF heads."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable

import pytest
from PIL import Image

from calibrary.errors import ParseError
from calibrary.parsers.imagery import read_source
from calibrary.parsers.imagery.head import MAX_XMP_BYTES
from tests.imagery import ExifTags, attributes
from tests.imagery.xmp import DRONE_DJI
from tests.parsers.imagery.build import box, full_box, heif, packet, png, read, source_of

EXIF = ExifTags(make="DJI", model="FC3582", focal_mm=(672, 100), orientation=6).encode()
XMP = packet(*attributes(DRONE_DJI, DewarpFlag="0"))
KEYWORD = b"XML:com.adobe.xmp\0"


def test_a_pngs_size_exif_and_xmp() -> None:
    data = png((53, 37), (b"eXIf", EXIF), (b"iTXt", KEYWORD + b"\0\0\0\0" + XMP))
    metadata = read(data)
    with Image.open(io.BytesIO(data)) as image:
        assert metadata.size == image.size == (53, 37)
    assert (metadata.model, metadata.focal_mm, metadata.orientation) == ("FC3582", 6.72, 6)
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"
    assert (metadata.has_exif, metadata.faults) == (True, ())


def test_exif_as_pillow_writes_it_into_a_png_is_read() -> None:
    stream = io.BytesIO()
    Image.new("RGB", (53, 37)).save(stream, "PNG", exif=b"Exif\0\0" + EXIF)
    assert read(stream.getvalue()).model == "FC3582"


def test_a_video_still_as_png_has_a_size_and_nothing_else() -> None:
    metadata = read(png((1920, 1080)))
    assert (metadata.size, metadata.has_exif, metadata.xmp, metadata.faults) == ((1920, 1080), False, (), ())


def test_compressed_xmp_is_inflated() -> None:
    text = KEYWORD + b"\1\0\0\0" + zlib.compress(XMP)
    assert read(png((53, 37), (b"iTXt", text))).xmp_text("drone-dji", "DewarpFlag") == "0"


@pytest.mark.parametrize(
    "text",
    [
        lambda: b"\1\0\0\0" + zlib.compress(bytes(MAX_XMP_BYTES * 50), 1),
        lambda: b"\1\0\0\0no zlib stream",
        lambda: b"\0\0\0\0" + bytes(MAX_XMP_BYTES + 1),
    ],
    ids=["bomb", "garbage", "endless"],
)
def test_xmp_that_cannot_be_inflated_within_bounds_is_a_fault(text: Callable[[], bytes]) -> None:
    metadata = read(png((53, 37), (b"iTXt", KEYWORD + text())))
    assert (metadata.size, [fault.tag for fault in metadata.faults]) == ((53, 37), ["XMP"])


def test_other_texts_are_stepped_over() -> None:
    chunks = ((b"iTXt", b"Comment\0\0\0\0\0hello"), (b"tEXt", b"Software\0x"), (b"eXIf", EXIF))
    assert read(png((53, 37), *chunks)).model == "FC3582"


def test_image_data_before_the_metadata_are_stepped_over_unread() -> None:
    source = source_of(png((53, 37), *((b"IDAT", bytes(60_000)),) * 20, (b"eXIf", EXIF)))
    assert read_source(source).model == "FC3582"
    assert source.bytes_read < 48 * 1024 < source.size


@pytest.mark.parametrize("data", [png((53, 37))[:20], png((0, 37)), b"\x89PNG\r\n\x1a\n" + bytes(50)])
def test_a_png_without_a_size_is_a_parse_error(data: bytes) -> None:
    with pytest.raises(ParseError):
        read(data)


@pytest.mark.parametrize("in_idat", [False, True])
def test_a_heifs_size_is_its_primary_items_and_exif_and_xmp_are_found(in_idat: bool) -> None:
    metadata = read(heif((4032, 3024), exif=EXIF, xmp=XMP, in_idat=in_idat))
    assert metadata.size == (4032, 3024)
    assert (metadata.model, metadata.focal_mm, metadata.orientation) == ("FC3582", 6.72, 6)
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"
    assert (metadata.has_exif, metadata.faults) == (True, ())


def test_a_heif_without_metadata_has_a_size_and_nothing_else() -> None:
    metadata = read(heif((640, 480)))
    assert (metadata.size, metadata.has_exif, metadata.xmp, metadata.faults) == ((640, 480), False, (), ())


def test_a_heif_whose_brand_is_only_compatible_is_one() -> None:
    data = heif((640, 480)).replace(b"ftypheic", b"ftypxxxx", 1)
    assert read(data).size == (640, 480)


def test_exif_outside_the_file_is_a_fault() -> None:
    whole = heif((640, 480), exif=EXIF)
    metadata = read(whole[: whole.rindex(b"Exif\0\0") - 4])
    assert metadata.size == (640, 480)
    assert [fault.tag for fault in metadata.faults] == ["EXIF"]


@pytest.mark.parametrize(
    "data",
    [
        heif((640, 480))[:30],
        box(b"ftyp", b"heic", bytes(4)) + box(b"mdat", bytes(50)),
        box(b"ftyp", b"heic", bytes(4)) + full_box(b"meta", 0),
        box(b"ftyp", b"heic", bytes(4)) + full_box(b"meta", 0, full_box(b"pitm", 0)),
        box(b"ftyp", b"heic", bytes(4))
        + struct.pack(">I", 1)
        + b"meta"
        + struct.pack(">Q", 1 << 40)
        + bytes(40),
        heif((640, 480)).replace(b"ispe", b"isxx"),
        heif((0, 480)),
    ],
    ids=["cut", "no meta", "empty meta", "no item", "endless meta", "no extent", "no width"],
)
def test_a_heif_without_a_size_is_a_parse_error(data: bytes) -> None:
    with pytest.raises(ParseError):
        read(data, "a.heic")


def test_an_item_table_that_claims_billions_of_extents_ends() -> None:
    rows = struct.pack(">HHHH", 1, 0, 0, 65535) * 20_000
    table = full_box(b"iloc", 1, b"\0\0", struct.pack(">H", 20_000), rows)
    whole = heif((640, 480), exif=EXIF)
    meta_end = 24 + int.from_bytes(whole[24:28], "big")
    meta = whole[24 + 8 : meta_end]
    data = whole[:24] + box(b"meta", meta, table) + whole[meta_end:]
    assert read(data).size == (640, 480)
