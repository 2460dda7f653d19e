"""Assessment of a solution: covariance, comparison of halves of the views, and findings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.adjustment import UNDETERMINED, Adjusted, culprits, lens_covariance
from calibrary.calib.board import Board
from calibrary.calib.board_shape import BoardShape, Stretch, stretch
from calibrary.calib.budget import EXPECTED_KAPPA2, Budget, Part, budget_of
from calibrary.calib.corners_file import corners_sha256
from calibrary.calib.geometry import Geometry, geometry, inside_circle, near_corners, proven
from calibrary.calib.least_squares import condition, solution_of
from calibrary.calib.lens_models import Solvable
from calibrary.calib.lens_series import series_shift
from calibrary.calib.misfit import Misfit, corner_noise, misfit
from calibrary.calib.model_choice import CLEARLY, Candidate, RivalLens, WarpTest, sound_share, with_warp
from calibrary.calib.network import State
from calibrary.calib.observations import Observations, View
from calibrary.calib.projection_difference import (
    ProjectionDifference,
    Uncertainty,
    pixel_grid,
    projection_difference,
    projection_uncertainty,
)
from calibrary.calib.rejection import in_px, residual_lengths, view_rms
from calibrary.calib.residual_field import Field, residual_field
from calibrary.calib.result import (
    LENGTH_UNITS,
    CalibrationResult,
    Dismissal,
    DismissalReason,
    RejectedCorner,
    ViewResult,
    Warp,
    finite,
    numbers,
    rows,
)
from calibrary.calib.solve import Solution
from calibrary.calib.variance_factor import SplitHalf, split_half
from calibrary.calib.verdict import BOARD, LIMITS, Departure, Evidence, Limits, Subject, uses_of
from calibrary.calib.verdict_rules import graver_first, judge
from calibrary.calibration import (
    Calibration,
    Covariance,
    Grade,
    Provenance,
    Quality,
    SourceFile,
)
from calibrary.errors import CalibrationError, InputError
from calibrary.extras import programs, versions_in_words
from calibrary.policy import FLEET, Policy
from calibrary.quality import Proven
from calibrary.records import replace
from calibrary.validation import Finding, Severity, Use

MAP_SHAPE: Final = (27, 21)


class Joint(Struct, frozen=True, kw_only=True, eq=False):
    """Uncertainty of a camera that was solved together with other cameras, or with the points of a scene.

    Attributes:
        covariance: covariance of the lens parameters.
        halves: comparison of the lenses from two halves of the views.
        rivals: lenses of other models that explain the observations as well.
    """

    covariance: Covariance
    halves: SplitHalf | None
    rivals: tuple[RivalLens, ...] = ()


class Solved(Struct, frozen=True, kw_only=True, eq=False):
    """The solution of a camera, before its assessment.

    Attributes:
        observations: input of the solution.
        usable: views for which a pose can be determined; they correspond to the rows of the solution.
        dropped: reasons for dropping the other views, by index.
        solution: lens, warp and poses.
        asked_warp: whether the board warp was to be estimated.
        shape: board shape used in the solution; None for points without a board.
        flat_shape: board shape estimated from the residuals of a flat board.
        joint: uncertainty, if the camera was solved together with other cameras or with scene points.
        versions: versions of the programs used; None for those of a board calibration.
        subject: what it was calibrated from, in words.
        further: findings that are not of the camera alone.
    """

    observations: Observations
    usable: Observations
    dropped: Mapping[int, Dismissal]
    solution: Solution
    asked_warp: bool
    shape: BoardShape | None
    flat_shape: BoardShape | None
    joint: Joint | None = None
    versions: Mapping[str, str] | None = None
    subject: Subject = BOARD
    further: tuple[Finding, ...] = ()


def assess(
    solved: Solved,
    limits: Limits = LIMITS,
    policy: Policy = FLEET,
    *,
    seed: int = 0,
) -> CalibrationResult:
    """Return the calibration with its uncertainty and verdict.

    Args:
        solved: the solution.
        limits: limits of the verdict.
        policy: limits of σ for each use.
        seed: random seed for splitting the views into halves.

    Raises:
        CalibrationError: the corners do not determine a camera.
    """
    observations, usable, solution = solved.observations, solved.usable, solved.solution
    adjusted = solution.adjusted
    halves = solved.joint.halves if solved.joint is not None else split_half(adjusted, seed=seed)
    # The warp is tested even if it was not to be estimated: the remaining residuals reveal other faults.
    untested = adjusted.network.is_planar and not solved.asked_warp
    tested, explained = with_warp(adjusted) if untested else (solution.warp, adjusted)
    stretched, noise = stretch(explained), corner_noise(usable)
    faults = misfit(explained, usable.image_size, noise)
    shifts: list[tuple[Part, FloatArray]] = []
    if solved.joint is None:
        shifts = _shifts(solved, halves, stretched[1] if stretched is not None else None, limits)
    covariance = (
        solved.joint.covariance if solved.joint is not None else _own_covariance(solved, halves, shifts)
    )
    versions = solved.versions or programs("cv2")
    shown = geometry(adjusted, usable.image_size)
    calibration = _calibration(solved, covariance, halves, shown.coverage.fraction, versions)
    calibration, uncertainty, field, rival = _over_frame(calibration, solved)
    corners = adjusted.network.pixels[adjusted.network.seen]
    where = (
        proven(
            uncertainty,
            corners,
            usable.image_size,
            limit_px=policy.fixed_sigma_px,
            circle=observations.circle,
        )
        if uncertainty is not None
        else None
    )
    quality = replace(calibration.quality or Quality(), proven=where)
    calibration = replace(calibration, quality=quality)
    views = _views(observations, usable, solution, solved.dropped)
    judged = _evidence(
        solved,
        quality,
        shown,
        views=views,
        budget=_budget(adjusted.state, quality, quality.covariance or covariance, shifts, field),
        proven=where,
        departure=_departure(field, uncertainty, observations, corners),
        rival=rival,
        warp=tested,
        faults=faults,
        noise=noise,
        longer=stretched[0] if stretched is not None else None,
    )
    findings = graver_first((*judge(judged, limits, policy), *solved.further))
    verdict, differ = Use.of(findings), _between_halves(calibration, adjusted.state.model, halves)
    # A refused calibration is usable only as a start value.
    grade = Grade.SEED if verdict is Use.NONE else solved.subject.grade
    board = observations.board
    return CalibrationResult(
        verdict=verdict,
        uses=uses_of(judged, findings, policy),
        findings=findings,
        calibration=replace(calibration, notes=tuple(notes_of(findings)), grade=grade),
        target=str(board),
        board=board if isinstance(board, Board) else None,
        model=adjusted.state.model,
        candidates=solution.candidates,
        warp=Warp(lift=tested.warp_mm, f=finite(tested.f), p=tested.p, kept=judged.is_warped)
        if tested
        else None,
        views=views,
        geometry=shown,
        length_unit=LENGTH_UNITS.get(judged.unit, "squares"),
        noise_px=noise,
        condition=finite(judged.condition),
        kappa2_by_split=halves.by_split if halves is not None else (),
        stretch=judged.stretch,
        misfit=faults,
        uncertainty_px=rows(uncertainty.std_px) if uncertainty is not None else None,
        half_difference_px=tuple(map(rows, differ.vectors)) if differ is not None else None,
        limits=limits,
        versions=versions,
        evidence=judged,
        uncertainty=uncertainty,
        observations=observations,
        policy=policy,
    )


def _evidence(  # noqa: PLR0913  one measurement each
    solved: Solved,
    quality: Quality,
    shown: Geometry,
    *,
    views: Sequence[ViewResult],
    budget: tuple[float, Budget],
    proven: Proven | None,
    departure: Departure | None,
    rival: tuple[Solvable, float] | None,
    warp: WarpTest | None,
    faults: Misfit | None,
    noise: float | None,
    longer: Stretch | None,
) -> Evidence:
    """Collect the measurements for the verdict."""
    usable, solution = solved.usable, solved.solution
    adjusted = solution.adjusted
    return Evidence(
        image_size=usable.image_size,
        subject=solved.subject,
        is_board=adjusted.network.is_planar,
        views=quality.views or 0,
        views_shown=len(solved.observations.views),
        repeats=len(solution.repeats),
        views_out=sum(
            view.without is not None and view.without.reason is DismissalReason.MISFIT for view in views
        ),
        corners_out=sum(len(view.corners_out) for view in views),
        geometry=shown,
        fx=budget[0],
        budget=budget[1],
        kappa2=quality.kappa2,
        rms_px=adjusted.rms_px,
        noise_px=noise,
        condition=condition(adjusted.reduced.matrix),
        model=adjusted.state.model,
        culprits=culprits(adjusted),
        sound=sound_share(adjusted, usable.image_size),
        better=_better(solution),
        proven=proven,
        departure=departure,
        rival=rival,
        near=_share_near(adjusted, solved.observations),
        warp=warp,
        is_warped=solution.is_warped,
        shape=solved.shape,
        is_lifted=solution.is_lifted,
        stretch=longer,
        misfit=faults,
        focus=usable.focus,
        unit=usable.board.unit,
    )


def _shifts(
    solved: Solved,
    halves: SplitHalf | None,
    stretched: FloatArray | None,
    limits: Limits,
) -> list[tuple[Part, FloatArray]]:
    """Return by how much models that were not used would move the lens parameters, (n,) each."""
    solution, before = solved.solution, solved.flat_shape
    contradicted = halves is not None and halves.kappa2 > limits.kappa2_wanted
    shifts = []
    # If the views contradict one another, warp and lifts may have absorbed something other than the board's shape.
    if before is not None and (contradicted or not solution.is_lifted):
        shifts.append((Part.BOARD_SHAPE, before.shift))
    if contradicted and solution.is_warped:
        shifts.append((Part.BOARD_SHAPE, shift_by_warp(solution.adjusted)))
    if stretched is not None:
        shifts.append((Part.STRETCHED_PRINT, stretched))
    further = series_shift(solution.adjusted, solved.usable.image_size, _inflation(halves))
    if further is not None:
        shifts.append((Part.LENS_SERIES, further))
    return shifts


def _inflation(halves: SplitHalf | None) -> float:
    return max(1.0, halves.kappa2) if halves is not None else 1.0


def _own_covariance(
    solved: Solved, halves: SplitHalf | None, shifts: Sequence[tuple[Part, FloatArray]]
) -> Covariance:
    """Return the covariance of a camera solved alone: from the residuals, and about the choice of the model.

    A shift d of the parameters under a larger model adds d·dᵀ (between-model variance of model averaging). It is not
    noise, so it is divided here by the variance factor, which later multiplies the whole matrix. Where no halves can
    be compared the residuals count as much more as they do in other sets.
    """
    C = lens_covariance(solved.solution.adjusted)
    lifted = solved.shape is not None and solved.solution.is_lifted
    matrix = solved.shape.covariance if lifted and solved.shape is not None else C.matrix
    if halves is None:
        matrix = matrix * EXPECTED_KAPPA2
    between = sum((np.outer(shift, shift) for _, shift in shifts), np.zeros_like(matrix))
    return Covariance.from_matrix(C.names, matrix + between / _inflation(halves))


def _budget(
    state: State,
    quality: Quality,
    covariance: Covariance,
    shifts: Sequence[tuple[Part, FloatArray]],
    field: Field | None,
) -> tuple[float, Budget]:
    """Return the focal length near the axis, px, and what its standard deviation consists of."""
    focal, by = state.model.axial_focal(dict(zip(covariance.names, state.parameters.tolist(), strict=True)))
    gradient = np.array([by.get(name, 0.0) for name in covariance.names]) / focal
    moved = [(part, float(gradient @ shift)) for part, shift in shifts]
    if field is not None and (field.is_of_lens or not field.is_significant):
        moved.append((Part.LENS_DEPARTS, math.sqrt(max(float(gradient @ field.of_lens @ gradient), 0.0))))
    variance = float(gradient @ covariance.matrix @ gradient) * quality.inflation
    return focal, budget_of(variance, quality.inflation, moved, quality.views or 0)


def shift_by_warp(adjusted: Adjusted) -> FloatArray:
    """Return by how much the board's warp has moved the lens parameters, (n,), to first order."""
    size, matrix = len(adjusted.state.parameters), adjusted.reduced.matrix
    shift = solution_of(matrix[:size, :size], matrix[:size, size:] @ adjusted.state.warp)
    if shift is None:
        raise CalibrationError(UNDETERMINED)
    return shift


def _better(solution: Solution) -> Candidate | None:
    """Return a model that fits the corners clearly better but was refused; None if there is none."""
    own = next((one.criterion for one in solution.candidates if one.model is solution.state.model), math.inf)
    others = [one for one in solution.candidates if one.refused is not None and one.criterion < own - CLEARLY]
    return min(others, key=lambda one: one.criterion, default=None)


def _calibration(
    solved: Solved,
    covariance: Covariance,
    halves: SplitHalf | None,
    coverage: float,
    versions: Mapping[str, str],
) -> Calibration:
    observations, usable, adjusted = solved.observations, solved.usable, solved.solution.adjusted
    state, network = adjusted.state, adjusted.network
    values = dict(zip(state.model.parameters, state.parameters.tolist(), strict=True))
    quality = Quality(
        rms_px=adjusted.rms_px,
        points=int(network.seen.sum()),
        views=int(network.used.sum()),
        std=covariance.std,
        covariance=covariance,
        kappa2=halves.kappa2 if halves is not None else None,
        coverage=coverage,
    )
    board = observations.board
    provenance = Provenance(
        kind="board" if network.is_planar else "control-points",
        source=str(usable.board),
        tag=board.described if isinstance(board, Board) else str(board),
        # The hash covers all observations, as corners.json contains them; the solution may have dropped views.
        sha256=corners_sha256(observations),
        sources=(
            *((usable.source,) if usable.source is not None else ()),
            *(SourceFile(name=view.name, sha256=view.sha256) for view in usable.views if view.sha256),
        ),
        tool=versions_in_words(versions),
        firmware=usable.firmware,
        focus=usable.focus,
    )
    return Calibration(
        camera=replace(usable.camera, image_size=usable.image_size),
        intrinsics=state.model.intrinsics(values, usable.image_size),
        distortion=state.model.distortion(values),
        grade=Grade.CALIBRATED,
        quality=quality,
        provenance=provenance,
    )


def notes_of(findings: Sequence[Finding]) -> Iterator[str]:
    """Yield the remarks for users of the calibration."""
    verdict = Use.of(findings)
    if verdict is not Use.FIXED:
        yield f"{verdict.value}: {Calibration.SHORT}"
    yield from (str(finding) for finding in findings if finding.severity is not Severity.NOTE)


def _views(
    observations: Observations, usable: Observations, solution: Solution, dropped: Mapping[int, Dismissal]
) -> tuple[ViewResult, ...]:
    """Return the result of every input view, in input order."""
    at_rows, repeats = iter(range(len(usable.views))), dict(solution.repeats)
    # A rejected view has the pose it was judged by; its residuals explain the rejection.
    alone = solution.at_their_poses()
    shown = _Shown(
        seen=solution.adjusted.network.seen,
        lengths=residual_lengths(alone),
        residuals=alone.linear.residuals.reshape(*alone.network.seen.shape, 2),
        rms_alone=view_rms(alone),
        rms=view_rms(solution.adjusted),
    )

    def result(index: int, view: View) -> ViewResult:
        if index in dropped:
            return ViewResult(name=view.name, without=dropped[index])
        row = next(at_rows)
        if row in repeats:
            message = f"shows the pose of {usable.views[repeats[row]].name}"
            return ViewResult(
                name=view.name, without=Dismissal(reason=DismissalReason.DUPLICATE, message=message)
            )
        return shown.result(view, row, solution.state if shown.seen[row].any() else alone.state)

    return tuple(result(index, view) for index, view in enumerate(observations.views))


class _Shown(Struct, frozen=True, kw_only=True, eq=False):
    """Residuals of the views: (V, M) used corners, all lengths and all (V, M, 2) residuals, and (V,) RMS in px."""

    seen: BoolArray
    lengths: FloatArray
    residuals: FloatArray
    rms_alone: FloatArray
    rms: FloatArray

    def result(self, view: View, row: int, state: State) -> ViewResult:
        """Return the result of the view at a row."""
        corners = len(view.ids)
        used = self.seen[row, :corners]
        without, out = None, np.flatnonzero(~used)
        if not used.any():
            message = f"rms {in_px(self.rms_alone[row])}, the others {in_px(float(np.nanmedian(self.rms)))}"
            without, out = Dismissal(reason=DismissalReason.MISFIT, message=message), out[:0]
        return ViewResult(
            name=view.name,
            rms_px=float((self.rms_alone if without is not None else self.rms)[row]),
            without=without,
            corners_out=tuple(
                RejectedCorner(id=int(view.ids[at]), px=float(self.lengths[row, at])) for at in out
            ),
            rotation=rows(state.rotations[row]),
            translation=numbers(state.translations[row]),
            residuals_px=rows(self.residuals[row, :corners]),
        )


def _over_frame(
    calibration: Calibration, solved: Solved
) -> tuple[Calibration, Uncertainty | None, Field | None, tuple[Solvable, float] | None]:
    """Return the calibration and σ over the frame, with what the lens departs from its model by; that; and a rival."""
    quality, adjusted = calibration.quality or Quality(), solved.solution.adjusted
    if quality.covariance is None:
        return calibration, None, None, None
    inflated = quality.covariance.matrix * quality.inflation
    try:
        uncertainty = projection_uncertainty(
            calibration, Covariance.from_matrix(quality.covariance.names, inflated), shape=MAP_SHAPE
        )
    except CalibrationError:
        return calibration, None, None, None
    if solved.joint is not None:
        beside, rival = _beside_rivals(uncertainty, calibration, adjusted.state.model, solved.joint.rivals)
        return calibration, beside, None, rival
    known = np.isfinite(uncertainty.std_px.ravel())
    field = _field(calibration, adjusted, uncertainty.pixels.reshape(-1, 2), known)
    if field is not None and (field.is_of_lens or not field.is_significant):
        # The model without the field is what is written.
        more = (field.mean**2).sum(axis=1) + field.variance.max(axis=1)
        std_px = np.sqrt(uncertainty.std_px**2 + more.reshape(uncertainty.std_px.shape))
        uncertainty, calibration = replace(uncertainty, std_px=std_px), _absorbed(calibration, field)
    return calibration, uncertainty, field, None


def _beside_rivals(
    uncertainty: Uncertainty, calibration: Calibration, model: Solvable, rivals: Sequence[RivalLens]
) -> tuple[Uncertainty | None, tuple[Solvable, float] | None]:
    """Add to σ what the rivals differ by, as far as they are plausible (between-model variance of model averaging).

    Where observations are they hardly differ. Elsewhere the chosen model extrapolates, and its own σ does not know it.

    Returns:
        σ, None if a rival cannot be compared; the rival that differs most, and by how many px.
    """
    weights, more, most = np.nan_to_num(1 / uncertainty.std_px**2), np.zeros(uncertainty.std_px.shape), None
    for one in rivals:
        try:
            apart = projection_difference(
                _camera(calibration, model, one.beside),
                _camera(calibration, one.model, one.parameters),
                shape=MAP_SHAPE,
                weights=weights,
            )
        except (CalibrationError, InputError):
            return None, None
        # Where only one of the two has a ray they differ at least as much.
        more += one.weight * np.nan_to_num(apart.lengths_px, nan=apart.max_px) ** 2
        if most is None or apart.max_px > most[1]:
            most = one.model, apart.max_px
    return replace(uncertainty, std_px=np.sqrt(uncertainty.std_px**2 + more)), most


def _camera(calibration: Calibration, model: Solvable, parameters: FloatArray) -> Calibration:
    """Return the calibration with another lens, whose quality is unknown."""
    values = dict(zip(model.parameters, parameters.tolist(), strict=True))
    K = model.intrinsics(values, calibration.intrinsics.image_size)
    return replace(calibration, intrinsics=K, distortion=model.distortion(values), quality=None)


def _field(
    calibration: Calibration, adjusted: Adjusted, pixels: FloatArray, shown: BoolArray
) -> Field | None:
    """Return what the lens departs from its model by, at (N, 2) pixels; NaN where there is no ray."""
    state = adjusted.state
    rays = calibration.unproject(pixels)
    known = shown & np.isfinite(rays).all(axis=1)
    _, by_lens, by_point = state.model.project(state.parameters, rays[known])
    size = len(state.parameters)
    turn = np.stack([np.cross(axis, rays[known]) for axis in np.eye(3)], axis=-1)
    by_lens, by_turn = by_lens.reshape(-1, 2, size), by_point.reshape(-1, 2, 3) @ turn
    if not (known.any() and np.isfinite(by_lens).all() and np.isfinite(by_turn).all()):
        return None
    found = residual_field(adjusted, calibration.intrinsics.image_size, pixels[known], by_lens, by_turn)
    if found is None:
        return None
    mean, variance = (np.full(pixels.shape, np.nan) for _ in range(2))
    mean[known], variance[known] = found.mean, found.variance
    return replace(found, mean=mean, variance=variance)


def _absorbed(calibration: Calibration, field: Field) -> Calibration:
    """Add to the covariance what the parameters have absorbed of the field: no noise, which κ² would multiply."""
    quality = calibration.quality
    if quality is None or quality.covariance is None:
        return calibration
    C = quality.covariance
    C = Covariance.from_matrix(C.names, C.matrix + field.of_lens / quality.inflation)
    return replace(calibration, quality=replace(quality, covariance=C, std=C.std))


def _departure(
    field: Field | None,
    uncertainty: Uncertainty | None,
    observations: Observations,
    corners: FloatArray,
) -> Departure | None:
    """Return where the lens departs most from its model near corners; None if noise explains it."""
    if field is None or uncertainty is None or not field.is_significant:
        return None
    pixels = uncertainty.pixels.reshape(-1, 2)
    near = near_corners(pixels, corners, observations.image_size) & np.isfinite(field.mean).all(axis=1)
    if not near.any():
        return None
    length = np.where(near, np.linalg.norm(np.nan_to_num(field.mean), axis=1), 0.0)
    at = int(np.argmax(length))
    return Departure(
        px=float(length[at]),
        std_px=float(np.sqrt(field.variance[at].max())),
        x=float(pixels[at, 0]),
        y=float(pixels[at, 1]),
        is_of_lens=field.is_of_lens,
    )


def _share_near(adjusted: Adjusted, observations: Observations) -> float:
    """Return the share of the image with a corner nearby."""
    pixels = pixel_grid(observations.image_size, MAP_SHAPE).reshape(-1, 2)
    shown = inside_circle(pixels, observations.circle)
    corners = adjusted.network.pixels[adjusted.network.seen]
    return float(near_corners(pixels[shown], corners, observations.image_size).mean())


def _between_halves(
    calibration: Calibration, model: Solvable, halves: SplitHalf | None
) -> ProjectionDifference | None:
    """Return the difference over the image between the two halves of the median split."""
    if halves is None:
        return None
    try:
        first, second = (_camera(calibration, model, parameters) for parameters in halves.halves)
        return projection_difference(first, second, shape=MAP_SHAPE)
    except (CalibrationError, InputError):
        # Too few views in a half may give no valid camera, or no common field of view.
        return None
