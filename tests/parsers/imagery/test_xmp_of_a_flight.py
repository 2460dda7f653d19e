"""The frames of a flight share one parse of their XMP: what differs between them is left out where that is safe."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.errors import ParseError
from calibrary.parsers.imagery import xmp
from calibrary.parsers.imagery.xmp import XmpFacts, XmpWords, xmp_facts
from tests.imagery.xmp import DRONE_DJI
from tests.parsers.imagery.build import rdf
from tests.thorough import examples

NAMESPACES = (
    f'xmlns:drone-dji="{DRONE_DJI.uri}" xmlns:tiff="http://ns.adobe.com/tiff/1.0/" xmlns:q="urn:q" '
    'xmlns:xmpMM="http://ns.adobe.com/xap/1.0/mm/"'
)


def frame(latitude: str, flag: str = "0", closing: str = "") -> bytes:
    attributes = f'drone-dji:GpsLatitude="{latitude}"\n drone-dji:DewarpFlag="{flag}" tiff:Model="M3E"'
    return rdf(f'<rdf:Description rdf:about="" {attributes}/>', NAMESPACES) + closing.encode()


def test_frames_that_differ_in_their_position_are_parsed_once() -> None:
    xmp._parse_once.cache_clear()
    found = {
        xmp.read_xmp([frame(latitude, closing=closing)], "a.jpg")
        for latitude in ("+46.1", "-7.25", "2024-05-17T06:00:00+02:00", "a > b")
        for closing in ("", " " * 3000 + "<?xpacket end='w'?>", '\n<?xpacket end="r"?>\0\0')
    }
    assert (xmp._parse_once.cache_info().misses, len(found)) == (1, 1)
    assert [name.rpartition("}")[2] for name, _ in found.pop().properties] == ["DewarpFlag", "Model"]


def test_a_value_that_is_taken_is_always_read() -> None:
    found = [xmp_facts(xmp.read_xmp([frame("+46.1", flag)], "a.jpg")) for flag in ("0", "1")]
    assert [facts.properties["drone-dji", "DewarpFlag"].values for facts in found] == [("0",), ("1",)]


@pytest.mark.parametrize("value", ["1 < 2", "1 & 2", "&nonsense;", "\x01"])
def test_a_value_that_no_attribute_can_have_is_a_fault_also_after_a_good_frame(value: str) -> None:
    assert not xmp.read_xmp([frame("+46.1")], "a.jpg").faults
    assert xmp.read_xmp([frame(value)], "a.jpg").faults


LOCAL = ["q:a", "drone-dji:GpsLatitude", "drone-dji:DewarpFlag", "tiff:Model", "q:action", "q:Model"]
PIECES = ['"', ' q:a="5"', ' q:a="', '" q:b="', "q:GpsLatitude=", "1", "&lt;", "&amp;", ">", " ", "\n", "é"]


def texts(*, rare: bool) -> st.SearchStrategy[str]:
    return st.lists(st.sampled_from([*PIECES, "'"] if rare else PIECES), max_size=3).map("".join)


@st.composite
def attributes(draw: st.DrawFn, *, rare: bool) -> str:
    quote = draw(st.sampled_from("\"'" if rare else '"'))
    names = draw(st.lists(st.sampled_from(LOCAL), max_size=3, unique=True))
    values = (draw(texts(rare=rare)).replace(quote, "") for _ in names)
    return "".join(f" {name}={quote}{value}{quote}" for name, value in zip(names, values, strict=True))


@st.composite
def element(draw: st.DrawFn, *, rare: bool, depth: int = 0) -> str:
    name = draw(st.sampled_from(["rdf:Description", "tiff:Model", "xmpMM:History", "rdf:li", "q:a"]))
    inside = [texts(rare=rare), *([element(rare=rare, depth=depth + 1)] if depth < 2 else [])]
    if rare:
        inside += [texts(rare=rare).map(form.format) for form in ("<!--{}-->", "<![CDATA[{}]]>", "<?q {}?>")]
    children = "".join(draw(st.lists(st.one_of(inside), max_size=3)))
    return f"<{name}{draw(attributes(rare=rare))}>{children}</{name}>"


@given(st.one_of(element(rare=False), element(rare=True)), st.none() | st.integers(0, 2000))
@settings(max_examples=examples(60, 1000))
def test_the_short_cut_says_what_the_whole_packet_says(body: str, lost: int | None) -> None:
    packet = rdf(f"<rdf:Description>{body}</rdf:Description>", NAMESPACES)
    if lost is not None:
        packet = packet[: lost % len(packet)] + packet[lost % len(packet) + 1 :]
    assert outcome(packet, whole=False) == outcome(packet, whole=True)


def outcome(packet: bytes, *, whole: bool) -> XmpFacts | tuple[str, str | None]:
    """The facts, or the fault and where it is."""
    try:
        words = xmp._parse(packet, "") if whole else xmp._read_packet(packet, "")
    except ParseError as error:
        return error.message, error.place
    return xmp_facts(XmpWords(words))
