"""TIFF heads: the full-resolution page's size, EXIF from the file's own directories, XMP from tag 700."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from calibrary.errors import ParseError
from calibrary.evidence.metadata import FocalPlaneUnit
from calibrary.parsers.imagery import read_metadata, read_source
from calibrary.parsers.imagery.exif import ExifTag
from tests.imagery import ByteOrder, ExifTags, FieldType, TiffPage, attributes, encode_tiff, write_tiff
from tests.imagery.structure import Field, Ifd, encode
from tests.imagery.xmp import DRONE_DJI, escaped
from tests.parsers.imagery.build import big_tiff, packet, read, source_of

XMP = packet(*attributes(DRONE_DJI, DewarpFlag="0"))


def exif(order: ByteOrder = ByteOrder.LITTLE) -> ExifTags:
    return ExifTags(make="MicaSense", model="RedEdge", focal_mm=(55, 10), byte_order=order)


def image_ifd(width: int, height: int, *fields: Field, kind: int | None = None, **more: object) -> Ifd:
    """A directory with a size and, if wanted, a NewSubfileType; it has no strips, which nobody asks for."""
    size = (
        Field(tag=0x0100, type=FieldType.LONG, values=(width,)),
        Field(tag=0x0101, type=FieldType.SHORT, values=(height,)),
    )
    marked = () if kind is None else (Field(tag=0x00FE, type=FieldType.LONG, values=(kind,)),)
    return Ifd(fields=(*marked, *size, *fields), **more)  # type: ignore[arg-type]  # children, successor


@pytest.mark.parametrize("order", ByteOrder)
@pytest.mark.parametrize("chunks_first", [False, True])
@pytest.mark.parametrize("tiled", [False, True])
def test_size_exif_and_xmp_of_a_cameras_tiff(order: ByteOrder, tiled: bool, chunks_first: bool) -> None:
    page = TiffPage(size=(1280, 960), bits=16, tiled=tiled)
    data = encode_tiff([page], exif=exif(order), xmp=XMP, chunks_first=chunks_first)
    with Image.open(io.BytesIO(data)) as image:
        assert image.size == (1280, 960)
    source = source_of(data, "IMG_0000_1.tif")
    metadata = read_source(source)
    assert (metadata.size, metadata.make, metadata.focal_mm) == ((1280, 960), "MicaSense", 5.5)
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"
    assert (metadata.has_exif, metadata.faults) == (True, ())
    assert source.bytes_read < 48 * 1024


@pytest.mark.parametrize("mode", ["1", "L", "RGB", "I;16", "F"])
@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "tiff_adobe_deflate"])
def test_the_size_is_pillows(tmp_path: Path, mode: str, compression: str) -> None:
    path = tmp_path / "a.tif"
    Image.new(mode, (53, 37)).save(path, compression=compression)
    assert read_metadata(path).size == (53, 37)


def test_a_tiff_that_is_only_pixels_has_no_exif() -> None:
    software = Field(tag=ExifTag.SOFTWARE, type=FieldType.ASCII, values="scanner 1.0")
    metadata = read(encode([image_ifd(40, 30, software)]))
    assert (metadata.has_exif, metadata.software, metadata.size) == (False, "scanner 1.0", (40, 30))


def test_overviews_behind_the_image_do_not_change_its_size() -> None:
    pages = [
        TiffPage(size=(400, 300)),
        *(TiffPage(size=size, reduced=True) for size in ((200, 150), (100, 75))),
    ]
    assert read(encode_tiff(pages)).size == (400, 300)


def test_of_several_full_pages_the_first_is_the_image(tmp_path: Path) -> None:
    assert read_metadata(write_tiff(tmp_path / "a.tif", (400, 300), pages=((800, 600),))).size == (400, 300)


def test_a_thumbnail_before_the_image_is_not_the_image() -> None:
    data = encode([image_ifd(160, 120, kind=1), image_ifd(5472, 3648, kind=0), image_ifd(640, 480, kind=1)])
    assert read(data).size == (5472, 3648)


@pytest.mark.parametrize("order", ByteOrder)
def test_a_dngs_image_and_xmp_are_in_a_sub_directory(order: ByteOrder) -> None:
    make = Field(tag=ExifTag.MAKE, type=FieldType.ASCII, values="DJI")
    raw = image_ifd(5472, 3648, Field(tag=0x02BC, type=FieldType.BYTE, values=XMP), kind=0)
    metadata = read(encode([image_ifd(256, 171, make, kind=1, children=((0x014A, raw),))], order))
    assert (metadata.size, metadata.make) == ((5472, 3648), "DJI")
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"


def test_of_several_sub_directories_the_full_image_counts_not_a_larger_mask() -> None:
    # The three are laid down as pages first; then the thumbnail's pointer is made to name them as SubIFDs.
    others = [image_ifd(1368, 912, kind=1), image_ifd(5472, 3648, kind=0), image_ifd(8000, 6000, kind=4)]
    starts: list[int] = []
    for _ in range(2):
        pointers = Field(tag=0x014A, type=FieldType.LONG, values=tuple(starts or (1, 2, 3)))
        data = encode([image_ifd(256, 171, pointers, kind=1), *others])
        starts = chain_of(data)
    cut = data[: 8 + 2 + 12 * 4] + bytes(4) + data[8 + 2 + 12 * 4 + 4 :]
    assert chain_of(cut) == []
    assert read(cut).size == (5472, 3648)


def chain_of(data: bytes) -> list[int]:
    """Where the directories behind the first one begin, in a little-endian TIFF."""
    starts = []
    (start,) = struct.unpack_from("<I", data, 4)
    while start:
        starts.append(start)
        (count,) = struct.unpack_from("<H", data, start)
        (start,) = struct.unpack_from("<I", data, start + 2 + 12 * count)
    return starts[1:]


@pytest.mark.parametrize("order", ["<", ">"])
def test_big_tiff_is_read_with_all_its_integer_types(order: str) -> None:
    focal = struct.pack(order + "II", 55, 10)
    fields = [
        (0x0100, 16, 1, struct.pack(order + "Q", 1280)),
        (0x0101, 4, 1, struct.pack(order + "I", 960)),
        (ExifTag.MAKE, 2, 10, b"MicaSense\0"),
        (ExifTag.MODEL, 2, 4, b"RED\0"),
        (0x02BC, 1, len(XMP), XMP),
        (ExifTag.FOCAL_LENGTH, 5, 1, focal),
        (ExifTag.PIXEL_X, 16, 1, struct.pack(order + "Q", 1280)),
        (ExifTag.PIXEL_Y, 16, 1, struct.pack(order + "Q", 2**40)),
    ]
    metadata = read(big_tiff(order, fields))
    assert (metadata.size, metadata.make, metadata.model) == ((1280, 960), "MicaSense", "RED")
    assert metadata.focal_mm == 5.5
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"
    assert [fault.tag for fault in metadata.faults] == ["EXIF PixelYDimension"]


def test_exif_that_gdal_has_turned_into_text_is_read() -> None:
    items = (
        ("AREA_OR_POINT", "Area"),
        ("EXIF_Make", "DJI"),
        ("EXIF_Model", "FC6310R"),
        ("EXIF_Software", "v01.09.1691"),
        ("EXIF_FocalLength", "(8.8)"),
        ("EXIF_FocalLengthIn35mmFilm", "24"),
        ("EXIF_DigitalZoomRatio", "(0)"),
        ("EXIF_PixelXDimension", "5472"),
        ("EXIF_PixelYDimension", "3648"),
        ("EXIF_FocalPlaneXResolution", "(3750.5)"),
        ("EXIF_FocalPlaneYResolution", "(3750.5)"),
        ("EXIF_FocalPlaneResolutionUnit", "3"),
        ("EXIF_GPSLatitude", "(48) (8) (13.75)"),
        ("EXIF_BodySerialNumber", "0"),
    )
    metadata = read(encode_tiff([TiffPage(size=(1368, 912))], gdal_metadata=items, xmp=XMP))
    assert (metadata.make, metadata.model, metadata.software) == ("DJI", "FC6310R", "v01.09.1691")
    assert (metadata.focal_mm, metadata.focal_35mm, metadata.digital_zoom) == (8.8, 24.0, None)
    assert (metadata.size, metadata.exif_size) == ((1368, 912), (5472, 3648))
    assert metadata.focal_plane_resolution == (3750.5, 3750.5)
    assert metadata.focal_plane_unit is FocalPlaneUnit.CENTIMETRE
    assert (metadata.has_exif, metadata.serial, metadata.faults) == (True, None, ())
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"


@pytest.mark.parametrize(
    ("text", "found"), [("(inf)", "inf"), ("(nan)", "nan"), ("(0)", "0.0"), ("", "no value"), ("8,8", "8,8")]
)
def test_a_focal_length_that_gdal_could_not_divide_is_named(text: str, found: str) -> None:
    metadata = read(encode_tiff([TiffPage(size=(40, 30))], gdal_metadata=(("EXIF_FocalLength", text),)))
    (fault,) = metadata.faults
    assert (fault.tag, fault.found) == ("EXIF FocalLength", found)


def test_the_files_own_tags_stand_before_gdals_text() -> None:
    items = (("EXIF_FocalLength", "(8.8)"), ("EXIF_Software", "v01"))
    metadata = read(encode_tiff([TiffPage(size=(40, 30))], exif=exif(), gdal_metadata=items))
    assert (metadata.focal_mm, metadata.software) == (5.5, "v01")


def test_xmp_that_gdal_keeps_in_its_list_is_read() -> None:
    item = f'<Item name="doc" domain="xml:XMP" format="xml">{escaped(XMP.decode())}</Item>'
    listed = Field(tag=0xA480, type=FieldType.ASCII, values=f"<GDALMetadata>{item}</GDALMetadata>\n")
    assert read(encode([image_ifd(40, 30, listed)])).xmp_text("drone-dji", "DewarpFlag") == "0"


@pytest.mark.parametrize("text", ["<GDALMetadata>", "", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'])
def test_a_broken_list_of_gdal_is_a_fault(text: str) -> None:
    listed = Field(tag=0xA480, type=FieldType.ASCII, values=text)
    metadata = read(encode([image_ifd(40, 30, listed)]))
    assert (metadata.size, [fault.tag for fault in metadata.faults]) == ((40, 30), ["GDAL_METADATA"])


def test_a_packet_of_absurd_length_is_a_fault() -> None:
    field = Field(tag=0x02BC, type=FieldType.BYTE, values=XMP, count=1 << 30)
    metadata = read(encode([image_ifd(40, 30, field)]))
    assert (metadata.size, [fault.tag for fault in metadata.faults]) == ((40, 30), ["XMP"])


@pytest.mark.parametrize("successor", [8, 1 << 30, 9])
def test_a_chain_that_turns_back_or_leads_nowhere_ends(successor: int) -> None:
    assert read(encode([image_ifd(160, 120, kind=1, successor=successor)])).size == (160, 120)


def test_sub_directories_that_lead_nowhere_or_back_are_left_out() -> None:
    pointers = Field(tag=0x014A, type=FieldType.LONG, values=(8, 8, 1 << 30, 0, 5))
    assert read(encode([image_ifd(160, 120, pointers, kind=1)])).size == (160, 120)


@pytest.mark.parametrize(
    "data",
    [
        b"II*\0",
        b"II*\0\x08\0\0\0",
        b"MM\0*\0\0\0\0" + bytes(50),
        b"II+\0\x08\0\0\0" + bytes(7),
        b"II*\0\x08\0\0\0\xff\xff" + bytes(100),
        encode([Ifd(fields=())]),
        encode([image_ifd(0, 30)]),
        encode([image_ifd(40, 0)]),
        encode([image_ifd(2**31, 30)]),
    ],
)
def test_a_tiff_without_an_image_is_a_parse_error(data: bytes) -> None:
    with pytest.raises(ParseError):
        read(data, "a.tif")


def test_a_page_of_pixels_is_never_read(tmp_path: Path) -> None:
    path = tmp_path / "big.tif"
    Image.fromarray(np.zeros((2000, 3000), np.uint16)).save(path)
    source = source_of(path.read_bytes())
    assert read_source(source).size == (3000, 2000)
    assert source.bytes_read < 48 * 1024
