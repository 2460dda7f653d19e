"""One call for every kind of image, recognised by content; the record is a plain value."""

from __future__ import annotations

import io
import pickle
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import exifread
import pytest
from PIL import Image

from calibrary.errors import ParseError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.parsers.imagery import IMAGE_SUFFIXES, read_metadata
from calibrary.records import replace
from tests.imagery import ExifField, ExifTags, attributes, write_jpeg, write_tiff
from tests.imagery.jpeg import exif_segment, xmp_segments
from tests.imagery.xmp import DRONE_DJI
from tests.parsers.imagery.build import jpeg, packet, read

EXIF = ExifTags(
    make="DJI",
    model="FC6310R",
    software="v01.09.1691",
    orientation=1,
    focal_mm=(88, 10),
    focal_35mm=24,
    digital_zoom=(0, 1024),
    pixel_size=(5472, 3648),
    focal_plane_resolution=((37491, 10), (37503, 10)),
    focal_plane_unit=3,
    lens_model="24.0 mm f/2.8",
)
XMP = packet(*attributes(DRONE_DJI, DewarpFlag="0"))


def test_the_suffix_decides_nothing(tmp_path: Path) -> None:
    path = write_jpeg(tmp_path / "IMG_0001.tif", (40, 30), exif=EXIF)
    assert read_metadata(path).model == "FC6310R"


def test_jpeg_and_tiff_of_one_camera_say_the_same(tmp_path: Path) -> None:
    as_jpeg = read_metadata(write_jpeg(tmp_path / "a.jpg", (5472, 3648), exif=EXIF, xmp=XMP))
    as_tiff = read_metadata(write_tiff(tmp_path / "a.tif", (5472, 3648), exif=EXIF, xmp=XMP))
    assert replace(as_jpeg, byte_order=None, encoding=None) == replace(as_tiff, byte_order=None)


def test_exifread_on_the_whole_file_says_the_same(tmp_path: Path) -> None:
    path = write_jpeg(tmp_path / "a.jpg", (40, 30), exif=EXIF)
    metadata = read_metadata(path)
    with path.open("rb") as file:
        tags = exifread.process_file(file, details=False)
    assert metadata.make == str(tags["Image Make"])
    assert metadata.lens == str(tags["EXIF LensModel"])
    assert metadata.focal_mm == float(tags["EXIF FocalLength"].values[0])
    assert metadata.focal_35mm == tags["EXIF FocalLengthIn35mmFilm"].values[0]
    assert metadata.focal_plane_resolution == tuple(
        float(tags[f"EXIF FocalPlane{axis}Resolution"].values[0]) for axis in "XY"
    )


def test_pillow_says_the_same(tmp_path: Path) -> None:
    path = write_jpeg(tmp_path / "a.jpg", (40, 30), exif=EXIF)
    metadata = read_metadata(path)
    with Image.open(path) as image:
        directory = image.getexif().get_ifd(0x8769)
        assert metadata.size == image.size
    assert metadata.focal_mm == float(directory[0x920A])
    assert metadata.exif_size == (directory[0xA002], directory[0xA003])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n", "Git LFS pointer"),
        (b"/annex/objects/SHA256E-s5--0.jpg\n", "git-annex pointer"),
        (b"GIF89a" + bytes(50), "not a JPEG, TIFF, DNG, PNG or HEIF image"),
        (b"<html><body>404</body></html>", "not a JPEG, TIFF, DNG, PNG or HEIF image"),
        (bytes(5000), "not a JPEG, TIFF, DNG, PNG or HEIF image"),
        (b"\xff", "not a JPEG, TIFF, DNG, PNG or HEIF image"),
        (b"\0\0\0\x18ftypisom" + bytes(50), "not a JPEG, TIFF, DNG, PNG or HEIF image"),
    ],
)
def test_what_is_no_image_is_named_in_one_line(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "DJI_0001.JPG"
    path.write_bytes(data)
    with pytest.raises(ParseError, match=message) as caught:
        read_metadata(path)
    assert caught.value.source == "DJI_0001.JPG"
    assert str(caught.value).startswith("DJI_0001.JPG: ")
    assert "\n" not in str(caught.value)
    assert str(tmp_path) not in str(caught.value)


def test_a_scan_takes_what_can_be_read_by_lower_case_suffix() -> None:
    assert {
        ".jpg",
        ".jpeg",
        ".jpe",
        ".mpo",
        ".tif",
        ".tiff",
        ".dng",
        ".heic",
        ".heif",
        ".png",
    } == IMAGE_SUFFIXES


def test_a_record_goes_between_processes() -> None:
    metadata = read_tags_with_faults()
    assert pickle.loads(pickle.dumps(metadata)) == metadata  # noqa: S301 - our own bytes


def test_an_error_goes_between_processes() -> None:
    with pytest.raises(ParseError) as caught:
        read(b"", "a.jpg")
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)  # noqa: S301 - our own bytes


def read_tags_with_faults() -> ImageMetadata:
    return read(jpeg_of(ExifTags(make="DJI", overrides=(ExifField("FocalLength", ((5, 0),)),))))


def jpeg_of(exif: ExifTags) -> bytes:
    return jpeg(exif_segment(exif), *xmp_segments(XMP))


def test_threads_may_read_at_once(tmp_path: Path) -> None:
    paths = [
        write_jpeg(tmp_path / f"{n}.jpg", (40 + n, 30), exif=ExifTags(model=f"M{n}"), xmp=XMP)
        for n in range(8)
    ]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(5):
            records = list(pool.map(read_metadata, paths))
            assert [(record.size[0], record.model) for record in records] == [
                (40 + n, f"M{n}") for n in range(8)
            ]


def test_a_huge_image_costs_no_warning(tmp_path: Path) -> None:
    stream = io.BytesIO()
    Image.new("1", (8, 8)).save(stream, "PNG")
    data = bytearray(stream.getvalue())
    data[16:24] = (60_000).to_bytes(4, "big") * 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read(bytes(data)).size == (60_000, 60_000)
        assert read_metadata(write_tiff(tmp_path / "a.tif", (40_000, 30_000))).size == (40_000, 30_000)


def test_importing_the_readers_loads_neither_lxml_nor_exifread_nor_pillow() -> None:
    code = (
        "import sys, calibrary.parsers.imagery\n"
        "heavy = {'lxml', 'exifread', 'PIL', 'cv2', 'git', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"


def test_a_program_that_logs_everything_sees_no_value_of_the_exif(tmp_path: Path) -> None:
    """Exifread logs every value at DEBUG, serial numbers too."""
    write_jpeg(
        tmp_path / "a.jpg", (72, 48), exif=ExifTags(make="DJI", model="FC6310R", body_serial="SN-SECRET-42")
    )
    program = (
        "import logging, sys; logging.basicConfig(level=logging.DEBUG); from pathlib import Path;"
        "from calibrary.parsers.imagery import read_metadata; print(read_metadata(Path(sys.argv[1])).model)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "a.jpg")], capture_output=True, text=True, check=True
    )
    assert done.stdout == "FC6310R\n"
    assert "exifread" not in done.stderr
    assert "SECRET" not in done.stderr
