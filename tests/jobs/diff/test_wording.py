from __future__ import annotations

import math

import pytest

from calibrary.jobs.diff.wording import chance, length, listed, percent, pixels


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (1e-13, "0 px"),
        (0.0031, "0.003 px"),
        (0.25, "0.25 px"),
        (8.31, "8.3 px"),
        (9.96, "10 px"),
        (482.4, "482 px"),
        (math.nan, "unknown"),
    ],
)
def test_pixels_have_two_digits_and_no_exponent(value: float, shown: str) -> None:
    assert pixels(value) == shown


@pytest.mark.parametrize(
    ("metres", "shown"),
    [
        (1e-9, "0 cm"),
        (0.0034, "3.4 mm"),
        (0.58, "58 cm"),
        (0.0271, "2.7 cm"),
        (0.996, "1.0 m"),
        (13.2, "13 m"),
        (-0.1, "-10 cm"),
    ],
)
def test_lengths_have_the_unit_that_people_use(metres: float, shown: str) -> None:
    assert length(metres) == shown


def test_signs_shares_chances_and_lists() -> None:
    assert length(0.1, signed=True) == "+10 cm"
    assert [percent(share) for share in (1e-9, 0.001, -0.15)] == ["0%", "+0.100%", "-15.0%"]
    assert [chance(p) for p in (0.57, 0.003, 1e-9)] == ["57%", "0.003", "less than 1 in 10000"]
    assert [listed(names) for names in (["k3"], ["fx", "fy"], ["a", "b", "c"])] == [
        "k3",
        "fx and fy",
        "a, b and c",
    ]
