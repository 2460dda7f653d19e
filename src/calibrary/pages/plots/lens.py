"""Plots of lens distortion: the displacement of each pixel, and the limit of the valid field of view."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration
from calibrary.pages import Figure
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import Axis, draw, number
from calibrary.pages.plots.frames import heat_map, vector_field

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["displacement", "distortion_map", "radial_curve"]

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
