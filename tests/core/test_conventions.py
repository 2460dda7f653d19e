"""Half pixels: where a principal point is counted from."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calibration import Origin, canonical_from_file, file_from_canonical

SIZE = (5472, 3648)


@pytest.mark.parametrize(
    ("origin", "centre"),
    [
        (Origin.CORNER, (2736.0, 1824.0)),
        (Origin.PIXEL_CENTRE, (2735.5, 1823.5)),
        (Origin.IMAGE_CENTRE, (0.0, 0.0)),
    ],
)
def test_the_middle_of_the_image_as_each_origin_counts_it(
    origin: Origin, centre: tuple[float, float]
) -> None:
    assert canonical_from_file(centre, origin, SIZE) == (2736.0, 1824.0)
    assert file_from_canonical((2736.0, 1824.0), origin, SIZE) == centre


def test_an_odd_image_has_its_middle_in_the_centre_of_a_pixel() -> None:
    middle = canonical_from_file((0.0, 0.0), Origin.IMAGE_CENTRE, (641, 481))
    assert file_from_canonical(middle, Origin.PIXEL_CENTRE, (641, 481)) == (320.0, 240.0)


@given(st.sampled_from(Origin), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_there_and_back_is_the_same_to_the_last_digits(origin: Origin, x: float, y: float) -> None:
    canonical = canonical_from_file((x, y), origin, SIZE)
    assert file_from_canonical(canonical, origin, SIZE) == pytest.approx((x, y), abs=4e-12)


def test_an_origin_reads_as_a_sentence() -> None:
    assert "centre of the top-left pixel" in Origin.PIXEL_CENTRE
    assert "outer corner of the top-left pixel" in Origin.CORNER
    assert str(Origin.IMAGE_CENTRE) == "the middle of the image"
