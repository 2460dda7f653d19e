"""Firmware is compared as numbers, and what cannot be compared is said, not guessed."""

from __future__ import annotations

import pytest

from calibrary.errors import InputError
from calibrary.registry.firmware import FirmwareRange, begins_with, compare


@pytest.mark.parametrize(
    ("older", "newer"),
    [
        ("1.9", "1.10"),
        ("01.00.0128", "01.00.0129"),
        ("10.00.12.07", "10.01"),
        ("v04.00.01.02", "4.0.1.3"),
        ("Firmware Version 1.0.1", "1.0.2"),
        ("ILCE-7RM4 v1.20", "ilce-7rm4 v1.21"),
    ],
)
def test_versions_are_compared_number_by_number(older: str, newer: str) -> None:
    assert (compare(older, newer), compare(newer, older)) == (-1, 1)


@pytest.mark.parametrize(
    ("one", "other"), [("01.00.0128", "1.0.128"), ("1.2", "1.2.0.0"), ("Ver.1.0 ", "V1.0")]
)
def test_spelling_makes_no_other_version(one: str, other: str) -> None:
    assert compare(one, other) == 0


@pytest.mark.parametrize(
    ("firmware", "version", "begins"),
    [
        ("v01.09.1691", "01.09", True),
        ("v01.09.1691", "v1.9.1691", True),
        ("1.9", "1.9.0", True),
        ("v01.09.1691", "01.0", False),
        ("01.10", "01.1", False),
        ("01.09", "01.09.1691", False),
    ],
)
def test_a_version_begins_with_another_number_by_number(firmware: str, version: str, begins: bool) -> None:
    assert begins_with(firmware, version) == begins
    assert FirmwareRange(min=firmware).covers(version) == (begins or compare(version, firmware) > 0)


@pytest.mark.parametrize("text", ["DJI GO", "1.00a", "", "1.2 beta"])
def test_what_is_no_version_is_an_error(text: str) -> None:
    with pytest.raises(InputError, match="not a version number"):
        compare(text, "1.0")


def test_versions_of_two_programs_cannot_be_compared() -> None:
    for text in ("Adobe Lightroom 7.3", "1..2"):
        with pytest.raises(InputError, match="cannot be compared"):
            compare(text, "01.00.0128")


@pytest.mark.parametrize(
    ("range_", "inside", "outside"),
    [
        (FirmwareRange(min="1.2"), ["1.2", "1.10", "3"], ["1.1.9"]),
        (FirmwareRange(max="1.2"), ["0.1", "1.2.0"], ["1.2.1"]),
        (FirmwareRange(min="1.2", max="1.4"), ["1.2", "1.3.99", "1.4"], ["1.1", "1.4.1"]),
    ],
)
def test_a_range_holds_both_its_ends(range_: FirmwareRange, inside: list[str], outside: list[str]) -> None:
    assert all(range_.holds(text) for text in inside)
    assert not any(range_.holds(text) for text in outside)


@pytest.mark.parametrize(
    ("one", "other", "overlap"),
    [
        (FirmwareRange(max="1.2"), FirmwareRange(min="1.2"), True),
        (FirmwareRange(max="1.2"), FirmwareRange(min="1.3"), False),
        (FirmwareRange(min="1.0"), FirmwareRange(min="5.0"), True),
        (FirmwareRange(min="1.0", max="1.4"), FirmwareRange(min="1.5", max="2"), False),
    ],
)
def test_overlap_is_seen_from_both_sides(one: FirmwareRange, other: FirmwareRange, overlap: bool) -> None:
    assert (one.overlaps(other), other.overlaps(one)) == (overlap, overlap)


def test_overlap_of_what_cannot_be_compared_is_an_error_even_of_open_ranges() -> None:
    with pytest.raises(InputError, match="cannot be compared"):
        FirmwareRange(min="1.0").overlaps(FirmwareRange(min="ILCE 1.4"))


@pytest.mark.parametrize("ends", [{}, {"min": "x"}, {"min": "2", "max": "1"}, {"min": "A 1", "max": "B 2"}])
def test_a_range_that_is_none_is_refused(ends: dict[str, str]) -> None:
    with pytest.raises(InputError):
        FirmwareRange(**ends)
