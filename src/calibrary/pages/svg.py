"""A drawing, made fit to stand inside a page.

Every element and attribute is one of those listed here or dropped, so a drawing can neither run a script nor
fetch anything. Styles become attributes, which a strict Content-Security-Policy lets pass, and the palette's
colours become classes, which follow the reader's theme. Names are renumbered because a page holds many drawings.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from calibrary.errors import InputError
from calibrary.pages.palette import Colour

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["inline_svg"]

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
PLAIN = re.compile(r"[-+\w\s.,#%()]*")
OWN_NAME = re.compile(r"url\(#([\w.:-]+)\)")
PICTURE = re.compile(r"data:image/png;base64,[A-Za-z0-9+/=\s]*")
LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}(?:e-?\d+)?")

CLASSES = {colour.light: colour.role for colour in Colour}
WIDE = 600
"""Drawings of this many units are as wide as the text; narrower ones stand two to a row."""


def inline_svg(svg: str, *, alt: str, prefix: str) -> str:
    """The drawing as an element of a page.

    Args:
        svg: an SVG document with a viewBox.
        alt: what it shows, in words.
        prefix: begins every name in it.

    Raises:
        InputError: it is no SVG.
    """
    from lxml import etree

    root = _parsed(svg)
    names = {name: f"{prefix}-{n}" for n, name in enumerate(sorted(set(_references(root))))}
    drawn = _copied(root, names)
    box = root.get("viewBox", "")
    sides = re.fullmatch(r"[-\d.]+ [-\d.]+ ([\d.]+) [\d.]+", box)
    if drawn is None or drawn.tag != "svg" or sides is None:
        raise InputError("a drawing is no SVG with a viewBox")
    drawn.attrib.clear()
    drawn.set("class", "plot wide" if float(sides[1]) >= WIDE else "plot normal")
    drawn.set("viewBox", box)
    drawn.set("stroke-linejoin", "round")
    drawn.set("role", "img")
    drawn.set("aria-labelledby", f"{prefix}-alt")
    description = etree.Element("desc", {"id": f"{prefix}-alt"})
    description.text = alt
    drawn.insert(0, description)
    return etree.tostring(drawn, encoding="unicode")


def _parsed(svg: str) -> _Element:
    from lxml import etree

    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        return etree.fromstring(svg.encode(), parser)
    except (etree.XMLSyntaxError, UnicodeEncodeError) as error:
        raise InputError(f"a drawing is no SVG: {error}") from None


def _references(root: _Element) -> Iterator[str]:
    for element in root.iter("*"):
        target = element.get(XLINK_HREF) or element.get("href") or ""
        if target.startswith("#"):
            yield target[1:]
        named = OWN_NAME.fullmatch(element.get("clip-path", ""))
        if named:
            yield named[1]


def _copied(element: _Element, names: dict[str, str]) -> _Element | None:
    """The element with all that may stay of it, None when it may not stay itself."""
    from lxml import etree

    tag = str(element.tag).removeprefix(SVG)
    if tag not in ELEMENTS:
        return None
    own = {str(name): str(value) for name, value in element.attrib.items()}
    copy = etree.Element(tag, {**_paint(own), **_geometry(own), **_links(own, names)})
    if tag in {"text", "tspan"}:
        copy.text, copy.tail = element.text, element.tail if tag == "tspan" else None
    for child in element:
        kept = _copied(child, names)
        if kept is None:
            continue
        if kept.tag == "g" and not kept.attrib:
            copy.extend(list(kept))
        elif len(kept) or kept.tag not in {"g", "defs"}:
            copy.append(kept)
    return copy


def _paint(own: dict[str, str]) -> dict[str, str]:
    """Colours and strokes as attributes; those of the palette as classes as well."""
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
        name: _shortened(value, decimals=4 if name == "transform" else 2)
        for name, value in own.items()
        if name in GEOMETRY and PLAIN.fullmatch(value) and not value.startswith("rotate(-0 ")
    }


def _links(own: dict[str, str], names: dict[str, str]) -> dict[str, str]:
    """Names within the drawing, and pictures that it carries itself."""
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
    """A hundredth of a unit is less than any screen shows."""
    text = LONG_NUMBER.sub(lambda number: f"{float(number[0]):.{decimals}f}".rstrip("0").rstrip("."), value)
    return " ".join(text.split())
