"""Joint adjustment of a rig: all cameras, their relative poses and the poses of the board."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.board_shape import BoardShape, board_shape, laid_on
from calibrary.calib.model_choice import WarpTest, with_warp
from calibrary.calib.network import Network, State, linearise
from calibrary.calib.rig.lens import Place, RigLens
from calibrary.calib.rig.observations import RigObservations, rig_network
from calibrary.calib.rig.start import Eye
from calibrary.calib.solve import Solution
from calibrary.errors import CalibrationError
from calibrary.records import replace

ROUNDS: Final = 5
NORMAL_MAD: Final = 1.4826
OUTSTANDING: Final = 4.0
"""A shot contradicts the rig if its residuals exceed the typical ones by this many median absolute deviations."""
LEAST_EXCESS: Final = 1.0
"""Smallest such excess, in standard deviations of a coordinate; a smaller one is noise or board shape."""
MOST_SHOTS: Final = 0.3
"""If a larger fraction of the shots contradicts the rig, the shots are not the cause."""
SAME_NOISE: Final = 0.05


class RigSolution(Struct, frozen=True, kw_only=True, eq=False):
    """Solution of a rig.

    Attributes:
        seen: input of the solution.
        rows: (V, C) index of the views with a common pose; a shot that contradicts the rig is split into several rows.
        adjusted: the minimum; residuals in standard deviations of each camera.
        alone: (V, C) RMS residual in px of each view with its own best pose; NaN if there is no view.
        joint: (V, C) the same with one pose for all cameras.
        apart: (shot, camera) of the views with a separate pose, since the shot contradicts the rig.
        rss_apart: sum of squared residuals if every view had its own pose.
        warp: test for a board warp; None if the warp was not to be estimated.
        shape: board shape in addition to its warp.
        flat_shape: board shape estimated from the residuals of a flat board.
        is_lifted: whether the board shape is part of the solution.
    """

    seen: RigObservations
    rows: IntArray
    adjusted: Adjusted[RigLens]
    alone: FloatArray
    joint: FloatArray
    apart: tuple[tuple[int, int], ...]
    rss_apart: float
    warp: WarpTest | None
    shape: BoardShape | None
    flat_shape: BoardShape | None
    is_lifted: bool

    @property
    def lens(self) -> RigLens:
        """The lenses and their poses."""
        return self.adjusted.state.model

    @property
    def is_warped(self) -> bool:
        """Whether the board warp is part of the solution."""
        return len(self.adjusted.free) > len(self.adjusted.state.parameters)

    def place(self, camera: int) -> Place:
        """Return the pose of a camera."""
        return self.lens.place(self.adjusted.state.parameters, camera)

    def eye(self, camera: int, alone: Solution) -> Solution:
        """Return the solution of one camera with the lens and poses of the rig, as if it had been solved alone.

        Args:
            camera: index of the camera.
            alone: its own solution, which provides the poses of unused views.
        """
        adjusted, lens = self.adjusted, self.lens
        views = self.seen.cameras[lens.names[camera]]
        network = replace(Network.of(views), points=self._lifted(camera))
        seen, state = np.zeros_like(network.seen), adjusted.state
        rotations, translations = alone.state.rotations.copy(), alone.state.translations.copy()
        place = self.place(camera)
        for row, view in enumerate(self.rows[:, camera]):
            if view >= 0:
                seen[view] = adjusted.network.seen[row, lens.block(camera)][: seen.shape[1]]
                rotations[view] = place.rotation @ state.rotations[row]
                translations[view] = place.rotation @ state.translations[row] + place.translation
        own = State(
            model=lens.models[camera],
            parameters=state.parameters[lens.lens_of(camera)],
            warp=state.warp,
            rotations=rotations,
            translations=translations,
        )
        counted = network.only(seen)
        linear = linearise(counted, own)
        if linear is None:
            raise CalibrationError(f"{lens.names[camera]}: part of a board is behind the camera")
        free = np.arange(len(own.parameters) + (2 if self.is_warped else 0))
        return Solution(
            adjusted=Adjusted(network=counted, state=own, linear=linear, free=free),
            everything=network,
            repeats=alone.repeats,
            warp=self.warp,
            candidates=alone.candidates,
            is_lifted=self.is_lifted,
        )

    def _lifted(self, camera: int) -> FloatArray:
        """Return the board points of a camera's views, (V, M, 3) mm, with the board's shape applied."""
        views = self.seen.cameras[self.lens.names[camera]]
        network = Network.of(views)
        if not self.is_lifted:
            return network.points
        height = np.zeros(len(views.board.points))
        for at, name in enumerate(self.lens.names):
            block = self.adjusted.network.points[:, self.lens.block(at), 2]
            for row, view in enumerate(self.rows[:, at]):
                if view >= 0:
                    ids = self.seen.cameras[name].views[view].ids
                    height[ids] = block[row, : len(ids)]
        points = network.points.copy()
        for row, view in enumerate(views.views):
            points[row, : len(view.ids), 2] = height[view.ids]
        return points


def solve_rig(
    seen: RigObservations, eyes: Sequence[Eye], places: Sequence[Place], *, warp: bool = True
) -> RigSolution:
    """Adjust lenses, relative poses and board poses together.

    Args:
        seen: the views.
        eyes: solutions of the single cameras, the reference first.
        places: approximate poses of the cameras; that of the reference is the identity.
        warp: whether the board warp may be estimated.

    Raises:
        CalibrationError: the shots do not link all cameras, or do not determine them.
    """
    rows = _counted(seen, eyes)
    current = _begun(seen, eyes, places, rows)
    apart: list[tuple[int, int]] = []
    for _ in range(ROUNDS):
        further = _contradicting(seen, current, rows, apart)
        if not further:
            break
        apart += further
        rows = _spread(_counted(seen, eyes), apart)
        current = _begun(seen, eyes, places, rows, current)
    current = _reweighed(current)
    tested, current = with_warp(current) if warp and current.network.is_planar else (None, current)
    flat = shape = board_shape(current) if warp else None
    lifted = False
    if flat is not None and flat.is_bent:
        found = laid_on(current, current.network)
        if found is not None:
            current, _, shape = found
            lifted = True
    alone, joint, rss_apart = _both(current, rows)
    return RigSolution(
        seen=seen, rows=rows, adjusted=current, alone=alone, joint=joint, apart=tuple(apart), rss_apart=rss_apart,
        warp=tested, shape=shape, flat_shape=flat, is_lifted=lifted,
    )  # fmt: skip


def _counted(seen: RigObservations, eyes: Sequence[Eye]) -> IntArray:
    """Return the views, (S, C), that are used by their camera's own solution; a shot may have none."""
    rows = seen.rows.copy()
    for camera, eye in enumerate(eyes):
        rows[~np.isin(rows[:, camera], list(eye.poses)), camera] = -1
    return rows


def _spread(rows: IntArray, apart: Sequence[tuple[int, int]]) -> IntArray:
    """Return the rows, (V, C), with a separate row for each of some views."""
    kept, further = rows.copy(), []
    for shot, camera in apart:
        alone = np.full(rows.shape[1], -1)
        alone[camera] = rows[shot, camera]
        kept[shot, camera] = -1
        further.append(alone)
    return np.concatenate([kept, np.array(further, dtype=rows.dtype).reshape(-1, rows.shape[1])])


def _begun(
    seen: RigObservations,
    eyes: Sequence[Eye],
    places: Sequence[Place],
    rows: IntArray,
    current: Adjusted[RigLens] | None = None,
) -> Adjusted[RigLens]:
    """Return the minimum on a flat board, starting from the cameras' own solutions or from a current one."""
    noise = tuple(eye.noise_px for eye in eyes)
    network = rig_network(seen, [eye.kept for eye in eyes], noise, rows)
    corners = network.seen.shape[1] // len(eyes)
    lens = RigLens(names=seen.names, models=tuple(eye.model for eye in eyes), noise_px=noise, corners=corners)
    parameters = lens.of([eye.parameters for eye in eyes], places[1:])
    if current is not None:
        parameters = current.state.parameters
    rotations, translations = (
        np.tile(np.eye(3), (len(rows), 1, 1)),
        np.tile([0.0, 0.0, 1000.0], (len(rows), 1)),
    )
    for row, views in enumerate(rows):
        with_view = [(int(eyes[c].kept[v].sum()), -c) for c, v in enumerate(views) if v >= 0]
        if with_view:
            camera = -max(with_view)[1]
            R, t = eyes[camera].poses[views[camera]]
            back = lens.place(parameters, camera).inverse
            rotations[row], translations[row] = back.rotation @ R, back.rotation @ t + back.translation
    state = State(
        model=lens, parameters=parameters, warp=np.zeros(2), rotations=rotations, translations=translations
    )
    return adjust(network, adjust(network, state, poses_only=True).state)


def _contradicting(
    seen: RigObservations, current: Adjusted[RigLens], rows: IntArray, already: Sequence[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Return (shot, camera) of views that contradict one common pose, unless most shots do."""
    alone, joint, _ = _both(current, rows)
    noise = np.array(current.state.model.noise_px)
    with np.errstate(invalid="ignore"):
        excess = np.sqrt(np.maximum(joint**2 - alone**2, 0.0)) / noise
    shots = rows[: len(seen.shots)]
    shared = (shots >= 0).sum(axis=1) >= 2
    excess = np.where((shots >= 0) & shared[:, None], excess[: len(shots)], np.nan)
    if not shared.any():
        return []
    by_shot = np.full(len(shots), np.nan)
    by_shot[shared] = np.nanmax(excess[shared], axis=1)
    middle = float(np.nanmedian(by_shot))
    spread = NORMAL_MAD * float(np.nanmedian(np.abs(by_shot - middle)))
    limit = max(middle + OUTSTANDING * spread, LEAST_EXCESS)
    worst = [int(shot) for shot in np.flatnonzero(by_shot > limit)]
    if len({shot for shot, _ in already} | set(worst)) > MOST_SHOTS * int(shared.sum() + len(already)):
        return []
    found: list[tuple[int, int]] = []
    for shot in worst:
        cameras = np.flatnonzero(shots[shot] >= 0)
        # If two cameras disagree, either may be wrong: each gets its own pose.
        out = cameras[1:] if len(cameras) == 2 else [int(np.nanargmax(excess[shot]))]
        found += [(shot, int(camera)) for camera in out]
    return found


def _both(current: Adjusted[RigLens], rows: IntArray) -> tuple[FloatArray, FloatArray, float]:
    """Return RMS residuals with a pose per view and with one per row, (V, C) px, and the former's sum of squares."""
    lens, network, state = current.state.model, current.network, current.state
    cameras = len(lens.names)
    taken = np.argwhere(rows >= 0)
    joint, alone = np.full(rows.shape, np.nan), np.full(rows.shape, np.nan)
    if not len(taken):
        return alone, joint, 0.0
    mask = np.zeros((len(taken), network.seen.shape[1]), dtype=np.bool_)
    for at, (row, camera) in enumerate(taken):
        mask[at, lens.block(camera)] = network.seen[row, lens.block(camera)]
    by_view = taken[:, 0]
    apart = adjust(network.views(by_view).only(mask), state.views(by_view), poses_only=True)
    noise = np.array(lens.noise_px)
    for residuals, table in ((current.linear.residuals, joint), (apart.linear.residuals, alone)):
        squares = (residuals.reshape(len(residuals), cameras, -1) ** 2).sum(axis=2)
        for at, (row, camera) in enumerate(taken):
            counted = int(mask[at].sum())
            total = squares[row if table is joint else at, camera]
            table[row, camera] = noise[camera] * np.sqrt(total / max(counted, 1))
    return alone, joint, apart.rss


def _reweighed(current: Adjusted[RigLens]) -> Adjusted[RigLens]:
    """Return the minimum with the noise of each camera estimated from its current residuals."""
    lens, network = current.state.model, current.network
    cameras, redundancy = len(lens.names), current.dof / max(network.scalars, 1)
    squares = (current.linear.residuals.reshape(len(network.seen), cameras, -1) ** 2).sum(axis=(0, 2))
    counts = 2 * network.seen.reshape(len(network.seen), cameras, -1).sum(axis=(0, 2))
    ratio = np.sqrt(squares / np.maximum(counts, 1) / max(redundancy, 1e-3))
    if (np.abs(ratio - 1) < SAME_NOISE).all() or not (ratio > 0).all():
        return current
    by_corner = np.repeat(ratio, lens.corners)
    weighed = replace(lens, noise_px=tuple((np.array(lens.noise_px) * ratio).tolist()))
    rescaled = replace(network, pixels=network.pixels / by_corner[None, :, None])
    return adjust(
        rescaled,
        replace(current.state, model=weighed),
        warp=len(current.free) > len(current.state.parameters),
    )
