"""XMP packets say one thing in every spelling RDF allows; an XML parser is the judge."""

from __future__ import annotations

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from calibrary.errors import InputError
from tests.imagery import (
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
from tests.imagery.xmp import DRONE_DJI, DRONE_SKYDIO, PIX4D_1, PIX4D_CAMERA

RDF = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
XML_TEXT = st.text(
    st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\ufffe\uffff")
    | st.sampled_from("\t\n\r")
)


def packet(*items: XmpItem, length: int | None = None) -> XmpPacket:
    return XmpPacket(descriptions=(XmpDescription(items=items),), length=length)


def description(*items: XmpItem) -> etree._Element:
    (rdf,) = etree.fromstring(packet(*items).encode())
    (found,) = rdf
    return found


@given(XML_TEXT)
def test_any_text_survives_as_an_attribute(text: str) -> None:
    found = description(*attributes(DRONE_DJI, DewarpData=text))
    assert found.get(f"{{{DRONE_DJI.uri}}}DewarpData") == text


@given(XML_TEXT)
def test_any_text_survives_as_an_element(text: str) -> None:
    (child,) = description(*elements(PIX4D_1, BandName=text))
    assert child.tag == f"{{{PIX4D_1.uri}}}BandName"
    assert (child.text or "") == text


@pytest.mark.parametrize("kind", ListKind)
def test_a_list_keeps_its_order(kind: ListKind) -> None:
    texts = ("-0.1", "0.2", "-0.3")
    (child,) = description(XmpList(namespace=PIX4D_1, name="PerspectiveDistortion", texts=texts, kind=kind))
    (container,) = child
    assert container.tag == f"{RDF}{kind}"
    assert tuple(item.text for item in container) == texts


def test_elements_of_several_texts_are_a_sequence() -> None:
    (child,) = description(*elements(PIX4D_1, PerspectiveDistortion=("-0.1", "0.2")))
    assert [item.text for item in child[0]] == ["-0.1", "0.2"]


@pytest.mark.parametrize("form", StructForm)
def test_a_structure_holds_its_members_in_every_form(form: StructForm) -> None:
    members = (("X", "2378.5"), ("Y", "2376.8"))
    item = XmpStruct(namespace=DRONE_SKYDIO, name="CalibratedFocalLength", members=members, form=form)
    (child,) = description(item)
    holder = child[0] if form is StructForm.DESCRIPTION else child
    inline = form is StructForm.INLINE
    tags = holder.attrib if inline else (member.tag for member in holder)
    found = {str(tag): holder.get(tag) if inline else holder.findtext(str(tag)) for tag in tags}
    assert found == {f"{{{DRONE_SKYDIO.uri}}}{name}": text for name, text in members}


def test_one_prefix_may_stand_for_two_uris_in_two_descriptions() -> None:
    both = XmpPacket(
        descriptions=(
            XmpDescription(items=elements(PIX4D_1, BandName="Blue")),
            XmpDescription(items=elements(PIX4D_CAMERA, BandName="Red")),
        )
    )
    root = etree.fromstring(both.encode())
    assert [e.text for e in root.iter(f"{{{PIX4D_1.uri}}}BandName")] == ["Blue"]
    assert [e.text for e in root.iter(f"{{{PIX4D_CAMERA.uri}}}BandName")] == ["Red"]


def test_one_prefix_for_two_uris_in_one_description_is_refused() -> None:
    items = (*elements(PIX4D_1, BandName="Blue"), *elements(PIX4D_CAMERA, ModelType="perspective"))
    with pytest.raises(InputError, match="prefix 'Camera' stands for"):
        packet(*items).encode()


def test_a_namespace_may_have_any_prefix() -> None:
    odd = Namespace("q", DRONE_DJI.uri)
    found = description(XmpText(namespace=odd, name="DewarpFlag", text="1"))
    assert found.get(f"{{{DRONE_DJI.uri}}}DewarpFlag") == "1"


def test_a_packet_is_filled_up_to_its_length_before_its_end() -> None:
    encoded = packet(*attributes(DRONE_DJI, DewarpFlag="0"), length=8159).encode()
    assert len(encoded) == 8159
    assert encoded.startswith(b'<?xpacket begin="\xef\xbb\xbf"')
    assert encoded.endswith(b' <?xpacket end="w"?>')


def test_a_packet_longer_than_its_length_is_refused() -> None:
    with pytest.raises(InputError, match="expected at most 100"):
        packet(*attributes(DRONE_DJI, DewarpFlag="0"), length=100).encode()


def test_a_packet_may_come_without_its_instructions() -> None:
    bare = XmpPacket(descriptions=(), wrapped=False, toolkit='T & "T"').encode()
    assert bare.startswith(b"<x:xmpmeta")
    assert etree.fromstring(bare).get("{adobe:ns:meta/}xmptk") == 'T & "T"'


def test_the_main_packet_names_its_extension_by_its_digest() -> None:
    extension = (XmpDescription(items=attributes(DRONE_DJI, DewarpData="x" * 100)),)
    both = XmpPacket(descriptions=(), extended=extension)
    digest = hashlib.md5(both.encode_extended(), usedforsecurity=False).hexdigest().upper()
    (found,) = etree.fromstring(both.encode()).iter(f"{RDF}Description")
    assert found.get("{http://ns.adobe.com/xmp/note/}HasExtendedXMP") == digest == both.guid()


def test_the_main_packet_may_name_another_extension() -> None:
    extension = (XmpDescription(items=attributes(DRONE_DJI, DewarpData="x")),)
    lie = XmpPacket(descriptions=(), extended=extension, extended_guid="0" * 32)
    assert b'HasExtendedXMP="00000000000000000000000000000000"' in lie.encode()
