"""EXIF becomes facts; a tag that cannot is named and costs nothing else."""

from __future__ import annotations

import logging
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata, TagFault
from calibrary.parsers.imagery.exif import ExifTag
from tests.imagery import ByteOrder, ExifField, ExifTags, FieldType
from tests.imagery.structure import Field, Ifd, encode
from tests.parsers.imagery.build import jpeg, jpeg_with_exif, read

MINIMAL = ExifTags(make="DJI", model="FC6310R", focal_mm=(88, 10))


def read_tags(*overrides: ExifField, **tags: Any) -> ImageMetadata:
    return read(jpeg_with_exif(ExifTags(**tags, overrides=overrides).encode()))


def fault_of(tag: str, field: ExifField) -> TagFault:
    """The one fault of an image whose only broken tag is this."""
    metadata = read_tags(field, make="DJI", orientation=1)
    assert metadata.make == "DJI"
    (fault,) = metadata.faults
    assert fault.tag == f"EXIF {tag}"
    assert metadata.fault(f"EXIF {tag}") is fault
    return fault


@pytest.mark.parametrize("order", ByteOrder)
def test_every_field_in_both_byte_orders(order: ByteOrder) -> None:
    metadata = read_tags(
        make="DJI",
        model="FC6310R",
        software="v01.09.1691",
        lens_model="24.0 mm f/2.8",
        orientation=1,
        focal_mm=(880, 100),
        focal_35mm=24,
        digital_zoom=(119, 100),
        pixel_size=(5472, 3648),
        focal_plane_resolution=((3749, 10), (3750, 10)),
        focal_plane_unit=4,
        byte_order=order,
    )
    assert metadata.has_exif
    assert metadata.faults == ()
    assert (metadata.make, metadata.model) == ("DJI", "FC6310R")
    assert (metadata.software, metadata.lens) == ("v01.09.1691", "24.0 mm f/2.8")
    assert (metadata.focal_mm, metadata.focal_35mm, metadata.digital_zoom) == (8.8, 24.0, 1.19)
    assert (metadata.orientation, metadata.exif_size) == (1, (5472, 3648))
    assert metadata.focal_plane_resolution == (374.9, 375.0)
    assert metadata.focal_plane_unit is FocalPlaneUnit.MILLIMETRE


@given(numerator=st.integers(1, 2**32 - 1), denominator=st.integers(1, 2**32 - 1))
def test_a_focal_length_is_the_correctly_rounded_quotient(numerator: int, denominator: int) -> None:
    assert read_tags(focal_mm=(numerator, denominator)).focal_mm == numerator / denominator


@pytest.mark.parametrize(
    ("ratio", "found"), [((5, 0), "5/0"), ((0, 0), "0/0"), ((0, 10), "0"), ((0, 1), "0")]
)
def test_a_focal_length_that_is_none_is_named_not_divided(ratio: tuple[int, int], found: str) -> None:
    metadata = read_tags(focal_mm=ratio, make="DJI", focal_35mm=20)
    assert metadata.focal_mm is None
    assert metadata.focal_35mm == 20
    assert metadata.faults == (TagFault("EXIF FocalLength", found, "a number above 0"),)


def test_a_negative_focal_length_is_named() -> None:
    field = ExifField("FocalLength", ((-88, 10),), type=FieldType.SRATIONAL)
    assert fault_of("FocalLength", field).found == "-44/5"


@pytest.mark.parametrize(
    ("field", "focal_mm"),
    [
        (ExifField("FocalLength", (8.5,), type=FieldType.DOUBLE), 8.5),
        (ExifField("FocalLength", (8.5,), type=FieldType.FLOAT), 8.5),
        (ExifField("FocalLength", (9,), type=FieldType.SHORT), 9.0),
        (ExifField("FocalLength", ((85, 10),), type=FieldType.SRATIONAL), 8.5),
        (ExifField("FocalLength", ((85, 10), (17, 2))), 8.5),
    ],
)
def test_a_focal_length_of_another_type_or_said_twice_is_still_a_number(
    field: ExifField, focal_mm: float
) -> None:
    metadata = read_tags(field)
    assert (metadata.focal_mm, metadata.faults) == (focal_mm, ())


def test_two_different_focal_lengths_are_none() -> None:
    fault = fault_of("FocalLength", ExifField("FocalLength", ((88, 10), (45, 10))))
    assert fault.found == "44/5, 9/2"


def test_not_a_number_is_named() -> None:
    field = ExifField("FocalLength", (float("nan"),), type=FieldType.DOUBLE)
    assert fault_of("FocalLength", field).found == "nan"


@pytest.mark.parametrize(
    "field",
    [
        ExifField("FocalLength", "8.8 mm", type=FieldType.ASCII),
        ExifField("FocalLength", b"\1\2\3\4\5\6\7\x08", type=FieldType.UNDEFINED),
        ExifField("FocalLength", b"\1\2\3\4", type=77, count=1),
        ExifField("FocalLength", b"", type=FieldType.RATIONAL, count=0),
        ExifField("FocalLength", ((88, 10),), count=4_000_000_000),
        ExifField("FocalLength", ((88, 10),), count=1000),
        ExifField("FocalLength", ((88, 10),), offset=4_000_000_000),
        ExifField("FocalLength", ((88, 10),), offset=100_000),
    ],
)
def test_a_wrong_type_a_wild_count_and_a_wild_offset_are_named(field: ExifField) -> None:
    fault_of("FocalLength", field)


def test_texts_of_the_wrong_type_are_named() -> None:
    field = ExifField("Software", (123,), type=FieldType.SHORT)
    assert fault_of("Software", field) == TagFault("EXIF Software", "no text (TIFF type 3)", "text")


def test_zero_of_a_35_mm_length_and_of_a_zoom_mean_unknown_and_are_no_faults() -> None:
    metadata = read_tags(focal_35mm=0, digital_zoom=(0, 1024))
    assert (metadata.focal_35mm, metadata.digital_zoom, metadata.faults) == (None, None, ())


@pytest.mark.parametrize("ratio", [(0, 0), (1, 0)])
def test_an_undefined_zoom_is_unknown_and_no_fault(ratio: tuple[int, int]) -> None:
    metadata = read_tags(digital_zoom=ratio)
    assert (metadata.digital_zoom, metadata.faults) == (None, ())


@pytest.mark.parametrize("orientation", [0, 9, 65535])
def test_an_orientation_that_is_none_is_named(orientation: int) -> None:
    metadata = read_tags(orientation=orientation)
    assert metadata.orientation is None
    assert metadata.faults == (TagFault("EXIF Orientation", str(orientation), "a whole number from 1 to 8"),)


@pytest.mark.parametrize(("code", "unit"), list(zip((2, 3, 4, 5), FocalPlaneUnit, strict=True)))
def test_the_four_units_of_the_focal_plane(code: int, unit: FocalPlaneUnit) -> None:
    assert read_tags(focal_plane_unit=code).focal_plane_unit is unit


def test_an_unknown_unit_and_an_absent_one_are_no_unit() -> None:
    assert read_tags(make="DJI").focal_plane_unit is None
    metadata = read_tags(focal_plane_unit=1)
    assert metadata.focal_plane_unit is None
    assert metadata.fault("EXIF FocalPlaneResolutionUnit") is not None


def test_a_resolution_in_one_direction_only_is_a_fault_of_the_other() -> None:
    metadata = read_tags(ExifField("FocalPlaneXResolution", ((3750, 1),)))
    assert metadata.focal_plane_resolution is None
    assert metadata.faults == (TagFault("EXIF FocalPlaneYResolution", "no such tag", "both of the pair"),)


def test_a_broken_half_of_a_pair_is_one_fault_not_two() -> None:
    metadata = read_tags(focal_plane_resolution=((3750, 1), (3750, 0)), pixel_size=(0, 3648))
    assert (metadata.focal_plane_resolution, metadata.exif_size) == (None, None)
    assert [fault.tag for fault in metadata.faults] == ["EXIF PixelXDimension", "EXIF FocalPlaneYResolution"]


@pytest.mark.parametrize(
    ("raw", "clean"),
    [
        ("DJI\0\0\0\0", "DJI"),
        ("  DJI  ", "DJI"),
        ("Canon\0garbage", "Canon"),
        ("A\x1b[31mB\x07\u202e", "A[31mB"),
        ("SONY \t\n ILCE", "SONY ILCE"),
        ("\0\0\0\0\0\0", None),
        ("          ", None),
        ("", None),
    ],
)
def test_texts_come_without_padding_and_control_characters(raw: str, clean: str | None) -> None:
    assert read_tags(model=raw).model == clean


def test_texts_are_bounded() -> None:
    assert read_tags(model="x" * 50_000).model == "x" * 200


def test_bytes_that_are_no_utf_8_are_kept_readable_and_not_logged(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        metadata = read_tags(ExifField("Model", b"FC\xb56310\0", type=FieldType.ASCII))
    assert metadata.model == "FCµ6310"
    assert caplog.records == []


def test_tags_that_stand_in_ifd0_instead_of_the_exif_directory_count() -> None:
    ifd = Ifd(fields=(Field(tag=ExifTag.FOCAL_LENGTH, type=FieldType.RATIONAL, values=((88, 10),)),))
    assert read(jpeg_with_exif(encode([ifd]))).focal_mm == 8.8


def test_where_both_directories_have_a_tag_the_standards_place_counts() -> None:
    inner = Ifd(fields=(Field(tag=ExifTag.FOCAL_LENGTH, type=FieldType.RATIONAL, values=((45, 10),)),))
    field = Field(tag=ExifTag.FOCAL_LENGTH, type=FieldType.RATIONAL, values=((88, 10),))
    assert read(jpeg_with_exif(encode([Ifd(fields=(field,), children=((0x8769, inner),))]))).focal_mm == 4.5


def test_no_exif_is_not_broken_exif() -> None:
    none, empty, broken = (
        read(jpeg()),
        read(jpeg_with_exif(encode([Ifd(fields=())]))),
        read(jpeg_with_exif(b"\0" * 50)),
    )
    assert (none.has_exif, none.faults) == (False, ())
    assert (empty.has_exif, empty.faults) == (True, ())
    assert broken.has_exif
    assert [fault.tag for fault in broken.faults] == ["EXIF"]


@pytest.mark.parametrize(
    "block", [b"", b"II", b"II*\0", b"II*\0\xff\xff\xff\xff", b"II*\0\0\0\0\0", b"MM\0*\0\0\0\x08\xff\xff"]
)
def test_a_broken_block_is_one_fault_and_the_size_stays(block: bytes) -> None:
    metadata = read(jpeg_with_exif(block))
    assert metadata.size == (40, 30)
    assert [fault.tag for fault in metadata.faults] == ["EXIF"]


def test_a_block_that_is_cut_off_keeps_what_is_left_and_says_so() -> None:
    whole = MINIMAL.encode()
    metadata = read(jpeg_with_exif(whole[: whole.index(b"FC6310R")]))
    assert metadata.make == "DJI"
    assert metadata.model is None
    assert metadata.fault("EXIF Model") is not None
    cut = read(jpeg_with_exif(whole[:30]))
    assert cut.fault("EXIF") == TagFault("EXIF", "a directory that is cut off", "the whole EXIF block")


def test_a_wild_exif_pointer_costs_the_exif_directory_only() -> None:
    pointer = Field(tag=0x8769, type=FieldType.LONG, values=(9_999_999,))
    make = Field(tag=ExifTag.MAKE, type=FieldType.ASCII, values="DJI")
    metadata = read(jpeg_with_exif(encode([Ifd(fields=(make, pointer))])))
    assert metadata.make == "DJI"
    assert [fault.tag for fault in metadata.faults] == ["EXIF"]


def test_a_hostile_maker_note_is_not_looked_at() -> None:
    note = b"Nikon\0\2\x10\0\0II*\0\x08\0\0\0" + b"\xff" * 40_000
    metadata = read_tags(make="NIKON CORPORATION", focal_mm=(88, 10), maker_note=note)
    assert (metadata.focal_mm, metadata.faults) == (8.8, ())


def test_nothing_is_logged_however_broken_the_block(caplog: pytest.LogCaptureFixture) -> None:
    blocks = [b"\0" * 20, MINIMAL.encode()[:50], encode([Ifd(fields=(), successor=8)])]
    with caplog.at_level(logging.INFO):
        for block in blocks:
            read(jpeg_with_exif(block))
    assert caplog.records == []
