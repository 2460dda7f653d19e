"""What messages name of many."""

from __future__ import annotations

import pytest

from calibrary.errors import first_of


@pytest.mark.parametrize(
    ("count", "said"),
    [(0, ""), (1, "a"), (3, "a, b, c"), (4, "a, b, c and 1 more"), (6, "a, b, c and 3 more")],
)
def test_of_many_names_the_first_three_are_told_and_how_many_more_there_are(count: int, said: str) -> None:
    assert first_of("abcdef"[:count]) == said


def test_sentences_are_separated_by_semicolons_and_as_many_are_told_as_asked() -> None:
    assert first_of(["one is", "two is", "three is"], 2, "; ") == "one is; two is and 1 more"
