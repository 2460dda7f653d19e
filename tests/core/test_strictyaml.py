"""The strict YAML reader: what each text means, what is refused, and where."""

import contextlib
import math
import re

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from calibrary import strictyaml
from calibrary.errors import ParseError
from calibrary.strictyaml import YamlValue, line_of, load_yaml


@pytest.fixture(params=["libyaml", "pure"], autouse=True)
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every test holds with PyYAML's C parser and with its Python one."""
    name: str = request.param
    monkeypatch.setattr(strictyaml, "_LOADER", yaml.CSafeLoader if name == "libyaml" else yaml.SafeLoader)
    return name


def load(text: bytes | str) -> YamlValue:
    return load_yaml(text, source="fleet.yaml")


def refusal(text: bytes | str) -> ParseError:
    with pytest.raises(ParseError) as caught:
        load(text)
    assert caught.value.source == "fleet.yaml"
    return caught.value


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("12", 12),
        ("+5", 5),
        ("-0", 0),
        ("0o17", 15),
        ("0x1F", 31),
        ("18446744073709551615", 2**64 - 1),
        ("1.10", 1.1),
        ("1e-05", 1e-05),
        ("1E5", 1e5),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("007.5", 7.5),
        ("1e-400", 0.0),
        ("", None),
        ("~", None),
        ("Null", None),
        ("TRUE", True),
        ("false", False),
    ],
)
def test_plain_scalars_follow_the_core_schema(text: str, meaning: object) -> None:
    value = load(f"- {text}")
    assert value == [meaning]
    assert isinstance(value, list)
    assert type(value[0]) is type(meaning)


@pytest.mark.parametrize(
    "text",
    [
        "NO",
        "yes",
        "on",
        "y",
        "n",
        "12:30:45",
        "190:20:30.15",
        "1_000.5",
        "0b101",
        "2024-05-17",
        "1,5",
        "=",
        "<<",
        "0o8",
        "0xG",
        "+",
        ".",
        "e5",
        "1e",
        "Nikon",
        "-.",
        "1.2.3",
        "01.00.0128",
        "~a",
        "tRUE",
    ],
)
def test_what_yaml_1_1_turns_into_other_things_stays_text(text: str) -> None:
    assert load(f"- {text}") == [text]


@pytest.mark.parametrize("text", ["017", "0012345", "08", "-01"])
def test_a_leading_zero_is_refused_because_readers_disagree(text: str) -> None:
    error = refusal(f"serial: {text}")
    assert (
        error.message == f"{text} starts with 0, which some readers take for octal; quote it, or drop the 0"
    )
    assert error.place == "line 1"


@pytest.mark.parametrize(
    "text", [".nan", ".NaN", "nan", "NaN", ".inf", "-.INF", "inf", "-Infinity", "1e400", "695e0514"]
)
def test_a_number_that_is_not_finite_is_refused(text: str) -> None:
    error = refusal(f"a: 1\nfx: {text}")
    assert error.message == (
        f"{text} is not a finite number; quote it if it is text, calibrate again if it is a result"
    )
    assert error.place == "line 2"


@pytest.mark.parametrize("text", [str(2**64), str(-(2**63) - 1), "0x10000000000000000"])
def test_an_integer_of_more_than_64_bits_is_refused(text: str) -> None:
    assert "more than 64 bits; quote it" in refusal(f"a: {text}").message


def test_a_number_of_a_megabyte_is_refused_before_it_is_converted(monkeypatch: pytest.MonkeyPatch) -> None:
    for conversion in ("int", "float"):
        monkeypatch.setattr(strictyaml, conversion, lambda _: pytest.fail("converted"), raising=False)
    assert "a number of 1000000 characters" in refusal("a: " + "9" * 1_000_000).message


@pytest.mark.parametrize("text", ["017", ".nan", "1e400", "true", "", "~", "0x1F", "1.10", "<<", "2 3"])
@pytest.mark.parametrize("quote", ["'", '"'])
def test_quotes_make_anything_text(text: str, quote: str) -> None:
    assert load(f"{quote}{text}{quote}: {quote}{text}{quote}") == {text: text}


def test_block_scalars_are_text() -> None:
    assert load("a: |\n  1.10\nb: >-\n  true\n") == {"a": "1.10\n", "b": "true"}


def test_a_key_is_text_whatever_it_looks_like() -> None:
    assert load("{1: a, true: b, 1.10: c, 017: d, NO: e, null: f}") == {
        "1": "a",
        "true": "b",
        "1.10": "c",
        "017": "d",
        "NO": "e",
        "null": "f",
    }


@pytest.mark.parametrize(
    "text", ["fx: 1\nfy: 2\nfx: 3\n", 'fx: 1\nfy: 2\n"fx": 3\n', "{fx: 1,\nfy: 2,\nfx: 3}"]
)
def test_a_key_twice_is_refused_with_the_line_of_the_second(text: str) -> None:
    error = refusal(text)
    assert error.message == "duplicate key fx"
    assert error.place == "line 3"


def test_equal_keys_of_different_maps_are_no_matter() -> None:
    assert load("a: {x: 1}\nb: {x: 2}\nx: 3") == {"a": {"x": 1}, "b": {"x": 2}, "x": 3}


@pytest.mark.parametrize(
    ("text", "message", "place"),
    [
        ("a: 1\nb: &x 2", "an anchor &x", "line 2"),
        ("&a [*a]", "an anchor &a", "line 1"),
        ("- &k a: 1", "an anchor &k", "line 1"),
        ("a: 1\n<<: {b: 2}", "a merge key <<", "line 2"),
        ("a: !!str 1", "a tag tag:yaml.org,2002:str", "line 1"),
        ("a: ! 1", "a tag !", "line 1"),
        ("!!python/object/apply:os.system [id]", "a Python object, which no file may build", "line 1"),
        ("- !!set {a}", "a tag tag:yaml.org,2002:set", "line 1"),
        ("!!str a: 1", "a tag tag:yaml.org,2002:str", "line 1"),
        ("%YAML 1.1\n---\na: on", "a directive", "line 1"),
        ("%TAG !e! tag:e,2000:\n---\na: 1", "a directive", "line 1"),
        ("a: 1\n---\nb: 2", "a second document starts", "line 2"),
        ("a: 1\n...\n---\n", "a second document starts", "line 3"),
        ("? [a]\n: 1", "a key is a map or list", "line 1"),
        ("? {a: 1}\n: 1", "a key is a map or list", "line 1"),
        ("? \n: 1", "an empty key", "line 1"),
    ],
)
def test_yaml_that_is_more_than_plain_data_is_refused(text: str, message: str, place: str) -> None:
    error = refusal(text)
    assert error.message.startswith(message)
    assert error.place == place


def test_an_alias_to_nothing_is_refused_by_name() -> None:
    assert refusal("a: *b").message.startswith("an alias *b")


@pytest.mark.parametrize("text", ["", "# only a comment\n", "---\n", "null", b"\xef\xbb\xbf"])
def test_an_empty_document_is_refused(text: bytes | str) -> None:
    assert refusal(text).message == "contains no YAML value, expected a document"


@pytest.mark.parametrize("text", ["{a: 1}", "a: 1", "---\na: 1\n...\n", "%YAML 1.2\n---\na: 1", "\ufeffa: 1"])
def test_one_explicit_or_bare_document_is_read(text: str) -> None:
    assert load(text) == {"a": 1}
    assert load(text.replace("\n", "\r\n")) == {"a": 1}
    assert load(text.removeprefix("\ufeff").encode("utf-16")) == {"a": 1}


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("a: 1\nb: 'open", "line 2"),
        ("a:\n\t- 1", "line 2"),
        ("a: 1\nb: \x01", "line 2"),
        (b"a: 1\nb: \xff", "line 2"),
        ("a: 1\nb: \ud800", "line 2"),
        ('a: 1\nb: "\\ud800"', "line 2"),
    ],
)
def test_what_is_not_yaml_is_refused_with_its_line(text: bytes | str, place: str) -> None:
    error = refusal(text)
    assert error.place == place
    assert "\n" not in str(error)


def test_what_is_never_closed_is_said_to_have_been_opened() -> None:
    error = refusal("a: 1\nb: [1,\n  2\n")
    assert error.place == "line 4"
    assert error.message.startswith("not YAML: while parsing a flow sequence from line 2 on, ")


@pytest.mark.parametrize("opening", ["[", "{a: ", "- ", "[{a: ", "? "])
def test_50_kb_of_brackets_are_refused_at_the_greatest_depth(
    opening: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[yaml.Event] = []

    class Counting(strictyaml._LOADER):  # type: ignore[misc, valid-type] # the one the parser fixture chose
        def get_event(self) -> yaml.Event:
            events.append(super().get_event())
            return events[-1]

    monkeypatch.setattr(strictyaml, "_LOADER", Counting)
    refusal(opening * (50_000 // len(opening)))
    # A key for every map, and what stands before the first.
    assert len(events) <= 2 * strictyaml.MAX_DEPTH + 4


def test_nesting_ends_where_it_is_said_to() -> None:
    load_yaml("[" * 5 + "]" * 5, source="s", max_depth=5)
    with pytest.raises(ParseError, match="nested more than 5 deep"):
        load_yaml("[" * 6 + "]" * 6, source="s", max_depth=5)


def test_size_ends_where_it_is_said_to() -> None:
    assert load_yaml("é: 1", source="s", max_bytes=5) == {"é": 1}
    with pytest.raises(ParseError, match="is 5 bytes of YAML, expected at most 4"):
        load_yaml("é: 1", source="s", max_bytes=4)


def test_a_tag_may_be_ignored_on_maps_and_lists_only() -> None:
    tag = "tag:yaml.org,2002:opencv-matrix"
    text = "K: !!opencv-matrix\n  rows: 3\n"
    assert load_yaml(text, source="s", ignored_tags={tag}) == {"K": {"rows": 3}}
    with pytest.raises(ParseError, match="a tag"):
        load_yaml("K: !!opencv-matrix 3", source="s", ignored_tags={tag})


def test_a_hostile_name_is_short_and_printable_in_the_message() -> None:
    error = refusal('"\\e[2J\\u202e": 1\n"\\e[2J\\u202e": 1')
    assert error.message.isprintable()
    assert len(refusal(f"{'k' * 900}: 1\n{'k' * 900}: 1").message) < 100


DOCUMENT = """\
make: DJI
cameras:
  - title: One
    pitch_um: {value: 2.4, source: x}
  - title: Two

    size: [1,
      2]
"""


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ([], 1),
        (["make"], 1),
        (["cameras", 0, "pitch_um", "value"], 4),
        (["cameras", 1], 5),
        (["cameras", 1, "size", 1], 8),
        (["cameras", 1, "lens"], 5),
        (["cameras", 7], 3),
        (["make", "x"], 1),
    ],
)
def test_the_line_of_a_value_or_of_where_it_should_have_been(path: list[str | int], line: int) -> None:
    assert line_of(DOCUMENT, path) == line
    assert line_of(DOCUMENT.encode(), path) == line


def test_there_is_no_line_in_what_cannot_be_read() -> None:
    assert line_of("[" * 50_000, [0]) is None


finite = st.floats(allow_nan=False, allow_infinity=False)
# PyYAML leaves text unquoted that YAML 1.1 takes for text and 1.2 for a number: 0E0, INFINITY.
texts = st.text().filter(lambda text: not re.match(r"[-+]?\.?(\d|inf|nan)", text, re.IGNORECASE))
scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | finite | texts
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4),
    max_leaves=12,
)


@given(values.filter(lambda value: value is not None))
@example({"\x85": "\u2028", "": [-0.0, 5e-324, 1.7976931348623157e308]})
def test_what_pyyaml_writes_reads_back_bit_for_bit(value: YamlValue) -> None:
    text = yaml.safe_dump(value, sort_keys=False)
    read = load(text)
    assert read == yaml.safe_load(text) == value
    assert repr(read) == repr(value)


safe_words = st.from_regex(r"[A-Za-z]{1,8}( [A-Za-z]{1,8})?", fullmatch=True).filter(
    lambda word: word.lower() not in {"y", "n", "yes", "no", "on", "off", "nan", "inf", "infinity"}
)
safe_numbers = st.integers(-(10**15), 10**15).map(str) | finite.map(lambda x: f"{x:.12f}")


@given(st.dictionaries(safe_words, st.lists(safe_words | safe_numbers, max_size=4), max_size=4))
def test_plain_documents_mean_what_they_mean_to_pyyaml(lines: dict[str, list[str]]) -> None:
    text = "".join(f"{key}: [{', '.join(items)}]\n" for key, items in lines.items()) or "{}"
    if any(key.lower() in {"true", "false", "null"} for key in lines):
        return
    assert load(text) == yaml.safe_load(text)


@given(st.text(alphabet="[]{}:,-?!&*#|>'\"%@`\n\t ab01.~<=\\\ud800\0\x85\u2028é") | st.text() | st.binary())
def test_noise_is_read_as_plain_data_or_refused(noise: bytes | str) -> None:
    with contextlib.suppress(ParseError):
        assert_plain(load(noise))


def assert_plain(value: YamlValue) -> None:
    if isinstance(value, dict):
        assert all(type(key) is str for key in value)
        for item in value.values():
            assert_plain(item)
    elif isinstance(value, list):
        for item in value:
            assert_plain(item)
    else:
        assert value is None or type(value) in {str, int, float, bool}
        assert not isinstance(value, float) or math.isfinite(value)
