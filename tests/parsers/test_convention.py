"""Units, origins and axes, each against the geometry it stands for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calibration import Intrinsics
from calibrary.distortion import BrownConrady
from calibrary.errors import InputError, ParseError
from calibrary.parsers.convention import Convention, Native, Origin, Tangential, Unit, YAxis

SIZE = (6000, 4000)
SENSOR_MM = (23.5, 15.6)


@given(
    unit=st.sampled_from(Unit),
    origin=st.sampled_from(Origin),
    y_axis=st.sampled_from(YAxis),
    focal=st.floats(0.1, 5.0),
    drift=st.floats(-0.1, 0.1),
    skew=st.floats(-5.0, 5.0),
)
def test_counting_there_and_back_keeps_every_number(
    unit: Unit, origin: Origin, y_axis: YAxis, focal: float, drift: float, skew: float
) -> None:
    convention = Convention(unit=unit, origin=origin, y_axis=y_axis)
    K = Intrinsics(
        fx=6000 * focal,
        fy=6001 * focal,
        cx=3000 * (1 + drift),
        cy=2000 * (1 - drift),
        skew=skew,
        image_size=SIZE,
    )
    native = convention.native(K, sensor_mm=SENSOR_MM)
    again = convention.intrinsics(native, SIZE, sensor_mm=SENSOR_MM)
    np.testing.assert_allclose(again.matrix, K.matrix, rtol=0, atol=1e-12 * max(6000, K.fy))


@pytest.mark.parametrize(
    ("convention", "native"),
    [
        (Convention(origin=Origin.CORNER), Native(fx=4500, fy=4490, cx=3010, cy=1980, skew=2)),
        (Convention(origin=Origin.PIXEL_CENTRE), Native(fx=4500, fy=4490, cx=3009.5, cy=1979.5, skew=2)),
        (Convention(origin=Origin.IMAGE_CENTRE), Native(fx=4500, fy=4490, cx=10, cy=-20, skew=2)),
        (
            Convention(origin=Origin.IMAGE_CENTRE, y_axis=YAxis.UP),
            Native(fx=4500, fy=4490, cx=10, cy=20, skew=-2),
        ),
        (
            Convention(origin=Origin.CORNER, y_axis=YAxis.UP),
            Native(fx=4500, fy=4490, cx=3010, cy=2020, skew=-2),
        ),
        (
            Convention(origin=Origin.PIXEL_CENTRE, y_axis=YAxis.UP),
            Native(fx=4500, fy=4490, cx=3009.5, cy=2019.5, skew=-2),
        ),
        (
            Convention(origin=Origin.CORNER, unit=Unit.LONGER_SIDE),
            Native(fx=0.75, fy=4490 / 6000, cx=3010 / 6000, cy=0.33, skew=2 / 6000),
        ),
        (
            Convention(origin=Origin.CORNER, unit=Unit.EACH_SIDE),
            Native(fx=0.75, fy=4490 / 4000, cx=3010 / 6000, cy=0.495, skew=2 / 6000),
        ),
        (
            Convention(origin=Origin.CORNER, unit=Unit.MILLIMETRE),
            Native(fx=17.625, fy=4490 * 15.6 / 4000, cx=3010 * 23.5 / 6000, cy=7.722, skew=2 * 23.5 / 6000),
        ),
    ],
)
def test_one_camera_in_many_counts(convention: Convention, native: Native) -> None:
    K = convention.intrinsics(native, SIZE, sensor_mm=SENSOR_MM)
    expected = [[4500, 2, 3010], [0, 4490, 1980], [0, 0, 1]]
    np.testing.assert_allclose(K.matrix, expected, rtol=1e-14, atol=1e-11)


def test_no_skew_has_no_sign_whichever_way_y_points() -> None:
    upwards = Convention(origin=Origin.CORNER, y_axis=YAxis.UP)
    K = upwards.intrinsics(Native(fx=100.0, fy=100.0, cx=50.0, cy=40.0), (100, 80))
    assert math.copysign(1.0, K.skew) == 1.0
    assert math.copysign(1.0, upwards.native(K).skew) == 1.0


def test_millimetres_ask_for_the_sensor() -> None:
    with pytest.raises(InputError, match="sensor"):
        Convention(origin=Origin.CORNER, unit=Unit.MILLIMETRE).intrinsics(
            Native(fx=1, fy=1, cx=0, cy=0), SIZE
        )


def test_numbers_that_make_no_k_are_the_files_fault() -> None:
    with pytest.raises(ParseError, match=r"^a\.txt: focal lengths"):
        Convention(origin=Origin.CORNER).intrinsics(Native(fx=-1, fy=1, cx=0, cy=0), SIZE, source="a.txt")


@pytest.mark.parametrize("y_axis", YAxis)
@pytest.mark.parametrize("tangential", [Tangential.OPENCV, Tangential.SWAPPED])
def test_the_tangential_terms_mean_what_the_sentence_says(y_axis: YAxis, tangential: Tangential) -> None:
    convention = Convention(origin=Origin.CORNER, y_axis=y_axis, tangential=tangential)
    first, second = 0.003, -0.002
    p1, p2 = convention.tangential_from_file(first, second)
    x, y = 0.31, -0.17
    up = -1.0 if y_axis is YAxis.UP else 1.0
    Y, r2 = up * y, x * x + y * y
    if tangential is Tangential.SWAPPED:
        dx, dY = first * (r2 + 2 * x * x) + 2 * second * x * Y, second * (r2 + 2 * Y * Y) + 2 * first * x * Y
    else:
        dx, dY = 2 * first * x * Y + second * (r2 + 2 * x * x), first * (r2 + 2 * Y * Y) + 2 * second * x * Y
    seen = BrownConrady(k1=0.0, k2=0.0, p1=p1, p2=p2).distort(np.array([[x, y]]))
    np.testing.assert_allclose(seen, [[x + dx, y + up * dY]], rtol=0, atol=1e-16)
    assert convention.tangential_to_file(p1, p2) == (first, second)


def test_a_convention_reads_as_sentences() -> None:
    sentences = Convention(origin=Origin.IMAGE_CENTRE, coefficients=("k1", "k2")).sentences()
    assert "the principal point counts from the middle of the image" in sentences
    assert "coefficients k1, k2" in sentences


@pytest.mark.parametrize(
    ("rows", "step"),
    [
        (((500, 0, 0), (0, 501, 0), (320, 240, 1)), "it is transposed"),
        (((500, 0, 320), (0, 501, 240), (0, 0, 2)), "its last number is 2: divide the matrix by it"),
        (((500, 0, 320), (1, 501, 240), (0, 0, 1)), "expected zeros below the diagonal"),
        (((500, 0, 320), (0, 501, 240), (0, 0, 0)), "expected zeros below the diagonal"),
    ],
    ids=["transposed", "scaled", "rotated", "singular"],
)
def test_what_is_not_a_camera_matrix_is_refused_with_the_next_step(
    rows: tuple[tuple[float, ...], ...], step: str
) -> None:
    with pytest.raises(ParseError, match=f"this is not a camera matrix: {step}") as caught:
        Native.of_matrix(rows, place="K", source="a.yaml")
    assert (caught.value.place, caught.value.source) == ("K", "a.yaml")
