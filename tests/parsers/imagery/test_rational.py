"""One number out of what image libraries give for a tag."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from exifread.utils import Ratio
from PIL.TiffImagePlugin import IFDRational

from calibrary.errors import BadRationalError
from calibrary.parsers.imagery.facts import as_number


@pytest.mark.parametrize(
    "value",
    [
        IFDRational(88, 10),
        Ratio(88, 10),
        Fraction(88, 10),
        8.8,
        np.float64(8.8),
        (8.8, 8.8),
        [Ratio(88, 10), Ratio(44, 5)],
        (IFDRational(88, 10),),
    ],
)
def test_a_number_is_a_number_in_any_dress(value: object) -> None:
    assert as_number(value) == 8.8


@pytest.mark.parametrize("value", [24, np.int64(24), Ratio(24), (24,), IFDRational(24, 1)])
def test_whole_numbers_too(value: object) -> None:
    assert as_number(value) == 24.0


@pytest.mark.parametrize("value", [Ratio(5, 0), IFDRational(5, 0), [Ratio(5, 0)]])
def test_a_zero_denominator_is_named_not_divided(value: object) -> None:
    with pytest.raises(BadRationalError, match="found 5/0"):
        as_number(value)


@pytest.mark.parametrize(
    "value",
    [Ratio(0, 0), math.nan, math.inf, -math.inf, None, "8.8", b"8.8", (), [], (8.8, 4.5), True, 10**400],
)
def test_what_is_no_single_finite_number_is_refused(value: object) -> None:
    with pytest.raises(BadRationalError, match="a finite number was expected"):
        as_number(value)


def test_the_refusal_is_a_value_error_that_says_where() -> None:
    with pytest.raises(ValueError, match=r"^DJI_0001\.JPG: EXIF FocalLength: found 0/0"):
        as_number(Ratio(0, 0), source="DJI_0001.JPG", place="EXIF FocalLength")
