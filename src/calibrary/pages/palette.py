"""Colours of pages and plots, for a light and for a dark theme.

A plot is drawn in the light colours; the page's style sheet then adapts each colour to the reader's theme. On
both backgrounds text has a contrast of at least 4.5 and the marks of a plot at least 3 (WCAG 2.2, 1.4.3,
1.4.11).
"""

from __future__ import annotations

from enum import Enum


class Colour(Enum):
    """A role, and its (light, dark) colours."""

    INK = ("#1b1f24", "#e6e9ee")
    MUTED = ("#525a64", "#a3adb8")
    SURFACE = ("#ffffff", "#14171c")
    RAISED = ("#f4f6f8", "#1d2229")
    LINE = ("#cfd6dd", "#3a424c")
    ACCENT = ("#0b5cad", "#74b5ff")
    SECOND = ("#a84b00", "#f2a65e")
    GOOD = ("#17692f", "#62cf82")
    CAUTION = ("#805000", "#eebb4d")
    BAD = ("#b0241c", "#ff938a")

    @property
    def light(self) -> str:
        """#rrggbb in the light theme; plots are drawn in it."""
        return self.value[0]

    @property
    def dark(self) -> str:
        """#rrggbb in the dark theme."""
        return self.value[1]

    @property
    def role(self) -> str:
        """Its name in the style sheet."""
        return self.name.lower()


def style_rules() -> str:
    """CSS of the colours: custom properties, and the classes that apply them to the parts of a plot."""

    def properties(shade: str) -> str:
        return "".join(f"--{colour.role}:{getattr(colour, shade)};" for colour in Colour)

    classes = "".join(
        f".f-{c.role}{{fill:var(--{c.role})}}.s-{c.role}{{stroke:var(--{c.role})}}" for c in Colour
    )
    # Printing always uses the light theme.
    return (
        f":root{{color-scheme:light dark;{properties('light')}}}"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{properties('dark')}}}}}{classes}"
    )
