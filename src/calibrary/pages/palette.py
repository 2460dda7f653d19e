"""The colours of every page and plot, each twice: on light paper, and on a dark screen.

A plot is drawn in the light ones; the page's style sheet then lets each of them follow the reader's theme. Text
colours keep a contrast of at least 4.5 on both grounds, and marks of a plot one of 3 (WCAG 2.2, 1.4.3, 1.4.11).
"""

from __future__ import annotations

from enum import Enum

__all__ = ["Colour", "style_rules"]


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
        """#rrggbb on light paper; the colour plots are drawn in."""
        return self.value[0]

    @property
    def dark(self) -> str:
        """#rrggbb on a dark screen."""
        return self.value[1]

    @property
    def role(self) -> str:
        """Its name in the style sheet."""
        return self.name.lower()


def style_rules() -> str:
    """The colours as custom properties, and the classes by which the parts of a plot take them."""

    def properties(shade: str) -> str:
        return "".join(f"--{colour.role}:{getattr(colour, shade)};" for colour in Colour)

    classes = "".join(
        f".f-{c.role}{{fill:var(--{c.role})}}.s-{c.role}{{stroke:var(--{c.role})}}" for c in Colour
    )
    # Paper is light, whatever the screen was.
    return (
        f":root{{color-scheme:light dark;{properties('light')}}}"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{properties('dark')}}}}}{classes}"
    )
