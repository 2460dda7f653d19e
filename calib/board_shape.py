"""Deviations of the board from its ideal shape: points off the plane, and unequal scale of the two directions.

A board's shape is the same in all views, so both halves of the views have the same error, and the variance factor does
not show it; the lens absorbs part of it, and the residuals contain the rest. So every point may be lifted off the
plane, and the print may be stretched, each with a prior of what real boards do. If noise alone does not explain the
improvement, the lifts are estimated; otherwise the change of the lens that they would cause adds to its uncertainty.

Source for free board points: K. H. Strobl and G. Hirzinger, "More accurate pinhole camera calibration with imperfect
planar target", 2011. They free all three coordinates; here only the normal one, along which a sheet bends.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.adjustment import Adjusted, adjust, extended_step
from calibrary.calib.model_choice import f_test
from calibrary.calib.network import LensT, Network
from calibrary.records import Record, replace

MOST_NODES: Final = (10, 8)
"""Nodes along the longer and the shorter side; a board with more corners is interpolated bilinearly between them."""
LEVEL: Final = 1e-4
SMALLEST_SINGULAR: Final = 1e-6
LIFT_PRIOR: Final = 0.0025
"""Prior standard deviation of a lift as a share of the board's longer side: 1 mm in 400."""
STRETCH_PRIOR: Final = 5e-4
"""Prior standard deviation of the ratio of the print's two scales; office printers stay within 0.1 %."""
ROUNDS: Final = 2
"""Lifts are steps to first order from a lens that has absorbed part of them; the second round corrects the first."""


class Stretch(Record):
    """Scale of the print along its columns relative to that along its rows.

    Attributes:
        value: relative excess: +0.001 means that the columns are 0.1 % too long.
        std: standard deviation of the value; large if the camera was never rolled, when it is equivalent to fx ≠ fy.
    """

    value: float
    std: float

    @property
    def z(self) -> float:
        """The value divided by its standard deviation."""
        return self.value / self.std if self.std > 0 else 0.0


class BoardShape(Struct, frozen=True, kw_only=True, eq=False):
    """Effect of letting every point of the board leave the plane.

    Attributes:
        f: statistic of the F-test for the lifts.
        p: p-value of the test.
        lifts_mm: (V, M) distance from the plane in mm.
        shift: (n,) change of the lens parameters.
        covariance: (n, n) covariance of the lens parameters with free lifts.
    """

    f: float
    p: float
    lifts_mm: FloatArray
    shift: FloatArray
    covariance: FloatArray

    @property
    def is_bent(self) -> bool:
        """Whether noise alone does not explain the lifts."""
        return self.p < LEVEL

    @property
    def largest_mm(self) -> float:
        """Largest lift in mm."""
        return float(np.abs(self.lifts_mm).max())


def board_shape(adjusted: Adjusted[LensT]) -> BoardShape | None:
    """Estimate the lifts of the board's points; None for points without a board, or too few views."""
    network, size = adjusted.network, len(adjusted.state.parameters)
    if not network.is_planar:
        return None
    shapes = _shapes(adjusted)
    more = shapes.shape[-1]
    dof = adjusted.dof - more
    if more == 0 or dof <= more:
        return None

    def lifted(rows: IntArray) -> FloatArray:
        moved = _moved(adjusted, rows, 2)[..., None] * shapes[rows][:, :, None, :]
        return np.asarray(moved.reshape(len(rows), -1, more))

    prior = LIFT_PRIOR * float(np.ptp(network.points[network.seen][:, :2], axis=0).max())
    found = extended_step(adjusted, lifted, more, prior)
    if found is None:
        return None
    f, p = f_test(adjusted.rss, max(adjusted.rss - found.gain, 1e-300), more, dof)
    variance = max(adjusted.rss - found.gain, 0.0) / dof
    return BoardShape(
        f=f,
        p=p,
        lifts_mm=shapes @ found.step[len(adjusted.free) :],
        shift=found.step[:size],
        covariance=variance * found.inverse[:size, :size],
    )


def laid_on(
    adjusted: Adjusted[LensT], everything: Network
) -> tuple[Adjusted[LensT], Network, BoardShape] | None:
    """Adjust the camera with the estimated shape of the board.

    Args:
        adjusted: solution with a flat board, apart from its warp.
        everything: the same views with all their corners.

    Returns:
        The solution and ``everything``, both with lifted points, and the shape with the total lifts; None if the lifts
        are not determined.
    """
    bent = len(adjusted.free) > len(adjusted.state.parameters)
    total = np.zeros(adjusted.network.seen.shape)
    first: BoardShape | None = None
    for _ in range(ROUNDS):
        shape = board_shape(adjusted)
        if shape is None:
            return None
        first = first or shape
        total += shape.lifts_mm
        lifted = adjusted.network.points.copy()
        lifted[..., 2] += shape.lifts_mm
        adjusted = adjust(replace(adjusted.network, points=lifted), adjusted.state, warp=bent)
    last = board_shape(adjusted)
    if first is None or last is None:
        return None
    final = replace(last, f=first.f, p=first.p, lifts_mm=total)
    return adjusted, replace(everything, points=adjusted.network.points), final


def stretch(adjusted: Adjusted[LensT]) -> tuple[Stretch, FloatArray] | None:
    """Estimate the stretch of the print, and the change of the lens parameters, (n,), if it is free.

    The value has no prior, since it is a measurement. The change uses the prior, since without rolled views the
    stretch is not determined; it corresponds to the RMS of the stretch given corners and prior. None for points
    without a board.
    """
    network, size = adjusted.network, len(adjusted.state.parameters)
    if not network.is_planar:
        return None

    def longer(rows: IntArray) -> FloatArray:
        moved = _moved(adjusted, rows, 1) * network.points[rows][..., 1:2]
        return np.asarray(moved.reshape(len(rows), -1, 1))

    alone, held = extended_step(adjusted, longer, 1), extended_step(adjusted, longer, 1, STRETCH_PRIOR)
    if alone is None or held is None or not alone.inverse[-1, -1] > 0:
        return None
    std = math.sqrt(alone.inverse[-1, -1] * adjusted.variance)
    remaining = math.hypot(held.step[-1], math.sqrt(held.inverse[-1, -1] * adjusted.variance))
    shift = held.inverse[:size, -1] / held.inverse[-1, -1] * remaining
    return Stretch(value=float(alone.step[-1]), std=std), shift


def _moved(adjusted: Adjusted[LensT], rows: IntArray, axis: int) -> FloatArray:
    """Return the motion of the points of some views along one axis of the board, (R, M, 2) px per mm."""
    by_place = adjusted.linear.gone[rows][..., 3:].reshape(len(rows), -1, 2, 3)
    return np.asarray((by_place @ adjusted.state.rotations[rows][:, None, :, axis, None])[..., 0])


def _shapes(adjusted: Adjusted[LensT]) -> FloatArray:
    """Return k shapes of lifts at each point, (V, M, k), independent of a plane and of an estimated warp."""
    network = adjusted.network
    xy = network.points[..., :2]
    places, at = np.unique(np.round(xy.reshape(-1, 2), 6), axis=0, return_inverse=True)
    low, high = places.min(axis=0), places.max(axis=0)
    if not (high > low).all():
        return np.zeros((*network.seen.shape, 0))
    unit = 2 * (places - low) / (high - low) - 1
    across, down = MOST_NODES if high[0] - low[0] >= high[1] - low[1] else MOST_NODES[::-1]
    hats = _hats(unit[:, 0], across)[:, :, None] * _hats(unit[:, 1], down)[:, None, :]
    hats = hats.reshape(len(places), -1)
    known = [np.ones(len(unit)), unit[:, 0], unit[:, 1]]
    if len(adjusted.free) > len(adjusted.state.parameters):
        known += [unit[:, 0] ** 2, unit[:, 1] ** 2]
    taken = np.linalg.qr(np.column_stack(known))[0]
    U, values, _ = np.linalg.svd(hats - taken @ (taken.T @ hats), full_matrices=False)
    independent = U[:, values > SMALLEST_SINGULAR] * math.sqrt(len(places))
    return independent[at.ravel()].reshape(*network.seen.shape, -1) * network.used[:, None, None]


def _hats(unit: FloatArray, most: int) -> FloatArray:
    """Return bilinear hat functions over −1 … 1, (N, nodes), with a node on every line of points if they are few."""
    lines = np.unique(unit)
    nodes = lines if len(lines) <= most else np.linspace(-1, 1, most)
    return np.stack([np.interp(unit, nodes, row) for row in np.eye(len(nodes))], axis=1)
