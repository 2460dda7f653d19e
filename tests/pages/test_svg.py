"""Drawings inside a page: nothing but shapes and words comes through."""

from __future__ import annotations

import pytest

from calibrary.errors import InputError
from calibrary.pages.svg import inline_svg

SVG = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


def inlined(content: str, *, box: str = "0 0 100 50") -> str:
    return inline_svg(f'<svg {SVG} viewBox="{box}">{content}</svg>', alt="A drawing.", prefix="plot-1")


@pytest.mark.parametrize(
    "content",
    [
        "<script>alert(1)</script>",
        '<rect onclick="alert(1)" width="1" height="1"/>',
        '<image xlink:href="https://example.org/x.png"/>',
        '<image href="data:image/svg+xml;base64,PHN2Zz4="/>',
        '<use xlink:href="https://example.org/x.svg#a"/>',
        '<a xlink:href="javascript:alert(1)"><text>x</text></a>',
        "<foreignObject><body/></foreignObject>",
        "<style>*{fill:url(https://example.org)}</style>",
        '<rect style="fill: url(https://example.org/#a)"/>',
        '<rect fill="url(https://example.org/#a)"/>',
        '<g clip-path="url(https://example.org/#a)"><rect/></g>',
        "<animate attributeName='href' to='javascript:alert(1)'/>",
        "<set attributeName='onload' to='alert(1)'/>",
    ],
)
def test_what_could_run_or_fetch_is_dropped(content: str) -> None:
    drawn = inlined(content + '<text x="1" y="2">kept</text>')
    assert "kept" in drawn
    for word in ("alert", "example.org", "javascript", "script", "onclick", "svg+xml", "foreign", "<style"):
        assert word not in drawn


def test_an_entity_is_not_expanded() -> None:
    declared = '<!DOCTYPE svg [<!ENTITY a "secret"><!ENTITY b SYSTEM "file:///etc/hostname">]>'
    drawn = inline_svg(
        f'{declared}<svg {SVG} viewBox="0 0 9 9">' + "<text>&a;&b;</text><text>kept</text></svg>",
        alt="x",
        prefix="p",
    )
    assert "secret" not in drawn
    assert "kept" in drawn


@pytest.mark.parametrize(
    "text", ["no drawing", "<svg/>", "<svg", "", "<html viewBox='0 0 1 1'/>", "<svg>\udcff</svg>"]
)
def test_what_is_no_drawing_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is not an SVG"):
        inline_svg(text, alt="x", prefix="p")


def test_styles_become_attributes_which_the_pages_policy_lets_pass() -> None:
    drawn = inlined('<path d="M 0 0 L 1 1" style="fill: none; stroke-width: 0.8; stroke: #123456"/>')
    assert 'fill="none" stroke-width="0.8" stroke="#123456"' in drawn
    assert "style" not in drawn


def test_the_palettes_colours_become_classes_and_other_colours_stay() -> None:
    drawn = inlined('<rect style="fill: #ffffff; stroke: #0b5cad"/><rect style="fill: #fefefe"/>')
    assert 'class="f-surface s-accent"' in drawn
    assert 'fill="#fefefe"/>' in drawn


def test_names_are_numbered_anew_and_only_where_they_are_used() -> None:
    content = '<defs><path id="m" d="M0 0"/><path id="unused" d="M0 0"/></defs><use xlink:href="#m" x="1"/>'
    drawn = inlined(content)
    assert 'id="plot-1-0"' in drawn
    assert 'href="#plot-1-0"' in drawn
    assert "unused" not in drawn


def test_numbers_are_as_long_as_a_screen_can_show() -> None:
    drawn = inlined('<path d="M 1.23456789 -0.00001234 L 10.5 2e-07"/>')
    assert 'd="M 1.23 0 L 10.5 2e-07"' in drawn.replace("-0 L", "0 L")


@pytest.mark.parametrize(("box", "kind"), [("0 0 520 300", "plot normal"), ("0 0 760 300", "plot wide")])
def test_its_width_decides_where_it_stands(box: str, kind: str) -> None:
    assert f'class="{kind}"' in inlined("", box=box)


def test_its_description_is_escaped() -> None:
    drawn = inline_svg(f'<svg {SVG} viewBox="0 0 9 9"/>', alt='a < b & "c"', prefix="p")
    assert '<desc id="p-alt">a &lt; b &amp; "c"</desc>' in drawn
