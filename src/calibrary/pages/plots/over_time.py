"""A quantity by date with what it is compared with: measurements with ± 3 σ, and expected values over their periods."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date, timedelta
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.pages.content import Figure
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, draw, name
from calibrary.pages.plots.intervals import Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["Dated", "Period", "over_time"]

SIGMAS = 3.0
TICKS = 5
WIDE_FROM = 5.0
"""A bar that is so many times longer than the others is cut off, so that they can be read."""


class Dated(Struct, frozen=True, kw_only=True):
    """A measurement.

    Attributes:
        day: of it.
        value: measured.
        std: its standard deviation.
        role: what became of it.
    """

    day: date
    value: float
    std: float
    role: Role


class Period(Struct, frozen=True, kw_only=True):
    """What was expected for some time.

    Attributes:
        first, last: days; None for an open end.
        value: expected.
        tolerance: how far a measurement may be from it.
        text: whose expectation it is.
    """

    first: date | None
    last: date | None
    value: float
    tolerance: float
    text: str


def over_time(
    measured: Sequence[Dated],
    expected: Sequence[Period],
    *,
    axis: Axis,
    caption: str,
    marks: Sequence[tuple[date, str]] = (),
) -> Figure:
    """Measurements by date against what was expected.

    Args:
        measured: at least one.
        expected: drawn as bars over their days.
        axis: what is measured.
        caption: what to look for.
        marks: (day, what happened), such as a change of firmware.
    """
    days = [one.day for one in measured]
    room = timedelta(days=max(3, (max(days) - min(days)).days // 12))
    left, right = min(days) - room, max(days) + room
    low, high = _range(measured, expected)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        for period in expected:
            ends = (max(period.first or left, left).toordinal(), min(period.last or right, right).toordinal())
            reach = (period.value - period.tolerance, period.value + period.tolerance)
            axes.fill_between(ends, *reach, color=Colour.LINE.light, alpha=0.6, linewidth=0)
            axes.plot(ends, [period.value] * 2, color=Colour.ACCENT.light, linewidth=1.6)
        for day, what in marks:
            _mark(axes, day, what, high)
        for one in measured:
            fmt, colour, _ = one.role.value
            x, bar = one.day.toordinal(), SIGMAS * one.std
            axes.errorbar(
                x, one.value, bar, fmt=fmt, color=colour.light, markersize=7, capsize=4, linewidth=1.5
            )
        axes.set_xlim(left.toordinal(), right.toordinal())
        axes.set_ylim(low, high)
        step = max(1, (right - left).days // TICKS)
        ticks = range(left.toordinal() + step // 2, right.toordinal(), step)
        axes.set_xticks(ticks, [date.fromordinal(tick).isoformat() for tick in ticks])
        axes.grid(axis="y")
        axes.set_ylabel(axis.label)

    alt = _described(measured, expected, axis, marks)
    return Figure(svg=draw(paint, width=520, height=260), alt=alt, caption=caption)


def _mark(axes: Axes, day: date, what: str, top: float) -> None:
    """A dashed line with its name."""
    colour = Colour.SECOND.light
    axes.axvline(day.toordinal(), color=colour, linewidth=1.2, linestyle=(0, (4, 3)))
    corner = (day.toordinal(), top)
    axes.annotate(
        name(what), corner, xytext=(3, -2), textcoords="offset points", color=colour, size=10, va="top"
    )


def _described(
    measured: Sequence[Dated], expected: Sequence[Period], axis: Axis, marks: Sequence[tuple[date, str]]
) -> str:
    """The figure in words."""
    described = "; ".join(
        f"{one.day} {one.value:.1f} ± {SIGMAS * one.std:.1f}, {one.role.value[2]}" for one in measured[:12]
    )
    alt = f"{axis.quantity} by date with ± 3 σ, {len(measured)} dates: {described}."
    held = "; ".join(f"{one.text} {one.value:.1f} {axis.unit}".strip() for one in expected[:6])
    alt += f" Expected: {held}." if held else ""
    happened = "; ".join(f"{what} on {day}" for day, what in marks[:6])
    return alt + (f" Marked: {happened}." if happened else "")


def _range(measured: Sequence[Dated], expected: Sequence[Period]) -> tuple[float, float]:
    """Of the vertical axis."""
    narrowest = min(one.std for one in measured)
    bars = [
        (one.value, SIGMAS * min(one.std, WIDE_FROM * max(narrowest, 1e-9)))
        for one in measured
        if math.isfinite(one.value)
    ]
    bars += [(one.value, one.tolerance) for one in expected]
    low, high = min(value - reach for value, reach in bars), max(value + reach for value, reach in bars)
    room = 0.08 * ((high - low) or abs(high) or 1.0)
    return low - room, high + room
