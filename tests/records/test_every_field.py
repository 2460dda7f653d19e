"""Every field of every record survives its files and is in every view; records are drawn from their declarations."""

from __future__ import annotations

import copy
import json
import math
import pickle
import runpy
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from calibrary.calibration import Calibration, CameraKey, Intrinsics, Provenance, SourceFile
from calibrary.distortion import MODELS
from calibrary.errors import InputError, ParseError
from calibrary.jobs.site.camera_page import camera_page
from calibrary.jobs.site.folder import Place
from calibrary.known_camera import KnownCamera
from calibrary.policy import Policy
from calibrary.quality import Covariance, Quality
from calibrary.records import Record, checker, flat, from_json, replace, to_json
from calibrary.registry.entry import Alias, Entry, Sensor, Validity
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.fields import NOT_SHOWN, entry_fields, entry_rows
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.locking import Lock, Pin
from calibrary.schemas import require
from tests.core.lens_models import evenly
from tests.house.project import ROOT
from tests.records.declared import neighbours, strategy_for
from tests.registry.entries import an_entry
from tests.thorough import examples

KINDS: tuple[type[Record], ...] = (
    CameraKey, Intrinsics, Covariance, Quality, SourceFile, Provenance, Calibration, FirmwareRange, Alias, Sensor,
    Validity, Entry, Pin, Lock, Policy,
)  # fmt: skip
SCRIPT = runpy.run_path(str(ROOT / "docs" / "make_schemas.py"))
DOCUMENTS: Mapping[str, type[Record]] = {
    name: SCRIPT["_record"](path)
    for name, path in [*SCRIPT["PRINTED"].items(), *SCRIPT["WRITTEN_BY_PEOPLE"].items()]
}
"""Every document that has a schema file, by the schema's name."""
WHOLE = sorted({*DOCUMENTS} - {"published-camera-3"})
"""All but the one whose entries stay the bytes that were published; tests/registry/published reads those."""
SLOW = settings(
    max_examples=examples(1, 40),
    deadline=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[*HealthCheck],
)


@pytest.mark.parametrize("name", WHOLE)
@settings(SLOW, max_examples=examples(1))
@given(data=st.data())
def test_a_document_fits_its_schema_file_and_comes_back_from_its_json(name: str, data: st.DataObject) -> None:
    kind = DOCUMENTS[name]
    record = data.draw(strategy_for(kind))
    document = over_a_file(to_json(record))
    require(document, name)
    assert from_json(kind, document) == record


def over_a_file(document: Any) -> Any:
    """As a program reads what another printed."""
    return json.loads(json.dumps(document, allow_nan=False))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@SLOW
@given(data=st.data())
def test_a_record_comes_back_from_its_json(kind: type[Record], data: st.DataObject) -> None:
    record = data.draw(strategy_for(kind))
    document = over_a_file(to_json(record))
    assert from_json(kind, document) == record
    assert to_json(from_json(kind, document)) == document
    assert pickle.loads(pickle.dumps(record)) == record  # noqa: S301  its own
    checker(kind).validate(document)


@pytest.mark.parametrize("model", MODELS)
def test_a_distortion_comes_back_from_its_json(model: str) -> None:
    kind = MODELS[model]
    lens = kind(**evenly(model, 0.01))
    assert from_json(kind, over_a_file(to_json(lens))) == lens
    assert list(to_json(lens)) == ["model", *kind.names()]
    checker(kind).validate(to_json(lens))


def _maps(value: Any) -> Iterator[dict[str, Any]]:
    """Every map of a document whose keys are fields."""
    if isinstance(value, dict):
        yield value
        for name, member in value.items():
            if name not in {"std", "extras"} and not name.startswith("x-"):
                yield from _maps(member)
    elif isinstance(value, list):
        for item in value:
            yield from _maps(item)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@SLOW
@given(data=st.data())
def test_a_key_that_no_field_has_is_refused_at_every_depth(kind: type[Record], data: st.DataObject) -> None:
    document = over_a_file(to_json(data.draw(strategy_for(kind))))
    prepared = checker(kind)
    for at in range(len([*_maps(document)])):
        wrong = copy.deepcopy(document)
        [*_maps(wrong)][at]["unheard_of"] = 1
        assert not prepared.is_valid(wrong)
        with pytest.raises(ParseError, match="unheard_of"):
            from_json(kind, wrong)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@SLOW
@given(data=st.data())
def test_a_field_that_changes_shows_in_the_flat_fields(kind: type[Record], data: st.DataObject) -> None:
    one, other = data.draw(strategy_for(kind)), data.draw(strategy_for(kind))
    for path, changed in neighbours(one, other):
        assert flat(changed) != flat(one), path


@SLOW
@given(one=strategy_for(Entry), other=strategy_for(Entry))
def test_an_entry_comes_back_from_its_file_and_each_field_changes_it(one: Entry, other: Entry) -> None:
    data = entry_yaml(one)
    assert parse_entry(data, "x.yaml") == one
    for path, changed in neighbours(one, other):
        assert isinstance(changed, Entry)
        assert entry_yaml(changed) != data, path


@SLOW
@given(one=strategy_for(Entry), other=strategy_for(Entry))
def test_every_field_of_an_entry_is_shown_or_named_as_not_shown(one: Entry, other: Entry) -> None:
    assert entry_fields(one).keys() | NOT_SHOWN >= flat(one).keys()
    assert dict(entry_rows(one)).keys() == entry_fields(one).keys()
    for path, changed in neighbours(one, other):
        assert isinstance(changed, Entry)
        assert entry_rows(changed) != entry_rows(one), path


WILD = ("", " ", "x" * 1001, "Ä", "2019-13-45", math.nan, math.inf, -math.inf, -1.0, 0.0, 0.7, 2e6, -1, 0, 10**7,
    (0, 5), ("",), ("a", "a"), {"fx": -1.0}, {"fx": math.nan})  # fmt: skip


def _shape(value: object) -> object:
    """What makes two values of one type; a list that is empty tells no type."""
    if isinstance(value, tuple):
        return tuple, *map(type, value[:1])
    return (dict, *map(type, value.values())) if isinstance(value, dict) else type(value)


def _wild(record: Record) -> Iterator[tuple[str, Record]]:
    """The record with one field, anywhere inside it, that has an unlikely value of its type."""
    for name in record.__struct_fields__:
        mine = getattr(record, name)
        values: list[tuple[str, Any]] = [(name, value) for value in WILD if _shape(mine) == _shape(value)]
        if isinstance(mine, Record):
            values = [(f"{name}.{path}", part) for path, part in _wild(mine)]
        for path, value in values:
            try:
                yield path, replace(record, **{name: value})
            except InputError:
                continue


@pytest.mark.parametrize(
    "kind", [SourceFile, Alias, Sensor, Validity, FirmwareRange, Pin, Lock, KnownCamera, Entry]
)
@settings(SLOW, max_examples=examples(2))
@given(data=st.data())
def test_what_can_be_made_can_be_read_back(kind: type[Record], data: st.DataObject) -> None:
    for path, record in _wild(data.draw(strategy_for(kind))):
        assert from_json(kind, over_a_file(to_json(record))) == record, path


@pytest.mark.parametrize("name", ["brown", "unknown"])
def test_a_cameras_page_shows_every_field(name: str) -> None:
    entry = parse_entry((ROOT / f"tests/golden/entries/{name}.yaml").read_bytes(), name)
    place = Place(stem=entry.id)
    page = camera_page(entry, id_=entry.id, place=place, revisions=(), changes=(), files=())
    assert all(repr((name, text)) in repr(page) for name, text in entry_rows(entry))


def test_what_is_named_as_not_shown_exists() -> None:
    assert flat(an_entry()).keys() >= NOT_SHOWN


class Drawn(Record, tag_field="schema", tag="calibrary/drawn-1"):
    """A picture.

    Attributes:
        title: above it.
        strokes: how it was drawn; not written.
    """

    _unwritten = frozenset({"strokes"})

    title: str
    strokes: Any = None


def test_an_unwritten_field_is_in_neither_the_document_nor_the_schema() -> None:
    document = to_json(Drawn(title="a", strokes=object()))
    assert document == {"schema": "calibrary/drawn-1", "title": "a"}
    assert from_json(Drawn, document) == Drawn(title="a")
    with pytest.raises(ParseError, match="strokes"):
        from_json(Drawn, {**document, "strokes": 1})
