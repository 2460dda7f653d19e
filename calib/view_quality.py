"""Quality of a view of the board: measurements, each with a limit and advice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board, Pattern
from calibrary.calib.found import Found, Reason, Remark
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import cell_levels, contrast
from calibrary.calib.observations import View

BLURRED_PX, USELESS_PX = 8.0, 14.0
"""Edge width in px from which corners become noisier (0.04 px and more), and from which they are useless (0.15 px)."""

DRAGGED_PX, DRAGGED_RATIO = 5.0, 1.5
"""Motion blur: smallest edge width in px along one board direction, and smallest ratio to the other direction."""

RISE: Final = 0.8
"""Share of the edge height over which the width is measured: OpenCV's default, and ISO 12233's 10 to 90 %."""

SMALL_PX = 15.0
LOW_CONTRAST = 0.15
SATURATED, MOSTLY_SATURATED = 253.0, 0.5
MOST_GLARE = 0.2
"""Largest share of the dark squares that may be washed out."""

SAME_POSE_SHARE = 0.02
"""Two views show the same pose if their corners differ by less than this, in spacings (hand tremor)."""


def edge_widths(gray: Gray, lattice: FloatArray) -> tuple[float, float]:
    """Return the width of a checkerboard's edges in px: of those across its rows, and of those across its columns.

    The definition is that of ``cv2.estimateChessboardSharpness``; about 3 px is sharp.
    """
    import cv2

    rows, columns = lattice.shape[:2]
    corners = np.ascontiguousarray(lattice.reshape(-1, 1, 2), dtype=np.float32)
    one, other = (
        float(np.ravel(cv2.estimateChessboardSharpness(gray, (columns, rows), corners, RISE, vertical)[0])[0])
        for vertical in (False, True)
    )
    return one, other


def judge_view(gray: Gray, board: Board, found: Found) -> tuple[float | None, tuple[Remark, ...]]:
    """Assess the quality of one view.

    Args:
        gray: (H, W), 8 bit.
        board: the board.
        found: its points in this image.

    Returns:
        The mean edge width in px, None if it cannot be measured for this pattern or part of the board; and remarks,
        those of the detector first.
    """
    remarks = list(found.remarks)
    # The gaps of an AprilGrid are a quarter of its pitch, and measuring in them needs less space.
    wanted = SMALL_PX / 2 if board.pattern is Pattern.APRILGRID else SMALL_PX
    if found.spacing_px < wanted:
        text = f"points {found.spacing_px:.1f} px apart, expected ≥ {wanted:g}; bring the board nearer"
        remarks.append(Remark(reason=Reason.SMALL, text=text))
    if board.pattern is not Pattern.CHECKERBOARD or found.lattice is None:
        return None, tuple(remarks)
    remarks += _light(gray, found.lattice)
    if found.spacing_px < SMALL_PX:
        # The spacing is too small to measure the width of a single edge.
        return None, tuple(remarks)
    widths = edge_widths(gray, found.lattice)
    remarks += _blur(widths)
    return float(np.mean(widths)), tuple(remarks)


def _blur(widths: tuple[float, float]) -> list[Remark]:
    thin, wide = sorted(widths)
    mean = (thin + wide) / 2
    if wide > DRAGGED_PX and wide > DRAGGED_RATIO * thin:
        text = (
            f"dragged: edges {wide:.1f} px wide in one direction and {thin:.1f} px in the other, expected a ratio "
            f"< {DRAGGED_RATIO:g}; hold still, or expose shorter"
        )
        return [Remark(reason=Reason.DRAGGED, text=text, rejects=wide > USELESS_PX)]
    if mean > BLURRED_PX:
        text = f"blurred {mean:.1f} px, expected < {BLURRED_PX:g}; hold still, and step back to where the lens is sharp"
        return [Remark(reason=Reason.BLURRED, text=text, rejects=mean > USELESS_PX)]
    return []


def _light(gray: Gray, lattice: FloatArray) -> list[Remark]:
    levels = cell_levels(gray, lattice)
    first_is_dark = contrast(gray, lattice) >= 0
    rows, columns = np.indices(levels.shape)
    even = (rows + columns) % 2 == 0
    dark, light = levels[even == first_is_dark], levels[even != first_is_dark]
    dark, light = dark[~np.isnan(dark)], light[~np.isnan(light)]
    if not dark.size or not light.size:
        return []
    low, high = float(np.median(dark)), float(np.median(light))
    remarks = []
    if high - low < LOW_CONTRAST * 255:
        text = f"contrast of {(high - low) / 2.55:.0f} %, expected ≥ {100 * LOW_CONTRAST:.0f} %; light the board better"
        remarks.append(Remark(reason=Reason.LOW_CONTRAST, text=text))
    if np.mean(light >= SATURATED) > MOSTLY_SATURATED:
        share = 100 * float(np.mean(light >= SATURATED))
        text = f"{share:.0f} % of the light squares are overexposed; expose less"
        remarks.append(Remark(reason=Reason.OVEREXPOSED, text=text))
    washed = int(np.sum(dark > (low + high) / 2))
    if washed:
        text = f"glare over {washed} of {dark.size} dark squares; turn the board away from the lamp"
        remarks.append(Remark(reason=Reason.GLARE, text=text, rejects=washed > MOST_GLARE * dark.size))
    return remarks


def judge_repeats(views: Sequence[View]) -> dict[int, Remark]:
    """Find views that repeat an earlier one, which would make a calibration appear more accurate than it is.

    Args:
        views: in the order of the images.

    Returns:
        Remarks by view index; the first view of each pose has none.
    """
    by_hash: dict[str, View] = {}
    kept: list[View] = []
    repeats: dict[int, Remark] = {}
    for index, view in enumerate(views):
        if view.sha256 is not None and view.sha256 in by_hash:
            text = f"the same file as {by_hash[view.sha256].name}"
            repeats[index] = Remark(reason=Reason.SAME_FILE, text=text, rejects=True)
            continue
        if view.sha256 is not None:
            by_hash[view.sha256] = view
        apart, twin = min(
            ((_apart(view, other), other) for other in kept), key=lambda pair: pair[0], default=(np.inf, view)
        )
        if apart < SAME_POSE_SHARE * (view.spacing_px or 0.0):
            text = (
                f"the same pose as {twin.name}, corners {apart:.2f} px apart; expected ≥ "
                f"{SAME_POSE_SHARE * (view.spacing_px or 0.0):.1f} px: move the board between frames"
            )
            repeats[index] = Remark(reason=Reason.SAME_POSE, text=text, rejects=True)
            continue
        kept.append(view)
    return repeats


def _apart(view: View, other: View) -> float:
    """Return the RMS distance in px of the points common to two views; infinite if less than half are common."""
    if np.array_equal(view.ids, other.ids):
        difference = view.image_points - other.image_points
    else:
        _, mine, its = np.intersect1d(view.ids, other.ids, assume_unique=True, return_indices=True)
        if 2 * len(mine) < max(len(view.ids), len(other.ids)):
            return float("inf")
        difference = view.image_points[mine] - other.image_points[its]
    return float(np.sqrt((difference**2).sum(axis=1).mean()))
