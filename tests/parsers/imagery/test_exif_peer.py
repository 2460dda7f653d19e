"""Values decoded here are those of exifread, an independent reader of the same block."""

from __future__ import annotations

import io
import math
from typing import Any, Literal

import exifread
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.parsers.imagery.exif import TAG_NAMES, TEXT_TAGS, ExifTag, decode, read_block
from calibrary.parsers.imagery.source import Block
from tests.imagery import ByteOrder, ExifTags, FieldType
from tests.imagery.structure import Field, Ifd, encode
from tests.thorough import examples

LIMITS = {
    FieldType.BYTE: (0, 2**8 - 1),
    FieldType.SHORT: (0, 2**16 - 1),
    FieldType.LONG: (0, 2**32 - 1),
    FieldType.SBYTE: (-(2**7), 2**7 - 1),
    FieldType.SSHORT: (-(2**15), 2**15 - 1),
    FieldType.SLONG: (-(2**31), 2**31 - 1),
}
PARTS = {FieldType.RATIONAL: LIMITS[FieldType.LONG], FieldType.SRATIONAL: LIMITS[FieldType.SLONG]}
WIDTHS: dict[FieldType, Literal[32, 64]] = {FieldType.FLOAT: 32, FieldType.DOUBLE: 64}


@st.composite
def fields(draw: st.DrawFn) -> Field:
    """A number of any type, or a text as ASCII, UNDEFINED or BYTE."""
    tag = draw(st.sampled_from(sorted(TAG_NAMES)))
    if tag in TEXT_TAGS:
        text = draw(st.binary(max_size=40) | st.text(max_size=12).map(str.encode))
        return Field(tag=tag, type=FieldType.ASCII, values=text)
    kind = draw(st.sampled_from([*LIMITS, *PARTS, *WIDTHS]))
    value: st.SearchStrategy[Any]
    if kind in PARTS:
        low, high = PARTS[kind]
        number = st.integers(low, high)
        value = st.tuples(number, st.just(0) | number)
    elif kind in WIDTHS:
        value = st.floats(width=WIDTHS[kind])
    else:
        value = st.integers(*LIMITS[kind])
    numbers: tuple[Any, ...] = tuple(draw(st.lists(value, min_size=1, max_size=8)))
    return Field(tag=tag, type=kind, values=numbers)


def ours(block: bytes) -> dict[int, object]:
    return dict(decode(read_block(Block.of(block, "a.jpg"))))


def theirs(block: bytes) -> dict[int, object]:
    """Values of exifread in our form: bytes for text, a number for a tuple of one, the text of a ratio x/0."""
    tags = exifread.process_file(io.BytesIO(block), details=False, extract_thumbnail=False)
    return {
        tag.tag: _text(tag.values) if tag.tag in TEXT_TAGS else tuple(map(_number, tag.values))
        for tag in tags.values()
        if tag.tag in TAG_NAMES
    }


def _text(values: str | bytes) -> bytes:
    return values.encode() if isinstance(values, str) else values


def _number(value: Any) -> object:
    if isinstance(value, tuple):
        return value[0]
    return f"{value.numerator}/0" if value.denominator == 0 else value


def same(one: object, other: object) -> bool:
    """Whether two values are equal; NaN equals NaN, and 0.0 differs from -0.0."""
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return (math.isnan(one) and math.isnan(other)) or (
            one == other and math.copysign(1, one) == math.copysign(1, other)
        )
    return one == other


@given(field=fields(), order=st.sampled_from(ByteOrder), in_ifd0=st.booleans())
@settings(max_examples=examples(20, 2000))
def test_a_field_of_any_type_has_the_value_that_exifread_reads(
    field: Field, order: ByteOrder, in_ifd0: bool
) -> None:
    directory = Ifd(fields=(field,))
    whole = directory if in_ifd0 else Ifd(fields=(), children=((0x8769, directory),))
    block = encode([whole], order)
    found, expected = ours(block), theirs(block)
    assert found.keys() == expected.keys() == {field.tag}
    assert same(found[field.tag], expected[field.tag])


@pytest.mark.parametrize("order", ByteOrder)
def test_all_tags_of_a_camera_have_the_values_that_exifread_reads(order: ByteOrder) -> None:
    block = ExifTags(
        make="DJI",
        model="FC6310R",
        software="v01.09.1691",
        lens_model="24.0 mm f/2.8",
        body_serial="0123456789",
        orientation=1,
        focal_mm=(880, 100),
        focal_35mm=24,
        digital_zoom=(0, 0),
        pixel_size=(5472, 3648),
        focal_plane_resolution=((3749, 10), (3750, 0)),
        focal_plane_unit=4,
        maker_note=b"\1" * 3000,
        byte_order=order,
    ).encode()
    found = ours(block)
    assert found == theirs(block)
    assert found.keys() == TAG_NAMES.keys() - {ExifTag.LENS_SERIAL, ExifTag.DNG_SERIAL}
    assert found[ExifTag.DIGITAL_ZOOM] == ("0/0",)
