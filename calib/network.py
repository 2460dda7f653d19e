"""Corners of all views as one block of arrays, and the camera and poses that are fitted to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, Protocol

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.board import Board
from calibrary.calib.lens_models import Projected, Solvable
from calibrary.calib.observations import ControlPoints, Observations
from calibrary.errors import CalibrationError
from calibrary.records import replace

if TYPE_CHECKING:
    from typing_extensions import TypeVar
else:
    from typing import TypeVar as _TypeVar

    def TypeVar(name, *, bound, default):  # noqa: N802  PEP 696's default is for type checkers only
        """As typing's own of Python 3.13."""
        del default
        return _TypeVar(name, bound=bound)


__all__ = ["Lens", "LensT", "Linear", "Network", "State", "linearise", "turned"]


MAX_CELLS = 1_000_000
"""Views × corners of the fullest view; 200 views of a 40 × 30 board are a quarter of it."""


class Lens(Protocol):
    """What maps points to pixels: the lens of one camera, or the lenses of a rig with the places they have in it."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of what is solved for, in the order of every vector and matrix about it."""

    def project(self, parameters: FloatArray, points: FloatArray) -> Projected:
        """Pixels of (V, M, 3) points in the frame of the poses, with their derivatives."""

    def faces(self, parameters: FloatArray, points: FloatArray) -> BoolArray:
        """(V, M) which points are where it can see at all."""

    def is_possible(self, parameters: FloatArray) -> bool:
        """Whether a search may go there: a focal length is positive."""


LensT = TypeVar("LensT", bound=Lens, default=Solvable)


class Network(Struct, frozen=True, kw_only=True, eq=False):
    """V views of at most M corners each; views with fewer are filled up with corners that count for nothing.

    Attributes:
        points: (V, M, 3) mm, about the middle of the board.
        pixels: (V, M, 2) px.
        seen: (V, M) which corners count.
        warp_shape: (V, M, 2) mm by which a unit of each warp parameter lifts the point: (1 − u², 1 − v²).
        is_planar: whether the points lie in z = 0.
    """

    points: FloatArray
    pixels: FloatArray
    seen: BoolArray
    warp_shape: FloatArray
    is_planar: bool

    @classmethod
    def of(cls, observations: Observations) -> Network:
        """Lay out a board's views.

        Raises:
            CalibrationError: there are too many corners for one solve.
        """
        counts = [len(view.ids) for view in observations.views]
        shape = (len(counts), max(counts, default=0))
        if shape[0] * shape[1] > MAX_CELLS:
            raise CalibrationError(
                f"{shape[0]} views of up to {shape[1]} points are too many for one solve (at most {MAX_CELLS} "
                "points in all): thin out the views"
            )
        board = observations.board
        middle = board.points.mean(axis=0) if len(board.points) else np.zeros(3)
        lift = _bend(board)
        points, pixels = np.zeros((*shape, 3)), np.zeros((*shape, 2))
        warp_shape, seen = np.zeros((*shape, 2)), np.zeros(shape, dtype=np.bool_)
        for row, view in enumerate(observations.views):
            n = counts[row]
            points[row, :n] = board.points[view.ids] - middle
            # A corner that counts for nothing must still have a harmless place: that of one which counts.
            points[row, n:] = points[row, 0] if n else 0.0
            pixels[row, :n], warp_shape[row, :n], seen[row, :n] = view.image_points, lift[view.ids], True
        return cls(
            points=points, pixels=pixels, seen=seen, warp_shape=warp_shape, is_planar=isinstance(board, Board)
        )

    def only(self, seen: BoolArray) -> Network:
        """The same views with other corners counting."""
        return replace(self, seen=seen)

    def views(self, rows: NDArray[np.intp]) -> Network:
        """Some of the views."""
        return replace(
            self,
            points=self.points[rows],
            pixels=self.pixels[rows],
            seen=self.seen[rows],
            warp_shape=self.warp_shape[rows],
        )

    @property
    def scalars(self) -> int:
        """Measured coordinates that count."""
        return 2 * int(self.seen.sum())

    @property
    def used(self) -> BoolArray:
        """(V,) which views have a corner that counts."""
        return np.asarray(self.seen.any(axis=1), dtype=np.bool_)


def _bend(board: Board | ControlPoints) -> FloatArray:
    """(N, 2) 1 − u² and 1 − v², u and v from −1 to 1 over a board; a cloud of control points has no warp."""
    points = board.points
    if not isinstance(board, Board):
        return np.zeros((len(points), 2))
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    half = np.maximum((high - low) / 2, 1e-12)
    return np.asarray(1.0 - ((points[:, :2] - (low + high) / 2) / half) ** 2)


class State(Struct, Generic[LensT], frozen=True, kw_only=True, eq=False):
    """What is solved for.

    Attributes:
        model: the lens model that the parameters are of, or a rig's.
        parameters: (n,) in the model's order.
        warp: (2,) mm, the lift of the board's middle over the middles of its edges, along u and along v.
        rotations: (V, 3, 3) board to camera.
        translations: (V, 3) mm, the board's middle in the camera frame.
    """

    model: LensT
    parameters: FloatArray
    warp: FloatArray
    rotations: FloatArray
    translations: FloatArray

    def views(self, rows: NDArray[np.intp]) -> State[LensT]:
        """The same camera with some of the poses."""
        return replace(self, rotations=self.rotations[rows], translations=self.translations[rows])


class Linear(Struct, frozen=True, kw_only=True, eq=False):
    """The network around a state; rows of corners that do not count are zero.

    Attributes:
        residuals: (V, 2M) observed − projected px.
        by_global: (V, 2M, g) derivatives by the lens parameters, then by the warp.
        by_pose: (V, 2M, 6) by a turn of the board about its middle (rad, camera axes) and by its place (mm).
    """

    residuals: FloatArray
    by_global: FloatArray
    by_pose: FloatArray

    @property
    def rss(self) -> float:
        """Sum of squared residuals, px²."""
        return float(np.vdot(self.residuals, self.residuals))


def linearise(network: Network, state: State[LensT]) -> Linear | None:
    """Residuals and derivatives; None where a point is behind a perspective camera or a number overflows."""
    views, corners = network.seen.shape
    lifted = network.points
    if state.warp.any():
        lifted = lifted.copy()
        lifted[..., 2] += network.warp_shape @ state.warp
    arms = lifted @ state.rotations.transpose(0, 2, 1)
    inside = arms + state.translations[:, None, :]
    if not state.model.faces(state.parameters, inside)[network.seen].all():
        return None
    with np.errstate(all="ignore"):
        pixels, by_parameter, by_point = state.model.project(state.parameters, inside)
    by_warp = (by_point @ state.rotations[:, None, :, 2:3]) * network.warp_shape[:, :, None, :]
    by_global = np.concatenate([by_parameter, by_warp], axis=-1)
    by_pose = np.empty((views, corners, 2, 6))
    for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
        # Column `axis` of −[arm]×, taken through ∂px/∂point.
        by_pose[..., axis] = by_point[..., b] * arms[..., None, a] - by_point[..., a] * arms[..., None, b]
    by_pose[..., 3:] = by_point
    residuals = network.pixels - pixels
    if not network.seen.all():
        unseen = ~network.seen
        residuals[unseen], by_global[unseen], by_pose[unseen] = 0.0, 0.0, 0.0
    linear = Linear(
        residuals=residuals.reshape(views, 2 * corners),
        by_global=by_global.reshape(views, 2 * corners, -1),
        by_pose=by_pose.reshape(views, 2 * corners, 6),
    )
    whole = np.isfinite(linear.rss) and np.isfinite(by_global.sum()) and np.isfinite(by_pose.sum())
    return linear if whole else None


def turned(rotations: FloatArray, by: FloatArray) -> FloatArray:
    """(V, 3, 3) rotations followed by a turn about ``by`` (V, 3) rad each (Rodrigues' formula)."""
    angle = np.linalg.norm(by, axis=1)[:, None, None]
    cross = np.zeros((len(by), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -by[:, 2], by[:, 1], -by[:, 0]
    cross -= cross.transpose(0, 2, 1)
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0, np.sin(safe) / safe)
    second = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    return np.asarray((np.eye(3) + first * cross + second * (cross @ cross)) @ rotations)
