"""XML comes in without a DTD, without entities, without reaching out, and within bounds."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.errors import ParseError
from calibrary.parsers.xml import parse_xml

LAUGHS = b"""<?xml version="1.0"?>
<!-- harmless so far -->
<!DOCTYPE lolz [
  <!ENTITY a "ha ha ha ha ha ha ha ha ha ha ha ha ha ha ha ha">
  <!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">
  <!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">
  <!ENTITY d "&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;">
  <!ENTITY e "&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;">
]>
<camera name="&e;">&e;</camera>"""


def test_a_document_gives_its_root() -> None:
    root = parse_xml(b'<calibration class="adjusted"><f>3658.1</f></calibration>', source="a.xml")
    assert (root.tag, root.get("class"), root.findtext("f")) == ("calibration", "adjusted", "3658.1")


def test_comments_and_instructions_are_left_out() -> None:
    root = parse_xml(b"<?xml version='1.0'?><a><!-- c --><?pi x?><b/>1<!-- c -->2</a>", source="a.xml")
    assert [child.tag for child in root] == ["b"]
    assert root[0].tail == "12"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_encodings_that_calibration_programs_write_are_read(encoding: str) -> None:
    declared = "utf-8" if encoding == "utf-8-sig" else encoding
    text = f'<?xml version="1.0" encoding="{declared}"?><lens>Würzburg 24 mm</lens>'
    assert parse_xml(text.encode(encoding), source="a.xml").text == "Würzburg 24 mm"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_a_document_type_is_refused_in_every_encoding(encoding: str) -> None:
    text = '\n<?xpacket a?><!-- <a> -->\n<!DOCTYPE a [<!ENTITY x "y">]><a>&x;</a>'
    with pytest.raises(ParseError):
        parse_xml(text.encode(encoding), source="a.xml")


def test_a_document_type_hidden_by_an_odd_encoding_is_refused() -> None:
    text = '<?xml version="1.0" encoding="IBM037"?><!DOCTYPE a [<!ENTITY x "y">]><a>&x;</a>'
    with pytest.raises(ParseError, match=r"document type|encoding"):
        parse_xml(text.encode("cp037"), source="a.xml")


def test_the_words_doctype_inside_the_document_are_no_document_type() -> None:
    root = parse_xml(b"<!-- <!DOCTYPE html> --><a><![CDATA[<!DOCTYPE html>]]></a>", source="a.xml")
    assert root.text == "<!DOCTYPE html>"


def test_entity_expansion_is_refused_before_parsing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lxml.etree.fromstring", lambda *_: pytest.fail("parsed"))
    with pytest.raises(ParseError, match="document type"):
        parse_xml(LAUGHS, source="laughs.xml")


def test_no_file_is_read_through_an_entity(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("position 50.1 8.6")
    document = f'<!DOCTYPE a [<!ENTITY x SYSTEM "{secret.as_uri()}">]><a>&x;</a>'
    with pytest.raises(ParseError) as caught:
        parse_xml(document.encode(), source="a.xml")
    assert "50.1" not in str(caught.value)


def test_a_hostile_prolog_costs_linear_time() -> None:
    # Time that grew with the square would be hours here: a hang, which the run's own limit ends.
    for prolog in (b"<!--" * 200_000, b"<?" * 200_000, b" " * 1_000_000, b"<!-- -->" * 100_000):
        with pytest.raises(ParseError):
            parse_xml(prolog, source="a.xml")


def test_more_bytes_than_wanted_are_refused_before_parsing() -> None:
    with pytest.raises(ParseError, match="it is over"):
        parse_xml(b"<a>01234567</a>", source="a.xml", max_bytes=10)


def test_nesting_is_bounded() -> None:
    deep = b"<a>" * 5 + b"</a>" * 5
    assert parse_xml(deep, source="a.xml", max_depth=5).tag == "a"
    with pytest.raises(ParseError, match="more than 4 deep"):
        parse_xml(deep, source="a.xml", max_depth=4)


def test_absurd_nesting_is_an_error_not_a_crash() -> None:
    with pytest.raises(ParseError):
        parse_xml(b"<a>" * 200_000, source="a.xml")


def test_a_broken_document_is_named_with_its_line() -> None:
    with pytest.raises(ParseError) as caught:
        parse_xml(b"<a>\n<b>\n</a>", source="block.xml")
    assert caught.value.source == "block.xml"
    assert caught.value.place == "line 3"
    assert "well-formed" in str(caught.value)


@pytest.mark.parametrize(
    "data", [b"", b" ", b"K = [1 0 0]", b"<a", b'<?xml version="1.0" encoding="no-such"?><a/>']
)
def test_what_is_no_xml_is_a_parse_error(data: bytes) -> None:
    with pytest.raises(ParseError):
        parse_xml(data, source="a.xml")


def test_threads_may_parse_at_once() -> None:
    roots: list[str | None] = []

    def work(number: int) -> None:
        roots.extend(parse_xml(b"<a>%d</a>" % number, source="a.xml").text for _ in range(50))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(str(text) for text in roots) == sorted(
        str(number) for number in range(4) for _ in range(50)
    )


@given(st.binary(max_size=300) | st.text(alphabet="<>!?&;/= \"'ab[]DOCTYPE-", max_size=120).map(str.encode))
def test_any_bytes_give_a_root_or_a_parse_error_of_one_line(data: bytes) -> None:
    message = "noise.xml: "
    try:
        parse_xml(data, source="noise.xml")
    except ParseError as error:
        message = str(error)
    assert message.startswith("noise.xml: ")
    assert "\n" not in message
