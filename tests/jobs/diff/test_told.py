"""Comparisons as pages: the same verdict, reasons and numbers as everywhere else."""

from __future__ import annotations

import html
import re

import numpy as np

from calibrary.distortion import NoDistortion
from calibrary.jobs.diff.comparison import DiffReport, compare
from calibrary.jobs.diff.fleet import FleetDiffReport, entry_change
from calibrary.jobs.diff.told import told, told_fleet
from calibrary.pages import render_page
from calibrary.records import replace
from calibrary.view import Figure, Plots, Tone, View
from tests.jobs.diff.cameras import camera, changed
from tests.jobs.diff.test_comparison import measured, with_focal
from tests.pages.gallery import HOSTILE
from tests.registry.entries import FILE, an_entry


def page_of(comparison: DiffReport, altitude_m: float = 100.0) -> View:
    return told(comparison, altitude_m)


def text(page: View) -> str:
    body = render_page(page).partition("<body>")[2]
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def maps(page: View) -> list[Figure]:
    rows = [block for section in page.sections for block in section.blocks if isinstance(block, Plots)]
    return [plot for row in rows for plot in row.draw()]


def test_a_drift_is_shown_with_its_numbers() -> None:
    comparison = compare(
        measured(camera(), kappa2=2.0),
        measured(with_focal(0.001), kappa2=2.0),
        labels=("a.xml", "b.xml"),
        altitude_m=80.0,
    )
    page = page_of(comparison, altitude_m=80.0)
    printed = text(page)
    assert page.badge is not None
    assert (page.badge.text, page.badge.tone) == ("drift", Tone.BAD)
    for part in (
        "+0.100%",
        "+3.68",
        "80 m",
        "+8.0 cm",
        "× κ² = 2",
        "Which K to use",
        comparison.advice,
        "a.xml",
        "b.xml",
    ):
        assert part in printed
    for reason in comparison.reasons:
        assert reason[1:] in printed


def test_how_both_were_made_is_told_once_where_it_is_the_same() -> None:
    a, b = (
        replace(camera(), provenance=replace(FILE, date="2026-02-03", tool="lab 3.1", operator=name))
        for name in ("Ada", "Eve")
    )
    told = dict(page_of(compare(a, b)).facts)
    assert (told["program"], told["operator"]) == ("A and B: lab 3.1", "A: Ada; B: Eve")
    older = replace(a, provenance=replace(a.provenance, operator=None))
    assert dict(page_of(compare(a, older)).facts)["operator"] == "A: Ada"


def test_what_is_within_noise_is_good() -> None:
    page = page_of(compare(measured(camera()), measured(with_focal(1e-6))))
    assert page.badge is not None
    assert (page.badge.text, page.badge.tone) == ("within noise", Tone.GOOD)


def test_the_maps_show_the_difference_its_significance_and_its_uncertainty() -> None:
    comparison = compare(measured(camera()), measured(with_focal(0.001)))
    arrows, z, sigma = maps(page_of(comparison))
    numbers = comparison.detail
    assert numbers is not None
    assert numbers.difference.std_px is not None
    assert "Arrows of difference of the projections" in arrows.alt
    assert "σ" in z.alt
    inside = numbers.difference.region[::2, ::2]
    inside &= ~numbers.unknown[::2, ::2]
    worst = float(numbers.difference.std_px[::2, ::2][inside].max())
    assert f"to {worst:.3g}"[:6] in sigma.alt
    assert np.mean(inside) < 1
    assert "Grey: unknown, known to no better than the limit." in arrows.caption


def test_a_change_of_kind_is_named() -> None:
    comparison = compare(camera(), camera(distortion=NoDistortion()))
    page = page_of(comparison)
    printed = text(page)
    assert "structural: distortion lost" in printed
    assert f"Distortion lost: {comparison.structural[0].reason}" in printed
    assert "Which K to use: A" in printed
    assert all(section.badge is None for section in page.sections)


def test_frames_that_nothing_brings_together_have_no_numbers() -> None:
    portrait = replace(
        camera(), intrinsics=replace(camera().intrinsics, image_size=(3648, 5472), cx=1824, cy=2736)
    )
    page = page_of(compare(camera(), portrait))
    assert [section.title for section in page.sections] == [
        "Which K to use: each for its own images",
        "Where both are from",
    ]
    assert "turned" in text(page)


def test_a_k_alone_is_said_to_be_one() -> None:
    printed = text(page_of(compare(camera(), camera(distortion=None))))
    assert "B does not state the distortion: only K was compared." in printed


def test_hostile_labels_and_sources_are_text() -> None:
    one = camera()
    hostile = replace(
        one, provenance=replace(one.provenance, source=HOSTILE[0], operator=HOSTILE[2], tool=HOSTILE[3])
    )
    labels = (HOSTILE[0], HOSTILE[1])
    page = told(compare(hostile, changed(one, fx=3700.0), labels=labels), 100.0)
    raw = render_page(page)
    assert "<script" not in raw
    assert "<img" not in raw
    assert "\u202e" not in raw


def test_a_fleet_is_a_table_that_leads_to_each_comparison() -> None:
    before, after = an_entry(), an_entry(fx=3680.0)
    changes = (
        entry_change("dji/x", compare(before.calibration, after.calibration)),
        entry_change("dji/broken", None, reason="the frames were turned", alarm=True),
        entry_change("dji/new", None, reason="new"),
    )
    page = told_fleet(FleetDiffReport(changes=changes), "The fleet since v1", 100.0)
    raw, printed = render_page(page), text(page)
    assert set(re.findall(r'<a href="#(entry-\d)"', raw)) == set(re.findall(r'<h2 id="(entry-\d)"', raw))
    assert "2 need attention: 3 entries" in printed
    assert "The frames were turned." in printed
    assert page.badge is not None
    assert page.badge.tone is Tone.BAD


def test_a_fleet_in_which_nothing_changed_says_so() -> None:
    page = told_fleet(FleetDiffReport(changes=()), "The fleet since v1", 100.0)
    assert "no entry differs" in text(page)
    assert page.badge is not None
    assert page.badge.tone is Tone.GOOD
