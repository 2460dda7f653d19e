"""Quantities over revisions, written directly as SVG: one panel each, bars of ± 1 σ, marked changes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import date, timedelta
from html import escape

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray
from calibrary.errors import InputError
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, as_values, name
from calibrary.view import Figure

INK, MUTED, LINE = Colour.INK.light, Colour.MUTED.light, Colour.LINE.light
ACCENT, SECOND = Colour.ACCENT.light, Colour.SECOND.light

WIDTH = 760.0
LEFT, RIGHT = 92.0, 24.0
TOP, PANEL, GAP = 44.0, 92.0, 30.0
LABEL_WIDTH = 88.0
"""Width of a label below the last panel, in SVG units."""

MARK_WIDTH = 150.0
MOST_REVISIONS = 400
DAYS_OF_MONTHS = 366 * 4
"""For a period longer than this many days, only years are labelled."""
MOST_FEW = 2
"""Fewest months, or years, in a period for these to be labelled."""
LARGEST = 1e12


class Series(Struct, frozen=True, kw_only=True):
    """One quantity over time.

    Attributes:
        axis: what it measures.
        values: (N,); NaN leaves a gap.
        std: (N,) standard deviations, NaN where unknown; None if none is known.
    """

    axis: Axis
    values: ArrayLike
    std: ArrayLike | None = None


def history(
    series: Sequence[Series],
    *,
    labels: Sequence[str],
    caption: str,
    marks: Sequence[tuple[int, str]] = (),
    days: Sequence[date] | None = None,
    spans: Sequence[tuple[date | None, date | None] | None] = (),
) -> Figure:
    """Several quantities over the same revisions, one panel each, with bars of ± 1 σ where known.

    Args:
        series: one per panel.
        labels: the N revisions, oldest first; if there are more than 400, the newest 400 are drawn.
        caption: what to look for.
        marks: (index, event before that revision), such as a change of firmware.
        days: dates of the revisions, oldest first, for a time axis; without them the revisions are evenly
            spaced.
        spans: first and last day on which each revision is valid, drawn as a bar; None within a span is an
            open end, None in place of a span means unknown.

    Raises:
        InputError: a series does not have N values.
    """
    columns = [
        (one.axis, _drawable(as_values(one.values, one.axis.quantity)), _drawable(_std(one, len(labels))))
        for one in series
    ]
    for axis, values, _ in columns:
        if len(values) != len(labels):
            raise InputError(f"{axis.quantity} has {len(values)} values over {len(labels)} revisions")
    start = max(0, len(labels) - MOST_REVISIONS)
    shown = labels[start:]
    scale = _Time.of([*days, *_ends(spans)]) if days is not None else None
    at = (
        np.array([scale.x(day) for day in (days or ())[start:]]) if scale is not None else _places(len(shown))
    )
    bars = [_bar(span, scale) for span in spans[start:]] if scale is not None else []
    marked = [(index - start, what) for index, what in marks if 0 <= index - start < len(shown)]
    parts: list[str] = []
    for n, (axis, values, std) in enumerate(columns):
        top = TOP + n * (PANEL + GAP)
        parts += _panel(axis.label, values[start:], std[start:], at, top, bars)
    foot = TOP + len(columns) * (PANEL + GAP) - GAP
    parts += _marks(marked, at, foot)
    parts += scale.labels(foot) if scale is not None else _labels(shown, at, foot)
    height = foot + 30
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {height:.0f}">{"".join(parts)}</svg>'
    described = "; ".join(_range(axis.quantity, axis.unit, values) for axis, values, _ in columns)
    alt = f"Timeline over {len(labels)} revisions, bars ± 1 σ where it is known: {described}."
    if days:
        alt += f" The axis is time, from {min(days)} to {max(days)}."
    if any(span is not None for span in spans):
        alt += " Shaded bars: the days that each is valid on."
    if marked:
        alt += f" Marked: {'; '.join(f'{name(what)} before {name(shown[i])}' for i, what in marked[:6])}."
    return Figure(svg=svg, alt=alt, caption=caption)


def _drawable(values: FloatArray) -> FloatArray:
    """The values, with NaN in place of those too large for an axis to separate from their neighbours."""
    return np.where(np.abs(values) < LARGEST, values, math.nan)


def _std(one: Series, count: int) -> FloatArray:
    std = np.full(count, math.nan) if one.std is None else as_values(one.std, f"σ of {one.axis.quantity}")
    if len(std) != count:
        raise InputError(f"σ of {one.axis.quantity} has {len(std)} values over {count} revisions")
    return std


def _places(count: int) -> FloatArray:
    if count == 1:
        return np.array([(LEFT + WIDTH - RIGHT) / 2])
    return np.linspace(LEFT + 22, WIDTH - RIGHT - 22, count)


def _ends(spans: Sequence[tuple[date | None, date | None] | None]) -> list[date]:
    return [day for span in spans if span is not None for day in span if day is not None]


def _bar(span: tuple[date | None, date | None] | None, scale: _Time) -> tuple[float, float] | None:
    if span is None:
        return None
    first, last = span
    return scale.x(first) if first is not None else LEFT, scale.x(last) if last is not None else WIDTH - RIGHT


class _Time(Struct, frozen=True):
    """A time axis.

    Attributes:
        first, last: the days at the ends of the axis.
    """

    first: date
    last: date

    @classmethod
    def of(cls, days: Sequence[date]) -> _Time:
        first, last = min(days), max(days)
        room = timedelta(days=max(2, (last - first).days // 20))
        return cls(max(first - min(room, first - date.min), date.min), last + min(room, date.max - last))

    def x(self, day: date) -> float:
        """Horizontal position of a day, in SVG units."""
        return LEFT + (WIDTH - RIGHT - LEFT) * ((day - self.first).days / (self.last - self.first).days)

    def labels(self, foot: float) -> Iterator[str]:
        """Labels at the first days of years or months, or at days, spaced so that they are readable."""
        for day, text in self._ticks():
            x = self.x(day)
            yield f'<path d="M{x:.1f} {foot:.1f}v5" fill="none" stroke="{MUTED}" stroke-width="1"/>'
            yield _text(x, foot + 18, text, anchor="middle", ink=INK)

    def _ticks(self) -> list[tuple[date, str]]:
        most = int((WIDTH - RIGHT - LEFT) / LABEL_WIDTH)
        months = (
            [
                date(year, month, 1)
                for year in range(self.first.year, self.last.year + 1)
                for month in range(1, 13)
                if self.first <= date(year, month, 1) <= self.last
            ]
            if (self.last - self.first).days < DAYS_OF_MONTHS
            else []
        )
        for step in (1, 2, 3, 6):
            some = [day for day in months if (day.month - 1) % step == 0]
            if len(months) >= MOST_FEW and len(some) <= most:
                return [(day, f"{day:%Y-%m}") for day in some]
        years = [*range(self.first.year + 1, self.last.year + 1)]
        for step in (1, 2, 5, 10, 20, 50, 100, 500, 1000, 5000):
            round_years = [year for year in years if year % step == 0]
            if len(years) >= MOST_FEW and len(round_years) <= most:
                return [(date(year, 1, 1), str(year)) for year in round_years]
        apart = max(1, math.ceil((self.last - self.first).days / most))
        every = range(self.first.toordinal() + apart // 2, self.last.toordinal() + 1, apart)
        return [(date.fromordinal(day), date.fromordinal(day).isoformat()) for day in every]


def _panel(
    label: str,
    values: FloatArray,
    std: FloatArray,
    at: FloatArray,
    top: float,
    valid: Sequence[tuple[float, float] | None] = (),
) -> Iterator[str]:
    spread = np.nan_to_num(std)
    finite = np.isfinite(values)
    low = float((values - spread)[finite].min()) if finite.any() else 0.0
    high = float((values + spread)[finite].max()) if finite.any() else 1.0
    middle, reach = (low + high) / 2, max((high - low) / 2, 1e-6 * abs(high), 1e-6) * 1.25
    low, high = middle - reach, middle + reach

    def y(value: float) -> float:
        return top + PANEL * (high - value) / (high - low)

    for tick, text in _ticks(low, high):
        yield (
            f'<path d="M{LEFT} {y(tick):.1f}H{WIDTH - RIGHT}" fill="none" stroke="{LINE}" stroke-width="0.8"/>'
        )
        yield _text(LEFT - 6, y(tick) + 4, text, anchor="end")
    yield _text(LEFT - 6, top - 10, label, anchor="end", ink=INK)
    for span, v in zip(valid, values.tolist(), strict=False):
        if span is not None and math.isfinite(v):
            yield (
                f'<path d="M{span[0]:.1f} {y(v):.1f}H{span[1]:.1f}" fill="none" stroke="{ACCENT}" stroke-width="9" '
                'stroke-opacity="0.22"/>'
            )
    for run in _runs(finite):
        line = "L".join(f"{at[i]:.1f} {y(values[i]):.1f}" for i in run)
        yield f'<path d="M{line}" fill="none" stroke="{ACCENT}" stroke-width="1.3"/>'
    bars = "".join(
        f"M{x:.1f} {y(v - s):.1f}V{y(v + s):.1f}M{x - 4:.1f} {y(v - s):.1f}h8M{x - 4:.1f} {y(v + s):.1f}h8"
        for x, v, s in zip(at.tolist(), values.tolist(), std.tolist(), strict=True)
        if math.isfinite(v) and math.isfinite(s)
    )
    if bars:
        yield f'<path d="{bars}" fill="none" stroke="{ACCENT}" stroke-width="1.3"/>'
    radius = 3.6 if len(at) < 60 else 2.0
    for x, v in zip(at.tolist(), values.tolist(), strict=True):
        if math.isfinite(v):
            yield f'<circle cx="{x:.1f}" cy="{y(v):.1f}" r="{radius}" fill="{ACCENT}"/>'


def _runs(finite: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Iterator[list[int]]:
    """Yield the indices of each run of consecutive finite values."""
    run: list[int] = []
    for i, known in enumerate(finite.tolist()):
        if known:
            run.append(i)
        elif run:
            yield run
            run = []
    if run:
        yield run


def _ticks(low: float, high: float) -> Iterator[tuple[float, str]]:
    """About three round numbers between the two."""
    power = 10.0 ** math.floor(math.log10((high - low) / 3))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= (high - low) / 4)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    for n in range(math.ceil(low / step), math.floor(high / step) + 1):
        yield n * step, f"{n * step:.{decimals}f}".replace("-", "−")


def _marks(marks: Sequence[tuple[int, str]], at: FloatArray, foot: float) -> Iterator[str]:
    free = -math.inf
    for index, what in marks:
        x = float((at[index - 1] + at[index]) / 2) if index > 0 else float(at[0]) - 18
        yield (
            f'<path d="M{x:.1f} {TOP - 22:.0f}V{foot:.1f}" fill="none" stroke="{SECOND}" stroke-width="1.2" '
            'stroke-dasharray="4 3"/>'
        )
        if x >= free:
            near_the_edge = x > WIDTH - MARK_WIDTH
            yield _text(
                x - 4 if near_the_edge else x + 4,
                TOP - 26,
                name(what)[:24],
                anchor="end" if near_the_edge else "start",
                ink=SECOND,
            )
            free = x + MARK_WIDTH


def _labels(labels: Sequence[str], at: FloatArray, foot: float) -> Iterator[str]:
    if not labels:
        return
    gap = (at[-1] - at[0]) / (len(at) - 1) if len(at) > 1 else WIDTH
    step = max(1, math.ceil(LABEL_WIDTH / max(gap, 1e-9)))
    # Counted from the newest revision, because that is the one readers look for.
    for i in range(len(labels) - 1, -1, -step):
        yield _text(float(at[i]), foot + 18, name(labels[i])[:14], anchor="middle", ink=INK)


def _text(x: float, y: float, text: str, *, anchor: str, ink: str = MUTED) -> str:
    where = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="11" fill="{ink}"'
    return f"<text {where}>{escape(text)}</text>"


def _range(quantity: str, unit: str, values: FloatArray) -> str:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return f"{quantity} unknown"
    first, last = float(finite[0]), float(finite[-1])
    if first == last and float(np.ptp(finite)) == 0:
        return f"{quantity} {first:.2f} {unit}".rstrip()
    return f"{quantity} {finite.min():.2f} to {finite.max():.2f} {unit}, {last:.2f} now".replace("-", "−")
