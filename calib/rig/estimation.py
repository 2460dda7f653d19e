"""Rig calibration from corners of several cameras: lenses, poses, uncertainty and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.adjustment import Adjusted, adjust, parameter_covariance
from calibrary.calib.assessment import Joint, Solved, assess
from calibrary.calib.board import Board
from calibrary.calib.board_shape import BoardShape, board_shape, laid_on, stretch
from calibrary.calib.estimation import solved_views
from calibrary.calib.lens_series import series_shift
from calibrary.calib.model_choice import WarpTest, f_test, with_warp
from calibrary.calib.network import Network, State, linearise
from calibrary.calib.observations import Observations
from calibrary.calib.opencv_state import one_blas_thread
from calibrary.calib.rig.causes import mispaired, moved_camera, swapped_images
from calibrary.calib.rig.lens import Place, RigLens
from calibrary.calib.rig.observations import RigObservations, rig_network
from calibrary.calib.rig.start import HALF_TURN, Eye, Link, eye_of, links, turns
from calibrary.calib.rig.verdict import RigResult, ShotResult
from calibrary.calib.solve import Solution
from calibrary.calib.variance_factor import SplitHalf, split_half
from calibrary.calib.verdict import LIMITS
from calibrary.calibration import Covariance, ImageSize
from calibrary.errors import CalibrationError, InputError
from calibrary.policy import FLEET, Policy
from calibrary.records import replace
from calibrary.rig import RigPose, turn_jacobian
from calibrary.validation import Finding

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


@one_blas_thread()
def estimate_rig(
    observations: RigObservations,
    model: str = "auto",
    *,
    warp: bool = True,
    policy: Policy = FLEET,
) -> RigResult:
    """Calibrate the cameras of a rig and their relative poses.

    Args:
        observations: views of one board by the cameras of one rig.
        model: lens model of all cameras, or "auto" to choose one for each camera.
        warp: whether the board warp may be estimated.
        policy: limits of σ for each use.

    Raises:
        InputError: the observations are inconsistent, or the scale of the board is unknown.
        CalibrationError: the views do not determine a camera.
    """
    board = observations.cameras[observations.names[0]].board
    if isinstance(board, Board):
        board.scale_mm("a rig, whose cameras have distances,")
    alone = [_alone(name, seen, model, warp=warp) for name, seen in observations.cameras.items()]
    seen = _usable(observations, alone)
    eyes = [eye_of(one.solution, one.usable.views) for one in alone]
    seen, eyes, tied = _tied(seen, eyes)
    untied = [name for at, name in enumerate(seen.names) if at and at not in {link.camera for link in tied}]
    placed = _places(tied, len(eyes))
    measured = RigResult(
        observations=observations,
        shared={seen.names[link.camera]: len(link.shots) for link in tied},
        untied=untied,
        mispaired=tuple(mispaired(seen, link) for link in tied if link.place is None),
        troubles=_troubles(seen, eyes, tied),
    )
    if placed is None:
        results = {name: assess(one, policy=policy) for name, one in zip(seen.names, alone, strict=True)}
        return replace(measured, cameras=results)
    solution = solve_rig(seen, eyes, placed, warp=warp)
    return _assessed(solution, alone, measured, policy)


def _alone(name: str, seen: Observations, model: str, *, warp: bool) -> Solved:
    try:
        return solved_views(seen, model, warp=warp)
    except CalibrationError as error:
        raise CalibrationError(f"{name}: {error}") from None
    except InputError as error:
        raise InputError(error.message, source=f"{name}: {error.source}" if error.source else name) from None


def _usable(observations: RigObservations, alone: Sequence[Solved]) -> RigObservations:
    """Remove the views for which no pose can be determined."""
    rows = observations.rows.copy()
    for camera, one in enumerate(alone):
        kept = [view for view in range(len(one.observations.views)) if view not in one.dropped]
        place = {view: at for at, view in enumerate(kept)}
        rows[:, camera] = [place.get(view, -1) for view in rows[:, camera].tolist()]
    some: BoolArray = np.asarray((rows >= 0).any(axis=1))
    return RigObservations(
        cameras={name: one.usable for name, one in zip(observations.names, alone, strict=True)},
        shots=tuple(name for name, keep in zip(observations.shots, some.tolist(), strict=True) if keep),
        rows=rows[some],
    )


def _tied(seen: RigObservations, eyes: Sequence[Eye]) -> tuple[RigObservations, list[Eye], list[Link]]:
    """Return the links, with the corners of all cameras counted from the same end of the board."""
    eyes = list(eyes)
    for camera in [link.camera for link in links(seen, eyes)]:
        link = next(link for link in links(seen, eyes) if link.camera == camera)
        views = turns(seen, eyes, link)
        if views:
            poses = eyes[camera].poses
            turned = {at: (R @ HALF_TURN, t) if at in views else (R, t) for at, (R, t) in poses.items()}
            seen, eyes[camera] = seen.turned(camera, views), replace(eyes[camera], poses=turned)
    return seen, eyes, links(seen, eyes)


def _places(tied: Sequence[Link], count: int) -> list[Place] | None:
    """Return every camera's pose relative to the reference; None if one is undetermined."""
    found = {0: Place(rotation=np.eye(3), translation=np.zeros(3))}
    for link in tied:
        if link.place is None or link.other not in found:
            return None
        found[link.camera] = link.place.after(found[link.other])
    return [found[camera] for camera in range(count)] if len(found) == count else None


def _troubles(seen: RigObservations, eyes: Sequence[Eye], tied: Sequence[Link]) -> tuple[Finding, ...]:
    able = [link for link in tied if link.mispairing is None]
    found = [swapped_images(seen, eyes, link) or moved_camera(seen, eyes, link) for link in able]
    return tuple(one for one in found if one is not None)


def _assessed(
    solution: RigSolution,
    alone: Sequence[Solved],
    measured: RigResult,
    policy: Policy,
) -> RigResult:
    adjusted, lens = solution.adjusted, solution.lens
    halves = split_half(adjusted, of=slice(lens.place_of(1).start, len(lens.parameters)))
    own = [split_half(adjusted, of=lens.lens_of(camera)) for camera in range(len(alone))]
    eyes = [solution.eye(camera, one.solution) for camera, one in enumerate(alone)]
    inflation = max(1.0, halves.kappa2) if halves is not None else 1.0
    C = _covariance(solution, [eye.adjusted for eye in eyes], own, halves)
    excess, p = _rigidity(solution)
    noise = float(np.sqrt(np.nanmax(np.nanmean(solution.alone**2, axis=0)) / 2))
    measured = replace(measured, excess_px=excess, noise_px=noise, rigid_p=p)
    if measured.is_loose:
        # Lenses fitted to a common pose that does not exist are worse than those of each camera alone.
        results = {name: assess(one, policy=policy) for name, one in zip(lens.names, alone, strict=True)}
    else:
        results = {
            name: assess(
                replace(
                    one,
                    observations=_as_turned(one, solution.seen.cameras[name]),
                    usable=solution.seen.cameras[name],
                    solution=eye,
                    shape=solution.shape,
                    flat_shape=solution.flat_shape,
                    joint=Joint(
                        covariance=Covariance.from_matrix(model.parameters, C[at, at]),
                        halves=half,
                    ),
                ),
                policy=policy,
            )
            for name, model, at, one, eye, half in zip(
                lens.names, lens.models, map(lens.lens_of, range(len(alone))), alone, eyes, own, strict=True
            )
        }
    distance = float(np.median(np.linalg.norm(adjusted.state.translations[adjusted.network.used], axis=1)))
    sizes = [one.image_size for one in solution.seen.cameras.values()]
    cross = {
        name: (
            cross_std_px(adjusted, C * inflation, camera, (sizes[0], sizes[camera]), distance),
            cross_std_px(adjusted, C * inflation, camera, (sizes[0], sizes[camera]), distance * FAR),
        )
        for camera, name in enumerate(lens.names)
        if camera
    }
    return replace(
        measured,
        cameras=results,
        poses={
            name: _pose(solution, C * inflation, camera) for camera, name in enumerate(lens.names) if camera
        },
        cross_px=cross,
        kappa2=halves.kappa2 if halves is not None else None,
        apart=tuple((solution.seen.shots[shot], lens.names[camera]) for shot, camera in solution.apart),
        joint=int(((solution.rows >= 0).sum(axis=1) >= 2).sum()),
        shots=_shots(solution),
    )


def _as_turned(one: Solved, usable: Observations) -> Observations:
    """Return all input views, with the corners counted as in the rig."""
    views = iter(usable.views)
    return replace(
        one.observations,
        views=tuple(
            view if at in one.dropped else next(views) for at, view in enumerate(one.observations.views)
        ),
    )


def _covariance(
    solution: RigSolution,
    eyes: Sequence[Adjusted],
    own: Sequence[SplitHalf | None],
    halves: SplitHalf | None,
) -> FloatArray:
    """Return the (n, n) covariance of lenses and poses, including the effect of models that were not used."""
    adjusted, lens = solution.adjusted, solution.lens
    is_lifted = solution.is_lifted and solution.shape is not None
    C = solution.shape.covariance if is_lifted and solution.shape else parameter_covariance(adjusted)
    factors = [max(1.0, half.kappa2) if half is not None else 1.0 for half in (*own, halves)]
    contradicted = factors[-1] > LIMITS.kappa2_wanted
    shifts = []
    if solution.flat_shape is not None and (contradicted or not is_lifted):
        shifts.append(solution.flat_shape.shift)
    stretched = stretch(adjusted)
    shifts += [stretched[1]] if stretched is not None else []
    for camera, (eye, factor) in enumerate(zip(eyes, factors[:-1], strict=True)):
        size = solution.seen.cameras[lens.names[camera]].image_size
        shift, at = series_shift(eye, size, factor), lens.lens_of(camera)
        if shift is not None:
            # Change of the poses that corresponds to this change of the lens.
            shifts.append(C[:, at] @ np.linalg.lstsq(C[at, at], shift, rcond=1e-12)[0])
    by_block = np.full(len(C), 1 / np.sqrt(factors[-1]))
    for camera, factor in enumerate(factors[:-1]):
        by_block[lens.lens_of(camera)] = 1 / np.sqrt(factor)
    between = sum((np.outer(shift, shift) for shift in shifts), np.zeros_like(C))
    return np.asarray(C + between * np.outer(by_block, by_block))


def _rigidity(solution: RigSolution) -> tuple[float, float]:
    """Return (px, p): the residuals added by one common pose for all cameras, and their p-value under noise."""
    adjusted, together = solution.adjusted, (solution.rows >= 0).sum(axis=1)
    shared = together >= 2
    if not shared.any():
        return 0.0, 1.0
    gap = solution.joint[shared] ** 2 - solution.alone[shared] ** 2
    extra = 6 * int((together[shared] - 1).sum()) - 6 * (len(solution.lens.names) - 1)
    if extra <= 0:
        return 0.0, 1.0
    p = f_test(adjusted.rss, min(solution.rss_apart, adjusted.rss), extra, adjusted.dof - extra)[1]
    return float(np.sqrt(max(float(np.nanmean(gap)), 0.0))), p


def _pose(solution: RigSolution, covariance: FloatArray, camera: int) -> RigPose:
    place, at = solution.place(camera), solution.lens.place_of(camera)
    J = turn_jacobian(place.rotation)
    return RigPose.of(place.rotation, place.translation, J @ covariance[at, at] @ J.T)


def _shots(solution: RigSolution) -> tuple[ShotResult, ...]:
    """Return the shots of two or more cameras, in the order of exposure."""
    names, apart, found = solution.lens.names, set(solution.apart), []
    further = {pair: len(solution.seen.shots) + at for at, pair in enumerate(solution.apart)}
    for shot, name in enumerate(solution.seen.shots):
        at = {camera: further.get((shot, camera), shot) for camera in range(len(names))}
        rms = {
            names[c]: float(solution.joint[row, c])
            for c, row in at.items()
            if np.isfinite(solution.joint[row, c])
        }
        alone = {names[c]: float(solution.alone[row, c]) for c, row in at.items() if names[c] in rms}
        if len(rms) >= 2:
            out = tuple(names[c] for c in at if (shot, c) in apart)
            found.append(ShotResult(name=name, rms_px=rms, alone_px=alone, apart=out))
    return tuple(found)


GRID: Final = (9, 7)
FAR: Final = 1e3
"""Multiple of the board distance that stands for infinity."""


def cross_std_px(
    adjusted: Adjusted[RigLens],
    covariance: FloatArray,
    camera: int,
    sizes: tuple[ImageSize, ImageSize],
    distance_mm: float,
) -> float | None:
    """Return σ of the predicted pixel in a camera for a point seen by the reference camera (RMS over the overlap), px.

    Args:
        adjusted: the rig.
        covariance: (n, n) covariance of its parameters.
        camera: index of the camera, not the reference.
        sizes: (width, height) px of the reference camera and of this one.
        distance_mm: distance of the point along the reference camera's axis, mm.

    Returns:
        The standard deviation; None if the two have no common field of view at this distance.
    """
    state, lens = adjusted.state, adjusted.state.model
    values = state.parameters
    first, second = lens.lens_of(0), lens.lens_of(camera)
    points = _plane_points(lens, values[first], sizes[0], distance_mm)
    place = lens.place(values, camera)
    inside = points @ place.rotation.T + place.translation
    points, inside = points[inside[:, 2] > 0], inside[inside[:, 2] > 0]
    pixels = lens.models[camera].project(values[second], inside)[0]
    # A lens is extrapolated outside its image, where nothing can be seen.
    there = ((pixels > 0) & (pixels < sizes[1])).all(axis=1)
    if not there.any():
        return None
    points, inside = points[there], inside[there]
    _, by_own, by_point = lens.models[0].project(values[first], points)
    # The point keeps its pixel and depth in the reference camera when that camera's lens changes.
    moved = -np.linalg.solve(by_point[:, :, :2], by_own)
    _, by_lens, by_inside = lens.models[camera].project(values[second], inside)
    slope = np.zeros((len(points), 2, len(values)))
    slope[:, :, second] = by_lens
    slope[:, :, first] += (by_inside @ place.rotation)[:, :, :2] @ moved
    at, one = lens.place_of(camera), replace(lens, corners=1)
    with np.errstate(all="ignore"):
        # Other cameras may not see the point; their blocks are ignored.
        everywhere = one.project(values, np.repeat(points[:, None], len(lens.names), axis=1))[1]
    by_place = everywhere[:, camera, :, at] * lens.noise_px[camera]
    slope[:, :, at] = by_place
    variance = np.einsum("nip,pq,niq->ni", slope, covariance, slope).sum(axis=1)
    return float(np.sqrt(max(float(variance.mean()), 0.0)))


def _plane_points(lens: RigLens, values: FloatArray, size: ImageSize, distance_mm: float) -> FloatArray:
    """Return points on a plane across the reference camera's axis, (N, 3) mm, seen over its whole image."""
    width, height = size
    x, y = np.meshgrid(np.linspace(0, width, GRID[0] + 2)[1:-1], np.linspace(0, height, GRID[1] + 2)[1:-1])
    model = lens.models[0]
    named = dict(zip(model.parameters, values.tolist(), strict=True))
    observed = np.column_stack(
        [(x.ravel() - named["cx"]) / named["fx"], (y.ravel() - named["cy"]) / named["fy"]]
    )
    rays = model.distortion(named).undistort_to_rays(observed)
    rays = rays[np.isfinite(rays).all(axis=1)]
    rays = rays[rays[:, 2] > 0.05]
    return np.asarray(rays / rays[:, 2:] * distance_mm)
