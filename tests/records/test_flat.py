"""A record as flat fields: how lists read, and which class a member of a family becomes."""

from __future__ import annotations

import pytest

from calibrary.records import Record, flat, from_json, to_json


class Shape(Record, tag_field="kind"):
    """A family.

    Attributes:
        side: its size.
    """

    side: float = 1.0


class Square(Shape, tag="square"):
    """A member that states its tag itself."""


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ([5472, 3648], "5472×3648"),
        ([0.5, 1.5], "0.5; 1.5"),
        (["a", "b"], "a; b"),
    ],
)
def test_a_short_list_is_shown_whole(values: list[object], text: str) -> None:
    assert flat({"list": values})["list"] == text  # type: ignore[dict-item]


def test_a_long_list_of_numbers_is_shown_as_their_count_and_a_digest() -> None:
    nine, ten = [0.5] * 9, [0.5] * 10
    assert flat({"list": nine})["list"] == "; ".join(["0.5"] * 9)  # type: ignore[dict-item]
    shown = str(flat({"list": ten})["list"])  # type: ignore[dict-item]
    assert shown.startswith("10 numbers (")
    assert shown != flat({"list": [*ten[:-1], 0.25]})["list"]


def test_a_member_of_a_family_is_written_with_its_tag_and_read_back() -> None:
    assert to_json(Square(side=2.0)) == {"kind": "square", "side": 2.0}
    assert from_json(Square, {"kind": "square", "side": 2.0}) == Square(side=2.0)
