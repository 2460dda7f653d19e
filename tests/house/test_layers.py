"""The picture of the layers in CONTRIBUTING.md shows what import-linter enforces."""

from __future__ import annotations

import re
import tomllib

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
