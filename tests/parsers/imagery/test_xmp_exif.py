"""A file whose EXIF was dropped still tells its focal length in XMP's mirror of it."""

from __future__ import annotations

from pathlib import Path

from calibrary.parsers.imagery import read_metadata
from tests.imagery import ExifTags, Namespace, XmpDescription, XmpPacket, attributes, write_jpeg

EXIF = Namespace("exif", "http://ns.adobe.com/exif/1.0/")


def mirror(**texts: str) -> XmpPacket:
    return XmpPacket(descriptions=(XmpDescription(items=attributes(EXIF, **texts)),))


def test_xmp_tells_what_exif_no_longer_does(tmp_path: Path) -> None:
    xmp = mirror(
        FocalLength="88/10", FocalLengthIn35mmFilm="24", PixelXDimension="5472", PixelYDimension="3648"
    )
    metadata = read_metadata(write_jpeg(tmp_path / "a.jpg", (1368, 912), xmp=xmp))
    assert (metadata.focal_mm, metadata.focal_35mm, metadata.exif_size) == (8.8, 24.0, (5472, 3648))
    assert not metadata.has_exif


def test_exif_of_the_files_own_is_not_overruled(tmp_path: Path) -> None:
    xmp = mirror(FocalLength="50/1")
    metadata = read_metadata(write_jpeg(tmp_path / "a.jpg", (8, 8), exif=ExifTags(make="DJI"), xmp=xmp))
    assert metadata.focal_mm is None


def test_a_zero_denominator_there_is_a_fault_as_well(tmp_path: Path) -> None:
    metadata = read_metadata(write_jpeg(tmp_path / "a.jpg", (8, 8), xmp=mirror(FocalLength="5/0")))
    fault = metadata.fault("EXIF FocalLength")
    assert metadata.focal_mm is None
    assert fault is not None
    assert fault.found == "5/0"
