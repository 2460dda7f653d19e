"""Maps over the image, written directly as SVG: they take a hundredth of matplotlib's time.

They can mark the part of the image in which the values are valid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from calibrary.arrays import FloatArray
from calibrary.calibration import ImageSize
from calibrary.errors import InputError
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, as_points, name, number, thinned
from calibrary.view import Figure

INK, MUTED, SURFACE = Colour.INK.light, Colour.MUTED.light, Colour.SURFACE.light
ACCENT, BAD = Colour.ACCENT.light, Colour.BAD.light

WIDTH = 520
LEFT, TOP = 46.0, 30.0
FRAME_WIDTH = 420.0
BELOW = 40.0
LONG_ARROW = 0.055
"""Length of the longest of the 95 % shortest arrows, as a fraction of the image's longer side; of many it is less."""
MOST_INK = 1.5

CUT = 2.5
"""Arrows are drawn up to this many times as long as the longest of the 95 % shortest."""

MOST_ARROWS = 500
LEAST = 1e-9
LARGEST = 1e15
"""Larger values are dropped: no plot of an image can show them."""

SHADES = 10
FAINTEST = 0.05


class _Frame(Struct, frozen=True, kw_only=True):
    """Position of the image in the drawing."""

    size: ImageSize
    scale: float

    @classmethod
    def of(cls, size: ImageSize) -> _Frame:
        return cls(size=size, scale=FRAME_WIDTH / max(size[0], size[1] / 1.2))

    @property
    def width(self) -> float:
        return self.size[0] * self.scale

    @property
    def height(self) -> float:
        return self.size[1] * self.scale

    def at(self, points: FloatArray) -> FloatArray:
        return np.asarray(points * self.scale + (LEFT, TOP))

    def axes(self) -> str:
        """The image border, and px along its sides."""
        right, foot = LEFT + self.width, TOP + self.height
        ticks = [
            _text(LEFT + x * self.scale, foot + 16, str(x), anchor="middle")
            for x in _round_steps(self.size[0])
        ]
        ticks += [
            _text(LEFT - 6, TOP + y * self.scale + 4, str(y), anchor="end")
            for y in _round_steps(self.size[1])
        ]
        unit = _text(right, foot + 32, "px of the image", anchor="end")
        edge = (
            f'<rect x="{LEFT}" y="{TOP}" width="{self.width:.1f}" height="{self.height:.1f}" fill="none" '
            f'stroke="{MUTED}" stroke-width="1"/>'
        )
        return edge + "".join(ticks) + unit

    def clipped(self, part: str) -> str:
        """The drawing clipped to the image."""
        box = f'x="{LEFT}" y="{TOP}" width="{self.width:.1f}" height="{self.height:.1f}"'
        return f'<clipPath id="frame"><rect {box}/></clipPath><g clip-path="url(#frame)">{part}</g>'

    def drawing(self, *parts: str) -> str:
        height = TOP + self.height + BELOW
        return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:.0f}">{"".join(parts)}</svg>'


def arrow_map(
    points: ArrayLike,
    vectors: ArrayLike,
    image_size: ImageSize,
    *,
    axis: Axis,
    caption: str,
    inside: ArrayLike | None = None,
) -> Figure:
    """Arrows over the image: residuals, or the difference between two calibrations.

    Args:
        points: (R, C, 2) px, start points of the arrows, rows from top to bottom; or (N, 2), anywhere.
        vectors: of the same shape, in ``axis.unit``; NaN for no arrow.
        image_size: (width, height) px.
        axis: what the arrows measure.
        caption: what to look for.
        inside: (R, C) True where the vectors are valid; elsewhere the image is grey and arrows do not set the
            scale.

    Raises:
        InputError: the shapes of the arrays do not match.
    """
    begin, given = (np.asarray(one, dtype=np.float64) for one in (points, vectors))
    if begin.shape != given.shape:
        raise InputError(
            f"{axis.quantity}: points of shape {begin.shape} have vectors of shape {given.shape}"
        )
    is_grid = begin.ndim == 3
    if is_grid:
        begin, given = _grid(begin, 2), _grid(given, 2)
    else:
        begin, given = as_points(begin, "points"), as_points(given, "vectors")
    valid = np.asarray((np.abs(np.concatenate([begin, given], axis=-1)) < LARGEST).all(axis=-1))
    counts = _inside(inside, valid)
    frame = _Frame.of(image_size)
    length = np.where(valid, np.hypot(given[..., 0], given[..., 1]), 0.0)
    usual = float(np.percentile(length[counts], 95)) if counts.any() else 0.0
    parts = [_shaded(begin, ~counts, frame)] if is_grid else []
    cut = length > CUT * usual
    if usual > LEAST:
        shown = np.ones(length.shape, dtype=np.bool_)
        if not is_grid:
            shown = np.isin(np.arange(len(length)), thinned(len(length), MOST_ARROWS))
        gain = min(LONG_ARROW, MOST_INK / math.sqrt(shown.sum())) * max(image_size) * frame.scale / usual
        shrink = (CUT * usual / np.maximum(length, CUT * usual))[..., None]
        drawn = np.where(valid[..., None], given, 0.0) * gain * shrink
        at = frame.at(begin)
        kinds = ((valid & ~counts, MUTED, 0.9), (counts & ~cut, ACCENT, 1.3), (counts & cut, BAD, 2.0))
        arrows = [
            _arrows(at[some & shown], drawn[some & shown], colour, width) for some, colour, width in kinds
        ]
        parts.append(frame.clipped("".join(arrows)))
        parts.append(_scale(usual, gain, frame, axis))
    alt = f"Arrows of {axis.quantity} over a {image_size[0]} × {image_size[1]} px frame"
    if counts.any():
        rms = float(np.sqrt(np.mean(length[counts] ** 2)))
        alt += f": root mean square {axis.of(rms)}, longest {axis.of(float(length[counts].max()))}"
    alt += f"; {_share(counts)}." if inside is not None else "."
    if cut.any():
        alt += f" {int(cut.sum())} longer ones are drawn cut, in red and thicker."
    if lost := int((~valid).sum()):
        alt += f" {lost} points have no value."
    return Figure(svg=frame.drawing(*parts, frame.axes()), alt=alt, caption=caption)


def cell_centres(shape: tuple[int, ...], image_size: ImageSize) -> FloatArray:
    """Centres (R, C, 2) px of equal cells that cover an image."""
    x, y = ((np.arange(shape[1 - at]) + 0.5) * image_size[at] / shape[1 - at] for at in (0, 1))
    return np.stack(np.meshgrid(x, y), axis=-1)


def amount_map(
    points: ArrayLike,
    values: ArrayLike,
    image_size: ImageSize,
    *,
    axis: Axis,
    caption: str,
    inside: ArrayLike | None = None,
) -> Figure:
    """Non-negative values over the image, such as uncertainty: darker is more, and some are written as numbers.

    Args:
        points: (R, C, 2) px, centres of the cells, rows from top to bottom.
        values: (R, C) in ``axis.unit``, not negative; NaN for an empty cell.
        image_size: (width, height) px.
        axis: what the values measure.
        caption: what to look for.
        inside: (R, C) True where the values are valid; elsewhere the image is grey.

    Raises:
        InputError: the shapes of the arrays do not match.
    """
    at, amounts = _grid(points, 2), np.asarray(values, dtype=np.float64)
    if at.shape[:2] != amounts.shape:
        raise InputError(f"{axis.quantity}: points of shape {at.shape} have values of shape {amounts.shape}")
    counts = _inside(inside, (amounts >= 0) & (amounts < LARGEST))
    frame = _Frame.of(image_size)
    high = float(amounts[counts].max(initial=0.0))
    share = np.where(counts, np.nan_to_num(amounts), 0.0) / (high or 1.0)
    shade = np.minimum((share * SHADES).astype(int), SHADES - 1)
    parts = [_shaded(at, ~counts, frame)]
    cells = _cells(at, frame)
    for step in range(SHADES):
        path = _marked(cells, counts & (shade == step))
        if path:
            parts.append(f'<path d="{path}" fill="{ACCENT}" fill-opacity="{_opacity(step):.2f}"/>')
    parts += _captions(at, amounts, counts, frame)
    parts.append(_key(high, axis))
    alt = f"Map of {axis.quantity} over a {image_size[0]} × {image_size[1]} px frame"
    if counts.any():
        centre = amounts[amounts.shape[0] // 2, amounts.shape[1] // 2]
        low = float(amounts[counts].min())
        alt += f", from {number(low)} to {axis.of(high)}"
        alt += f", {axis.of(float(centre))} in the middle" if math.isfinite(centre) else ""
        row, column = divmod(int(np.argmax(np.where(counts, np.nan_to_num(amounts), -1.0))), amounts.shape[1])
        alt += f", largest {_place(row, column, amounts.shape)}"
    alt += f"; {_share(counts)}." if inside is not None else "."
    return Figure(svg=frame.drawing(*parts, frame.axes()), alt=alt, caption=caption)


def _place(row: int, column: int, shape: tuple[int, ...]) -> str:
    """Position of a cell in words."""
    down = ("at the top", "in the middle", "at the bottom")[min(2, 3 * row // shape[0])]
    across = ("left", "centre", "right")[min(2, 3 * column // shape[1])]
    return f"{down} {across}"


def _grid(values: ArrayLike, depth: int) -> FloatArray:
    grid = np.asarray(values, dtype=np.float64)
    if grid.ndim != 3 or grid.shape[2] != depth or min(grid.shape[:2]) < 2:
        raise InputError(
            f"a map of shape {grid.shape}, expected (rows, columns, {depth}), two of each at least"
        )
    return grid


def _inside(inside: ArrayLike | None, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    given = valid if inside is None else np.asarray(inside, dtype=np.bool_)
    if given.shape != valid.shape:
        raise InputError(f"a region of shape {given.shape} for a map of shape {valid.shape}")
    return np.asarray(given & valid)


def _share(counts: NDArray[np.bool_]) -> str:
    return (
        "it counts all over the frame" if counts.all() else f"it counts in {counts.mean():.0%} of the frame"
    )


def _cells(at: FloatArray, frame: _Frame) -> list[list[str]]:
    """SVG path of the cell around each point, by row and column, clipped to the image."""
    xs, ys = frame.at(at)[0, :, 0], frame.at(at)[:, 0, 1]
    x = np.concatenate([[LEFT], (xs[1:] + xs[:-1]) / 2, [LEFT + frame.width]])
    y = np.concatenate([[TOP], (ys[1:] + ys[:-1]) / 2, [TOP + frame.height]])
    across = [
        (f"M{left:.1f} ", f"h{w:.1f}v", f"h{-w:.1f}z")
        for left, w in zip(x.tolist(), np.diff(x).tolist(), strict=False)
    ]
    down = [(f"{top:.1f}", f"{h:.1f}") for top, h in zip(y.tolist(), np.diff(y).tolist(), strict=False)]
    return [[f"{m}{top}{there}{h}{back}" for m, there, back in across] for top, h in down]


def _marked(cells: list[list[str]], where: NDArray[np.bool_]) -> str:
    """SVG path of the cells where ``where`` is True."""
    rows = zip(cells, where.tolist(), strict=True)
    return "".join(
        cell for row, wanted in rows for cell, is_wanted in zip(row, wanted, strict=True) if is_wanted
    )


def _shaded(at: FloatArray, where: NDArray[np.bool_], frame: _Frame) -> str:
    path = _marked(_cells(at, frame), where) if where.any() else ""
    return f'<path d="{path}" fill="{MUTED}" fill-opacity="0.22"/>' if path else ""


def _arrows(begin: FloatArray, drawn: FloatArray, colour: str, width: float) -> str:
    if not len(begin):
        return ""
    end, back = begin + drawn, -0.32 * drawn
    turn = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])
    rows = np.hstack([begin, end, end + back @ turn, end + back @ turn.T])
    path = "".join(
        f"M{x:.1f} {y:.1f}L{tip}M{a:.1f} {b:.1f}L{tip}L{c:.1f} {d:.1f}"
        for x, y, u, v, a, b, c, d in rows.tolist()
        for tip in (f"{u:.1f} {v:.1f}",)
    )
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def _scale(usual: float, gain: float, frame: _Frame, axis: Axis) -> str:
    """Scale arrow of a round length above the image, with the magnification of the arrows."""
    value = _round_below(usual)
    length = value * gain
    arrow = _arrows(np.array([[LEFT, TOP - 12]]), np.array([[length, 0.0]]), INK, 1.5)
    times = f", arrows drawn × {number(gain / frame.scale)}" if axis.unit == "px" else ""
    return arrow + _text(LEFT + length + 8, TOP - 8, f"{axis.of(value)}{times}", ink=INK)


def _captions(at: FloatArray, amounts: FloatArray, counts: NDArray[np.bool_], frame: _Frame) -> Iterator[str]:
    rows, columns = amounts.shape
    places = frame.at(at)
    # A thousandth of the largest value counts as zero.
    high = float(np.max(amounts[counts], initial=0.0))
    decimals = 2 - math.floor(math.log10(high)) if high > 0 else 2
    for row in sorted({rows // 8, rows // 2, rows - 1 - rows // 8}):
        for column in sorted({columns // 8, columns // 2, columns - 1 - columns // 8}):
            if counts[row, column]:
                x, y = places[row, column]
                text = number(round(float(amounts[row, column]), decimals))
                wide = 7.0 * len(text) + 6
                yield (
                    f'<rect x="{x - wide / 2:.1f}" y="{y - 9:.1f}" width="{wide:.1f}" height="17" fill="{SURFACE}"/>'
                    + _text(x, y + 4, text, anchor="middle", ink=INK)
                )


def _key(high: float, axis: Axis) -> str:
    """Colour key above the image."""
    wide = 14.0
    steps = [
        f'<rect x="{LEFT + 14 + step * wide:.1f}" y="{TOP - 20}" width="{wide}" height="12" fill="{ACCENT}" '
        f'fill-opacity="{_opacity(step):.2f}"/>'
        for step in range(SHADES)
    ]
    edge = f'<rect x="{LEFT + 14}" y="{TOP - 20}" width="{SHADES * wide}" height="12" fill="none" stroke="{MUTED}"/>'
    right = LEFT + 14 + SHADES * wide + 6
    return _text(LEFT, TOP - 10, "0") + "".join(steps) + edge + _text(right, TOP - 10, axis.of(high), ink=INK)


def _opacity(step: int) -> float:
    return FAINTEST + (1 - FAINTEST) * step / (SHADES - 1) * 0.85


def _text(x: float, y: float, text: str, *, anchor: str = "start", ink: str = MUTED, size: int = 11) -> str:
    where = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" fill="{ink}"'
    return f"<text {where}>{escape(name(text))}</text>"


def _round_steps(side: int) -> list[int]:
    """About four round numbers along a side, starting at 0."""
    step = max(1, int(_round_below(side / 3.0)))
    return list(range(0, side + 1, step))


def _round_below(value: float) -> float:
    """The largest of 1, 2, 5 × 10ⁿ that does not exceed the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max((step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)), default=power)
