"""Figures of a calibration's page: the corners on a frame, and the board's warp."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detectors.refinement import reduced
from calibrary.calib.frames import read_frame
from calibrary.calib.model_choice import WarpTest
from calibrary.calib.observations import View
from calibrary.calib.result import ViewResult
from calibrary.calibration import ImageSize
from calibrary.pages import Figure
from calibrary.pages.palette import Colour
from calibrary.pages.plots.canvas import draw, frame_axes, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["board_warp", "corners_on_frame"]


PICTURE_SIDE: Final = 640
"""Longer side in px of the copy of a frame; two copies keep a page far below 2 MB."""
MARGIN: Final = 0.25
"""Margin shown around the board, as a fraction of its larger side."""
LEVELS: Final = 16
"""Gray levels of the copy: enough to recognise a board, in a third of the bytes."""
DIM: Final = (70, 255)
"""Gray range of the copy; black is raised so that marks are visible on the dark squares."""


def corners_on_frame(path: Path, view: View, fit: ViewResult, board: Board, *, caption: str) -> Figure:
    """Detected corners over a small copy of that part of the frame.

    Args:
        path: of the frame.
        view: its corners.
        fit: states which corners were rejected.
        board: the board.
        caption: what to look for.

    Raises:
        InputError: the frame no longer exists.
    """
    frame = read_frame(path)
    left, top, right, bottom = _around(view.image_points, frame.size)
    small, _ = reduced(frame.gray[top:bottom, left:right], PICTURE_SIDE)
    low, high = DIM
    gray = low + np.round(small / 255.0 * (LEVELS - 1)) / (LEVELS - 1) * (high - low)
    out = np.isin(view.ids, [at for at, _ in fit.corners_out])
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


def _around(corners: FloatArray, size: ImageSize) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) px of the part of a frame with the board and a margin."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = MARGIN * float((high - low).max())
    left, top = (max(0, int(at - margin)) for at in low.tolist())
    right, bottom = (min(side, int(at + margin) + 1) for at, side in zip(high.tolist(), size, strict=True))
    return left, top, right, bottom


def board_warp(board: Board, test: WarpTest, *, caption: str) -> Figure:
    """Height of the board above its plane along its middle row and column."""
    across, down = (side / 2 for side in board.extent)
    share = np.linspace(-1.0, 1.0, 61)
    w0, w1 = test.warp_mm
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
    return Figure(svg=draw(paint, width=520, height=320), alt=alt, caption=caption)
