"""How a JPEG is written, against what Pillow was told to write; MakerNote, thumbnail and interoperability of EXIF."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile

from calibrary.evidence.metadata import Encoding, ImageMetadata
from calibrary.parsers.imagery import read_metadata
from tests.imagery import ExifTags, write_jpeg
from tests.imagery.jpeg import JFIF, Segment, assemble, exif_segment, flat_scan

PIXELS = np.random.default_rng(2).integers(0, 255, (48, 64, 3), dtype=np.uint8)


def saved(folder: Path, **options: object) -> Encoding:
    stream = io.BytesIO()
    Image.fromarray(PIXELS).save(stream, "JPEG", **options)
    (folder / "a.jpg").write_bytes(stream.getvalue())
    encoding = read_metadata(folder / "a.jpg").encoding
    assert encoding is not None
    return encoding


@pytest.mark.parametrize("quality", [1, 20, 49, 50, 75, 90, 100])
def test_tables_of_libjpeg_are_recognised_at_any_quality(tmp_path: Path, quality: int) -> None:
    found = saved(tmp_path, quality=quality)
    assert found.standard_tables
    assert found.split_tables
    assert found.standard_codes
    assert found.segments == ("JFIF",)


def test_tables_of_another_encoder_are_not_libjpegs(tmp_path: Path) -> None:
    assert not saved(tmp_path, qtables=[[16] * 64, [17] * 64]).standard_tables


def test_tables_that_were_turned_are_recognised(tmp_path: Path) -> None:
    rows = np.reshape(saved_tables(tmp_path)[0], (8, 8))
    turned = saved(tmp_path, qtables=[rows.T.ravel().tolist()])
    assert (turned.turned_tables, turned.standard_tables) == (True, False)
    assert not saved(tmp_path).turned_tables


def saved_tables(folder: Path) -> dict[int, list[int]]:
    saved(folder)
    with JpegImageFile(folder / "a.jpg") as image:
        return dict(image.quantization)


def test_tables_in_one_segment_are_not_split(tmp_path: Path) -> None:
    saved(tmp_path)
    data = (tmp_path / "a.jpg").read_bytes()
    first = data.index(b"\xff\xdb\x00\x43")
    second = data.index(b"\xff\xdb\x00\x43", first + 1)
    both = data[first + 4 : second] + data[second + 4 : second + 69]
    joined = data[:first] + b"\xff\xdb\x00\x84" + both + data[second + 69 :]
    (tmp_path / "b.jpg").write_bytes(joined)
    encoding = read_metadata(tmp_path / "b.jpg").encoding
    assert encoding is not None
    assert not encoding.split_tables
    assert encoding.standard_tables


@pytest.mark.parametrize(("subsampling", "first"), [("4:4:4", (1, 1)), ("4:2:2", (2, 1)), ("4:2:0", (2, 2))])
def test_the_sampling_is_the_encoders(tmp_path: Path, subsampling: str, first: tuple[int, int]) -> None:
    assert saved(tmp_path, subsampling=subsampling).sampling == (first, (1, 1), (1, 1))


def test_a_progressive_frame_is_recognised(tmp_path: Path) -> None:
    assert saved(tmp_path, progressive=True).progressive
    assert not saved(tmp_path).progressive


def test_codes_that_were_computed_for_the_image_are_not_the_standards(tmp_path: Path) -> None:
    assert not saved(tmp_path, optimize=True).standard_codes


def test_restart_intervals_are_recognised(tmp_path: Path) -> None:
    assert saved(tmp_path, restart_marker_rows=1).restarts
    assert not saved(tmp_path).restarts


@pytest.mark.parametrize(
    ("marker", "payload", "name"),
    [
        (0xE2, b"MPF\0rest", "MPF"),
        (0xE2, b"ICC_PROFILE\0\1\1rest", "ICC"),
        (0xE2, b"FPXR\0rest", "FPXR"),
        (0xED, b"Photoshop 3.0\0rest", "Photoshop"),
        (0xEE, b"Adobe\0rest", "Adobe"),
    ],
)
def test_segments_are_named_in_their_order(tmp_path: Path, marker: int, payload: bytes, name: str) -> None:
    path = tmp_path / "a.jpg"
    exif = exif_segment(ExifTags(make="Acme"))
    named = Segment(marker, payload)
    path.write_bytes(
        assemble([exif, named, named, Segment(0xE3, b"temperatures"), JFIF], flat_scan((64, 48)))
    )
    encoding = read_metadata(path).encoding
    assert encoding is not None
    assert encoding.segments == ("Exif", name, "JFIF")


@pytest.mark.parametrize("cut", [b"\xff\xdb\x00\x05\x00\x10\x10", b"\xff\xc4\x00\x02", b"\xff\xdd\x00\x02"])
def test_tables_that_are_cut_off_are_no_fault(tmp_path: Path, cut: bytes) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(b"\xff\xd8" + cut + flat_scan((64, 48)))
    assert read_metadata(path).size == (64, 48)


def exif_block(
    *, maker_note: int = 0, related: tuple[int, int] | None = None, thumbnail: bool = False
) -> bytes:
    """IFD0, an Exif directory with a MakerNote and an interoperability directory, and IFD1."""
    at_exif, at_related, at_note = 38, 80, 120
    tags = [(0x927C, 7, maker_note, at_note)] if maker_note else []
    tags += [(0xA005, 4, 1, at_related)] if related else []
    image = struct.pack("<HHHIII", 1, 0x8769, 4, 1, at_exif, at_related + 60 if thumbnail else 0)
    exif = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + bytes(4)
    sides = related or (0, 0)
    directory = struct.pack("<H", 3) + struct.pack("<HHI4s", 1, 2, 4, b"R98\0")
    directory += struct.pack("<HHIHH", 0x1001, 3, 1, sides[0], 0) + struct.pack(
        "<HHII", 0x1002, 4, 1, sides[1]
    )
    block = b"II*\0\x08\0\0\0" + image
    block = block.ljust(at_exif, b"\0") + exif
    return block.ljust(at_related, b"\0") + directory + bytes(200)


def of(folder: Path, block: bytes) -> ImageMetadata:
    return read_metadata(write_jpeg(folder / "a.jpg", (64, 48), exif=block))


def test_the_size_in_the_first_directory_is_read(tmp_path: Path) -> None:
    sides = struct.pack("<HHIIHHII", 0x0100, 4, 1, 4000, 0x0101, 4, 1, 3000)
    assert of(tmp_path, b"II*\0\x08\0\0\0\x02\0" + sides + bytes(4)).main_size == (4000, 3000)
    assert of(tmp_path, exif_block()).main_size is None


def test_a_maker_note_and_a_thumbnail_are_noticed(tmp_path: Path) -> None:
    bare = of(tmp_path, exif_block())
    assert (bare.has_maker_note, bare.has_thumbnail, bare.related_size, bare.byte_order) == (
        False,
        False,
        None,
        "<",
    )
    full = of(tmp_path, exif_block(maker_note=100, related=(4000, 3000), thumbnail=True))
    assert (full.has_maker_note, full.has_thumbnail, full.related_size) == (True, True, (4000, 3000))
    assert not of(tmp_path, exif_block(maker_note=8)).has_maker_note


def test_an_interoperability_directory_cut_short_states_nothing(tmp_path: Path) -> None:
    whole = exif_block(related=(4000, 3000))
    assert of(tmp_path, whole[: whole.index(struct.pack("<I", 3000), 80) - 2]).related_size is None


def test_an_interoperability_directory_outside_the_block_is_no_fault(tmp_path: Path) -> None:
    pointer, astray = (struct.pack("<HHII", 0xA005, 4, 1, at) for at in (80, 9999))
    assert of(tmp_path, exif_block(related=(4000, 3000)).replace(pointer, astray)).related_size is None
