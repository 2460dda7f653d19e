"""Comparison of the values that several sources give for one quantity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.pages import Figure
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, draw, name, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["Band", "Interval", "Role", "intervals"]

MOST_ROWS = 24


class Role(Enum):
    """How a source was used: (mark, colour, word); the shape of the mark alone identifies it."""

    CHOSEN = ("D", Colour.ACCENT, "used")
    AGREES = ("o", Colour.GOOD, "agrees")
    DIFFERS = ("^", Colour.CAUTION, "differs")
    DISAGREES = ("X", Colour.BAD, "disagrees")
    NO_K = ("s", Colour.MUTED, "no K")


class Interval(Struct, frozen=True, kw_only=True):
    """One source.

    Attributes:
        name: of the source.
        value: that the source gives.
        half_width: uncertainty of the value from its rounding or standard deviation, 0 if unknown.
        role: how the source was used.
    """

    name: str
    value: float
    half_width: float = 0.0
    role: Role


class Band(Struct, frozen=True):
    """An expected range.

    Attributes:
        low, high: its ends.
        text: source of the expectation.
    """

    low: float
    high: float
    text: str


def intervals(rows: Sequence[Interval], *, axis: Axis, caption: str, band: Band | None = None) -> Figure:
    """Plot each source on its own line, with its difference from the source that is used.

    Args:
        rows: best first; values that are not finite are omitted.
        axis: the quantity and its unit.
        caption: what to look for.
        band: expected range, drawn in the background.
    """
    shown = [row for row in rows if math.isfinite(row.value)][:MOST_ROWS]
    chosen = next((row for row in shown if row.role is Role.CHOSEN), None)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        if band is not None:
            axes.axvspan(band.low, band.high, color=Colour.LINE.light, alpha=0.6, linewidth=0)
        if chosen is not None:
            axes.axvline(chosen.value, color=Colour.ACCENT.light, linewidth=0.9, linestyle=(0, (3, 3)))
        low = min([row.value - row.half_width for row in shown] + ([band.low] if band else []), default=0.0)
        high = max([row.value + row.half_width for row in shown] + ([band.high] if band else []), default=1.0)
        room = 0.08 * ((high - low) or abs(high) or 1.0)
        axes.set_xlim(low - room, high + room)
        for at, row in enumerate(shown):
            mark, colour, _ = row.role.value
            axes.errorbar(
                row.value,
                at,
                xerr=row.half_width if row.half_width > 0 else None,
                fmt=mark,
                color=colour.light,
                markersize=8,
                capsize=4,
                linewidth=1.6,
            )
            described = f"{name(row.name)}: {_described(row, chosen, axis)}"
            axes.text(
                0.0,
                at - 0.3,
                described,
                transform=axes.get_yaxis_transform(),
                va="bottom",
                size=11,
                bbox={"facecolor": Colour.SURFACE.light, "edgecolor": "none", "pad": 1.5, "alpha": 0.8},
            )
        axes.set_ylim(len(shown) - 0.6, -0.9)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_xlabel(axis.label)

    described = "; ".join(f"{name(row.name)} {_described(row, chosen, axis)}" for row in shown)
    alt = f"{axis.quantity} by {len(shown)} sources: {described or 'none'}."
    if band is not None:
        alt += f" Expected by {band.text}: {number(band.low)} to {axis.of(band.high)}."
    return Figure(svg=draw(paint, width=520, height=70 + 52 * max(1, len(shown))), alt=alt, caption=caption)


def _described(row: Interval, chosen: Interval | None, axis: Axis) -> str:
    """Describe a source: its value, the difference from the chosen one and its role."""
    said = f"{row.value:.1f} {axis.unit}".strip() if abs(row.value) >= 100 else axis.of(row.value)
    if chosen is None or row is chosen or chosen.value == 0:
        return f"{said}, {row.role.value[2]}"
    apart = f"{row.value / chosen.value - 1.0:+.1%}".replace("-", "−").replace("%", " %")
    return f"{said}, {apart}, {row.role.value[2]}"
