"""Plots over an image: vector fields, heat maps with contour lines, and what a lens does to each pixel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, as_points, draw, frame_axes, number, thinned
from calibrary.view import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

MOST_ARROWS = 500
FRAME_WIDTH = 520
LONG_ARROW = 0.07
"""Length of the longest of the 95 % shortest arrows, as a fraction of the image's longer side; reduced if there are
many arrows."""

SHORT = 0.008
"""Length from which an arrow has a head, as a fraction of the image's longer side: 4 units."""

CUT = 2.5
"""Arrows are drawn up to this many times as long as the longest of the 95 % shortest."""

STATIC_DARK, STATIC_LIGHT = "#101010", "#fefefe"
"""Colours of text on a map, which has the same colours in every theme."""


def vector_field(
    points: ArrayLike, vectors: ArrayLike, image_size: ImageSize, *, axis: Axis, caption: str
) -> Figure:
    """Arrows over the image: residuals, or the difference between two calibrations.

    Args:
        points: (N, 2) px, start points of the arrows.
        vectors: (N, 2), in ``axis.unit``; rows that are not finite are omitted and counted.
        image_size: (width, height) px.
        axis: what the arrows measure.
        caption: what to look for.

    Raises:
        InputError: ``points`` and ``vectors`` differ in length.
    """
    begin, arrows = as_points(points, "points"), as_points(vectors, "vectors")
    if len(begin) != len(arrows):
        raise InputError(f"{len(begin)} points have {len(arrows)} vectors")
    finite = np.isfinite(begin).all(axis=1) & np.isfinite(arrows).all(axis=1)
    lost = int((~finite).sum())
    begin, arrows = begin[finite], arrows[finite]
    length = np.hypot(*arrows.T)
    usual = float(np.percentile(length, 95)) if len(length) else 0.0
    cut = length > CUT * usual

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        frame_axes(axes, image_size)
        if usual <= 0:
            return
        shown = thinned(len(begin), MOST_ARROWS)
        gain = min(LONG_ARROW, 1.5 / math.sqrt(len(shown))) * max(image_size) / usual
        shrink = np.where(cut, CUT * usual / np.where(length > 0, length, 1.0), 1.0)
        drawn = arrows * (gain * shrink)[:, None]
        for some, colour, width in ((~cut, Colour.ACCENT, 1.1), (cut, Colour.BAD, 1.8)):
            these = shown[some[shown]]
            _arrows(axes, begin[these], drawn[these], colour.light, width, SHORT * max(image_size))
        _scale(axes, _round(usual), gain, image_size, axis)

    alt = f"Arrows of {axis.quantity} at {len(begin)} points of a {image_size[0]} × {image_size[1]} px frame"
    if len(length):
        longest = float(length.max()) or 1.0
        # Divided first, so that no square overflows.
        rms = longest * math.sqrt(float(np.mean((length / longest) ** 2)))
        alt += f"; root mean square {axis.of(rms)}, longest {axis.of(float(length.max()))}"
    alt += "."
    if cut.any():
        alt += f" {int(cut.sum())} longer ones are drawn cut, in red and thicker."
    if lost:
        alt += f" {lost} points have no value."
    return Figure(svg=draw(paint, width=FRAME_WIDTH, height=_height(image_size)), alt=alt, caption=caption)


def heat_map(
    values: ArrayLike,
    image_size: ImageSize,
    *,
    axis: Axis,
    caption: str,
    cells: bool = False,
) -> Figure:
    """Values over the image as colours with contour lines: uncertainty, a difference, coverage.

    Args:
        values: (rows, columns) of equal cells that cover the image, top row first; NaN for an empty cell.
        image_size: (width, height) px.
        axis: what the colours measure.
        caption: what to look for.
        cells: whether the values are counts: the cells are not smoothed and there are no contour lines.

    Raises:
        InputError: ``values`` is not two-dimensional or is empty.
    """
    grid = np.asarray(values, dtype=np.float64)
    if grid.ndim != 2 or not grid.size or max(grid.shape) > 1000:
        raise InputError(
            f"{axis.quantity} has shape {grid.shape}, expected (rows, columns), at most 1000 each"
        )
    grid = np.where(np.isfinite(grid), grid, math.nan)
    finite = grid[np.isfinite(grid)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    if cells or 0 <= low < 0.3 * high:
        low = 0.0
    high = high if high > low else low + 1.0

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        frame_axes(axes, image_size)
        axes.set_facecolor(Colour.RAISED.light)
        width, height = image_size
        extent = (0.0, float(width), float(height), 0.0)
        shown = np.ma.masked_invalid(grid)
        axes.imshow(shown, extent=extent, cmap="viridis", vmin=low, vmax=high, interpolation="none")
        if not cells and min(grid.shape) >= 2 and finite.size and float(np.ptp(finite)) > 0:
            _contours(axes, grid, image_size)
        _colour_bar(axes, low, high, axis)

    alt = f"Map of {axis.quantity} over a {image_size[0]} × {image_size[1]} px frame"
    if finite.size:
        alt += f", from {number(float(finite.min()))} to {axis.of(float(finite.max()))}"
        row, column = np.unravel_index(int(np.nanargmax(grid)), grid.shape)
        alt += f", largest {_place(int(row), int(column), (grid.shape[0], grid.shape[1]))}"
    empty = grid.size - finite.size
    alt += f"; {empty} of {grid.size} cells have no value." if empty else "."
    svg = draw(paint, width=FRAME_WIDTH, height=_height(image_size), smooth=not cells)
    return Figure(svg=svg, alt=alt, caption=caption)


def _contours(axes: Axes, grid: FloatArray, image_size: ImageSize) -> None:
    from matplotlib.ticker import MaxNLocator

    (rows, columns), (width, height) = grid.shape, image_size
    x, y = (np.arange(columns) + 0.5) * width / columns, (np.arange(rows) + 0.5) * height / rows
    low, high = float(np.nanmin(grid)), float(np.nanmax(grid))
    wanted = MaxNLocator(5).tick_values(low, high)
    inside = [float(level) for level in wanted if low < level < high]
    if not inside:
        return
    masked = np.ma.masked_invalid(grid)
    axes.contour(x, y, masked, levels=inside, colors=STATIC_DARK, linewidths=2.6)
    lines = axes.contour(x, y, masked, levels=inside, colors=STATIC_LIGHT, linewidths=1.1)
    labels = axes.clabel(lines, fmt=number, inline=True, fontsize=10, colors=Colour.INK.light)
    for label in labels or ():
        label.set_bbox({"facecolor": Colour.SURFACE.light, "edgecolor": "none", "pad": 1.2})


def _colour_bar(axes: Axes, low: float, high: float, axis: Axis) -> None:
    bar = axes.inset_axes((1.03, 0.0, 0.045, 1.0))
    ramp = np.linspace(low, high, 128)[:, None]
    bar.imshow(
        ramp,
        extent=(0.0, 1.0, low, high),
        origin="lower",
        aspect="auto",
        cmap="viridis",
        interpolation="none",
    )
    bar.yaxis.tick_right()
    bar.yaxis.set_label_position("right")
    bar.set_xticks([])
    bar.set_ylabel(axis.label)


def _arrows(
    axes: Axes, begin: FloatArray, drawn: FloatArray, colour: str, width: float, least: float
) -> None:
    """Draw arrows; of those shorter than ``least`` nobody would see the head."""
    end, back = begin + drawn, -0.3 * drawn
    turn = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])
    parts = (begin, end, end + back @ turn, end, end + back @ turn.T)
    short = np.hypot(*drawn.T) < least
    _stroke(axes, [part[~short] for part in parts], "MLMLL", color=colour, linewidth=width)
    _stroke(axes, [part[short] for part in parts[:2]], "ML", color=colour, linewidth=width)


def dots(
    axes: Axes, points: FloatArray, colour: str, width: float, ends: str = "round", alpha: float = 1.0
) -> None:
    """Draw a mark at each point (N, 2): the two ends of a line without a length."""
    _stroke(axes, (points, points), "ML", color=colour, linewidth=width, capstyle=ends, alpha=alpha)


def _stroke(axes: Axes, parts: Sequence[FloatArray], commands: str, **how: Any) -> None:
    """Draw lines through the n-th points of the parts as one path, a tenth of the size of as many drawings.

    Args:
        axes: to draw on.
        parts: (N, 2) each.
        commands: for each part M, where a line begins, or L, where it goes on.
        how: width, colour and ends of the lines.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    if not len(parts[0]):
        return
    codes = [Path.MOVETO if command == "M" else Path.LINETO for command in commands]
    path = Path(np.stack(parts, axis=1).reshape(-1, 2), np.tile(codes, len(parts[0])))
    # Matplotlib leaves out lines without a length.
    path.should_simplify = False
    axes.add_patch(PathPatch(path, fill=False, **how))


def _scale(axes: Axes, value: float, gain: float, image_size: ImageSize, axis: Axis) -> None:
    """Draw a scale arrow of a round length above the image, with the magnification of the arrows."""
    length = value * gain / image_size[0]
    axes.annotate(
        "",
        (length, 1.035),
        (0.0, 1.035),
        xycoords="axes fraction",
        textcoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "color": Colour.INK.light, "shrinkA": 0, "shrinkB": 0},
    )
    times = f", arrows drawn × {number(gain)}" if axis.unit == "px" else ""
    axes.text(length + 0.02, 1.035, f"{axis.of(value)}{times}", transform=axes.transAxes, va="center")


def _round(value: float) -> float:
    """The largest of 1, 2, 5 × 10ⁿ that does not exceed the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9))


def _height(image_size: ImageSize) -> int:
    """Height of the plot for the image's aspect ratio and the axes, in SVG units."""
    shape = min(1.3, max(0.35, image_size[1] / image_size[0]))
    return round(400 * shape) + 75


def _place(row: int, column: int, shape: tuple[int, int]) -> str:
    """Position of a cell in words."""
    down = ("at the top", "in the middle", "at the bottom")[min(2, 3 * row // shape[0])]
    across = ("left", "centre", "right")[min(2, 3 * column // shape[1])]
    return f"{down} {across}"


GRID = (17, 13)
PERSPECTIVE_LIMIT = math.radians(70.0)
"""Angle from the axis (rad) beyond which a lens is compared with an equidistant one: tan grows too fast there."""

NEARLY_SIDEWAYS = math.cos(math.radians(80.0))
DIRECTIONS = 24


def displacement(calibration: Calibration, pixels: FloatArray) -> FloatArray:
    """Displacement by the lens (N, 2) in px: ``pixels`` minus the undistorted (pinhole) positions of the same rays.

    NaN where the model has no ray, and beyond 80 degrees from the axis, where the pinhole position tends to
    infinity.
    """
    rays = calibration.unproject(pixels)
    K = calibration.intrinsics
    with np.errstate(all="ignore"):
        x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    ideal = np.column_stack([K.fx * x + K.skew * y + K.cx, K.fy * y + K.cy])
    ideal[~(rays[:, 2] > NEARLY_SIDEWAYS)] = math.nan
    return pixels - ideal


def distortion_map(calibration: Calibration, *, caption: str | None = None) -> tuple[Figure, Figure]:
    """Maps of the displacement by the lens: as arrows, and its magnitude in px."""
    size = calibration.intrinsics.image_size
    columns, rows = GRID if size[0] >= size[1] else GRID[::-1]
    grid = _grid(size, columns, rows)
    quantity = "displacement by the lens"
    arrows = vector_field(
        grid,
        displacement(calibration, grid),
        size,
        axis=Axis(quantity, "px"),
        caption=caption or "From where a pinhole would see a point to where this lens shows it.",
    )
    fine = np.hypot(*displacement(calibration, _grid(size, 60, 45)).T).reshape(45, 60)
    amounts = heat_map(
        fine, size, axis=Axis(quantity, "px"), caption="How far the lens moves each part of the image."
    )
    return arrows, amounts


def radial_curve(calibration: Calibration, *, caption: str | None = None) -> Figure:
    """Radial displacement over the angle from the axis, up to the image corner and the monotonicity limit.

    If the image reaches beyond 70 degrees, the reference is an equidistant lens instead of a pinhole.
    """
    corner, monotonic_to = _angles(calibration)
    edge = monotonic_to if corner is None else corner
    wide = edge > PERSPECTIVE_LIMIT
    limit = math.radians(179.0) if wide else math.radians(85.0)
    reach = min(limit, max(edge, min(monotonic_to, 1.25 * edge)))
    angles = np.linspace(0.0, reach, 121)
    low, mean, high = _departure(calibration, angles, wide=wide)
    reference = "an equidistant lens" if wide else "a pinhole"
    in_view = angles <= edge
    largest = (
        mean[in_view][int(np.nanargmax(np.abs(mean[in_view])))]
        if np.isfinite(mean[in_view]).any()
        else math.nan
    )

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        degrees = np.degrees(angles)
        axes.fill_between(degrees, low, high, color=Colour.ACCENT.light, alpha=0.25, linewidth=0)
        axes.plot(degrees, mean, color=Colour.ACCENT.light, linewidth=1.8)
        axes.axhline(0, color=Colour.MUTED.light, linewidth=0.8)
        axes.grid()
        axes.set_xlabel("angle from the optical axis (°)")
        axes.set_ylabel(f"displacement from {reference} (px)")
        if corner is not None:
            _mark(axes, math.degrees(corner), "corner", Colour.INK, before=True)
        if monotonic_to <= reach:
            _mark(axes, math.degrees(monotonic_to), "not monotonic beyond", Colour.BAD, before=False)
        axes.set_xlim(0, math.degrees(reach) * 1.06)

    validity = f"The model is not monotonic beyond {math.degrees(monotonic_to):.1f}°"
    if corner is None:
        validity += ", inside the image: nothing is seen in at least one corner."
    elif monotonic_to < limit:
        validity += ", outside the image."
    else:
        validity = "The model is monotonic everywhere."
    alt = f"Radial displacement from {reference} over the angle from the axis: {number(largest)} px at most in view"
    alt += (
        f", the corner at {math.degrees(corner):.1f}°. {validity}" if corner is not None else f". {validity}"
    )
    described = caption or f"Outwards is positive. {validity}"
    return Figure(svg=draw(paint, width=520, height=340), alt=alt, caption=described)


def _grid(size: tuple[int, int], columns: int, rows: int) -> FloatArray:
    """Centres of equal cells, row by row: (columns · rows, 2) px."""
    x = (np.arange(columns) + 0.5) * size[0] / columns
    y = (np.arange(rows) + 0.5) * size[1] / rows
    return np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])


def _angles(calibration: Calibration) -> tuple[float | None, float]:
    """Angles from the axis of the farthest corner and of the limit up to which the model is monotonic, in rad.

    The first is None if a corner has no ray, that is, lies beyond the second.
    """
    width, height = calibration.intrinsics.image_size
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
    monotonic_to = (
        calibration.distortion.max_angle_rad() if calibration.distortion is not None else math.pi / 2
    )
    depth = float(calibration.unproject(corners)[:, 2].min())
    return (math.acos(max(-1.0, min(1.0, depth))) if math.isfinite(depth) else None), monotonic_to


def _departure(
    calibration: Calibration, angles: FloatArray, *, wide: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Image radius minus the reference's in px: least, mean and largest over all directions."""
    K = calibration.intrinsics
    around = np.linspace(0.0, 2.0 * math.pi, DIRECTIONS, endpoint=False)
    theta, phi = (axis.ravel() for axis in np.meshgrid(angles, around, indexing="ij"))
    rays = np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    seen = calibration.project(rays) - (K.cx, K.cy)
    radius = theta if wide else np.tan(theta)
    reference = np.column_stack([K.fx * radius * np.cos(phi), K.fy * radius * np.sin(phi)])
    outwards = np.column_stack([np.cos(phi), np.sin(phi)])
    along = ((seen - reference) * outwards).sum(axis=1).reshape(len(angles), DIRECTIONS)
    return along.min(axis=1), along.mean(axis=1), along.max(axis=1)


def _mark(axes: Axes, at: float, text: str, colour: Colour, *, before: bool) -> None:
    dashes = (2, 2) if before else (6, 3)
    axes.axvline(at, color=colour.light, linewidth=1.3, linestyle=(0, dashes))
    axes.annotate(
        f"{text} {at:.1f}°",
        (at, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(-3 if before else 3, -3),
        textcoords="offset points",
        ha="right" if before else "left",
        va="top",
        color=colour.light,
        rotation=90,
        size=10,
    )
