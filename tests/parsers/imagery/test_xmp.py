"""XMP is read by namespace and name, in every spelling RDF allows."""

from __future__ import annotations

import pytest

from calibrary.evidence.metadata import ImageMetadata, XmpProperty
from tests.imagery import (
    ExifTags,
    ListKind,
    Namespace,
    StructForm,
    XmpDescription,
    XmpItem,
    XmpList,
    XmpPacket,
    XmpStruct,
    XmpText,
    attributes,
    elements,
)
from tests.imagery.jpeg import exif_segment, xmp_segments
from tests.imagery.xmp import (
    CAMERA_RAW,
    DRONE_DJI,
    DRONE_SKYDIO,
    EXIF,
    PIX4D_1,
    PIX4D_CAMERA,
    PIX4D_CAMERA_SLASH,
    TIFF,
    XMP,
)
from tests.parsers.imagery.build import jpeg, jpeg_with_xmp, packet, rdf, read

CAMERA_URIS = [PIX4D_1, PIX4D_CAMERA, PIX4D_CAMERA_SLASH, Namespace("Camera", "Camera/")]
SKYDIO = f'xmlns:s="{DRONE_SKYDIO.uri}"'


def read_items(*items: XmpItem) -> ImageMetadata:
    return read(jpeg_with_xmp(packet(*items)))


def read_rdf(body: str, namespaces: str = SKYDIO) -> ImageMetadata:
    return read(jpeg_with_xmp(rdf(body, namespaces)))


@pytest.mark.parametrize("as_attribute", [True, False])
def test_a_property_is_the_same_as_attribute_and_as_element(as_attribute: bool) -> None:
    text = XmpText(namespace=DRONE_DJI, name="DewarpFlag", text="1", as_attribute=as_attribute)
    assert read_items(text).xmp == (XmpProperty("drone-dji", "DewarpFlag", ("1",)),)


@pytest.mark.parametrize("namespace", CAMERA_URIS)
def test_the_four_uris_of_the_camera_schema_are_one_schema(namespace: Namespace) -> None:
    metadata = read_items(*elements(namespace, PerspectiveFocalLength="1449.25", BandName=("Blue",)))
    assert metadata.xmp_text("Camera", "PerspectiveFocalLength") == "1449.25"
    assert metadata.xmp_values("Camera", "BandName") == ("Blue",)


def test_a_prefix_means_nothing() -> None:
    skydio_under_djis_prefix = Namespace("drone-dji", DRONE_SKYDIO.uri)
    metadata = read_items(*attributes(skydio_under_djis_prefix, DewarpData="0.1,-0.2,0.05"))
    assert metadata.xmp_text("drone-dji", "DewarpData") is None
    assert metadata.xmp_text("drone-skydio", "DewarpData") == "0.1,-0.2,0.05"


def test_an_unknown_namespace_is_left_alone() -> None:
    assert (
        read_items(*attributes(Namespace("Camera", "http://example.org/"), PerspectiveFocalLength="5")).xmp
        == ()
    )


def test_several_descriptions_are_one_document_in_order() -> None:
    descriptions = (
        XmpDescription(items=elements(PIX4D_1, BandName="NIR", PerspectiveFocalLength="5.4")),
        XmpDescription(items=attributes(PIX4D_CAMERA, PrincipalPoint="2.4,1.8", BandName="RedEdge")),
    )
    metadata = read(jpeg_with_xmp(XmpPacket(descriptions=descriptions).encode()))
    assert metadata.xmp == (
        XmpProperty("Camera", "BandName", ("NIR",)),
        XmpProperty("Camera", "PerspectiveFocalLength", ("5.4",)),
        XmpProperty("Camera", "PrincipalPoint", ("2.4,1.8",)),
    )


@pytest.mark.parametrize("kind", ListKind)
def test_lists_keep_their_order(kind: ListKind) -> None:
    texts = ("-0.0968", "0.1404", "-0.0230", "0.0003", "0.0007")
    item = XmpList(namespace=PIX4D_1, name="PerspectiveDistortion", texts=texts, kind=kind)
    metadata = read_items(item)
    assert metadata.xmp_values("Camera", "PerspectiveDistortion") == texts
    assert metadata.xmp_text("Camera", "PerspectiveDistortion") == ",".join(texts)


@pytest.mark.parametrize("form", StructForm)
def test_structures_are_members_in_each_spelling(form: StructForm) -> None:
    members = (("X", "2378.5"), ("Y", "2376.75"))
    metadata = read_items(
        XmpStruct(namespace=DRONE_SKYDIO, name="CalibratedFocalLength", members=members, form=form)
    )
    assert metadata.xmp == (
        XmpProperty("drone-skydio", "CalibratedFocalLength/X", ("2378.5",)),
        XmpProperty("drone-skydio", "CalibratedFocalLength/Y", ("2376.75",)),
    )


def test_a_nested_description_may_have_attributes() -> None:
    body = (
        "<rdf:Description><s:CalibratedOpticalCenter>"
        '<rdf:Description s:X="2027.5" s:Y="1519.5"/>'
        "</s:CalibratedOpticalCenter></rdf:Description>"
    )
    metadata = read_rdf(body)
    assert metadata.xmp_text("drone-skydio", "CalibratedOpticalCenter/X") == "2027.5"
    assert metadata.xmp_text("drone-skydio", "CalibratedOpticalCenter/Y") == "1519.5"


def test_a_qualified_value_is_its_value() -> None:
    body = (
        '<rdf:Description><s:DewarpFlag rdf:parseType="Resource">'
        "<rdf:value>1</rdf:value><s:note>by hand</s:note></s:DewarpFlag></rdf:Description>"
    )
    assert read_rdf(body).xmp == (XmpProperty("drone-skydio", "DewarpFlag", ("1",)),)


def test_the_history_keeps_what_was_done_and_not_when_or_where() -> None:
    mm = 'xmlns:xmpMM="http://ns.adobe.com/xap/1.0/mm/" xmlns:e="http://ns.adobe.com/xap/1.0/sType/ResourceEvent#"'
    step = (
        '<rdf:li rdf:parseType="Resource"><e:action>{}</e:action>{}<e:when>2020-02-02T02:02</e:when></rdf:li>'
    )
    steps = step.format(
        "converted", "<e:parameters>from image/dng to image/jpeg</e:parameters>"
    ) + step.format("saved", "")
    body = f"<rdf:Description><xmpMM:History><rdf:Seq>{steps}</rdf:Seq></xmpMM:History></rdf:Description>"
    assert read_rdf(body, mm).xmp == (
        XmpProperty("xmpMM", "History/action", ("converted", "saved")),
        XmpProperty("xmpMM", "History/parameters", ("from image/dng to image/jpeg",)),
    )


def test_values_come_stripped_and_empty_ones_not_at_all() -> None:
    metadata = read_items(
        *attributes(DRONE_DJI, DewarpData=" 2018-09-04;3666.5,1\n", ProductName="", DroneModel="  ")
    )
    assert metadata.xmp == (XmpProperty("drone-dji", "DewarpData", ("2018-09-04;3666.5,1",)),)


def test_fields_of_view_and_marks_of_processing_are_taken() -> None:
    metadata = read_items(
        *attributes(EXIF, CameraHorizontalFOV="68.2"),
        *attributes(CAMERA_RAW, AlreadyApplied="True", HasCrop="True", LensProfileEnable="1"),
        *attributes(XMP, CreatorTool="Adobe Photoshop 23.1 (Windows)", CreateDate="2021-01-01"),
    )
    assert metadata.xmp_text("exif", "CameraHorizontalFOV") == "68.2"
    assert metadata.xmp_text("crs", "LensProfileEnable") == "1"
    assert metadata.xmp_text("xmp", "CreatorTool") == "Adobe Photoshop 23.1 (Windows)"
    assert metadata.xmp_text("xmp", "CreateDate") is None


def test_xmp_names_the_camera_where_exif_does_not() -> None:
    names = attributes(TIFF, Make="Autel Robotics", Model="XL715")
    assert (read_items(*names).make, read_items(*names).model) == ("Autel Robotics", "XL715")


@pytest.mark.parametrize(
    ("exif_make", "make"),
    [("Camera", "Autel Robotics"), ("CAMERA", "Autel Robotics"), ("Hasselblad", "Hasselblad")],
)
def test_exif_names_the_camera_unless_its_make_is_known_to_be_wrong(exif_make: str, make: str) -> None:
    segments = xmp_segments(packet(*attributes(TIFF, Make="Autel Robotics", Model="test/pro")))
    metadata = read(jpeg(exif_segment(ExifTags(make=exif_make, model="L1D-20c")), *segments))
    assert (metadata.make, metadata.model) == (make, "L1D-20c")


def test_a_make_of_camera_stays_where_nothing_better_is_known() -> None:
    assert read(jpeg(exif_segment(ExifTags(make="Camera")))).make == "Camera"


def test_skydios_release_key_is_its_software() -> None:
    key = attributes(DRONE_SKYDIO, ReleaseKey="0123456789abcdef0123456789abcdef")
    assert read_items(*key).software == "0123456789abcdef0123456789abcdef"


@pytest.mark.parametrize(
    "broken",
    [
        b"<x:xmpmeta",
        b"not XML at all",
        b"",
        b'<!DOCTYPE a [<!ENTITY x "1">]><a/>',
        rdf('<rdf:Description undeclared:a="1"/>'),
        rdf("<rdf:Description>")[:-30],
        b"<a>" * 300 + b"</a>" * 300,
    ],
)
def test_broken_xmp_is_a_fault_and_exif_counts(broken: bytes) -> None:
    metadata = read(jpeg(exif_segment(ExifTags(make="DJI", focal_mm=(88, 10))), *xmp_segments(broken)))
    assert (metadata.make, metadata.focal_mm) == ("DJI", 8.8)
    (fault,) = metadata.faults
    assert (fault.tag, fault.expected) == ("XMP", "well-formed XMP")


def test_a_broken_packet_does_not_cost_the_next_one() -> None:
    good = packet(*attributes(DRONE_DJI, DewarpFlag="0"))
    metadata = read(jpeg(*xmp_segments(b"<broken"), *xmp_segments(good)))
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"
    assert len(metadata.faults) == 1


def test_padding_of_any_kind_around_a_packet_is_fine() -> None:
    body = packet(*attributes(DRONE_DJI, DewarpFlag="0"))
    for padded in (b"\xef\xbb\xbf" + body, body + bytes(500), b" \n" + body + b" " * 500 + b"\0"):
        metadata = read(jpeg_with_xmp(padded))
        assert (metadata.xmp_text("drone-dji", "DewarpFlag"), metadata.faults) == ("0", ())


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "utf-16"])
def test_packets_in_utf_16_are_read(encoding: str) -> None:
    body = packet(*attributes(DRONE_DJI, DewarpFlag="0")).decode()
    metadata = read(jpeg_with_xmp(body.encode(encoding) + bytes(100)))
    assert (metadata.xmp_text("drone-dji", "DewarpFlag"), metadata.faults) == ("0", ())


def test_a_value_of_absurd_length_is_a_fault_and_not_a_shorter_value() -> None:
    metadata = read_items(*attributes(DRONE_DJI, DewarpData="1," * 5000, DewarpFlag="0"))
    assert metadata.xmp_text("drone-dji", "DewarpData") is None
    assert metadata.xmp_text("drone-dji", "DewarpFlag") == "0"
    assert [fault.tag for fault in metadata.faults] == ["XMP drone-dji:DewarpData"]


def test_what_cannot_be_printed_is_left_out_of_values() -> None:
    assert (
        read_items(*attributes(DRONE_DJI, DroneModel="M\u202e3\u200bT")).xmp_text("drone-dji", "DroneModel")
        == "M3T"
    )
