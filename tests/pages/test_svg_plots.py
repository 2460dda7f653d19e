"""Plots that are written as SVG directly: they show the numbers they are given and say them in words."""

from __future__ import annotations

import math
import re
from datetime import date

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calibrary.errors import InputError
from calibrary.pages.plots import Axis
from calibrary.pages.plots.history import Series, history
from calibrary.pages.plots.svg_plots import amount_map, arrow_map, cell_centres
from calibrary.pages.svg import inline_svg
from calibrary.view import Figure
from tests.pages.gallery import HOSTILE

SIZE = (5400, 3600)
PX = Axis("difference", "px")
LEFT, TOP, SCALE = 46.0, 30.0, 420.0 / 5400


def grid(rows: int = 5, columns: int = 7) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, SIZE[0], columns), np.linspace(0, SIZE[1], rows))
    return np.stack([x, y], axis=-1)


def drawn(figure: Figure) -> str:
    return inline_svg(figure.svg, alt=figure.alt, prefix="p")


NOTHING, LOST = np.empty((0, 2)), np.full((3, 2), np.nan)


@pytest.mark.parametrize(
    ("points", "vectors"),
    [
        (NOTHING, NOTHING),
        (LOST, LOST),
        (np.ones((3, 2)), np.zeros((3, 2))),
        (np.ones((3, 2)), np.full((3, 2), 1e-300)),
        (np.ones((3, 2)), np.full((3, 2), 1e300)),
    ],
)
def test_arrows_of_nothing_or_of_nonsense_are_still_a_map(points: np.ndarray, vectors: np.ndarray) -> None:
    figure = arrow_map(points, vectors, SIZE, axis=PX, caption="c")
    assert "nan" not in drawn(figure)


def test_arrows_anywhere_tell_what_is_cut_and_what_has_no_value() -> None:
    vectors = np.ones((60, 2))
    vectors[7], vectors[8] = 500.0, np.nan
    figure = arrow_map(np.full((60, 2), 50.0), vectors, SIZE, axis=PX, caption="c")
    assert figure.alt.endswith("1 longer ones are drawn cut, in red and thicker. 1 points have no value.")
    assert 'fill-opacity="0.22"' not in figure.svg


def test_arrows_need_a_vector_for_each_point() -> None:
    with pytest.raises(InputError, match="have vectors of shape"):
        arrow_map([[1, 1], [2, 2]], [[1, 1]], SIZE, axis=PX, caption="c")


def test_a_map_of_cells_tells_where_it_is_largest() -> None:
    values = np.full((6, 9), 0.1)
    values[5, 0] = 0.75
    figure = amount_map(cell_centres(values.shape, SIZE), values, SIZE, axis=PX, caption="c")
    assert figure.alt.endswith("from 0.1 to 0.75 px, 0.1 px in the middle, largest at the bottom left.")


def test_an_arrow_begins_at_its_point_and_goes_its_way() -> None:
    vectors = np.zeros((5, 7, 2))
    vectors[2, 3] = (3.0, 4.0)
    vectors[..., 0] += 1.0
    figure = arrow_map(grid(), vectors, SIZE, axis=PX, caption="")
    x, y = LEFT + 2700 * SCALE, TOP + 1800 * SCALE
    [(u, v)] = re.findall(rf"M{x:.1f} {y:.1f}L([\d.]+) ([\d.]+)M", figure.svg)
    assert (float(v) - y) / (float(u) - x) == pytest.approx(1.0, abs=0.02)
    assert "longest 5.66 px" in figure.alt


def test_the_scale_is_the_one_the_arrows_are_drawn_in() -> None:
    vectors = np.full((5, 7, 2), (2.0, 0.0))
    figure = arrow_map(grid(), vectors, SIZE, axis=PX, caption="")
    [times] = re.findall(r"2 px, arrows drawn × ([\d.]+)", figure.svg)
    [(x, u)] = re.findall(r"M(46\.0) 18\.0L([\d.]+)", figure.svg)
    assert float(u) - float(x) == pytest.approx(2.0 * SCALE * float(times), abs=0.1)


def test_what_does_not_count_is_grey_and_sets_no_scale() -> None:
    vectors = np.full((5, 7, 2), (1.0, 0.0))
    inside = np.ones((5, 7), dtype=bool)
    inside[0, 0] = False
    vectors[0, 0] = (1000.0, 0.0)
    figure = arrow_map(grid(), vectors, SIZE, axis=PX, caption="", inside=inside)
    assert "longest 1 px" in figure.alt
    assert "97% of the frame" in figure.alt
    assert 'fill-opacity="0.22"' in figure.svg


def test_one_arrow_that_is_far_too_long_is_cut_and_red() -> None:
    vectors = np.full((10, 10, 2), (1.0, 0.0))
    vectors[5, 5] = (400.0, 0.0)
    figure = arrow_map(grid(10, 10), vectors, SIZE, axis=PX, caption="")
    assert 'stroke="#b0241c"' in figure.svg
    assert "longest 400 px" in figure.alt


def test_amounts_are_told_in_numbers_and_shades() -> None:
    amounts = np.linspace(0, 4, 35).reshape(5, 7)
    figure = amount_map(grid(), amounts, SIZE, axis=Axis("1 σ", "px"), caption="")
    assert "from 0 to 4 px, 2 px in the middle" in figure.alt
    shades = [float(found) for found in re.findall(r'<path [^>]*fill-opacity="([\d.]+)"', figure.svg)]
    assert shades == sorted(shades)
    assert len(shades) == 10


def test_cells_fill_the_frame_without_gap_or_overlap() -> None:
    figure = amount_map(grid(), np.ones((5, 7)), SIZE, axis=PX, caption="")
    cells = re.findall(r"M([\d.]+) ([\d.]+)h([\d.]+)v([\d.]+)h", figure.svg)
    assert len(cells) == 35
    assert sum(float(w) * float(h) for _, _, w, h in cells) == pytest.approx(420 * 280, rel=2e-3)


def test_nothing_to_show_is_a_frame() -> None:
    empty = np.full((5, 7, 2), np.nan)
    assert "clip" not in drawn(arrow_map(grid(), empty, SIZE, axis=PX, caption=""))
    assert "from" not in amount_map(grid(), empty[..., 0], SIZE, axis=PX, caption="").alt


@pytest.mark.parametrize("shape", [(5, 7), (4, 7, 2), (1, 7, 2), (5, 7, 3)])
def test_arrays_that_do_not_fit_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError):
        arrow_map(grid(), np.zeros(shape), SIZE, axis=PX, caption="")


@given(
    arrays(np.float64, (3, 4, 2), elements=st.floats(-1e12, 1e12) | st.just(math.nan)),
    st.tuples(st.integers(1, 20_000), st.integers(1, 20_000)),
)
def test_any_numbers_are_drawn(vectors: np.ndarray, size: tuple[int, int]) -> None:
    x, y = np.meshgrid(np.linspace(0, size[0], 4), np.linspace(0, size[1], 3))
    points = np.stack([x, y], axis=-1)
    for figure in (
        arrow_map(points, vectors, size, axis=PX, caption=""),
        amount_map(points, np.abs(vectors[..., 0]), size, axis=PX, caption=""),
    ):
        assert "nan" not in drawn(figure).lower().replace(figure.alt.lower(), "")


def series(*values: float, std: tuple[float, ...] | None = None) -> Series:
    return Series(axis=Axis("fx", "px"), values=values, std=std)


def test_a_history_has_a_point_a_revision_and_a_bar_where_the_spread_is_known() -> None:
    figure = history(
        [series(3700.0, 3700.5, 3704.0, std=(0.4, math.nan, 0.4))], labels=["a", "b", "c"], caption=""
    )
    assert figure.svg.count("<circle") == 3
    [bars] = re.findall(r'<path d="(M[^"]*h8M[^"]*)"', figure.svg)
    assert bars.count("V") == 2
    assert "fx 3700.00 to 3704.00 px, 3704.00 now" in figure.alt


def test_a_gap_parts_the_line() -> None:
    figure = history([series(1.0, math.nan, 2.0, 3.0)], labels=list("abcd"), caption="")
    assert figure.svg.count("<circle") == 3
    lines = re.findall(r'<path d="M([^"A-Z]*(?:L[^"]*)?)" fill="none" stroke="#0b5cad"', figure.svg)
    assert [line.count("L") for line in lines] == [0, 1]


def test_a_change_of_firmware_stands_between_its_revisions() -> None:
    figure = history([series(1.0, 2.0, 3.0)], labels=["x", "y", "z"], marks=[(2, "firmware 2")], caption="")
    xs = [float(found) for found in re.findall(r'<circle cx="([\d.]+)"', figure.svg)]
    [mark] = re.findall(r'<path d="M([\d.]+) [\d.]+V[\d.]+" fill="none" stroke="#a84b00"', figure.svg)
    assert xs[1] < float(mark) < xs[2]
    assert "firmware 2 before z" in figure.alt


def test_names_that_nobody_should_write_are_text() -> None:
    marks = [(n, name) for n, name in enumerate(HOSTILE)]
    figure = history([series(*range(len(HOSTILE)))], labels=HOSTILE, marks=marks, caption="")
    svg = drawn(figure)
    assert "<script" not in svg
    assert "\u202e" not in svg


@given(st.lists(st.floats(-1e9, 1e9) | st.just(math.nan), min_size=1, max_size=30))
def test_any_history_is_drawn(values: list[float]) -> None:
    figure = history([series(*values)], labels=[str(n) for n in range(len(values))], caption="")
    assert "nan" not in drawn(figure)


def test_of_very_many_revisions_the_newest_are_drawn() -> None:
    values = list(range(1000))
    figure = history([series(*values)], labels=[f"r{n}" for n in values], caption="", marks=[(5, "old")])
    assert figure.svg.count("<circle") == 400
    assert "over 1000 revisions" in figure.alt
    assert "old" not in figure.svg


def test_a_series_of_another_length_is_refused() -> None:
    with pytest.raises(InputError, match="2 values over 3 revisions"):
        history([series(1.0, 2.0)], labels=["a", "b", "c"], caption="")
    with pytest.raises(InputError, match="σ of fx"):
        history([series(1.0, 2.0, std=(1.0,))], labels=["a", "b"], caption="")


def test_a_history_over_time_puts_each_revision_on_its_day_and_shows_when_it_is_valid() -> None:
    days = [date(2020, 1, 1), date(2020, 2, 1), date(2024, 1, 1)]
    figure = history(
        [series(1.0, 2.0, 3.0)],
        labels=["a", "b", "c"],
        caption="",
        days=days,
        spans=[None, (date(2020, 2, 1), date(2022, 2, 1)), (date(2024, 1, 1), None)],
    )
    x = [float(text) for text in re.findall(r'<circle cx="([0-9.]+)"', figure.svg)]
    months = [(day - days[0]).days for day in days]
    assert (x[1] - x[0]) / (x[2] - x[0]) == pytest.approx(months[1] / months[2], abs=0.002)
    assert figure.svg.count('stroke-opacity="0.22"') == 2
    assert re.findall(r">(20[0-9]{2})<", figure.svg) == [
        "2020",
        "2021",
        "2022",
        "2023",
        "2024",
    ]
    assert "The axis is time, from 2020-01-01 to 2024-01-01." in figure.alt


@pytest.mark.parametrize(
    "days",
    [
        [date(2026, 5, 1)] * 3,
        [date(2026, 5, 1), date(2026, 5, 2), date(2026, 5, 3)],
        [date.min, date(2026, 5, 2), date.max],
    ],
)
def test_any_days_have_an_axis(days: list[date]) -> None:
    figure = history([series(1.0, 2.0, 3.0)], labels=["a", "b", "c"], caption="", days=days)
    x = [float(text) for text in re.findall(r'<circle cx="([0-9.]+)"', figure.svg)]
    assert all(92 <= at <= 736 for at in x)
    assert len(re.findall(r"<text", figure.svg)) < 30
