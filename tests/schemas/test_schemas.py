"""The schemas themselves, and how a breach of one is said."""

from __future__ import annotations

import math
import socket
import subprocess
import sys
from functools import partial

import pytest
from jsonschema import Draft202012Validator

from calibrary.errors import ParseError
from calibrary.records import Json
from calibrary.records.complaints import complaints
from calibrary.records.schema import SCHEMA_BASE
from calibrary.schemas import load, names, require, validator
from calibrary.strictyaml import line_of


def said(value: Json, schema: dict[str, object]) -> list[tuple[tuple[str | int, ...], str]]:
    strict = type(validator("policy-1"))
    return complaints(strict(schema).iter_errors(value))


@pytest.mark.parametrize("name", names())
def test_a_schema_is_a_good_one_and_named_by_its_id(name: str) -> None:
    schema = load(name)
    Draft202012Validator.check_schema(dict(schema))
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["$id"] == SCHEMA_BASE + name
    assert schema["title"]


@pytest.mark.parametrize("name", names())
def test_no_schema_needs_a_network(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        pytest.fail("a schema was fetched")

    monkeypatch.setattr(socket, "socket", refuse)
    list(validator(name).iter_errors({}))
    list(validator(name).iter_errors({"cameras": [{}], "camera": {}, "make": None}))


def test_a_schema_is_prepared_once() -> None:
    assert validator("catalogue-1") is validator("catalogue-1")


def test_importing_the_schemas_leaves_jsonschema_alone() -> None:
    code = "import sys, calibrary.schemas; sys.exit('jsonschema' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True])
def test_a_number_is_finite_and_no_boolean(value: float) -> None:
    assert said(value, {"type": "number"})


def test_a_whole_number_is_written_as_one() -> None:
    assert said(5472.0, {"type": "integer"}) == [((), "5472.0, expected a whole number")]
    assert said(5472, {"type": "integer"}) == []


DEEP = {"properties": {"a": {"properties": {"b": {"type": "number"}}}}}


@pytest.mark.parametrize(
    ("value", "schema", "message"),
    [
        (1.1, {"type": "string"}, "1.1, expected text: quote it"),
        (True, {"type": "string"}, "true, expected text: quote it"),
        (None, {"type": "string"}, "null, expected text: quote it"),
        ([], {"type": "string"}, "[], expected text"),
        ("x", {"type": ["number", "null"]}, "'x', expected a number or null"),
        ({}, {"type": "array"}, "a map, expected a list"),
        ([1, 2, 3, 4, 5], {"type": "object"}, "a list of 5, expected a map"),
        ({}, {"required": ["a", "b"]}, "lacks a, b"),
        (-1, {"minimum": 0}, "-1, expected at least 0"),
        (2, {"maximum": 1}, "2, expected at most 1"),
        (0, {"exclusiveMinimum": 0}, "0, expected more than 0"),
        (1, {"exclusiveMaximum": 1}, "1, expected less than 1"),
        ("c", {"enum": ["a", "b", None]}, "'c', expected 'a', 'b' or null"),
        ("c", {"const": "a"}, "'c', expected 'a'"),
        ("c", {"pattern": "^[ab]$"}, "'c', expected text that matches ^[ab]$"),
        ("", {"minLength": 1}, "'', expected at least 1 characters"),
        ([1, 1], {"uniqueItems": True}, "[1, 1], expected no two items alike"),
        ([1], {"minItems": 2}, "[1], expected at least 2 items"),
        (
            {"pich": 1},
            {"properties": {"pitch": {}, "size": {}}, "additionalProperties": False},
            "'pich' is not a valid key, did you mean pitch?",
        ),
        (
            {"zzz": 1},
            {"properties": {"pitch": {}, "size": {}}, "additionalProperties": False},
            "'zzz' is not a valid key, expected pitch or size",
        ),
        ("\x1b[2J", {"type": "number"}, "'\\x1b[2J', expected a number"),
        ({"a": {"b": "x"}}, {"anyOf": [{"type": "string"}, DEEP]}, "'x', expected a number"),
    ],
)
def test_a_breach_is_said_in_words(value: Json, schema: dict[str, object], message: str) -> None:
    assert [text for _, text in said(value, schema)] == [message]


def test_a_long_or_hostile_value_is_shortened() -> None:
    ((_, message),) = said("x" * 100_000, {"type": "number"})
    assert len(message) < 100


def test_breaches_come_in_the_order_of_the_document_and_each_once() -> None:
    schema: dict[str, object] = {"items": {"type": "number"}}
    assert [path for path, _ in said([1, "a", 2, "b", *[0] * 8, "c"], schema)] == [(1,), (3,), (12,)]


POLICY = 'schema: "calibrary/policy-1"\nname: 1.10\n'


def test_a_document_is_refused_with_line_path_and_how_much_more_there_is() -> None:
    document: Json = {"schema": "calibrary/policy-1", "name": 1.1, "nonsense": 3}
    with pytest.raises(ParseError) as caught:
        require(document, "policy-1", source="mine.yaml", locate=partial(line_of, POLICY))
    assert caught.value.source == "mine.yaml"
    assert str(caught.value).startswith("mine.yaml: ")
    assert "(and 1 more to put right)" in caught.value.message
    with pytest.raises(ParseError) as caught:
        require({"schema": "calibrary/policy-1", "name": 1.1}, "policy-1", locate=partial(line_of, POLICY))
    assert str(caught.value) == "line 2, name: 1.1, expected text: quote it"


def test_a_good_document_is_let_through() -> None:
    require({"schema": "calibrary/policy-1", "name": "mine"}, "policy-1")
