"""Conversion of an SVG drawing so that it can be embedded in a page.

Elements and attributes that are not listed here are removed, so a drawing can neither run a script nor load
anything. Styles become attributes, which a strict Content-Security-Policy permits, and the palette's colours
become classes, which follow the reader's theme. Ids get a prefix, because a page contains many drawings.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from html import escape
from typing import TYPE_CHECKING

from calibrary.errors import InputError
from calibrary.pages.palette import Colour

if TYPE_CHECKING:
    from lxml.etree import _Element

SVG = "{http://www.w3.org/2000/svg}"
XLINK_HREF = "{http://www.w3.org/1999/xlink}href"

ELEMENTS = frozenset(
    {"svg", "g", "defs", "use", "clipPath", "path", "rect", "circle", "line", "polyline", "polygon", "image"}
    | {"text", "tspan"}
)
GEOMETRY = frozenset(
    {"d", "x", "y", "x1", "y1", "x2", "y2", "cx", "cy", "r", "width", "height", "points", "transform"}
)
PAINT = frozenset(
    {"fill", "fill-opacity", "fill-rule", "stroke", "stroke-width", "stroke-opacity", "stroke-dasharray"}
    | {"stroke-dashoffset", "stroke-linecap", "stroke-linejoin", "opacity", "text-anchor"}
    | {"font-size", "font-weight", "font-style", "image-rendering"}
)
PLAIN = re.compile(r"[-+0-9A-Za-z_ \t\n\r.,#%()]*")
OWN_NAME = re.compile(r"url\(#([\w.:-]+)\)")
PICTURE = re.compile(r"data:image/png;base64,[A-Za-z0-9+/=\s]*")
MANY_DECIMALS = re.compile(r"\.\d{3}")
LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}(?:e-?\d+)?")

CLASSES = {colour.light: colour.role for colour in Colour}
LONGEST_REMEMBERED = 200
"""Attributes longer than this many characters are not cached: they are paths, which no two drawings share."""
LONG_PATH = 10_000
"""Characters from which a path is a cloud of small marks, of which a tenth of a unit is not visible."""

WIDE = 600
"""Drawings at least this wide (SVG units) fill the text's width; narrower ones are placed two to a row."""


def inline_svg(svg: str, *, alt: str, prefix: str) -> str:
    """Convert a drawing to an element of a page.

    Args:
        svg: an SVG document with a viewBox.
        alt: text alternative.
        prefix: prefix of every id in it.

    Raises:
        InputError: it is not an SVG.
    """
    root = _parsed(svg)
    names = {name: f"{prefix}-{n}" for n, name in enumerate(sorted(set(_references(root))))}
    box = str(root.get("viewBox", ""))
    sides = re.fullmatch(r"[-\d.]+ [-\d.]+ ([\d.]+) [\d.]+", box)
    if _tag(root) != "svg" or sides is None:
        raise InputError("a drawing is not an SVG with a viewBox")
    width = "wide" if float(sides[1]) >= WIDE else "normal"
    return (
        f'<svg class="plot {width}" viewBox="{box}" stroke-linejoin="round" role="img" '
        f'aria-labelledby="{prefix}-alt"><desc id="{prefix}-alt">{escape(alt, quote=False)}</desc>'
        f"{''.join(_rewritten(child, names) for child in root)}</svg>"
    )


def _parsed(svg: str) -> _Element:
    from lxml import etree

    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        return etree.fromstring(svg.encode(), parser)
    except (etree.XMLSyntaxError, UnicodeEncodeError) as error:
        raise InputError(f"a drawing is not an SVG: {error}") from None


def _references(root: _Element) -> Iterator[str]:
    for element in root.iter("*"):
        target = element.get(XLINK_HREF) or element.get("href") or ""
        if target.startswith("#"):
            yield target[1:]
        named = OWN_NAME.fullmatch(element.get("clip-path", ""))
        if named:
            yield named[1]


def _tag(element: _Element) -> str:
    return str(element.tag).removeprefix(SVG)


def _rewritten(element: _Element, names: dict[str, str]) -> str:
    """The element with its permitted content; "" if the element itself is not permitted."""
    tag = _tag(element)
    if tag not in ELEMENTS:
        return ""
    own = tuple((str(name), str(value)) for name, value in element.attrib.items())
    long = any(len(value) > LONGEST_REMEMBERED for _, value in own)
    attributes = (_attributes.__wrapped__ if long else _attributes)(own)
    if names or tag == "image":
        attributes += "".join(f' {name}="{value}"' for name, value in _links(dict(own), names).items())
    content = "".join([_rewritten(child, names) for child in element])
    if tag in {"text", "tspan"}:
        content = escape(element.text or "", quote=False) + content
    if tag == "g" and not attributes:
        return content
    if not content:
        return "" if tag in {"g", "defs"} else f"<{tag}{attributes}/>{_tail(element, tag)}"
    return f"<{tag}{attributes}>{content}</{tag}>{_tail(element, tag)}"


def _tail(element: _Element, tag: str) -> str:
    return escape(element.tail or "", quote=False) if tag == "tspan" else ""


@lru_cache(maxsize=4096)
def _attributes(own: tuple[tuple[str, str], ...]) -> str:
    """Attributes of paint and geometry; cached, because the axes and keys of most drawings are alike."""
    given = dict(own)
    kept = {**_paint(given), **_geometry(given)}
    return "".join(f' {name}="{escape(value)}"' for name, value in kept.items())


def _paint(own: dict[str, str]) -> dict[str, str]:
    """Colours and strokes as attributes; colours of the palette also as classes."""
    style = (part.partition(":") for part in own.get("style", "").split(";"))
    wanted = {name.strip(): value.strip() for name, _, value in style} | own
    paint = {
        name: value
        for name, value in wanted.items()
        if name in PAINT and PLAIN.fullmatch(value) and "url" not in value.lower()
    }
    roles = [(name[0], CLASSES.get(paint.get(name, "").lower())) for name in ("fill", "stroke")]
    classes = " ".join(f"{initial}-{role}" for initial, role in roles if role is not None)
    return {**paint, "class": classes} if classes else paint


def _geometry(own: dict[str, str]) -> dict[str, str]:
    return {
        name: _shortened(value, decimals=4 if name == "transform" else 1 if len(value) > LONG_PATH else 2)
        for name, value in own.items()
        if name in GEOMETRY and PLAIN.fullmatch(value) and not value.startswith("rotate(-0 ")
    }


def _links(own: dict[str, str], names: dict[str, str]) -> dict[str, str]:
    """References to ids within the drawing, and embedded pictures."""
    links: dict[str, str] = {}
    if own.get("id") in names:
        links["id"] = names[own["id"]]
    target = own.get(XLINK_HREF) or own.get("href") or ""
    if target.startswith("#") and target[1:] in names:
        links["href"] = f"#{names[target[1:]]}"
    elif PICTURE.fullmatch(target):
        links["href"] = "".join(target.split())
    clip = OWN_NAME.fullmatch(own.get("clip-path", ""))
    if clip:
        links["clip-path"] = f"url(#{names[clip[1]]})"
    return links


def _shortened(value: str, *, decimals: int) -> str:
    """Numbers rounded to ``decimals``; a hundredth of a unit is not visible on any screen."""
    if MANY_DECIMALS.search(value) is not None:
        value = LONG_NUMBER.sub(
            lambda number: f"{float(number[0]):.{decimals}f}".rstrip("0").rstrip("."), value
        )
    return " ".join(value.split())
