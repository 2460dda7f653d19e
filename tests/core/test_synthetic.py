"""What the demonstration and the synthesis write is read back as it was meant, and as the tests' own writer's is."""

from __future__ import annotations

from pathlib import Path

import exifread
import numpy as np
import pytest
from lxml import etree
from PIL import Image
from PIL.MpoImagePlugin import MpoImageFile

from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.parsers.imagery import read_metadata
from calibrary.records import replace
from calibrary.synthetic import ExifValue, Head, Position, description, jpeg, packet, write_image
from tests.imagery import ExifTags, XmpDescription, XmpPacket, attributes, write_jpeg
from tests.imagery.xmp import DRONE_DJI

EXIF: dict[str, ExifValue] = {
    "Make": "DJI",
    "Model": "FC6310R",
    "Software": "v01.09.1691",
    "Orientation": 1,
    "DateTimeOriginal": "2024:05:17 09:30:12",
    "FocalLength": (88, 10),
    "FocalLengthIn35mmFilm": 24,
    "DigitalZoomRatio": (0, 0),
    "ExifImageWidth": 40,
    "ExifImageHeight": 30,
    "FocalPlaneXResolution": (266_666_667, 1_000_000),
    "FocalPlaneYResolution": (266_666_667, 1_000_000),
    "FocalPlaneResolutionUnit": 4,
    "BodySerialNumber": "5f1d0c7a9be24d3c",
}
DEWARP = "2018-09-07;3659.41,3652.87,-4.61,23.48,-0.26713,0.11246,0.000812,-0.000104,-0.03391"
HEAD = Head(
    exif=EXIF,
    position=Position(latitude_deg=-46.123456, longitude_deg=7.2, altitude_m=512.25),
    xmp=packet([description("DJI Meta Data", attributes={"drone-dji:DewarpData": DEWARP})], length=8159),
)
GREY = np.full((30, 40, 3), 128, dtype=np.uint8)


def tags(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        return {name: str(tag) for name, tag in exifread.process_file(file, details=False).items()}


def said(metadata: ImageMetadata) -> ImageMetadata:
    """What an image's tags say, without how its pixels are encoded."""
    return replace(metadata, encoding=None)


def test_a_jpeg_says_what_one_made_byte_by_byte_says(tmp_path: Path) -> None:
    by_hand = write_jpeg(
        tmp_path / "by_hand.jpg",
        (40, 30),
        exif=ExifTags(
            make="DJI",
            model="FC6310R",
            software="v01.09.1691",
            orientation=1,
            date_time="2024:05:17 09:30:12",
            focal_mm=(88, 10),
            focal_35mm=24,
            digital_zoom=(0, 0),
            pixel_size=(40, 30),
            focal_plane_resolution=((266_666_667, 1_000_000), (266_666_667, 1_000_000)),
            focal_plane_unit=4,
            body_serial="5f1d0c7a9be24d3c",
        ),
        xmp=XmpPacket(descriptions=(XmpDescription(items=attributes(DRONE_DJI, DewarpData=DEWARP)),)),
    )
    ours = read_metadata(write_image(tmp_path / "ours.jpg", GREY, HEAD))
    assert said(ours) == said(read_metadata(by_hand))
    assert ours.xmp_text("drone-dji", "DewarpData") == DEWARP
    assert ours.focal_mm == 8.8


def test_a_tiff_carries_the_same_head_and_all_16_bits(tmp_path: Path) -> None:
    band = np.arange(1200, dtype=np.uint16).reshape(30, 40) * 50
    tiff = write_image(tmp_path / "band.tif", band, HEAD)
    jpeg = read_metadata(write_image(tmp_path / "frame.jpg", GREY, HEAD))
    assert replace(said(read_metadata(tiff)), size=jpeg.size) == said(jpeg)
    with Image.open(tiff) as image:
        np.testing.assert_array_equal(np.asarray(image), band)


@pytest.mark.parametrize("name", ["frame.jpg", "band.tif"])
def test_a_position_is_written_in_degrees_minutes_and_seconds(name: str, tmp_path: Path) -> None:
    pixels = GREY if name == "frame.jpg" else GREY[..., 0].astype(np.uint16)
    written = tags(write_image(tmp_path / name, pixels, HEAD))
    assert written["GPS GPSLatitudeRef"] == "S"
    assert written["GPS GPSLatitude"] == "[46, 7, 15276/625]"
    assert written["GPS GPSLongitude"] == "[7, 12, 0]"
    assert written["GPS GPSAltitude"] == "2049/4"


def test_a_second_image_is_where_mpf_says(tmp_path: Path) -> None:
    path = write_image(tmp_path / "a.jpg", GREY, replace(HEAD, preview=jpeg(GREY[:16, :24], 75)))
    with Image.open(path) as picture:
        assert isinstance(picture, MpoImageFile)
        picture.seek(1)
        assert picture.size == (24, 16)
    encoding = read_metadata(path).encoding
    assert encoding is not None
    assert encoding.segments == ("Exif", "MPF")


def test_colour_has_both_tables_in_one_segment_as_cameras_write_them(tmp_path: Path) -> None:
    encoding = read_metadata(write_image(tmp_path / "a.jpg", np.zeros((16, 16, 3), np.uint8), HEAD)).encoding
    assert encoding is not None
    assert not encoding.split_tables
    assert encoding.standard_tables


def test_a_focal_length_of_nothing_over_nothing_is_written_as_it_is(tmp_path: Path) -> None:
    broken = replace(HEAD, exif=EXIF | {"FocalLength": (0, 0)})
    assert tags(write_image(tmp_path / "a.jpg", GREY, broken))["EXIF FocalLength"] == "0/0"


def test_an_image_without_a_head_has_no_tags(tmp_path: Path) -> None:
    path = write_image(tmp_path / "folder" / "bare.jpg", GREY, Head())
    assert tags(path) == {}
    assert not read_metadata(path).has_exif


def test_a_packet_is_of_its_length_and_its_texts_are_escaped() -> None:
    both = description(
        'a "b"', attributes={"dc:format": "<&>"}, elements={"Camera:Band": "R&D", "Camera:D": ("1", "2")}
    )
    written = packet([both], toolkit="XMP Core", length=2000)
    assert len(written) == 2000
    root = etree.fromstring(written)
    [said] = root.iter("{http://www.w3.org/1999/02/22-rdf-syntax-ns#}Description")
    assert said.get("{http://purl.org/dc/elements/1.1/}format") == "<&>"
    assert said.findtext("{http://pix4d.com/1.0}Band") == "R&D"
    assert [item.text for item in said.iter("{http://www.w3.org/1999/02/22-rdf-syntax-ns#}li")] == ["1", "2"]


def test_what_no_segment_holds_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="70029 bytes, wanted at most 65533"):
        write_image(tmp_path / "a.jpg", GREY, Head(xmp=bytes(70_000)))
    assert not (tmp_path / "a.jpg").exists()
