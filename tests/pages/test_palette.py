"""Colours: readable on light paper and on a dark screen, and the same ones in plots and style sheet."""

from __future__ import annotations

import pytest

from calibrary.pages.palette import Colour, style_rules

GROUNDS = (Colour.SURFACE, Colour.RAISED)
TEXT = [c for c in Colour if c not in {*GROUNDS, Colour.LINE}]


def luminance(colour: str) -> float:
    """Relative luminance as WCAG 2.2 defines it."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("shade", ["light", "dark"])
@pytest.mark.parametrize("colour", TEXT, ids=lambda colour: colour.role)
def test_text_in_every_colour_can_be_read_on_either_ground(colour: Colour, shade: str) -> None:
    for ground in GROUNDS:
        assert contrast(getattr(colour, shade), getattr(ground, shade)) >= 4.5


def test_no_two_roles_share_a_colour_by_which_plots_tell_them_apart() -> None:
    assert len({colour.light for colour in Colour}) == len(Colour)


def test_the_style_sheet_gives_each_role_both_its_colours() -> None:
    light, _, dark = style_rules().partition("prefers-color-scheme:dark")
    for colour in Colour:
        assert f"--{colour.role}:{colour.light};" in light
        assert f"--{colour.role}:{colour.dark};" in dark
        assert f".f-{colour.role}{{fill:var(--{colour.role})}}" in dark
