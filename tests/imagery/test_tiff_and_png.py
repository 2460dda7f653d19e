"""TIFF pages hold the pixels they were given and the metadata where readers look; PNG holds none."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import exifread
import numpy as np
import pytest
from lxml import etree
from PIL import Image, ImageSequence

from calibrary.errors import InputError
from tests.imagery import (
    ByteOrder,
    ExifTags,
    TiffPage,
    XmpDescription,
    XmpPacket,
    attributes,
    encode_tiff,
    write_png,
    write_tiff,
)
from tests.imagery.xmp import DRONE_DJI

PACKET = XmpPacket(descriptions=(XmpDescription(items=attributes(DRONE_DJI, DewarpFlag="0")),))


@pytest.mark.parametrize("order", ByteOrder)
@pytest.mark.parametrize("chunks_first", [False, True])
@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("shape", [(300, 401), (300, 401, 3)])
@pytest.mark.parametrize("bits", [8, 16])
def test_opencv_reads_back_every_pixel(
    order: ByteOrder, chunks_first: bool, tiled: bool, shape: tuple[int, ...], bits: int
) -> None:
    noise = np.random.default_rng(3).integers(0, 2**bits, shape)
    pixels = noise.astype(np.uint8) if bits == 8 else noise.astype(np.uint16)
    page = TiffPage(size=(401, 300), bits=bits, tiled=tiled, pixels=pixels)
    file = encode_tiff([page], exif=ExifTags(make="Acme", byte_order=order), chunks_first=chunks_first)
    read = cv2.imdecode(np.frombuffer(file, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    assert read is not None
    np.testing.assert_array_equal(read[..., ::-1] if read.ndim == 3 else read, pixels)


@pytest.mark.parametrize("order", ByteOrder)
@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("bits", [8, 16])
def test_exif_and_xmp_are_found_in_the_first_directory(
    tmp_path: Path, order: ByteOrder, tiled: bool, bits: int
) -> None:
    exif = ExifTags(make="Acme", focal_mm=(55, 10), byte_order=order)
    path = write_tiff(tmp_path / "a" / "b.tif", (5472, 3648), exif=exif, xmp=PACKET, bits=bits, tiled=tiled)
    with Image.open(path) as image:
        assert image.size == (5472, 3648)
        tags = image.tag_v2  # type: ignore[attr-defined]
        assert (tags[0x010F], tags[700]) == ("Acme", PACKET.encode())
        assert image.getexif().get_ifd(0x8769)[0x920A] == 5.5
    with path.open("rb") as file:
        read = exifread.process_file(file, details=False)
    assert str(read["Image Make"]) == "Acme"
    assert float(read["EXIF FocalLength"].values[0]) == 5.5


def test_a_large_flat_file_is_small_and_decodes(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "a.tif", (5472, 3648), bits=16)
    assert path.stat().st_size < 120_000
    with Image.open(path) as image:
        assert image.getextrema() == (0, 0)


def test_further_pages_follow_the_first(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "a.tif", (400, 300), tiled=True, pages=((200, 150), (100, 75)))
    with Image.open(path) as image:
        sizes = [page.size for page in ImageSequence.Iterator(image)]
    assert sizes == [(400, 300), (200, 150), (100, 75)]


def test_an_overview_says_that_it_is_one() -> None:
    pages = [TiffPage(size=(400, 300)), TiffPage(size=(200, 150), reduced=True)]
    image = Image.open(io.BytesIO(encode_tiff(pages)))
    image.seek(1)
    assert image.tag_v2[0x00FE] == 1  # type: ignore[attr-defined]


def test_gdals_list_is_an_xml_document_of_items(tmp_path: Path) -> None:
    items = (("EXIF_FocalLength", "(8.8)"), ("EXIF_Make", "D&J"))
    path = write_tiff(tmp_path / "a.tif", (64, 48), gdal_metadata=items)
    with Image.open(path) as image:
        listed = etree.fromstring(image.tag_v2[42112])  # type: ignore[attr-defined]
    assert [(item.get("name"), item.text) for item in listed] == list(items)


def test_a_file_of_no_pages_is_refused() -> None:
    with pytest.raises(InputError, match="expected at least one"):
        encode_tiff([])


def test_a_thumbnail_is_refused_because_it_would_be_a_page() -> None:
    with pytest.raises(InputError, match="a page of its own"):
        encode_tiff([TiffPage(size=(8, 8))], exif=ExifTags(thumbnail=b"\xff\xd8"))


def test_a_page_of_odd_depth_or_shape_is_refused() -> None:
    with pytest.raises(InputError, match="expected 8 or 16 bits"):
        TiffPage(size=(8, 8), bits=12)
    with pytest.raises(InputError, match="expected 16 bits and 8×8"):
        TiffPage(size=(8, 8), bits=16, pixels=np.zeros((8, 8), dtype=np.uint8))


def test_a_png_has_its_size_and_says_nothing_else(tmp_path: Path) -> None:
    with Image.open(write_png(tmp_path / "a" / "still.png", (3840, 2160))) as image:
        assert image.size == (3840, 2160)
        assert image.getextrema() == (0, 0)
        assert image.info == {}
        assert len(image.getexif()) == 0
