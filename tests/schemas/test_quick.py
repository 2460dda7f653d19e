"""The quick keywords say what jsonschema says, only sooner."""

from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator, validators

from calibrary.schemas import validator
from calibrary.schemas.quick import judge_of

STRICT = type(validator("entry-1"))
ORDINARY = validators.extend(  # type: ignore[no-untyped-call]  # the stubs leave its arguments untyped
    STRICT,
    {name: Draft202012Validator.VALIDATORS[name] for name in ("items", "properties", "additionalProperties")},
)

numbers = st.integers(-3, 3) | st.sampled_from([-1.5, 0.0, 2.0, float("nan"), float("inf")])
scalars = st.none() | st.booleans() | numbers | st.sampled_from(["", "a", "ab", "2"])
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abx"), inner),
    max_leaves=6,
)
kinds = st.sampled_from(["string", "number", "integer", "boolean", "null", "array", "object"])
leaves = st.fixed_dictionaries(
    {},
    optional={
        "type": kinds | st.lists(kinds, min_size=1, max_size=3, unique=True),
        "minimum": st.integers(-2, 2),
        "exclusiveMaximum": st.integers(-2, 2),
        "maxLength": st.integers(0, 2),
        "pattern": st.sampled_from(["^a", "b$"]),
        "const": scalars,
        "enum": st.lists(st.sampled_from(["a", "ab", 1, None]), min_size=1, max_size=3),
        "description": st.just("words"),
        "minItems": st.integers(0, 2),
    },
)


def larger(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.fixed_dictionaries(
        {},
        optional={
            "items": inner | st.booleans(),
            "prefixItems": st.lists(inner, min_size=1, max_size=2),
            "properties": st.dictionaries(st.sampled_from("ab"), inner, max_size=2),
            "additionalProperties": inner | st.booleans(),
            "patternProperties": st.just({"^x": {}}),
        },
    )


schemas = st.recursive(leaves, larger, max_leaves=6)


@given(schemas, values)
def test_the_same_is_right_and_the_same_is_wrong(schema: dict[str, Any], value: Any) -> None:
    quick, ordinary = ([*kind(schema).iter_errors(value)] for kind in (STRICT, ORDINARY))
    said = ([(str(list(e.absolute_path)), e.message) for e in errors] for errors in (quick, ordinary))
    assert sorted(next(said)) == sorted(next(said))


@given(leaves, scalars)
def test_a_judge_lets_nothing_wrong_through(schema: dict[str, Any], value: Any) -> None:
    judge = judge_of(schema)
    assert judge is None or not judge(value) or ORDINARY(schema).is_valid(value)


def test_numbers_of_a_document_are_not_descended_to() -> None:
    judge = judge_of({"type": ["number", "null"], "exclusiveMinimum": 0})
    assert judge is not None
    assert [judge(value) for value in (1.5, 2, None, 0.0, True, "1", float("nan"))] == [
        True,
        True,
        True,
        *[False] * 4,
    ]
