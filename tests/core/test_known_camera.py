"""The common vocabulary of sub-cameras and bands."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.known_camera import (
    BANDS,
    SUB_CAMERAS,
    KnownCamera,
    hash_serial,
    is_serial_hash,
    normalise_sub_camera,
)


@pytest.mark.parametrize(
    ("tag", "word"),
    [
        ("WideCamera", "wide"),
        ("ZoomCamera", "zoom"),
        ("TeleCamera", "tele"),
        ("MediumTeleCamera", "medium-tele"),
        ("InfraredCamera", "thermal"),
        ("VisibleCamera", "rgb"),
        ("RGBCamera", "rgb"),
        ("COLOR", "rgb"),
        ("IR", "thermal"),
        ("LWIR", "thermal"),
        ("Blue", "blue"),
        ("Green", "green"),
        ("GRE", "green"),
        ("Red", "red"),
        ("Red edge", "red-edge"),
        ("Rededge", "red-edge"),
        ("RedEdge", "red-edge"),
        ("red_edge", "red-edge"),
        ("REG", "red-edge"),
        ("NIR", "nir"),
        ("Panchro", "panchromatic"),
        ("Red,Green,Blue", "rgb"),
        ("Red, Green, Blue", "rgb"),
    ],
)
def test_every_makers_word_comes_down_to_one(tag: str, word: str) -> None:
    assert normalise_sub_camera(tag) == word
    assert normalise_sub_camera(f"  {tag.upper()} ") == word
    assert word in SUB_CAMERAS


def test_two_bands_of_nearly_one_name_stay_two() -> None:
    words = {
        normalise_sub_camera(tag) for tag in ("Blue", "Blue-444", "Red edge", "Red edge-705", "Red edge-740")
    }
    assert words == {"blue", "blue-444", "red-edge", "red-edge-705", "red-edge-740"}


@pytest.mark.parametrize("tag", ["", "   ", "---", "\0"])
def test_a_tag_without_a_letter_says_nothing(tag: str) -> None:
    assert normalise_sub_camera(tag) is None


@given(st.text())
def test_a_word_is_short_and_its_own_normal_form(text: str) -> None:
    word = normalise_sub_camera(text)
    assert word is None or (len(word) <= 48 and normalise_sub_camera(word) == word)


def test_a_megabyte_of_commas_is_no_work() -> None:
    assert normalise_sub_camera("," * 1_000_000) is None


def test_every_word_of_the_vocabulary_is_its_own() -> None:
    assert {normalise_sub_camera(word) for word in SUB_CAMERAS} == SUB_CAMERAS


def camera(sub_camera: str | None = None, bands: tuple[str, ...] = ()) -> KnownCamera:
    return KnownCamera(make="A", models=("B",), title="C", sub_camera=sub_camera, bands=bands)


def test_rgb_leaves_room_for_any_visible_camera_and_wide_only_for_itself() -> None:
    assert camera("wide").may_answer("rgb")
    assert camera("rgb").may_answer("zoom")
    assert not camera("wide").may_answer("zoom")
    assert not camera("thermal").may_answer("rgb")
    assert not camera("multispectral", ("green",)).may_answer("rgb")


def test_an_entry_answers_for_each_of_its_bands() -> None:
    head = camera("multispectral", ("green", "nir"))
    assert [band for band in sorted(BANDS) if head.answers(band)] == ["green", "nir"]
    assert head.answers("multispectral")
    assert not head.may_answer("blue")


def test_a_serial_number_of_the_length_of_a_hash_is_none() -> None:
    made = hash_serial("Example", "A123")
    assert is_serial_hash(made)
    assert not is_serial_hash("Z" * len(made))
    assert not is_serial_hash(made[:-1])
