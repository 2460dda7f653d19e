"""The same calibration in other clothes: what editors, copies and checkouts do to a text changes no number.

Every format's own small file is changed as other programs change files. It then reads as the same cameras; only where
the change leaves a number open, because the last line is not ended, may it be refused, and the message says so.
"""

from __future__ import annotations

import codecs
import json
import re
from collections.abc import Callable, Sequence
from decimal import Decimal

import pytest
from _pytest.mark import ParameterSet

from calibrary.calibration import Calibration
from calibrary.errors import InputError, ParseError
from calibrary.parsers.content import Content
from calibrary.parsers.format import Format
from calibrary.records import Json
from tests.parsers.test_contract import FILES, read_back, sample

NUMBER = re.compile(r"(?<![\w.+\-\"'])-?\d+\.\d+(?![\w.\"']|\s*[eE×*x])")
SHORTEST_DECIMAL = 4
"""1.0 and 0.3 are versions as a rule."""
TOP_LEVEL = re.compile(r"^(?=[A-Za-z_])", re.MULTILINE)
WITHOUT_LONE_CR = {"bundler", "nvm"}
"""Read line by line out of the bytes, which may be many; no program has written them with old Macintosh lines."""
HASH = {"colmap_text", "kapture", "mrcal", "ocamcalib", "ros_ini", "zed"}
"""Formats of their own syntax in which a line that begins with # is a comment."""


def text_of(record: Format, name: str) -> str:
    """The file as text, with LF."""
    text = sample(record, name).data.decode("utf-8")
    return text.replace("\r\n", "\n").removeprefix("\ufeff")


def numbers(cameras: Sequence[Calibration]) -> list[tuple[object, ...]]:
    return [(item.intrinsics, item.distortion, item.quality, item.grade) for item in cameras]


def same(record: Format, name: str, data: bytes) -> None:
    """The changed file is recognised without its name and reads as the original."""
    whole = read_back(record, name, sample(record, name).data)
    assert record.sniff(Content(data, "no name to go by")) is not None
    assert numbers(read_back(record, name, data)) == numbers(whole)


def is_json(text: str) -> bool:
    return Content(text.encode(), "x").json is not None


def is_xml(text: str) -> bool:
    return text.lstrip().startswith("<")


def is_yaml(record: Format) -> bool:
    return bool({".yaml", ".yml"} & set(record.suffixes))


def has_comments(record: Format, text: str) -> bool:
    return is_xml(text) or record.name in HASH or (is_yaml(record) and not is_json(text))


def has_keys(record: Format, text: str) -> bool:
    """Whether its order is that of keys, and not of lines."""
    return is_json(text) or (is_yaml(record) and not is_xml(text))


def is_text(record: Format, name: str) -> bool:
    return Content(sample(record, name).data, name).text is not None


def where(holds: Callable[[Format, str], bool]) -> list[ParameterSet]:
    """The parameters whose record and text are such."""
    chosen = []
    for each in FILES:
        record, name = each.values
        assert isinstance(record, Format)
        assert isinstance(name, str)
        if is_text(record, name) and holds(record, text_of(record, name)):
            chosen.append(each)
    return chosen


TEXTS = where(lambda _record, _text: True)
COMMENTED = where(has_comments)
KEYED = where(has_keys)

CLOTHES: dict[str, Callable[[str], bytes]] = {
    "a byte order mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "CR LF": lambda text: text.replace("\n", "\r\n").encode(),
    "empty lines at the end": lambda text: (text + "\n \n\n").encode(),
    "blanks at the ends of lines": lambda text: text.replace("\n", " \t\n").encode(),
}


@pytest.mark.parametrize("clothes", CLOTHES)
@pytest.mark.parametrize(("record", "name"), TEXTS)
def test_what_editors_do_to_a_text_changes_nothing(record: Format, name: str, clothes: str) -> None:
    same(record, name, CLOTHES[clothes](text_of(record, name)))


@pytest.mark.parametrize(("record", "name"), TEXTS)
def test_lines_that_end_in_cr_alone_are_lines(record: Format, name: str) -> None:
    data = text_of(record, name).replace("\n", "\r").encode()
    if record.name in WITHOUT_LONE_CR:
        with pytest.raises(InputError):
            read_back(record, name, data)
        return
    same(record, name, data)


@pytest.mark.parametrize(("record", "name"), TEXTS)
def test_a_file_without_a_last_newline_is_read_unless_a_number_may_be_cut(record: Format, name: str) -> None:
    data = text_of(record, name).rstrip("\n").encode()
    refusal = ""
    try:
        same(record, name, data)
    except ParseError as error:
        refusal = str(error)
    word = re.split(r"[\s,;:=]", data.decode())[-1]
    assert not refusal or (re.search(r"\d", word) and word[:40] in refusal and "not ended" in refusal)


@pytest.mark.parametrize(("record", "name"), TEXTS)
def test_numbers_with_exponents_are_the_same_numbers(record: Format, name: str) -> None:
    text = text_of(record, name)

    def with_exponent(match: re.Match[str]) -> str:
        return match[0] if len(match[0]) < SHORTEST_DECIMAL else f"{Decimal(match[0]):e}"

    same(record, name, NUMBER.sub(with_exponent, text).encode())


@pytest.mark.parametrize(("record", "name"), COMMENTED)
def test_comments_say_nothing(record: Format, name: str) -> None:
    text = text_of(record, name)
    if is_xml(text):
        at = text.rindex("</")
        text = f"{text[:at]}<!-- fx = 1.5 -->{text[at:]}"
    else:
        text += "# fx: 1.5\n"
    same(record, name, text.encode())
    if text.endswith("\n"):
        same(record, name, text.rstrip("\n").encode())


@pytest.mark.parametrize(("record", "name"), KEYED)
def test_the_order_of_keys_means_nothing(record: Format, name: str) -> None:
    text = text_of(record, name)
    if is_json(text):
        changed = json.dumps(turned(json.loads(text)))
    else:
        head, mark, body = text.rpartition("---\n")
        first, *blocks = TOP_LEVEL.split(body)
        changed = head + mark + first + "".join(reversed(blocks))
    whole = read_back(record, name, sample(record, name).data)
    copies = read_back(record, name, changed.encode())
    assert sorted(map(str, numbers(copies))) == sorted(map(str, numbers(whole)))


def turned(value: Json) -> Json:
    """The document with the keys of every object in the opposite order."""
    if isinstance(value, list):
        return [turned(item) for item in value]
    if isinstance(value, dict):
        return {key: turned(item) for key, item in reversed(value.items())}
    return value
