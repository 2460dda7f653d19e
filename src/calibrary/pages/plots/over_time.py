"""Plot of a quantity over time: measurements with ± 3 σ, and the expected values over their periods."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date, timedelta
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.pages import Figure
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
"""An error bar this many times longer than the shortest is cut off, so that the others stay readable."""


class Dated(Struct, frozen=True, kw_only=True):
    """A measurement with its date.

    Attributes:
        day: of the measurement.
        value: measured value.
        std: its standard deviation.
        role: how the measurement was used.
    """

    day: date
    value: float
    std: float
    role: Role


class Period(Struct, frozen=True, kw_only=True):
    """The expected value during a period.

    Attributes:
        first, last: first and last day; None for an open end.
        value: expected value.
        tolerance: largest allowed difference of a measurement from it.
        text: source of the expectation.
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
    """Plot measurements by date against the expected values.

    Args:
        measured: at least one measurement.
        expected: drawn as bars over their periods.
        axis: the quantity and its unit.
        caption: what to look for.
        marks: (day, event), such as a change of firmware.
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
    """Draw a dashed line with its label."""
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
    """Range of the vertical axis."""
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
