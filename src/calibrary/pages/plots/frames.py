"""Plots of what a lens does to each pixel, and marks over an image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, draw, number
from calibrary.pages.plots.svg_plots import arrow_map, cell_centres
from calibrary.view import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas


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


def distortion_map(calibration: Calibration) -> Figure:
    """Map of the displacement by the lens, as arrows."""
    size = calibration.intrinsics.image_size
    columns, rows = GRID if size[0] >= size[1] else GRID[::-1]
    grid = cell_centres((rows, columns), size).reshape(-1, 2)
    return arrow_map(
        grid,
        displacement(calibration, grid),
        size,
        axis=Axis("displacement by the lens", "px"),
        caption="From where a pinhole would see a point to where this lens shows it.",
    )


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
