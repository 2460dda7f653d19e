"""Numbers and documents, read strictly."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.errors import ParseError
from calibrary.parsers.content import Content
from calibrary.parsers.document import load_json
from calibrary.parsers.text import decode, image_size, lines, number, numbers, whole
from calibrary.strictjson import parse_json


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_number_python_writes_is_read_to_the_bit(value: float) -> None:
    assert number(repr(value)) == value
    assert number(f" {value:.17e} ") == value


@pytest.mark.parametrize(("text", "value"), [("1.", 1.0), (".5", 0.5), ("+3E+002", 300.0), ("1e-05", 1e-5)])
def test_other_programs_spellings_are_read(text: str, value: float) -> None:
    assert number(text) == value


@pytest.mark.parametrize("text", ["1_000", "0x10", "٣", "1e", "--1", "", "1 2", "1,000.5", "True"])
def test_what_is_not_plainly_a_number_is_none(text: str) -> None:
    with pytest.raises(ParseError, match="not a number"):
        number(text)


@pytest.mark.parametrize("text", ["nan", ".NaN", "-inf", "Infinity", "1e999", "1.#IND", "-.Inf"])
def test_what_is_not_finite_is_named_so(text: str) -> None:
    with pytest.raises(ParseError, match="not finite"):
        number(text)


def test_a_decimal_comma_gets_a_hint() -> None:
    with pytest.raises(ParseError, match="write a decimal point"):
        number("3650,7")


def test_a_message_escapes_what_cannot_be_printed() -> None:
    with pytest.raises(ParseError) as caught:
        number("\x1b[31m")
    assert "\x1b" not in str(caught.value)


def test_numbers_are_counted() -> None:
    assert numbers(" 1 2.5\n3 ", count=(2, 3)) == (1.0, 2.5, 3.0)
    with pytest.raises(ParseError, match="3 numbers, expected 4 or 5"):
        numbers("1 2 3", count=(4, 5))


def test_a_whole_number_may_be_written_with_a_point() -> None:
    assert whole("5472.0") == 5472
    with pytest.raises(ParseError, match="fraction"):
        whole("5472.5")


@pytest.mark.parametrize("size", [(0, 1), (1, -1), (1.5, 1), (1e7, 1), (float("nan"), 1), (1, float("inf"))])
def test_an_image_has_a_size_that_an_image_can_have(size: tuple[float, float]) -> None:
    with pytest.raises(ParseError, match="image size"):
        image_size(*size)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_text_of_every_usual_encoding_is_read(encoding: str) -> None:
    assert decode("5 µm, Süd".encode(encoding), source="x") == "5 µm, Süd"


@pytest.mark.parametrize("data", [b"\0\1\2", b"\xff\xfe1", b"\xff\xfe\0\xd8"])
def test_bytes_that_are_no_text_are_refused(data: bytes) -> None:
    with pytest.raises(ParseError):
        decode(data, source="x")


def test_lines_end_in_any_of_three_ways() -> None:
    assert lines(decode(b"a\r\nb\rc\n\n")) == ("a", "b", "c", "")
    assert lines("a\n3650.1") == ("a", "3650.1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b'{"a": 1, "a": 2}', "'a' is a duplicate key"),
        (b'{"a": NaN}', "NaN is not finite"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not JSON|cannot be read"),
        (b'{"a": 1', "not JSON|cannot be read"),
        (b"\xff\xfe\x00", "text"),
    ],
)
def test_json_that_means_two_things_or_none_is_refused(text: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parse_json(text, source="x")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_json_of_every_encoding_is_read(encoding: str) -> None:
    assert parse_json('{"a": "ü"}'.encode(encoding), source="x") == {"a": "ü"}


def test_a_complaint_says_which_key_it_is_about() -> None:
    camera = load_json(b'{"cam0": {"size": [640, "480", 1.5], "name": null, "on": true}}', source="c.json")[
        "cam0"
    ]
    assert camera["size"].items()[1].whole() == 480
    assert camera.get("name") is None
    assert "size" in camera
    for attempt, message in (
        (lambda: camera["size"].numbers(2), "c.json: cam0.size: 3 numbers, expected 2"),
        (camera["size"].items()[2].whole, r"c.json: cam0.size\[2\]: 1.5 has a fraction"),
        (lambda: camera["fx"], "c.json: cam0: there is no 'fx'; there are 'size', 'name', 'on'"),
        (camera["on"].number, "c.json: cam0.on: this is a yes or no, expected a number"),
        (camera["size"].text, "c.json: cam0.size: this is a list, expected text"),
        (camera["name"].items, "c.json: cam0.name: this is empty, expected a list"),
        (lambda: camera["size"]["x"], "c.json: cam0.size: this is a list, expected a mapping"),
        (lambda: camera["size"].matrix(2, 2), "c.json: cam0.size: 3 numbers, expected 4"),
        (lambda: camera.image_size("size", "on"), "c.json: cam0.size: this is a list, expected a number"),
    ):
        with pytest.raises(ParseError, match=message):
            attempt()


def test_a_matrix_may_lie_in_rows_or_flat() -> None:
    node = load_json(b'{"a": [[1, 2], [3, 4]], "b": [1, 2, 3, 4], "c": [[1, 2]]}', source="x")
    assert node["a"].matrix(2, 2) == node["b"].matrix(2, 2) == ((1, 2), (3, 4))
    with pytest.raises(ParseError, match="1 rows, expected 2"):
        node["c"].matrix(2, 2)


def test_a_number_past_all_floats_is_not_finite() -> None:
    with pytest.raises(ParseError, match="not finite"):
        load_json(b"1" + b"0" * 400, source="x").number()


def test_what_identifies_a_file_is_seen_without_parsing_it() -> None:
    xml = Content(
        b"\xef\xbb\xbf<?xml version='1.0'?>\n<!-- <a/> --> <x:meta xmlns:x='u'><b/><!-- <c/> --><d>", "M.XML"
    )
    assert (xml.xml_root, xml.xml_tags, xml.suffix) == ("meta", ("x:meta", "b", "d"), ".xml")
    yaml = Content(b"%YAML:1.0\n---\nfx: 1\n  deeper: 2\nCamera.fy: 3\ntime 12:30\n", "a")
    assert (yaml.yaml_keys, yaml.first_line, yaml.suffix) == (("fx", "Camera.fy"), "%YAML:1.0", "")
    binary = Content(b"\0\1\2", ".hidden")
    assert (binary.text, binary.lines, binary.xml_root, binary.json, binary.suffix) == (
        None,
        (),
        None,
        None,
        "",
    )
    assert Content(b'[{"a": 1}]', "x").json == [{"a": 1}]
    assert Content(b'{"a": 1, "b": 2}', "x").json_keys == ("a", "b")


@given(st.binary(max_size=200))
def test_looking_at_a_file_never_raises(data: bytes) -> None:
    content = Content(data, "x")
    assert isinstance(content.beginning(), str)
    assert isinstance((content.xml_tags, content.json_keys, content.yaml_keys), tuple)
