"""The schema files are what the records say now."""

from __future__ import annotations

import runpy

import pytest

from tests.house.project import ROOT

SCRIPT = runpy.run_path(str(ROOT / "docs" / "make_schemas.py"))
GENERATED = SCRIPT["schemas"]()


def test_every_schema_is_generated() -> None:
    """None is written by hand."""
    kept = {path.name.removesuffix(".schema.json") for path in (ROOT / "schemas").glob("*.schema.json")}
    assert kept == GENERATED.keys()


@pytest.mark.parametrize("name", GENERATED)
def test_a_schema_is_fresh(name: str) -> None:
    kept = (ROOT / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8")
    assert kept == SCRIPT["text_of"](GENERATED[name]), "a record has changed since; run: make schemas"
