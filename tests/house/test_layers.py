"""The picture of the layers in CONTRIBUTING.md shows what import-linter enforces."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from importlib import import_module

import pytest

from calibrary.records import Record
from calibrary.registry.query import EntryListing
from tests.house.project import ROOMS, ROOT

CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
(LAYERS,) = (
    one["layers"] for one in CONTRACTS if one["type"] == "layers" and one["containers"] == ["calibrary"]
)


def drawn() -> list[set[str]]:
    """The storeys from the top down: names at the left, parted by two spaces, a wider gap before what they do."""
    text = (ROOT / "CONTRIBUTING.md").read_text().partition("## Where things go\n\n")[2].partition("\n\n")[0]
    rows = [line.strip() for line in text.splitlines() if re.match(r" {4}\w", line)]
    return [set(re.split(r" {3,}", row)[0].split()) for row in rows]


def enforced() -> list[set[str]]:
    return [set(re.findall(r"\w+", layer)) for layer in LAYERS]


def test_the_picture_shows_the_layers_that_are_enforced() -> None:
    assert drawn() == enforced()


def test_every_room_has_its_layer() -> None:
    assert set(ROOMS) <= set().union(*enforced())


def shown_of_rooms() -> Iterator[tuple[str, str, str]]:
    """The names that the jobs' packages take from rooms for commands: package, module, name."""
    for face in sorted((ROOT / "src/calibrary/jobs").glob("*/__init__.py")):
        for node in ast.walk(ast.parse(face.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                yield from (
                    (face.parent.name, node.module or "", one.name)
                    for one in node.names
                    if one.asname == one.name
                )


@pytest.mark.parametrize(("job", "module", "name"), [*shown_of_rooms()])
def test_what_a_command_gets_of_a_room_is_a_record(job: str, module: str, name: str) -> None:
    found = getattr(import_module(module), name)
    if isinstance(found, type):
        assert issubclass(found, Record | EntryListing), f"{job} shows what does work"
