"""What the board is not: flat in every point, and as long down as across.

A board's shape is the same in every view, so both halves of the views are wrong together and the variance factor sees
nothing of it; the lens takes up what it can, and the residuals keep the rest. So every point of the board may stand
off its plane, and the print may be stretched, each with a prior of what boards do. Where noise alone does not
explain the gain, the lifts are solved for; what is not solved for says by how much the lens would move if it were.

Freeing the points of the board is K. H. Strobl and G. Hirzinger, "More accurate pinhole camera calibration with
imperfect planar target", 2011; there all three coordinates, here the one that a sheet bends along.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.freed import freed
from calibrary.calib.model_choice import f_test
from calibrary.calib.network import LensT, Network
from calibrary.records import Record, replace

__all__ = ["BoardShape", "Stretch", "board_shape", "laid_on", "stretch"]

MOST_NODES: Final = (10, 8)
"""Along the longer and the shorter side; a board with more corners is lifted between them by bilinear hats."""
LEVEL: Final = 1e-4
SMALLEST_SINGULAR: Final = 1e-6
LIFT_PRIOR: Final = 0.0025
"""Standard deviation of a lift as a share of the board's longer side: 1 mm in 400."""
STRETCH_PRIOR: Final = 5e-4
"""Of a print, down against across: office printers stay within a thousandth."""
ROUNDS: Final = 2


class Stretch(Record):
    """Of the print, down against across.

    Attributes:
        value: relative: +0.001 is 0.1 % longer down than across.
        std: of the value; large where the board was never rolled, for then it is the same as fx ≠ fy.
    """

    value: float
    std: float

    @property
    def z(self) -> float:
        """The value in its standard deviations."""
        return self.value / self.std if self.std > 0 else 0.0


class BoardShape(Struct, frozen=True, kw_only=True, eq=False):
    """What letting every point of the board leave its plane changes.

    Attributes:
        f: the statistic of the test that it saves no more than noise would.
        p: chance of such an F.
        lifts_mm: (V, M) off the plane.
        shift: (n,) by which the lens's parameters move.
        covariance: (n, n) of the lens's parameters when the lifts are free.
    """

    f: float
    p: float
    lifts_mm: FloatArray
    shift: FloatArray
    covariance: FloatArray

    @property
    def is_bent(self) -> bool:
        """Whether noise alone does not do it."""
        return self.p < LEVEL

    @property
    def largest_mm(self) -> float:
        """The largest lift."""
        return float(np.abs(self.lifts_mm).max())


def board_shape(adjusted: Adjusted[LensT]) -> BoardShape | None:
    """Let the board's points leave its plane; None for points that are no board, or too few views for it."""
    network, size = adjusted.network, len(adjusted.state.parameters)
    if not network.is_planar:
        return None
    shapes = _shapes(adjusted)
    more = shapes.shape[-1]
    dof = adjusted.dof - more
    if more == 0 or dof <= more:
        return None

    def lifted(row: int) -> FloatArray:
        return np.asarray((_moved(adjusted, row, 2)[..., None] * shapes[row][:, None, :]).reshape(-1, more))

    prior = LIFT_PRIOR * float(np.ptp(network.points[network.seen][:, :2], axis=0).max())
    found = freed(adjusted, lifted, more, prior)
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
    """The camera before the board as it is bent.

    Args:
        adjusted: the solution with a board that is flat but for its warp.
        everything: the same views with all of their corners.

    Returns:
        The solution, everything, both on a board whose points are lifted, and the shape with its lifts in all; None
        where the lifts are not determined.
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
    """One length of the print against the other, and (n,) by which the lens moves when it is free.

    Without the prior in the value, for it is a measurement; with it in the shift, for a board that was never rolled
    does not determine it. The shift is that of the root mean square which corners and prior leave of the stretch. None
    for points that are no board.
    """
    network, size = adjusted.network, len(adjusted.state.parameters)
    if not network.is_planar:
        return None

    def longer(row: int) -> FloatArray:
        return np.asarray((_moved(adjusted, row, 1) * network.points[row][:, 1:2]).reshape(-1, 1))

    alone, held = freed(adjusted, longer, 1), freed(adjusted, longer, 1, STRETCH_PRIOR)
    if alone is None or held is None or not alone.inverse[-1, -1] > 0:
        return None
    std = math.sqrt(alone.inverse[-1, -1] * adjusted.variance)
    remaining = math.hypot(held.step[-1], math.sqrt(held.inverse[-1, -1] * adjusted.variance))
    shift = held.inverse[:size, -1] / held.inverse[-1, -1] * remaining
    return Stretch(value=float(alone.step[-1]), std=std), shift


def _moved(adjusted: Adjusted[LensT], row: int, axis: int) -> FloatArray:
    """(M, 2) px per mm by which a view's points move along one axis of the board."""
    by_place = adjusted.linear.by_pose[row][:, 3:].reshape(-1, 2, 3)
    return np.asarray(by_place @ adjusted.state.rotations[row][:, axis])


def _shapes(adjusted: Adjusted[LensT]) -> FloatArray:
    """(V, M, k) by how much each of k shapes lifts each point; none of them is a plane or an arch solved for."""
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
    """(N, nodes) bilinear hats over −1 … 1, with a node on every line of points where there are few enough."""
    lines = np.unique(unit)
    nodes = lines if len(lines) <= most else np.linspace(-1, 1, most)
    return np.stack([np.interp(unit, nodes, row) for row in np.eye(len(nodes))], axis=1)
