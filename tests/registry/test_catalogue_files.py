"""Catalogues of one's own: read from a file or a folder, and refused with the line of what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.catalogue import load_catalogue, search_catalogue
from calibrary.errors import InputError, ParseError
from calibrary.known_camera import SUB_CAMERAS
from calibrary.schemas import load

OWN = """\
schema: "calibrary/catalogue-1"
make: "Acme"
cameras:
  - title: "Mapper"
    models: ["M1"]
    native_size: {value: [6000, 4000], source: "data sheet"}
    pitch_um: {value: 3.9, source: "data sheet"}
"""


def test_a_catalogue_of_ones_own_is_read_from_a_file_or_a_folder(tmp_path: Path) -> None:
    (tmp_path / "acme.yaml").write_text(OWN)
    for path in (tmp_path, tmp_path / "acme.yaml"):
        camera = load_catalogue(path).find("ACME", "m1").camera
        assert camera is not None
        assert camera.pitch_um == 3.9
        assert camera.source("pitch_um") == "data sheet"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"M1"', "2", "acme.yaml: line 5, cameras[0].models[0]: 2, expected text: quote it"),
        ("value: 3.9,", "value: -3.9,", "line 7, cameras[0].pitch_um.value: -3.9, expected more than 0.1"),
        ('{value: 3.9, source: "data sheet"}', "3.9", "line 7, cameras[0].pitch_um: 3.9, expected a map"),
        (
            ', source: "data sheet"}\n    pitch',
            "}\n    pitch",
            "line 6, cameras[0].native_size: lacks source",
        ),
        ("pitch_um:", "pitch:", "'pitch' is not a valid key, did you mean pitch_um?"),
        (
            "[6000, 4000]",
            "[6000, 4000.0]",
            "line 6, cameras[0].native_size.value[1]: 4000.0, expected a whole number",
        ),
        ("[6000, 4000]", "[6000]", "cameras[0].native_size.value: [6000], expected at least 2 items"),
        ('make: "Acme"\n', "", "acme.yaml: line 1: lacks make"),
        ("catalogue-1", "catalogue-9", "'calibrary/catalogue-9', expected 'calibrary/catalogue-1'"),
        ('title: "Mapper"', "title: 017", "017 starts with 0"),
        ('title: "Mapper"', 'title: "Mapper"\n    title: "x"', "line 5: duplicate key title"),
        ('["M1"]', '["M1"]\n    sub_camera: "infrared"', "'infrared', expected 'blue', 'green'"),
    ],
)
def test_what_is_wrong_in_a_catalogue_of_ones_own_is_said_with_its_line(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert old in OWN
    (tmp_path / "acme.yaml").write_text(OWN.replace(old, new, 1))
    with pytest.raises(ParseError) as caught:
        load_catalogue(tmp_path / "acme.yaml")
    assert said in str(caught.value)


def test_a_catalogue_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_catalogue(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="no catalogue here"):
        load_catalogue(tmp_path)


def test_the_vocabulary_of_the_schema_is_the_one_of_the_code() -> None:
    camera = load("catalogue-1")["$defs"]["KnownCamera"]["properties"]  # type: ignore[index,call-overload]
    assert set(camera["sub_camera"]["enum"]) == SUB_CAMERAS | {None}  # type: ignore[index,call-overload,arg-type]


@pytest.mark.parametrize(
    ("member", "said"),
    [
        ('make: "Acme"', "'make' is not a valid key"),
        ('models: ["M1", "M1"]', "duplicate key models"),
        ('other_makes: ["A", "A"]', "expected no two items alike"),
        ('spread: {value: 0.1, source: "x"}', "fx_over_w"),
        ('sources: [["lens", "x"]]', "'sources' is not a valid key"),
        ("focal_mm: null", "null, expected a map"),
    ],
)
def test_what_no_single_field_says_is_refused_too(tmp_path: Path, member: str, said: str) -> None:
    (tmp_path / "acme.yaml").write_text(f"{OWN}    {member}\n")
    with pytest.raises(ParseError, match=said):
        load_catalogue(tmp_path / "acme.yaml")


def test_a_search_finds_what_reading_every_file_finds() -> None:
    catalogue = load_catalogue()
    words = {
        word
        for camera in list(catalogue)[::16]
        for word in (*camera.title.split(), *camera.models, camera.make)
    }
    assert len(words) > 20
    for word in words:
        assert search_catalogue(word) == catalogue.search(word), word
    assert search_catalogue("") == list(catalogue)
    assert search_catalogue("dji no-such-camera") == []
