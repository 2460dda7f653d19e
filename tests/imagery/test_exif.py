"""EXIF is read back by Pillow and exifread as it was said: every type, both orders, and wrong on purpose."""

from __future__ import annotations

import io
from typing import Any

import exifread
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from calibrary.errors import InputError
from calibrary.records import replace
from tests.imagery import TAGS, ByteOrder, ExifField, ExifTags, FieldType, GpsPosition
from tests.imagery.exif import Directory
from tests.imagery.jpeg import assemble, exif_segment, flat_scan
from tests.imagery.structure import Field, Ifd, encode

UINT32 = st.integers(0, 2**32 - 1)

FULL = ExifTags(
    make="Acme",
    model="Mapper 7",
    software="v3.1",
    description="über allem",
    date_time="2024:05:17 09:30:12",
    orientation=3,
    exposure_time=(1, 640),
    f_number=(28, 10),
    iso=200,
    focal_mm=(1137, 100),
    focal_35mm=31,
    digital_zoom=(3, 2),
    pixel_size=(5280, 3956),
    focal_plane_resolution=((2_993_333, 10_000), (2_993_334, 10_000)),
    focal_plane_unit=4,
    lens_make="Glassworks",
    lens_model="GW 11.4 mm",
    lens_specification=((114, 10), (114, 10), (28, 10), (0, 0)),
    body_serial="SN-000417",
    maker_note=bytes(range(256)),
)


def exif_of(tags: ExifTags) -> Image.Exif:
    exif = Image.Exif()
    exif.load(b"Exif\0\0" + tags.encode())
    return exif


def exifread_of(tags: ExifTags) -> dict[str, Any]:
    file = assemble([exif_segment(tags)], flat_scan((64, 48)))
    return dict(exifread.process_file(io.BytesIO(file), details=False))


@pytest.mark.parametrize("order", ByteOrder)
def test_pillow_reads_every_attribute(order: ByteOrder) -> None:
    exif = exif_of(replace(FULL, byte_order=order))
    inner = exif.get_ifd(0x8769)
    assert exif[0x010F] == "Acme"
    assert exif[0x0110] == "Mapper 7"
    assert exif[0x0131] == "v3.1"
    assert exif[0x0112] == 3
    assert exif[0x0132] == inner[0x9003] == inner[0x9004] == "2024:05:17 09:30:12"
    assert inner[0x829A] == pytest.approx(1 / 640)
    assert inner[0x829D] == pytest.approx(2.8)
    assert inner[0x8827] == 200
    assert inner[0x920A] == pytest.approx(11.37)
    assert inner[0xA405] == 31
    assert inner[0xA404] == pytest.approx(1.5)
    assert (inner[0xA002], inner[0xA003]) == (5280, 3956)
    assert inner[0xA20E] == pytest.approx(299.3333)
    assert inner[0xA20F] == pytest.approx(299.3334)
    assert inner[0xA210] == 4
    assert inner[0xA433] == "Glassworks"
    assert inner[0xA434] == "GW 11.4 mm"
    assert inner[0xA431] == "SN-000417"
    assert [(r.numerator, r.denominator) for r in inner[0xA432]] == list(FULL.lens_specification or ())
    assert inner[0x927C] == bytes(range(256))


@pytest.mark.parametrize("order", ByteOrder)
def test_exifread_reads_the_same(order: ByteOrder) -> None:
    tags = exifread_of(replace(FULL, byte_order=order))
    assert str(tags["Image Make"]) == "Acme"
    assert str(tags["Image Model"]) == "Mapper 7"
    assert float(tags["EXIF FocalLength"].values[0]) == pytest.approx(11.37)
    assert tags["EXIF FocalLengthIn35mmFilm"].values == [31]
    assert tags["EXIF ExifImageWidth"].values == [5280]
    assert tags["EXIF ExifImageLength"].values == [3956]
    assert tags["EXIF FocalPlaneResolutionUnit"].values == [4]
    assert str(tags["EXIF BodySerialNumber"]) == "SN-000417"


@given(numerator=UINT32, denominator=UINT32, order=st.sampled_from(ByteOrder))
def test_a_rational_is_stored_unreduced_and_undivided(
    numerator: int, denominator: int, order: ByteOrder
) -> None:
    tags = ExifTags(focal_mm=(numerator, denominator), byte_order=order)
    read = exif_of(tags).get_ifd(0x8769)[0x920A]
    assert (read.numerator, read.denominator) == (numerator, denominator)


@pytest.mark.parametrize("ratio", [(0, 0), (5, 0)])
def test_a_zero_denominator_reaches_the_reader(ratio: tuple[int, int]) -> None:
    value = exifread_of(ExifTags(focal_mm=ratio))["EXIF FocalLength"].values[0]
    assert (value.num, value.den) == ratio


def test_a_tag_may_hold_several_values() -> None:
    focals = ExifField("FocalLength", ((88, 10), (280, 10)))
    values = exifread_of(ExifTags(overrides=(focals,)))["EXIF FocalLength"].values
    assert [float(value) for value in values] == pytest.approx([8.8, 28.0])


@pytest.mark.parametrize(
    ("kind", "values", "read"),
    [
        (FieldType.ASCII, "8.8 mm", "8.8 mm"),
        (FieldType.SHORT, (9,), 9),
        (FieldType.SRATIONAL, ((-88, 10),), -8.8),
        (FieldType.DOUBLE, (8.8,), 8.8),
        (FieldType.FLOAT, (8.5,), 8.5),
        (FieldType.UNDEFINED, b"\x08\x08", b"\x08\x08"),
        (FieldType.SLONG, (-9,), -9),
        (FieldType.SSHORT, (-9,), -9),
        (FieldType.SBYTE, (-9,), -9),
    ],
)
def test_a_tag_may_have_a_type_the_standard_does_not_give_it(
    kind: FieldType, values: str | bytes | tuple[float, ...], read: object
) -> None:
    field = ExifField("FocalLength", values, type=kind)
    got = exif_of(ExifTags(overrides=(field,))).get_ifd(0x8769)[0x920A]
    assert float(got) == pytest.approx(read) if isinstance(read, float) else got == read


def test_an_override_replaces_the_attribute_of_its_name() -> None:
    tags = ExifTags(make="Acme", model="Mapper", overrides=(ExifField("Model", "Other"),))
    exif = exif_of(tags)
    assert (exif[0x010F], exif[0x0110], len(exif)) == ("Acme", "Other", 2)


def test_a_count_may_lie() -> None:
    field = ExifField("Model", "FC6310", count=0xFFFF_FFFF)
    block = ExifTags(overrides=(field,)).encode()
    assert block[10:18] == bytes.fromhex("1001 0200 ffffffff")


def test_an_offset_may_point_outside_the_file() -> None:
    field = ExifField("FocalLength", ((88, 10),), offset=0x7FFF_FFF0)
    block = ExifTags(overrides=(field,)).encode()
    assert bytes.fromhex("0a920500 01000000 f0ffff7f") in block


def test_a_directory_may_be_its_own_successor() -> None:
    block = encode([Ifd(fields=(Field(tag=0x0112, type=FieldType.SHORT, values=(1,)),), successor=8)])
    assert block[-4:] == bytes.fromhex("08000000")


def test_fields_stand_in_ascending_order_whatever_order_they_were_given_in() -> None:
    fields = [Field(tag=tag, type=FieldType.SHORT, values=(1,)) for tag in (0x0213, 0x0112, 0x0128)]
    block = encode([Ifd(fields=tuple(fields))])
    assert [block[10 + 12 * n : 12 + 12 * n] for n in range(3)] == [b"\x12\x01", b"\x28\x01", b"\x13\x02"]


@given(latitude=st.floats(-90, 90), longitude=st.floats(-180, 180), altitude=st.floats(-400, 9000))
def test_a_position_comes_back_to_the_last_tick(latitude: float, longitude: float, altitude: float) -> None:
    position = GpsPosition(latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude)
    gps = exif_of(ExifTags(position=position)).get_ifd(0x8825)
    for reference, tag, negative, degrees in ((1, 2, "S", latitude), (3, 4, "W", longitude)):
        whole, minutes, seconds = (float(value) for value in gps[tag])
        assert minutes < 60
        assert seconds < 60
        value = whole + minutes / 60 + seconds / 3600
        assert (-value if gps[reference] == negative else value) == pytest.approx(degrees, abs=2e-8)
    sign = -1 if gps[5] == b"\x01" else 1
    assert sign * float(gps[6]) == pytest.approx(altitude, abs=6e-4)


def test_a_thumbnail_is_found_through_ifd1() -> None:
    thumbnail = assemble([], flat_scan((160, 120)))
    tags = exifread.process_file(
        io.BytesIO(assemble([exif_segment(ExifTags(thumbnail=thumbnail))], flat_scan((8, 8)))), details=True
    )
    assert tags["JPEGThumbnail"] == thumbnail
    assert Image.open(io.BytesIO(thumbnail)).size == (160, 120)


def test_every_named_tag_is_found_in_its_directory() -> None:
    samples: dict[FieldType, str | bytes | tuple[int, ...] | tuple[tuple[int, int], ...]] = {
        FieldType.ASCII: "text",
        FieldType.BYTE: (1, 2, 3, 4),
        FieldType.SHORT: (1,),
        FieldType.LONG: (1,),
        FieldType.RATIONAL: ((1, 2),),
        FieldType.SRATIONAL: ((-1, 2),),
        FieldType.UNDEFINED: b"abcd",
    }
    tags = ExifTags(overrides=tuple(ExifField(name, samples[tag.type]) for name, tag in TAGS.items()))
    exif = exif_of(tags)
    inner = exif.get_ifd(0x8769)
    found = {
        Directory.IMAGE: exif,
        Directory.EXIF: inner,
        Directory.GPS: exif.get_ifd(0x8825),
        Directory.INTEROPERABILITY: exif.get_ifd(0xA005),
    }
    assert [name for name, tag in TAGS.items() if tag.number not in found[tag.directory]] == []


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(InputError, match="no tag is called 'FocalLenght'"):
        ExifTags(overrides=(ExifField("FocalLenght", ((88, 10),)),)).encode()


@pytest.mark.parametrize(
    ("name", "values"), [("FocalLength", (8,)), ("Orientation", (70_000,)), ("Make", (1,)), ("Flash", (0.5,))]
)
def test_values_that_do_not_fit_the_type_are_refused(name: str, values: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="cannot be stored as TIFF type"):
        ExifTags(overrides=(ExifField(name, values),)).encode()


def test_bytes_are_stored_whatever_the_type_code() -> None:
    block = ExifTags(overrides=(ExifField("FocalLength", b"\1\2\3", type=99),)).encode()
    assert bytes.fromhex("0a926300 03000000 01020300") in block
