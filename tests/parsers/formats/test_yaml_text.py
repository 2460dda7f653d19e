"""What is written as YAML, against PyYAML, which follows YAML 1.1, and against our own reader of 1.2."""

from __future__ import annotations

import yaml
from hypothesis import given
from hypothesis import strategies as st

from calibrary.parsers.formats._yaml_text import decimal, scalar
from calibrary.records import Json
from calibrary.strictyaml import load_yaml

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
PLAIN = st.one_of(st.none(), st.booleans(), st.integers(-(2**63), 2**63 - 1), NUMBERS, TEXTS)
VALUES = st.recursive(
    PLAIN,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.text("abc_ -:#", min_size=1, max_size=8), inner, max_size=3),
    ),
    max_leaves=8,
)


@given(value=NUMBERS)
def test_a_number_is_the_same_to_every_reader(value: float) -> None:
    for read in (yaml.safe_load(f"k: {decimal(value)}"), load_yaml(f"k: {decimal(value)}", source="x")):
        assert isinstance(read, dict)
        assert isinstance(read["k"], float)
        assert read["k"] == value


@given(value=VALUES)
def test_any_value_on_one_line_reads_back_the_same(value: Json) -> None:
    line = scalar(value)
    assert len(line.splitlines()) == 1
    assert load_yaml(f"k: {line}\n", source="x") == {"k": value}
    assert yaml.safe_load(f"k: {line}\n") == {"k": value}
