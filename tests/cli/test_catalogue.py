"""``calibrary catalogue``: a table of all, the sources of a few, and JSON that a catalogue file could hold."""

from __future__ import annotations

import json
from typing import Any

import pytest

from calibrary.catalogue import load_catalogue
from calibrary.cli.main import main
from calibrary.schemas import load, require


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["catalogue", *arguments]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    cameras: list[dict[str, Any]] = json.loads(printed(capsys, "--json", *arguments))["cameras"]
    return cameras


def test_without_a_model_every_camera_is_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    table = printed(capsys)
    for camera in load_catalogue():
        assert camera.title in table
    assert f"{len(load_catalogue())} known cameras" in table


def test_a_model_is_told_with_the_source_of_every_number(capsys: pytest.CaptureFixture[str]) -> None:
    text = printed(capsys, "M3T")
    for camera in load_catalogue().search("M3T"):
        assert camera.sources
        for field, source in camera.sources:
            assert f"{field}: {source}" in text
        assert all(conflict in text for conflict in camera.conflicts)


def test_a_model_is_told_with_the_k_of_each_size_that_it_writes(capsys: pytest.CaptureFixture[str]) -> None:
    text = printed(capsys, "FC6310")
    for size, cx in (("5472×3648", 2736), ("4864×3648", 2432), ("5472×3078", 2736)):
        assert f"K of {size}: fx 3660.8 fy 3660.8 cx {cx} " in text
    half = "K of 4000×3000: fx 2820.0 fy 2820.0 cx 2000 cy 1500 px, nominal"
    assert half in printed(capsys, "M3T")
    assert "K of" not in printed(capsys, "HERO6 Black")


@pytest.mark.parametrize("words", ["phantom 4", "PHANTOM 4", "4 phantom", "fc6310"])
def test_a_camera_is_found_by_words_in_any_case_and_order(
    capsys: pytest.CaptureFixture[str], words: str
) -> None:
    titles = [camera["title"] for camera in listed(capsys, words)]
    assert any("Phantom 4" in title for title in titles)
    assert len(titles) < len(load_catalogue()) / 2


def test_json_holds_what_a_catalogue_file_holds(capsys: pytest.CaptureFixture[str]) -> None:
    makers: dict[str, list[dict[str, Any]]] = {}
    cameras = listed(capsys)
    for camera in cameras:
        makers.setdefault(camera.pop("make"), []).append(camera)
    for make, group in makers.items():
        document: Any = {"schema": "calibrary/catalogue-1", "make": make, "cameras": group}
        require(document, "catalogue-1")
    assert sum(map(len, makers.values())) == len(load_catalogue())


@pytest.mark.parametrize("words", [[], ["M3T"]])
def test_json_is_the_document_it_says_it_is(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    document = json.loads(printed(capsys, "--json", *words))
    assert document["schema"] == "calibrary/catalogue-listing-1"
    require(document, "catalogue-listing-1")


def test_the_listing_has_every_word_of_a_catalogue_file_and_the_make() -> None:
    listing: Any = load("catalogue-listing-1")
    file: Any = load("catalogue-1")
    words = file["$defs"]["KnownCamera"]["properties"].keys()
    assert listing["$defs"]["KnownCamera"]["properties"].keys() == words | {"make"}


def test_an_unknown_model_is_said_and_ends_with_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["catalogue", "no such camera"]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "'no such camera'" in captured.err


def test_an_unknown_model_is_an_empty_list_for_machines(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["catalogue", "--json", "no such camera"]) == 1
    assert json.loads(capsys.readouterr().out)["cameras"] == []
