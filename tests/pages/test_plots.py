"""Plots: they show the numbers they are given, say in words what they show, and come out the same everywhere."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from datetime import date

import cv2
import matplotlib as mpl
import numpy as np
import pytest

from calibrary.distortion import BrownConrady
from calibrary.errors import InputError
from calibrary.pages.plots import (
    Axis,
    Band,
    Interval,
    Role,
    bars,
    correlations,
    displacement,
    distortion_map,
    intervals,
    poses,
    radial_curve,
)
from calibrary.pages.plots.canvas import number
from calibrary.pages.plots.intervals import Dated, over_time
from calibrary.pages.svg import inline_svg
from calibrary.quality import Covariance
from calibrary.view import Figure
from tests.pages.gallery import BROWN, FISHEYE, HOSTILE, SIZE, calibration, plots

PX = Axis("rms", "px")
DAY = date(2026, 5, 1)
NOTHING = np.empty((0, 2))
LOST = np.full((3, 2), math.nan)


def words(figure: Figure) -> list[str]:
    """The text that is drawn."""
    return re.findall(r"<text[^>]*>([^<]*)</text>", inline_svg(figure.svg, alt="", prefix="p"))


@pytest.fixture(scope="module")
def gallery() -> dict[str, Figure]:
    return plots()


class TestEveryPlot:
    @pytest.mark.thorough
    def test_is_the_same_bytes_whatever_the_user_has_set_up(self, gallery: dict[str, Figure]) -> None:
        with mpl.rc_context(
            {"font.size": 30, "axes.grid": True, "svg.fonttype": "path", "text.color": "red"}
        ):
            assert plots.__wrapped__() == gallery

    def test_leaves_what_the_user_has_set_up_as_it_was(self) -> None:
        with mpl.rc_context({"font.size": 30}):
            bars([1.0], labels=["a"], axis=PX, caption="c")
            assert mpl.rcParams["font.size"] == 30

    def test_carries_no_date_and_no_place(self, gallery: dict[str, Figure]) -> None:
        for figure in gallery.values():
            assert re.findall(r"\b20[234]\d-\d\d-\d\dT|/home/|/usr/", figure.svg) == []

    def test_says_in_a_sentence_what_it_shows(self, gallery: dict[str, Figure]) -> None:
        for kind, figure in gallery.items():
            assert re.match(r".{25,}\.$", figure.alt), kind

    def test_has_words_as_words_and_units_beside_what_it_measures(self, gallery: dict[str, Figure]) -> None:
        for kind, figure in gallery.items():
            if kind not in {"coverage", "correlations"}:
                assert any(re.search(r"\((px|°|mm)\)|\d (px|°|mm)\b", text) for text in words(figure)), kind

    def test_takes_its_colours_from_the_palette_but_for_the_maps_own(
        self, gallery: dict[str, Figure]
    ) -> None:
        for kind, figure in gallery.items():
            drawn = inline_svg(figure.svg, alt="", prefix="p")
            for element in re.findall(r"<\w+ [^>]*>", drawn):
                for paint, colour in re.findall(r'(fill|stroke)="(#\w+)"', element):
                    assert f"{paint[0]}-" in element or colour in {"#101010", "#fefefe"}, (kind, element)

    @pytest.mark.parametrize(
        "make",
        [
            lambda: bars([], labels=[], axis=PX, limit=0.5, caption="c"),
            lambda: bars([math.nan] * 3, labels=["a"] * 3, axis=PX, limit=0.5, caption="c"),
            lambda: bars([math.inf, 1.0], labels=["a", "b"], axis=PX, limit=0.5, caption="c"),
            lambda: bars(np.ones(3000), labels=["name"] * 3000, axis=PX, caption="c"),
            lambda: poses(np.zeros((2, 3)), [1.0, 2.0], axis=PX, caption="c"),
            lambda: poses(np.empty((0, 3)), [], axis=PX, caption="c"),
            lambda: correlations(Covariance(names=(), upper=()), caption="c"),
            lambda: correlations(Covariance(names=("fx",), upper=(1.0,)), caption="c"),
            lambda: correlations(Covariance(names=("a", "b"), upper=(0.0, 0.0, 1.0)), caption="c"),
            lambda: intervals([], axis=PX, caption="c"),
            lambda: intervals([Interval(name="a", value=math.nan, role=Role.CHOSEN)], axis=PX, caption="c"),
            lambda: intervals([Interval(name="a", value=0.0, role=Role.CHOSEN)] * 99, axis=PX, caption="c"),
            lambda: distortion_map(calibration(None)),
            lambda: radial_curve(calibration(None)),
            lambda: radial_curve(calibration(BrownConrady(k1=-9.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0))),
        ],
    )
    def test_of_nothing_or_of_nonsense_is_still_a_plot(self, make: Callable[[], Figure]) -> None:
        figure = make()
        assert "nan" not in words(figure)
        assert len(inline_svg(figure.svg, alt=figure.alt, prefix="p")) < 300_000

    @pytest.mark.parametrize("text", HOSTILE)
    def test_shows_a_name_as_a_name(self, text: str) -> None:
        figure = bars([1.0, 2.0], labels=[text, "b"], axis=Axis(text, "px"), limit=1.5, caption="c")
        assert max(len(word) for word in words(figure)) < 120
        assert "$" not in text or any("$" in word for word in words(figure))


class TestBars:
    def test_names_what_lies_above_the_limit(self) -> None:
        figure = bars([0.2, 0.9, 0.3, math.nan], labels=["a", "b", "c", "d"], axis=PX, limit=0.5, caption="x")
        assert figure.alt.endswith("The limit is 0.5 px; 1 above it: b.")
        assert "limit 0.5 px" in words(figure)
        assert figure.svg.count("fill: #b0241c") == 1

    def test_need_a_label_each(self) -> None:
        with pytest.raises(InputError, match="2 bars have 1 labels"):
            bars([1.0, 2.0], labels=["a"], axis=PX, caption="c")


class TestPoses:
    def test_tell_how_far_the_board_was_tilted(self) -> None:
        normals = [
            np.asarray(cv2.Rodrigues(np.radians([angle, 0.0, 0.0]))[0])[:, 2] for angle in (5.0, -35.0)
        ]
        figure = poses(np.array(normals) * 7, [900, 1200], axis=Axis("distance", "mm"), caption="c")
        assert figure.alt.startswith("Tilt of the board in 2 views, 5 to 35 °; distance, 900 to 1200 mm.")

    def test_do_not_mind_which_side_of_the_board_its_normal_leaves(self) -> None:
        one, other = (poses([[0.1, 0.2, z]], [9], axis=PX, caption="c") for z in (0.9, -0.9))
        assert one.alt == other.alt


def test_correlations_name_the_strongest_pair() -> None:
    samples = np.random.default_rng(3).normal(size=(3, 50))
    samples[2] -= 3 * samples[0]
    rho = float(np.asarray(np.corrcoef(samples))[0, 2])
    figure = correlations(Covariance.from_matrix(("fx", "fy", "k1"), np.cov(samples)), caption="c")
    assert f"Strongest: fx with k1 {number(rho)}" in figure.alt
    assert f"{rho:.2f}".replace("-0", "−") in words(figure)


class TestIntervals:
    def test_tell_each_source_its_difference_and_what_became_of_it(self) -> None:
        rows = [
            Interval(name="tag", value=3700.0, role=Role.CHOSEN),
            Interval(name="film", value=4070.0, half_width=80.0, role=Role.DISAGREES),
        ]
        figure = intervals(rows, axis=Axis("fx", "px"), band=Band(3600, 3800, "the catalogue"), caption="c")
        assert "tag 3700.0 px, used; film 4070.0 px, +10.0 %, disagrees." in figure.alt
        assert "Expected by the catalogue: 3600 to 3800 px." in figure.alt
        assert "film: 4070.0 px, +10.0 %, disagrees" in words(figure)

    def test_give_each_role_a_shape_of_its_own(self) -> None:
        assert len({role.value[0] for role in Role}) == len(Role)


class TestTheLens:
    def test_moves_a_pixel_as_opencv_does(self) -> None:
        pixels = np.random.default_rng(2).uniform((0, 0), SIZE, (50, 2))
        K = BROWN.intrinsics.matrix - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        assert isinstance(BROWN.distortion, BrownConrady)
        d = BROWN.distortion
        ideal = pixels - 0.5 - displacement(BROWN, pixels)
        rays = np.column_stack([(ideal - K[:2, 2]) / np.diag(K)[:2], np.ones(len(ideal))])
        seen, _ = cv2.projectPoints(
            rays, np.zeros(3), np.zeros(3), K, np.array([d.k1, d.k2, d.p1, d.p2, d.k3])
        )
        np.testing.assert_allclose(seen[:, 0], pixels - 0.5, atol=1e-6)

    def test_of_unknown_distortion_moves_nothing(self) -> None:
        pixels = np.array([[0.0, 0.0], [2000.0, 1000.0]])
        np.testing.assert_allclose(displacement(calibration(None), pixels), 0.0, atol=1e-9)

    def test_is_monotonic_up_to_where_its_radial_polynomial_turns(self) -> None:
        # d/dr of r − 0.3 r³ is zero at r² = 1 / 0.9.
        lens = calibration(BrownConrady(k1=-0.3, k2=0.0, p1=0.0, p2=0.0, k3=0.0))
        limit = math.degrees(math.atan(math.sqrt(1 / 0.9)))
        assert f"not monotonic beyond {limit:.1f}°, inside the image" in radial_curve(lens).alt
        assert f"not monotonic beyond {limit:.1f}°" in words(radial_curve(lens))

    def test_that_is_not_monotonic_inside_the_image_is_reported(self) -> None:
        lens = calibration(BrownConrady(k1=-0.9, k2=0.0, p1=0.0, p2=0.0, k3=0.0))
        assert "inside the image: nothing is seen in at least one corner" in radial_curve(lens).alt

    def test_that_is_monotonic_everywhere_is_reported(self) -> None:
        lens = calibration(BrownConrady(k1=0.1, k2=0.0, p1=0.0, p2=0.0, k3=0.0))
        assert radial_curve(lens).alt.endswith("The model is monotonic everywhere.")

    def test_that_is_a_fisheye_is_held_against_an_equidistant_one(self) -> None:
        assert "from an equidistant lens" in radial_curve(FISHEYE).alt


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (0.31, "0.31"),
        (3657.02, "3657"),
        (-0.1234, "−0.123"),
        (1e-7, "1e−07"),
        (math.nan, "unknown"),
    ],
)
def test_a_number_has_three_digits(value: float, text: str) -> None:
    assert number(value) == text


def test_measurements_of_one_day_stand_side_by_side() -> None:
    measured = [Dated(day=DAY, value=value, std=1.0, role=Role.AGREES) for value in (100.0, 100.5)]
    svg = over_time(measured, (), axis=PX, caption="x").svg
    bars = re.findall(r'id="LineCollection_\d">\s*<path d="M ([\d.]+)', svg)
    assert len(set(bars)) == 2
