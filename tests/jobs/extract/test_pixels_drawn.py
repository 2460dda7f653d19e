"""The focal lengths that the pixels measured, as the page of a camera draws them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from calibrary.jobs.extract.told import _of_pixels
from calibrary.pages.plots.intervals import Role
from calibrary.sfm.pixel_check import PixelVerdict

MEASURED: dict[str, Any] = {
    "images": 20,
    "pairs": 7,
    "measured_fx": 3700.0,
    "std": 0.01,
    "pair_fx": 3600.0,
    "pair_std": 0.02,
}
ALL, PAIRS = ("pixels of 20 images", 3700.0, 74.0), ("7 pairs of images", 3600.0, 144.0)


@pytest.mark.parametrize(
    ("missing", "expected"),
    [
        ((), [ALL, PAIRS]),
        (("std",), [PAIRS]),
        (("measured_fx",), [PAIRS]),
        (("pair_fx",), [ALL]),
        (("pair_std",), [ALL]),
    ],
)
def test_each_measurement_with_its_standard_deviation_is_drawn_to_two_of_them(
    missing: tuple[str, ...], expected: list[tuple[str, float, float]]
) -> None:
    check = SimpleNamespace(verdict=PixelVerdict.AGREES, **(MEASURED | dict.fromkeys(missing)))
    drawn = [(one.name, one.value, one.half_width) for one in _of_pixels(check)]  # type: ignore[arg-type]
    assert drawn == expected


@pytest.mark.parametrize(
    ("verdict", "role"),
    [
        (PixelVerdict.AGREES, Role.AGREES),
        (PixelVerdict.CONTRADICTS, Role.DISAGREES),
        (PixelVerdict.CANNOT_TELL, Role.NO_K),
    ],
)
def test_pairs_of_images_agree_with_nothing_and_all_images_as_the_verdict_says(
    verdict: PixelVerdict, role: Role
) -> None:
    check = SimpleNamespace(verdict=verdict, **MEASURED)
    assert [one.role for one in _of_pixels(check)] == [role, Role.NO_K]  # type: ignore[arg-type]
