"""Rig calibration from corners of several cameras: lenses, poses, uncertainty and verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.assessment import Joint, Solved, assess
from calibrary.calib.board import Board
from calibrary.calib.board_shape import stretch
from calibrary.calib.covariance import parameter_covariance
from calibrary.calib.estimation import solved_views
from calibrary.calib.lens_series import series_shift
from calibrary.calib.model_choice import f_test
from calibrary.calib.observations import Observations
from calibrary.calib.opencv_state import one_blas_thread
from calibrary.calib.result import CalibrationResult
from calibrary.calib.rig.causes import RigTrouble, moved_camera, swapped_images
from calibrary.calib.rig.lens import Place, RigLens
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.rig.solve import RigSolution, solve_rig
from calibrary.calib.rig.start import HALF_TURN, Eye, Link, eye_of, links, turns
from calibrary.calib.rig.verdict import RIG_LIMITS, Mispaired, RigEvidence, RigLimits, is_loose, judge_rig
from calibrary.calib.variance_factor import SplitHalf, split_half
from calibrary.calib.verdict import LIMITS, BoardVerdict, Limits
from calibrary.calibration import Covariance, ImageSize
from calibrary.errors import CalibrationError, InputError
from calibrary.records import Record, replace
from calibrary.rig import RigPose, turn_jacobian
from calibrary.validation import Finding


class ShotResult(Record):
    """One shot with views of two or more cameras.

    Attributes:
        name: name of the shot.
        rms_px: reprojection error (RMS) by camera, with one pose of the board for all cameras.
        alone_px: the same with the best pose for each camera.
        apart: cameras with a separate pose, because the shot contradicts the rig.
    """

    name: str
    rms_px: Mapping[str, float]
    alone_px: Mapping[str, float]
    apart: tuple[str, ...]


class RigResult(Struct, frozen=True, kw_only=True, eq=False):
    """A rig calibration with its findings and evidence.

    Attributes:
        cameras: calibration of each camera, the reference first; if the rig was not solved, from each camera alone.
        poses: poses relative to the reference camera, with covariance; empty if the rig was not solved.
        findings: problems of the rig; those of a camera are in its calibration.
        evidence: measurements that the verdict is based on.
        limits: limits of the verdict.
        shots: shots of two or more cameras.
        observations: input of the calibration.
    """

    cameras: Mapping[str, CalibrationResult]
    poses: Mapping[str, RigPose]
    findings: tuple[Finding, ...]
    evidence: RigEvidence
    limits: RigLimits
    shots: tuple[ShotResult, ...]
    observations: RigObservations

    @property
    def verdict(self) -> BoardVerdict:
        """Verdict on the rig, decided by the worst finding."""
        return BoardVerdict.of(self.findings)

    @property
    def reference(self) -> str:
        """Name of the reference camera, which the poses refer to."""
        return next(iter(self.cameras))


@one_blas_thread()
def estimate_rig(
    observations: RigObservations,
    model: str = "auto",
    *,
    warp: bool = True,
    limits: Limits = LIMITS,
    rig_limits: RigLimits = RIG_LIMITS,
) -> RigResult:
    """Calibrate the cameras of a rig and their relative poses.

    Args:
        observations: views of one board by the cameras of one rig.
        model: lens model of all cameras, or "auto" to choose one for each camera.
        warp: whether the board warp may be estimated.
        limits: limits of the cameras' verdicts.
        rig_limits: limits of the rig's verdict.

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
    evidence = RigEvidence(
        verdicts={},
        shared={seen.names[link.camera]: len(link.shots) for link in tied},
        untied=untied,
        mispaired=tuple(_mispaired(seen, link) for link in tied if link.place is None),
        troubles=_troubles(seen, eyes, tied),
    )
    if placed is None:
        results = {name: assess(one, limits) for name, one in zip(seen.names, alone, strict=True)}
        return _judged(
            results, {}, replace(evidence, verdicts=_verdicts(results)), rig_limits, (), observations
        )
    solution = solve_rig(seen, eyes, placed, warp=warp)
    return _assessed(observations, solution, alone, evidence, limits, rig_limits)


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


def _mispaired(seen: RigObservations, link: Link) -> Mispaired:
    kind, by = link.mispairing or (None, 0)
    return Mispaired(
        kind=kind,
        camera=seen.names[link.camera],
        other=seen.names[link.other],
        by=by,
        miss_px=float(min(np.median(link.miss_px), link.width)),
    )


def _troubles(seen: RigObservations, eyes: Sequence[Eye], tied: Sequence[Link]) -> tuple[RigTrouble, ...]:
    able = [link for link in tied if link.mispairing is None]
    found = [swapped_images(seen, eyes, link) or moved_camera(seen, eyes, link) for link in able]
    return tuple(one for one in found if one is not None)


def _assessed(
    observations: RigObservations,
    solution: RigSolution,
    alone: Sequence[Solved],
    evidence: RigEvidence,
    limits: Limits,
    rig_limits: RigLimits,
) -> RigResult:
    adjusted, lens = solution.adjusted, solution.lens
    halves = split_half(adjusted, of=slice(lens.place_of(1).start, len(lens.parameters)))
    own = [split_half(adjusted, of=lens.lens_of(camera)) for camera in range(len(alone))]
    eyes = [solution.eye(camera, one.solution) for camera, one in enumerate(alone)]
    inflation = max(1.0, halves.kappa2) if halves is not None else 1.0
    C = _covariance(solution, [eye.adjusted for eye in eyes], own, halves, limits)
    excess, p = _rigidity(solution)
    noise = float(np.sqrt(np.nanmax(np.nanmean(solution.alone**2, axis=0)) / 2))
    evidence = replace(evidence, excess_px=excess, noise_px=noise, rigid_p=p)
    if is_loose(evidence, rig_limits):
        # Lenses fitted to a common pose that does not exist are worse than those of each camera alone.
        results = {name: assess(one, limits) for name, one in zip(lens.names, alone, strict=True)}
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
                limits,
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
    evidence = replace(
        evidence,
        verdicts=_verdicts(results),
        cross_px=cross,
        kappa2=halves.kappa2 if halves is not None else None,
        apart=tuple((solution.seen.shots[shot], lens.names[camera]) for shot, camera in solution.apart),
        shots=int(((solution.rows >= 0).sum(axis=1) >= 2).sum()),
    )
    poses = {name: _pose(solution, C * inflation, camera) for camera, name in enumerate(lens.names) if camera}
    return _judged(results, poses, evidence, rig_limits, _shots(solution), observations)


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
    limits: Limits,
) -> FloatArray:
    """Return the (n, n) covariance of lenses and poses, including the effect of models that were not used."""
    adjusted, lens = solution.adjusted, solution.lens
    is_lifted = solution.is_lifted and solution.shape is not None
    C = solution.shape.covariance if is_lifted and solution.shape else parameter_covariance(adjusted)
    factors = [max(1.0, half.kappa2) if half is not None else 1.0 for half in (*own, halves)]
    contradicted = factors[-1] > limits.kappa2_wanted
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


def _verdicts(results: Mapping[str, CalibrationResult]) -> dict[str, BoardVerdict]:
    return {name: result.verdict for name, result in results.items()}


def _judged(
    results: Mapping[str, CalibrationResult],
    poses: Mapping[str, RigPose],
    evidence: RigEvidence,
    limits: RigLimits,
    shots: tuple[ShotResult, ...],
    observations: RigObservations,
) -> RigResult:
    return RigResult(
        cameras=results,
        poses=poses,
        findings=judge_rig(evidence, limits),
        evidence=evidence,
        limits=limits,
        shots=shots,
        observations=observations,
    )


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
