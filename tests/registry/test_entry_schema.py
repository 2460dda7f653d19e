"""schemas/entry-1.schema.json says of every distortion model and every provenance what the code says."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import NODEFAULT
from msgspec.structs import fields

from calibrary.distortion import MODELS
from calibrary.errors import ParseError
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.schemas import load, require
from calibrary.strictyaml import load_yaml
from tests.core.lens_models import evenly
from tests.registry.entries import DIGITS, a_content


def document(**changes: Any) -> Any:
    value = load_yaml(entry_yaml(a_content()), source="x")
    assert isinstance(value, dict)
    return {**value, **changes}


def lens(model: str) -> dict[str, Any]:
    fields = evenly(model, 0.05)
    return {"model": model} | {name: [*v] if isinstance(v, tuple) else v for name, v in fields.items()}


@pytest.mark.parametrize("model", MODELS)
def test_the_coefficients_of_a_model_are_the_codes(model: str) -> None:
    good = lens(model)
    require(document(distortion=good), "entry-1")
    with pytest.raises(ParseError, match="'k99' is not a valid key"):
        require(document(distortion={**good, "k99": 0.0}), "entry-1")
    for field in fields(MODELS[model]):
        without = {name: value for name, value in good.items() if name != field.name}
        if field.default is NODEFAULT:
            with pytest.raises(ParseError, match=f"lacks {field.name}"):
                require(document(distortion=without), "entry-1")
        else:
            require(document(distortion=without), "entry-1")


@pytest.mark.parametrize("model", MODELS)
def test_every_model_has_its_place_in_a_file(model: str) -> None:
    distortion = MODELS[model](**evenly(model, 0.05))
    entry = a_content(distortion=distortion)
    assert parse_entry(entry_yaml(entry), "x") == entry


def test_the_schema_knows_no_other_models() -> None:
    family: Any = load("entry-1")["$defs"]
    assert family["Distortion"]["properties"]["model"]["enum"] == [*MODELS]
    with pytest.raises(ParseError, match="'own', expected"):
        require(document(distortion={"model": "own"}), "entry-1")


FILES = [{"name": "a.jpg", "sha256": DIGITS}]
COMPLETE: dict[str, dict[str, Any]] = {
    "calibration-file": {"source": "a.xml", "sha256": DIGITS},
    "matrix-file": {"source": "K.npy", "sha256": DIGITS},
    "checkerboard": {"sources": FILES, "tool": "calibrary 1"},
    "board": {"sources": FILES, "tool": "calibrary 1"},
    "image-metadata": {"source": "a.jpg", "tag": "drone-dji:DewarpData"},
    "adjustment": {"source": "cameras.xml", "tool": "Metashape 2.1"},
    "manual": {"operator": "ops"},
    "catalogue": {"source": "dji.yaml"},
}


@pytest.mark.parametrize("kind", COMPLETE)
def test_each_kind_of_provenance_says_what_it_takes_to_trace_it(kind: str) -> None:
    printed = COMPLETE[kind]
    require(document(provenance={"kind": kind, **printed}), "entry-1")
    for name in printed:
        nothing: dict[str, Any] = {name: [] if name == "sources" else None}
        for lacking in ({}, nothing):
            less = {"kind": kind, **{key: value for key, value in printed.items() if key != name}, **lacking}
            with pytest.raises(ParseError, match=name):
                require(document(provenance=less), "entry-1")


@pytest.mark.parametrize("kind", COMPLETE)
def test_a_date_may_be_unknown_and_is_one_of_iso_8601_where_it_is_not(kind: str) -> None:
    for date in (None, "2026-05-01", "2026-05-01T10:00:00Z"):
        require(document(provenance={"kind": kind, **COMPLETE[kind], "date": date}), "entry-1")
    with pytest.raises(ParseError, match="date"):
        require(document(provenance={"kind": kind, **COMPLETE[kind], "date": "1 May 2026"}), "entry-1")


def test_a_kind_of_somebody_elses_asks_for_nothing_more() -> None:
    require(document(provenance={"kind": "laser-tracker"}), "entry-1")


@pytest.mark.parametrize("kind", ["registry", "seed", "unstated", "Lab", ""])
def test_what_is_no_source_is_no_kind(kind: str) -> None:
    with pytest.raises(ParseError, match="kind"):
        require(document(provenance={"kind": kind}), "entry-1")


@pytest.mark.parametrize(
    "changes",
    [
        {"intrinsics": {"pixel_origin": "corner", "fx": float("nan"), "fy": 1.0, "cx": 1.0, "cy": 1.0}},
        {"quality": {"coverage": 1.5}},
        {"quality": {"std": {"fx": -1.0}}},
        {"quality": {"covariance": {"names": ["fx", "fx"], "upper": [1.0, 0.0, 1.0]}}},
        {"quality": {"covariance": {"names": ["fx"], "upper": ["1.0"]}}},
        {"aliases": [{"make": "DJI"}]},
        {"validity": {}},
        {"tolerance": 0},
        {"sensor": {"width_mm": -13.2}},
        {"provenance": {"kind": "manual", "operator": "x", "date": "1 May 2026"}},
        {"digest": "sha256:12"},
        {"notes": "one"},
        {"camera": {"make": "DJI", "model": "", "image_size": [5472, 3648]}},
        {"camera": {"make": "DJI", "model": "FC6310R", "image_size": [5472]}},
        {"camera": {"make": "DJI", "model": "FC6310R", "image_size": [5472, 3648], "firmware": {}}},
    ],
)
def test_what_no_entry_may_say_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ParseError, match=next(iter(changes))):
        require(document(**changes), "entry-1")


def test_x_fields_are_let_through_at_the_top_and_in_the_blocks_that_take_them() -> None:
    require(document(**{"x-a": {"b": [1]}}), "entry-1")
    require(document(provenance={"kind": "own", "x-b": 1}), "entry-1")
    with pytest.raises(ParseError, match="intrinsics"):
        require(document(intrinsics={**document()["intrinsics"], "x-c": 1}), "entry-1")
