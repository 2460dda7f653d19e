"""Observations of all views as arrays, and the camera and poses that are fitted to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, Protocol

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.board import Board
from calibrary.calib.least_squares import Linear
from calibrary.calib.lens_models import Projected, Solvable, columns_of
from calibrary.calib.observations import ControlPoints, Observations
from calibrary.errors import CalibrationError
from calibrary.records import replace

if TYPE_CHECKING:
    from typing_extensions import TypeVar
else:
    from typing import TypeVar as _TypeVar

    def TypeVar(name, *, bound, default):  # noqa: N802  PEP 696's default is for type checkers only
        """Stand-in for the TypeVar of Python 3.13."""
        del default
        return _TypeVar(name, bound=bound)


MAX_CELLS = 1_000_000
"""Views × corners of the largest view; 200 views of a 40 × 30 board are a quarter of it."""


class Lens(Protocol):
    """A projection model: the lens of one camera, or the lenses of a rig with their poses in it."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the adjusted parameters, in the order of all vectors and matrices of this model."""

    def project(self, parameters: FloatArray, points: FloatArray) -> Projected:
        """Project (V, M, 3) points, given in the frame of the poses, to pixels, with derivatives."""

    def faces(self, parameters: FloatArray, points: FloatArray) -> BoolArray:
        """Return which points, (V, M), the model can project."""

    def is_possible(self, parameters: FloatArray) -> bool:
        """Return whether parameters are admissible: the focal lengths are positive."""


LensT = TypeVar("LensT", bound=Lens, default=Solvable)


class Network(Struct, frozen=True, kw_only=True, eq=False):
    """V views of at most M corners each; views with fewer corners are padded with unused ones.

    Attributes:
        points: (V, M, 3) mm, relative to the centre of the board.
        pixels: (V, M, 2) px.
        seen: (V, M) which corners are used.
        warp_shape: (V, M, 2) lift of the point in mm per mm of each warp parameter: (1 − u², 1 − v²).
        is_planar: whether the points lie in z = 0.
    """

    points: FloatArray
    pixels: FloatArray
    seen: BoolArray
    warp_shape: FloatArray
    is_planar: bool

    @classmethod
    def of(cls, observations: Observations) -> Network:
        """Arrange the views of a board as arrays.

        Raises:
            CalibrationError: there are too many corners for one adjustment.
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
            # An unused corner still needs a valid position: that of a used one.
            points[row, n:] = points[row, 0] if n else 0.0
            pixels[row, :n], warp_shape[row, :n], seen[row, :n] = view.image_points, lift[view.ids], True
        return cls(
            points=points, pixels=pixels, seen=seen, warp_shape=warp_shape, is_planar=isinstance(board, Board)
        )

    def only(self, seen: BoolArray) -> Network:
        """Return the same views with other corners used."""
        return replace(self, seen=seen)

    def views(self, rows: NDArray[np.intp]) -> Network:
        """Return some of the views."""
        return replace(
            self,
            points=self.points[rows],
            pixels=self.pixels[rows],
            seen=self.seen[rows],
            warp_shape=self.warp_shape[rows],
        )

    @property
    def scalars(self) -> int:
        """Number of used coordinates."""
        return 2 * int(self.seen.sum())

    @property
    def used(self) -> BoolArray:
        """Which views, (V,), have a used corner."""
        return np.asarray(self.seen.any(axis=1), dtype=np.bool_)


def _bend(board: Board | ControlPoints) -> FloatArray:
    """Return (N, 2) 1 − u² and 1 − v², with u and v from −1 to 1 over the board; zero for control points."""
    points = board.points
    if not isinstance(board, Board):
        return np.zeros((len(points), 2))
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    half = np.maximum((high - low) / 2, 1e-12)
    return np.asarray(1.0 - ((points[:, :2] - (low + high) / 2) / half) ** 2)


class State(Struct, Generic[LensT], frozen=True, kw_only=True, eq=False):
    """Parameters of the adjustment.

    Attributes:
        model: lens model of the parameters, or the model of a rig.
        parameters: (n,) in the order of the model.
        warp: (2,) mm, lift of the board's centre relative to the middles of its edges, along u and along v.
        rotations: (V, 3, 3) from board to camera.
        translations: (V, 3) mm, centre of the board in the camera frame.
    """

    model: LensT
    parameters: FloatArray
    warp: FloatArray
    rotations: FloatArray
    translations: FloatArray

    def views(self, rows: NDArray[np.intp]) -> State[LensT]:
        """Return the same camera with some of the poses."""
        return replace(self, rotations=self.rotations[rows], translations=self.translations[rows])


def linearise(network: Network, state: State[LensT]) -> Linear | None:
    """Compute residuals and derivatives: a row for each view, whose pose is eliminated.

    The derivatives are by the lens parameters, then by the warp; and by a rotation of the board about its centre (rad,
    camera axes), then by its position (mm).

    Returns:
        None if a point is behind a perspective camera or a value overflows.
    """
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
    size = by_parameter.shape[-1]
    by_global, by_pose = columns_of((views, corners), size + 2), columns_of((views, corners), 6)
    by_global[..., :size], by_pose[..., 3:] = by_parameter, by_point
    normal = state.rotations[:, None, :, 2]
    shape, arm = (np.ascontiguousarray(np.moveaxis(each, -1, 0)) for each in (network.warp_shape, arms))
    # One coordinate after the other: NumPy is slow in an innermost loop over two.
    for along in (0, 1):
        by = by_point[:, :, along]
        by_lift = (by * normal).sum(axis=-1)
        for at in (0, 1):
            by_global[:, :, along, size + at] = by_lift * shape[at]
        for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            # Column `axis` of −[arm]×, multiplied by ∂px/∂point.
            by_pose[:, :, along, axis] = by[..., b] * arm[a] - by[..., a] * arm[b]
    residuals = network.pixels - pixels
    if not network.seen.all():
        unseen = ~network.seen
        residuals[unseen], by_global[unseen], by_pose[unseen] = 0.0, 0.0, 0.0
    linear = Linear(
        residuals=residuals.reshape(views, 2 * corners),
        shared=by_global.reshape(views, 2 * corners, -1),
        gone=by_pose.reshape(views, 2 * corners, 6),
        scalars=network.scalars,
        members=int(network.used.sum()),
    )
    whole = np.isfinite(linear.rss) and np.isfinite(by_global.sum()) and np.isfinite(by_pose.sum())
    return linear if whole else None


def turned(rotations: FloatArray, by: FloatArray) -> FloatArray:
    """Return rotations, (V, 3, 3), followed by rotations about ``by``, (V, 3) rad (Rodrigues' formula)."""
    angle = np.linalg.norm(by, axis=1)[:, None, None]
    cross = np.zeros((len(by), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -by[:, 2], by[:, 1], -by[:, 0]
    cross -= cross.transpose(0, 2, 1)
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0, np.sin(safe) / safe)
    second = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    return np.asarray((np.eye(3) + first * cross + second * (cross @ cross)) @ rotations)
