"""Comparison of the values that several sources give for one quantity, and of its measurements over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date, timedelta
from enum import Enum
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, draw, name, number
from calibrary.view import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

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


SIGMAS = 3.0
TICKS = 5
BESIDE = 0.03
"""Distance of two measurements of one day, as a fraction of the plot's width."""
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
    # Those of one day side by side, or they would be drawn over one another.
    beside = BESIDE * (right - left).days
    alike = [[at for at, other in enumerate(days) if other == day] for day in days]
    places = [
        day.toordinal() + beside * (these.index(at) - (len(these) - 1) / 2)
        for at, (day, these) in enumerate(zip(days, alike, strict=True))
    ]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        for period in expected:
            ends = (max(period.first or left, left).toordinal(), min(period.last or right, right).toordinal())
            reach = (period.value - period.tolerance, period.value + period.tolerance)
            axes.fill_between(ends, *reach, color=Colour.LINE.light, alpha=0.6, linewidth=0)
            axes.plot(ends, [period.value] * 2, color=Colour.ACCENT.light, linewidth=1.6)
        for day, what in marks:
            _mark(axes, day, what, high)
        for x, one in zip(places, measured, strict=True):
            fmt, colour, _ = one.role.value
            axes.errorbar(
                x,
                one.value,
                SIGMAS * one.std,
                fmt=fmt,
                color=colour.light,
                markersize=7,
                capsize=4,
                linewidth=1.5,
            )
        axes.set_xlim(left.toordinal(), right.toordinal())
        axes.set_ylim(low, high)
        step = max(1, (right - left).days // TICKS)
        ticks = range(left.toordinal() + step // 2, right.toordinal(), step)
        axes.set_xticks(ticks, [date.fromordinal(tick).isoformat() for tick in ticks])
        axes.grid(axis="y")
        axes.set_ylabel(axis.label)

    alt = _described_over_time(measured, expected, axis, marks)
    return Figure(svg=draw(paint, width=520, height=260), alt=alt, caption=caption)


def _mark(axes: Axes, day: date, what: str, top: float) -> None:
    """Draw a dashed line with its label."""
    colour = Colour.SECOND.light
    axes.axvline(day.toordinal(), color=colour, linewidth=1.2, linestyle=(0, (4, 3)))
    corner = (day.toordinal(), top)
    axes.annotate(
        name(what), corner, xytext=(3, -2), textcoords="offset points", color=colour, size=10, va="top"
    )


def _described_over_time(
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
