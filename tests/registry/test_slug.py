"""Names as parts of paths: what is one name is one path, and nothing a camera writes leads anywhere else."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.catalogue import load_catalogue
from calibrary.known_camera import match_key
from calibrary.registry.paths import scripts, slug

SAFE = re.compile(r"[a-z0-9][a-z0-9._-]*(?:~[0-9a-f]{10})?")
ALPHABET = "aAbB1. _-~+×\0\u200d\u00a0ſßİ/\\:х"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("DJI", "dji"),
        ("FC6310\0\0junk", "fc6310"),
        ("E-M10      ", "e-m10"),
        ("  Canon\tEOS  R5 ", "canon_eos_r5"),
        ("ＤＪＩ", "dji"),
        ("zoom 2×", "zoom_2x"),
        ("FC\u200b6310\u202e", "fc6310"),
    ],
)
def test_a_plain_name_is_readable_in_its_path(text: str, expected: str) -> None:
    assert slug(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("../../x", "x~9cdf6a5010"),
        ("NUL.txt", "xnul.txt~7f3cbdd58a"),
        ("Oppo Rеnо 3", "oppo_rn_3~579cf5c847"),
    ],
)
def test_a_name_that_cannot_stand_in_a_path_is_told_by_its_hash(text: str, expected: str) -> None:
    assert slug(text) == expected


HOSTILE = [
    "", " ", "\0", ".", "..", "/", "\\", "-rf", "--output=x", ".git", "GIT~1", ".gitmodules", "a/b", "a\\b", "C:x",
    "con", "COM¹", "lpt9.yaml", "a.lock", "x.yaml", "a.", "a..b", "*", "x" * 5000, "\ud83d", "\u202egnp", "sn-x/..",
]  # fmt: skip


@pytest.mark.parametrize("text", HOSTILE, ids=ascii)
def test_no_name_leads_out_of_its_folder_or_means_something(text: str) -> None:
    name = slug(text)
    assert SAFE.fullmatch(name)
    assert len(name) <= 48
    stem = name.partition("~")[0].partition(".")[0]
    assert stem not in {"con", "prn", "aux", "nul", "com1", "lpt9", "git"}
    assert not name.endswith((".", ".lock", ".yaml"))
    assert ".." not in name


@given(st.text())
def test_any_text_is_a_safe_name(text: str) -> None:
    assert SAFE.fullmatch(slug(text))
    assert slug(text) == slug(text).casefold()


@given(st.text(ALPHABET, max_size=6), st.text(ALPHABET, max_size=6))
def test_two_names_share_a_slug_exactly_if_they_match(one: str, other: str) -> None:
    assert (slug(one) == slug(other)) == (match_key(one) == match_key(other))


@given(st.text())
def test_matching_twice_changes_nothing(text: str) -> None:
    assert match_key(match_key(text)) == match_key(text)


@given(st.from_regex(r"[A-Za-z0-9]([A-Za-z0-9 -]{0,18}[A-Za-z0-9])?", fullmatch=True))
def test_letter_case_and_padding_do_not_matter(text: str) -> None:
    assert slug(f" {text.upper()}\0x") == slug(text.lower())


def test_one_more_sign_is_another_camera() -> None:
    assert (
        len({slug(text) for text in ("V2 Viper X", "V2 Viper X+", "V2-Viper X", "V2_Viper X", "V2ViperX")})
        == 5
    )


def test_the_catalogues_cameras_keep_their_names_apart_and_readable() -> None:
    names = {model for camera in load_catalogue() for model in camera.models}
    assert len({slug(name) for name in names}) == len({match_key(name) for name in names})
    assert [name for name in names if "~" in slug(name) and name.replace("-", "").isalnum()] == []


def test_mixed_scripts_are_seen() -> None:
    assert scripts("FC6310 R") == {"LATIN"}
    assert scripts("Rеno") == {"LATIN", "CYRILLIC"}
