"""Plots of a calibration's page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detection import Detections
from calibrary.calib.detectors.refinement import reduced
from calibrary.calib.frames import read_frame
from calibrary.calib.geometry import CELLS, inside_circle, near_corners
from calibrary.calib.observations import Observations, View
from calibrary.calib.projection_difference import pixel_grid
from calibrary.calib.result import ViewResult, Warp
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError
from calibrary.jobs.calibrate.report import CalibrateReport
from calibrary.jobs.calibrate.rig_report import RigReport
from calibrary.pages.palette import Colour
from calibrary.pages.plots import (
    Axis,
    bars,
    distortion_map,
    poses,
    radial_curve,
)
from calibrary.pages.plots.canvas import draw, frame_axes, number
from calibrary.pages.plots.frames import dots
from calibrary.pages.plots.svg_plots import amount_map, arrow_map, cell_centres
from calibrary.probability import two_digits, whole_percent
from calibrary.sfm.tracks import upward
from calibrary.view import Block, Figure, SideBySide

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas


MEAN_CELLS: Final = (16, 12)
"""Columns and rows of the cells in which residuals are averaged."""
FEWEST: Final = 3
"""Fewest residuals in a cell for a mean."""
MOST_DRAWN: Final = 1000
"""Most points of a plot of all of them."""
MOST_BARS: Final = 120


def fit_plots(views: Sequence[ViewResult], observations: Observations, points: str) -> Iterator[Figure]:
    """Reprojection error of each view, and the directions of the residuals; ``points`` is the word for what is seen."""
    shown = [view for view in views if view.rms_px is not None and view.without is None]
    shown = sorted(shown, key=lambda view: -(view.rms_px or 0.0))[:MOST_BARS]
    names = {id(view) for view in shown}
    ordered = [view for view in views if id(view) in names]
    yield bars(
        [view.rms_px or 0.0 for view in ordered],
        labels=[view.name for view in ordered],
        axis=Axis("reprojection error (RMS)", "px"),
        caption=f"How far {points} are from where the model puts them. What stands far above the others was "
        + (
            "blurred, or shows what moves."
            if points != "corners"
            else "moved or blurred, or has a point that is not a corner."
        ),
    )
    pixels, residuals = _residuals(views, observations)
    size, axis = observations.image_size, Axis("residual", "px")
    yield arrow_map(
        pixels,
        residuals,
        size,
        axis=axis,
        caption=f"Residuals of all {points}. Where nothing is wrong their directions are random.",
    )
    middles, means = _averaged(pixels, residuals, size)
    yield arrow_map(
        middles,
        means,
        size,
        axis=Axis("mean residual", "px"),
        caption="Their means by cell: a pattern here is something that the lens model"
        + (", or the flat board, does not explain." if points == "corners" else " does not explain."),
    )


def board_plots(report: CalibrateReport, observations: Observations) -> Iterator[Block]:
    """Coverage, poses, and the board's warp if it was solved for."""
    covered = _covered(report.views, observations, report.points)
    posed = _posed([view for view in report.views if view.without is None])
    normals = np.array([turn[:, 2] for turn, _ in posed])
    away, unit = _distances(posed, report.length_unit)
    held = poses(
        normals,
        away,
        axis=Axis("distance", unit),
        caption="To which side the board was tilted, as seen from the camera; larger marks are nearer. "
        "All around and out to 30° is best.",
    )
    yield SideBySide((covered, held))
    if report.warp is not None and report.board is not None and report.warp.kept:
        yield _board_warp(report.board, report.warp)


def flight_plots(views: Sequence[ViewResult], observations: Observations) -> Iterator[Block]:
    """Coverage, and the viewing directions of the images."""
    posed = _posed(views)
    middle = observations.board.points.mean(axis=0)
    centres = np.array([middle - turn.T @ place for turn, place in posed])
    # "Up" is the normal of the ground plane, as in the figures of the flight: the world frame may be tilted.
    up = upward(observations.board.points, centres)
    ups = np.array([turn @ up for turn, _ in posed])
    away, unit = _distances(posed, observations.board.unit)
    looked = poses(
        ups,
        away,
        axis=Axis("distance to the middle of the points", unit),
        caption="From which side the ground was seen; larger marks are nearer. Marks at different distances, and some "
        "out to 30°, tell the focal length from the height.",
        of="the ground",
    )
    yield SideBySide((_covered(views, observations, "points"), looked))


def _posed(views: Sequence[ViewResult]) -> list[tuple[FloatArray, FloatArray]]:
    """Rotation and translation of the views that have a pose."""
    return [
        (np.array(view.rotation, dtype=np.float64), np.array(view.translation, dtype=np.float64))
        for view in views
        if view.rotation is not None
    ]


def _distances(posed: Sequence[tuple[FloatArray, FloatArray]], unit: str) -> tuple[FloatArray, str]:
    """Distances (N,) from the camera to the observed points, and their unit."""
    away = np.array([float(np.linalg.norm(place)) for _, place in posed])
    return (away / 1000, "m") if unit == "mm" else (away, unit)


def _covered(views: Sequence[ViewResult], observations: Observations, points: str) -> Figure:
    """Coverage of the image by observed points."""
    size = observations.image_size
    pixels, _ = _residuals(views, observations)
    columns, rows = CELLS
    counts, _, _ = np.histogram2d(
        pixels[:, 1], pixels[:, 0], bins=(rows, columns), range=((0, size[1]), (0, size[0]))
    )
    return amount_map(
        cell_centres(counts.shape, size),
        np.where(counts > 0, counts, np.nan),
        size,
        axis=Axis(points),
        caption=f"Where {points} were seen. In an empty cell the distortion is extrapolated.",
    )


def trust_plots(report: CalibrateReport, observations: Observations) -> Iterator[Block]:
    """Where K is proven, uncertainty of a direction, and the difference between halves of the views."""
    size = report.calibration.intrinsics.image_size
    plots: list[Block] = []
    if (proven := _proven(report, observations)) is not None:
        plots.append(proven)
    if report.uncertainty_px is not None:
        std = np.array(report.uncertainty_px, dtype=np.float64)
        cells = _between_nodes(std)
        plots.append(
            amount_map(
                cell_centres(cells.shape, size),
                cells,
                size,
                axis=Axis("σ of a direction", "px"),
                caption="1 σ of the pixel in which a far point is seen, the variance factor included: "
                f"{two_digits(float(np.nanmin(std)))} px at best, {two_digits(float(np.nanmax(std)))} px at the edge.",
            )
        )
    if report.half_difference_px is not None:
        vectors = np.array(report.half_difference_px, dtype=np.float64)
        rows, columns, _ = vectors.shape
        lengths = np.linalg.norm(vectors, axis=-1)
        lengths = lengths[np.isfinite(lengths)]
        plots.append(
            arrow_map(
                pixel_grid(size, (columns, rows)).reshape(-1, 2),
                vectors.reshape(-1, 2),
                size,
                axis=Axis("difference", "px"),
                caption=f"Difference of two calibrations, from one half of the {report.shots} each: RMS "
                f"{two_digits(float(np.sqrt(np.mean(lengths**2))))} px, at most {two_digits(float(lengths.max()))} px.",
            )
        )
    if plots:
        yield SideBySide(tuple(plots))
    else:
        yield "There are too few views to compare one half with the other, or no direction is determined."


def _proven(report: CalibrateReport, observations: Observations) -> Figure | None:
    """Draw where corners prove K to the limit, the circle within which it is, and the image circle."""
    quality, uses, size = report.calibration.quality, report.uses, observations.image_size
    proven = quality.proven if quality is not None else None
    if proven is None or report.uncertainty_px is None:
        return None
    std = np.array(report.uncertainty_px, dtype=np.float64)
    pixels = pixel_grid(size, (std.shape[1], std.shape[0])).reshape(-1, 2)
    corners, _ = _residuals(report.views, observations)
    where = near_corners(pixels, corners, size) & inside_circle(pixels, observations.circle)
    where &= np.nan_to_num(std.ravel(), nan=np.inf) <= uses.limit_px
    every = math.ceil(len(corners) / MOST_DRAWN)
    circle = observations.circle
    middle = (circle.x, circle.y) if circle is not None else (size[0] / 2, size[1] / 2)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        frame_axes(axes, size)
        dots(axes, pixels[where], Colour.GOOD.light, 9, ends="projecting", alpha=0.35)
        dots(axes, corners[::every], Colour.MUTED.light, 1.7)
        turn = np.linspace(0, 2 * math.pi, 181)
        rings = [(*middle, proven.radius_px, Colour.GOOD, "-")]
        rings += [(circle.x, circle.y, circle.radius, Colour.SECOND, "--")] if circle is not None else []
        for x, y, radius, colour, style in rings:
            axes.plot(x + radius * np.cos(turn), y + radius * np.sin(turn), style, color=colour.light)

    image = "frame" if circle is None else "image circle (dashed)"
    share = whole_percent(proven.share)
    alt = f"Where K is proven: {share} of the frame, within {proven.radius_px:.0f} px of its middle."
    return Figure(
        svg=draw(paint, width=520, height=430),
        alt=alt,
        caption=f"Where {report.points} prove K to {uses.limit_px:g} px: {share} of the {image}, "
        f"everywhere within {proven.radius_px:.0f} px of the middle (ring). Outside, σ extrapolates the model."
        + (f" Of the {report.points}, one in {every} is drawn." if every > 1 else ""),
    )


def lens_plots(calibration: Calibration) -> Iterator[Figure]:
    """Lens distortion over the image."""
    if calibration.distortion is not None and calibration.distortion.coefficients:
        yield distortion_map(calibration)
        yield radial_curve(calibration)


def frame_plots(report: CalibrateReport, detections: Detections) -> Iterator[Figure]:
    """Corners on the used frame with the largest reprojection error, and on a typical one."""
    board = report.board
    if board is None:
        return
    seen = {view.name: view for view in detections.observations.views}
    fitted = [v for v in report.views if v.rms_px is not None and v.without is None and v.name in seen]
    fitted.sort(key=lambda view: -(view.rms_px or 0.0))
    if not fitted:
        return
    chosen = {fitted[0].name: (fitted[0], "The view that fits worst")}
    usual = fitted[len(fitted) // 2]
    chosen.setdefault(usual.name, (usual, "A view that fits as most do"))
    for name, (fit, told) in chosen.items():
        if (figure := _on_frame(seen[name], fit, board, detections, told)) is not None:
            yield figure


def _on_frame(view: View, fit: ViewResult, board: Board, detections: Detections, told: str) -> Figure | None:
    path = detections.files.get(view.sha256 or "")
    if path is None:
        return None
    caption = (
        f"{told}, RMS {fit.rms_px:.2f} px: {view.name}. The square is the board's first corner, the line "
    )
    caption += "its first row."
    try:
        return _corners_on_frame(path, view, fit, board, caption=caption)
    except InputError:
        # The frame has disappeared since it was read; the page omits it.
        return None


def _residuals(views: Sequence[ViewResult], observations: Observations) -> tuple[FloatArray, FloatArray]:
    """Positions (N, 2) px and residuals (N, 2) px of all used corners."""
    places, lengths = [np.empty((0, 2))], [np.empty((0, 2))]
    for view, given in zip(views, observations.views, strict=True):
        if view.without is not None or view.residuals_px is None:
            continue
        kept = ~np.isin(given.ids, [corner.id for corner in view.corners_out])
        places.append(given.image_points[kept])
        lengths.append(np.array(view.residuals_px, dtype=np.float64).reshape(-1, 2)[kept])
    return np.concatenate(places), np.concatenate(lengths)


def _averaged(
    pixels: FloatArray, residuals: FloatArray, size: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Centres of the cells that contain residuals, and the mean residual in each."""
    shape = np.array(MEAN_CELLS if size[0] >= size[1] else MEAN_CELLS[::-1])
    cell = np.clip((pixels / np.array(size) * shape).astype(np.intp), 0, shape - 1)
    flat = cell[:, 1] * shape[0] + cell[:, 0]
    count = np.bincount(flat, minlength=int(shape.prod()))
    sums = np.stack([np.bincount(flat, residuals[:, axis], minlength=len(count)) for axis in (0, 1)], axis=1)
    enough = count >= FEWEST
    x, y = (np.arange(len(count)) % shape[0] + 0.5), (np.arange(len(count)) // shape[0] + 0.5)
    middles = np.stack([x, y], axis=1) / shape * np.array(size)
    return middles[enough], sums[enough] / count[enough, None]


def _between_nodes(nodes: FloatArray) -> FloatArray:
    """Values at the cell centres, interpolated from values at the cell corners."""
    return (nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[1:, 1:]) / 4


PICTURE_SIDE: Final = 320
"""Longer side in px of the copy of a frame; a page with two copies has less than 300 kB."""
MARGIN: Final = 0.25
"""Margin shown around the board, as a fraction of its larger side."""
LEVELS: Final = 8
"""Gray levels of the copy: enough to recognise a board, in a fifth of the bytes."""
DIM: Final = (70, 255)
"""Gray range of the copy; black is raised so that marks are visible on the dark squares."""


def _corners_on_frame(path: Path, view: View, fit: ViewResult, board: Board, *, caption: str) -> Figure:
    """Detected corners over a small copy of that part of the frame; ``fit`` states which were rejected.

    Raises:
        InputError: the frame no longer exists.
    """
    frame = read_frame(path)
    left, top, right, bottom = _board_crop(view.image_points, frame.size)
    small, _ = reduced(frame.gray[top:bottom, left:right], PICTURE_SIDE)
    low, high = DIM
    gray = low + np.round(small / 255.0 * (LEVELS - 1)) / (LEVELS - 1) * (high - low)
    out = np.isin(view.ids, [corner.id for corner in fit.corners_out])
    first = int(np.argmin(view.ids))
    row = view.image_points[np.flatnonzero(view.ids < board.lattice[0])]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        frame_axes(axes, frame.size)
        extent = (float(left), float(right), float(bottom), float(top))
        axes.imshow(gray, extent=extent, cmap="gray", vmin=0, vmax=255, interpolation="none")
        axes.plot(*row.T, color=Colour.SECOND.light, linewidth=1.2)
        for some, colour, mark in ((~out, Colour.ACCENT, "o"), (out, Colour.BAD, "X")):
            axes.plot(
                *view.image_points[some].T,
                linestyle="none",
                marker=mark,
                markersize=5 if mark == "o" else 8,
                markerfacecolor="none" if mark == "o" else colour.light,
                markeredgecolor=colour.light,
            )
        axes.plot(
            *view.image_points[first], marker="s", markersize=9, markerfacecolor="none",
            markeredgecolor=Colour.SECOND.light, markeredgewidth=1.6,
        )  # fmt: skip
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)

    alt = f"Frame {view.name} with {len(view.ids)} corners marked"
    alt += f", {int(out.sum())} of them rejected." if out.any() else "."
    drawn_height = round(430 * min(1.3, (bottom - top) / (right - left))) + 70
    return Figure(svg=draw(paint, width=520, height=drawn_height), alt=alt, caption=caption)


def _board_crop(corners: FloatArray, size: ImageSize) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) px of the part of a frame with the board and a margin."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = MARGIN * float((high - low).max())
    left, top = (max(0, int(at - margin)) for at in low.tolist())
    right, bottom = (min(side, int(at + margin) + 1) for at, side in zip(high.tolist(), size, strict=True))
    return left, top, right, bottom


def _board_warp(board: Board, warp: Warp) -> Figure:
    """Height of the board above its plane along its middle row and column."""
    across, down = (side / 2 for side in board.extent)
    share = np.linspace(-1.0, 1.0, 61)
    w0, w1 = warp.lift
    lines = (
        ("across", across, w0 * (1 - share**2), Colour.ACCENT, "-"),
        ("down", down, w1 * (1 - share**2), Colour.SECOND, "--"),
    )

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        for name, half, lift, colour, style in lines:
            axes.plot(share * half, lift, style, color=colour.light, linewidth=2.0)
            axes.annotate(
                name,
                (share[45] * half, lift[45]),
                xytext=(5, 5),
                textcoords="offset points",
                color=colour.light,
            )
        axes.axhline(0, color=Colour.MUTED.light, linewidth=0.8)
        axes.grid()
        axes.set_xlabel(f"from the middle of the board ({board.unit})")
        axes.set_ylabel(f"away from the camera ({board.unit})")
        axes.margins(y=0.15)

    alt = (
        f"Bend of the board along its middle row, {number(w0)} {board.unit}, and its middle column, {number(w1)} "
        f"{board.unit}."
    )
    return Figure(
        svg=draw(paint, width=520, height=320),
        alt=alt,
        caption=f"The board warp that fits best (F = {warp.f or math.inf:.1f}), solved for.",
    )


REACH: Final = 0.6
"""Distance at which the outline of a camera's view is drawn, relative to the distance between cameras."""


def rig_picture(report: RigReport) -> Figure:
    """The cameras from above and from the front, with their fields of view."""
    centres = {report.reference: np.zeros(3)} | {name: pose.centre_mm for name, pose in report.poses.items()}
    turns = {report.reference: np.eye(3)} | {name: pose.rotation for name, pose in report.poses.items()}
    spread = max(float(np.ptp(np.array(list(centres.values())), axis=0).max()), 1.0)
    outlines = {
        name: _outline(calibration, centres[name], turns[name], REACH * spread)
        for name, calibration in report.calibrations.items()
    }

    def paint(canvas: Canvas) -> None:
        above, front = canvas.subplots(1, 2)
        for axes, (a, b), labels in (
            (above, (0, 2), ("x, to the right (mm)", "z, ahead (mm)")),
            (front, (0, 1), ("x, to the right (mm)", "y, down (mm)")),
        ):
            for name, corners in outlines.items():
                own = Colour.SECOND if name == report.reference else Colour.ACCENT
                centre = centres[name]
                for corner in corners:
                    axes.plot(
                        [centre[a], corner[a]],
                        [centre[b], corner[b]],
                        color=Colour.MUTED.light,
                        linewidth=0.7,
                    )
                closed = np.concatenate([corners, corners[:1]])
                axes.plot(closed[:, a], closed[:, b], color=own.light, linewidth=1.2)
                axes.plot(centre[a], centre[b], "o", color=own.light, markersize=6)
                axes.annotate(
                    name, (centre[a], centre[b]), xytext=(5, -11), textcoords="offset points", color=own.light
                )
            axes.set_xlabel(labels[0])
            axes.set_ylabel(labels[1])
            axes.set_aspect("equal", adjustable="datalim")
            axes.margins(0.12)
            axes.grid()
        front.invert_yaxis()

    distances = ", ".join(
        f"{name} {np.linalg.norm(at):.1f} mm" for name, at in centres.items() if name != report.reference
    )
    return Figure(
        svg=draw(paint, width=900, height=380),
        alt=f"Plan and front view of the rig; distance from {report.reference}: {distances}.",
        caption=f"The rig from above and from behind, in the frame of {report.reference}: projection centres, and what "
        "each camera sees at a short distance.",
    )


def _outline(
    calibration: Calibration, centre: FloatArray, rotation: FloatArray, reach_mm: float
) -> FloatArray:
    """Corners (4, 3) of a camera's view in mm, in the frame of the reference camera."""
    width, height = calibration.intrinsics.image_size
    rays = calibration.unproject([[0, 0], [width, 0], [width, height], [0, height]])
    middle = calibration.unproject([[width / 2, height / 2]])
    # An image corner without a ray, as outside a fisheye's circle, is moved towards the centre.
    rays = np.where(np.isfinite(rays), rays, np.where(np.isfinite(middle), middle, (0.0, 0.0, 1.0)))
    along = rays / np.maximum(rays[:, 2:], 0.3) * reach_mm
    return np.asarray(along @ rotation + centre)


def shot_errors(report: RigReport) -> Figure:
    """Reprojection error of each shot over all its cameras, with a single pose of the board."""
    shots = sorted(report.shots, key=lambda shot: -max(shot.rms_px.values()))[:MOST_BARS]
    kept = {shot.name for shot in shots}
    ordered = [shot for shot in report.shots if shot.name in kept]
    return bars(
        [float(np.sqrt(np.mean(np.square(list(shot.rms_px.values()))))) for shot in ordered],
        labels=[f"{shot.name} (apart)" if shot.apart else shot.name for shot in ordered],
        axis=Axis("reprojection error (RMS)", "px"),
        caption="How far corners are from where the rig puts them, by shot, over all cameras. A shot that stands out "
        "was taken while something moved, or its frames do not belong together.",
    )
