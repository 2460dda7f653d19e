"""Filling of the page template; the only module that imports Jinja2."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup, escape

from calibrary.pages import Frame
from calibrary.pages.svg import inline_svg
from calibrary.pages.wording import visible
from calibrary.view import Figure, Section, View

MOST_LINES = 1_000
LONGEST_ALT = 2_000
_WHOLE = re.compile(r"(?<![\w-])--\w[\w-]*|\b\d{4}-\d\d-\d\d\b")


def fill(
    page: View,
    *,
    security: str,
    style: str,
    script: str | None,
    frame: Frame | None = None,
    at: str = "",
) -> str:
    """The page as HTML.

    Args:
        page: the content.
        security: the Content-Security-Policy.
        style: calibrary's style sheet.
        script: calibrary's script, if any.
        frame: what a server puts around the page, if one does.
        at: the page's address there.

    Raises:
        InputError: a figure's drawing is not an SVG.
    """
    names = _Names()

    def drawing(figure: Figure) -> Markup:
        alt = visible(figure.alt, LONGEST_ALT)
        # inline_svg keeps only elements from a list of harmless ones.
        return Markup(inline_svg(figure.svg, alt=alt, prefix=names.next("plot")))  # noqa: S704

    return _template().render(
        page=page,
        anchors=names,
        drawing=drawing,
        frame=frame,
        here=frame.way_of(at) if frame is not None else None,
        security=security,
        style=Markup(style),  # noqa: S704  our own file
        script=Markup(script) if script is not None else None,  # noqa: S704  our own file
    )


class _Names:
    """Generator of ids and labels that are unique in a page."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._anchors: dict[int, str] = {}
        self._taken: set[str] = {"content"}

    def of(self, section: Section) -> str:
        """The section's anchor; the same on every call."""
        if id(section) not in self._anchors:
            wanted = "".join(c if c.isalnum() and c.isascii() else "-" for c in (section.anchor or ""))[:80]
            while not wanted or wanted in self._taken:
                wanted = self.next("section")
            self._taken.add(wanted)
            self._anchors[id(section)] = wanted
        return self._anchors[id(section)]

    def next(self, stem: str) -> str:
        """A new id: the stem with the next number."""
        self._counts[stem] = self._counts.get(stem, 0) + 1
        return f"{stem}-{self._counts[stem]}"

    def unique(self, label: str) -> str:
        """The label, with a number if the page already has it, because screen readers identify regions by label."""
        self._counts[label] = self._counts.get(label, 0) + 1
        return label if self._counts[label] == 1 else f"{label} ({self._counts[label]})"


@cache
def _template() -> Template:
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, finalize=_finalize, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["bounded"] = visible
    environment.filters["lines"] = _lines
    environment.filters["flags"] = _flags
    environment.filters["parts"] = _parts
    source = resources.files("calibrary.pages").joinpath("page.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source)


def _finalize(value: object) -> object:
    """Filter applied to every expression of the template before it is escaped."""
    return value if hasattr(value, "__html__") else visible(str(value))


def _flags(text: str) -> str:
    """Text in which no line ends within a flag of a command or a day: browsers break lines after their hyphens."""
    if _WHOLE.search(text) is None:
        return text
    return Markup(_WHOLE.sub(r'<span class="whole">\g<0></span>', str(escape(visible(text)))))  # noqa: S704  escaped here


def _parts(text: str) -> Markup:
    """Text whose lines end between the parts of a KEY rather than within one."""
    return Markup(re.sub(r"(?<=\w)(?=[+@])|(?<=\w/)", "<wbr>", str(escape(visible(text)))))  # noqa: S704  escaped here


def _lines(text: str) -> Markup:
    """Text with its line breaks kept."""
    lines = text.split("\n")
    shown = [_flags(visible(line.rstrip("\r"))) for line in lines[:MOST_LINES]]
    if len(lines) > MOST_LINES:
        shown.append(f"… {len(lines) - MOST_LINES} more lines")
    return Markup("\n").join(shown)
