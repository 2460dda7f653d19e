"""Charts: bars, poses of a board, correlation matrices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrary.arrays import FloatArray
from calibrary.errors import InputError
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, as_points, as_values, draw, name, number
from calibrary.quality import Covariance
from calibrary.view import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

MOST_NAMES = 24
"""Most names that fit below an axis."""

MOST_NUMBERS = 12
"""Most rows of a matrix that leave room for a number in each cell."""


def bars(
    values: ArrayLike, *, labels: Sequence[str], axis: Axis, caption: str, limit: float | None = None
) -> Figure:
    """Bar chart, such as the residual of each view.

    Args:
        values: (N,); NaN leaves a gap.
        labels: N names, for the axis and for the bars above the limit.
        axis: what the bars measure.
        caption: what to look for.
        limit: draws a horizontal line; bars above it are highlighted.

    Raises:
        InputError: the numbers of labels and values differ.
    """
    heights = as_values(values, axis.quantity)
    if len(labels) != len(heights):
        raise InputError(f"{len(heights)} bars have {len(labels)} labels")
    over = heights > limit if limit is not None else np.zeros(len(heights), dtype=bool)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        at = np.arange(len(heights))
        axes.set_xlim(-0.6, len(heights) - 0.4)
        axes.set_ylim(0, 1.05 * float(np.nanmax(heights, initial=0.0)) or 1.0)
        for some, colour in ((~over, Colour.ACCENT), (over, Colour.BAD)):
            _bars(axes, at[some], np.nan_to_num(heights[some]), colour.light)
        _name_ticks(axes, labels)
        axes.set_ylabel(axis.label)
        axes.grid(axis="y")
        if limit is not None:
            axes.axhline(limit, color=Colour.INK.light, linewidth=1.4, linestyle=(0, (5, 3)))
            axes.annotate(
                f"limit {axis.of(limit)}",
                (1, limit),
                xycoords=("axes fraction", "data"),
                xytext=(0, 3),
                textcoords="offset points",
                ha="right",
            )
            axes.set_ylim(0, max(limit * 1.18, axes.get_ylim()[1]))

    alt = f"Bar chart of {axis.quantity} for {len(heights)} items{_range(heights, axis)}."
    if limit is not None:
        high = [name(label) for label, above in zip(labels, over, strict=True) if above]
        more = f" and {len(high) - 8} more" if len(high) > 8 else ""
        found = f"{len(high)} above it: {', '.join(high[:8])}{more}" if high else "none above it"
        alt += f" The limit is {axis.of(limit)}; {found}."
    return Figure(svg=draw(paint, width=760, height=300), alt=alt, caption=caption)


def poses(
    normals: ArrayLike, distances: ArrayLike, *, axis: Axis, caption: str, of: str = "the board"
) -> Figure:
    """Poses of a board: direction and amount of its tilt in each view, as seen from the camera.

    Args:
        normals: (N, 3) normals of the board in the camera frame (x right, y down, z forward), any length.
        distances: (N,) from the camera; nearer boards have larger marks.
        of: name of the tilted object.
        axis: quantity and unit of the distances, such as "distance" in "mm".
        caption: what to look for.

    Raises:
        InputError: ``normals`` and ``distances`` differ in length.
    """
    directions = as_points(normals, "normals", 3)
    away = as_values(distances, axis.quantity)
    if len(away) != len(directions):
        raise InputError(f"{len(directions)} boards have {len(away)} distances")
    length = np.linalg.norm(directions, axis=1)
    usable = np.isfinite(length) & (length > 0) & np.isfinite(away) & (away > 0)
    n, away = directions[usable] / length[usable, None], away[usable]
    n = np.where(n[:, 2:] < 0, -n, n)
    tilt = np.degrees(np.arccos(np.clip(n[:, 2], -1.0, 1.0)))
    towards = np.arctan2(n[:, 1], n[:, 0])
    reach = max(30.0, 10.0 * math.ceil(float(tilt.max(initial=0.0)) / 10.0 + 0.2))

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        axes.set_aspect("equal")
        circle = np.linspace(0.0, 2.0 * math.pi, 73)
        for ring in np.arange(10.0, reach + 1.0, 10.0):
            axes.plot(ring * np.cos(circle), ring * np.sin(circle), color=Colour.LINE.light, linewidth=0.9)
            axes.annotate(
                f"{ring:.0f}°", (0, -ring), ha="center", va="center", color=Colour.MUTED.light, size=10
            )
        axes.axhline(0, color=Colour.LINE.light, linewidth=0.9)
        axes.axvline(0, color=Colour.LINE.light, linewidth=0.9)
        area = 60.0 * np.clip(np.median(away) / away, 0.3, 4.0) if len(away) else []
        axes.scatter(
            tilt * np.cos(towards),
            tilt * np.sin(towards),
            s=area,
            facecolor=Colour.ACCENT.light,
            edgecolor=Colour.SURFACE.light,
            linewidth=0.8,
            zorder=3,
        )
        axes.set_xlim(-reach, reach)
        axes.set_ylim(reach, -reach)
        axes.set_xlabel("tilt to the right (°)")
        axes.set_ylabel("tilt downwards (°)")

    alt = f"Tilt of {of} in {len(tilt)} views{_range(tilt, Axis('tilt', '°'))}; {axis.quantity}"
    alt += f"{_range(away, axis)}. Larger marks are nearer."
    return Figure(svg=draw(paint, width=520, height=470), alt=alt, caption=caption)


def correlations(covariance: Covariance, *, caption: str) -> Figure:
    """Lower triangle of the correlation matrix of the parameters."""
    rho = covariance.correlation
    count = len(covariance.names)
    below = np.tril(np.ones((count, count), dtype=bool), -1) & np.isfinite(rho)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        shown = np.ma.masked_array(rho, ~below)
        axes.imshow(shown, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="none")
        names = [name(text) for text in covariance.names]
        axes.set_xticks(range(count), names)
        axes.set_yticks(range(count), names)
        axes.tick_params(length=0)
        axes.set_xlim(-0.5, max(0.5, count - 1.5))
        axes.set_ylim(max(0.5, count - 0.5), 0.5)
        axes.spines[:].set_visible(False)
        for row, column in np.argwhere(below) if count <= MOST_NUMBERS else ():
            value = float(rho[row, column])
            # Text on the map's colours, which are the same in every theme.
            ink = "#101010" if abs(value) < 0.6 else "#fefefe"
            text = f"{value:.2f}".replace("-0.", "−.").replace("0.", ".", 1)
            axes.text(column, row, text, ha="center", va="center", size=10, color=ink)

    pairs = sorted(((abs(rho[r, c]), r, c) for r, c in np.argwhere(below)), reverse=True)[:3]
    described = ", ".join(
        f"{covariance.names[c]} with {covariance.names[r]} {number(rho[r, c])}" for _, r, c in pairs
    )
    alt = f"Correlation matrix of {', '.join(covariance.names)}. Strongest: {described or 'none'}."
    return Figure(svg=draw(paint, width=520, height=440), alt=alt, caption=caption)


def _bars(axes: Axes, at: NDArray[np.intp], heights: FloatArray, colour: str) -> None:
    """All bars of one colour as one path."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    if not len(at):
        return
    left, right, foot = at - 0.39, at + 0.39, np.zeros(len(at))
    corners = ((left, foot), (left, heights), (right, heights), (right, foot), (left, foot))
    vertices = np.stack([np.column_stack(corner) for corner in corners], axis=1).reshape(-1, 2)
    codes = (Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY)
    axes.add_patch(PathPatch(Path(vertices, np.tile(codes, len(at))), facecolor=colour, linewidth=0))


def _name_ticks(axes: Axes, labels: Sequence[str]) -> None:
    """Label the ticks, as many as fit side by side; long labels are slanted."""
    step = max(1, math.ceil(len(labels) / MOST_NAMES))
    at = range(0, len(labels), step)
    names = [name(labels[i]) for i in at]
    crowded = sum(len(text) + 2 for text in names) > 90
    axes.set_xticks(list(at), names, rotation=35 if crowded else 0, ha="right" if crowded else "center")
    if crowded:
        for text in axes.get_xticklabels():
            text.set_rotation_mode("anchor")


def _range(values: FloatArray, axis: Axis) -> str:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return ""
    low, high = float(finite.min()), float(finite.max())
    if low == high:
        return f", {axis.of(low)}"
    # As many decimals as are needed to distinguish the two.
    decimals = min(6, max(0, 1 - math.floor(math.log10(high - low))))
    return f", {low:.{decimals}f} to {high:.{decimals}f} {axis.unit}".rstrip().replace("-", "−")
