"""The one call: corners in, a calibration with its uncertainty, its verdict and everything behind them out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.board import Board
from calibrary.calib.board_shape import BoardShape, board_shape, laid_on, stretch
from calibrary.calib.corners_file import corners_sha256
from calibrary.calib.covariance import identifiability, lens_covariance
from calibrary.calib.geometry import geometry
from calibrary.calib.lens_models import Solvable
from calibrary.calib.lens_series import series_shift
from calibrary.calib.misfit import corner_noise, misfit
from calibrary.calib.model_choice import CLEARLY, Candidate, WarpTest, sound_share, warp_test
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations, View
from calibrary.calib.projection_difference import (
    ProjectionDifference,
    Uncertainty,
    projection_difference,
    projection_uncertainty,
)
from calibrary.calib.rejection import Gate, residual_lengths, view_rms
from calibrary.calib.result import CalibrationResult, Dismissal, DismissalReason, ViewResult
from calibrary.calib.solve import Solution, solve
from calibrary.calib.variance_factor import SplitHalf, split_half
from calibrary.calib.verdict import LIMITS, BoardVerdict, Evidence, Limits, judge
from calibrary.calibration import (
    Calibration,
    Covariance,
    Grade,
    Intrinsics,
    Provenance,
    Quality,
    SourceFile,
)
from calibrary.errors import CalibrationError, InputError
from calibrary.records import replace
from calibrary.validation import Finding, Severity

__all__ = ["estimate"]


FEWEST_CORNERS: Final = 6
FLATTEST: Final = 0.02
"""Second over first extent of a view's points on the board; below it they are a line, which has no pose."""
MAP_SHAPE: Final = (17, 13)


def estimate(
    observations: Observations,
    model: str | Solvable = "auto",
    *,
    guess: Intrinsics | None = None,
    warp: bool = True,
    limits: Limits = LIMITS,
    gate: Gate | None = None,
    seed: int = 0,
) -> CalibrationResult:
    """Find the camera that took these views, and say how far to trust it.

    Args:
        observations: views of one board, or of control points, by one camera at one focus.
        model: a :class:`~calibrary.calib.lens_models.Solvable`, or "auto" to choose it by the corners.
        guess: an initial K, such as an ingest gate's seed. Points that do not lie in a plane need one; without it
            0.8 · max(W, H) is taken.
        warp: whether the board may be warped.
        limits: of the verdict.
        gate: for views and corners to be rejected.
        seed: of dealing the views into halves.

    Raises:
        InputError: the observations contradict themselves, or the model is none.
        CalibrationError: they do not determine a camera.
    """
    chosen = _model(model)
    _check(observations, guess)
    usable, dropped = _usable(observations)
    network = Network.of(usable)
    solution = solve(network, usable.image_size, model=chosen, guess=guess, warp=warp, gate=gate)
    solution, shape, before = _before_the_real_board(solution, asked=warp)
    adjusted = solution.adjusted
    halves = split_half(adjusted, seed=seed)
    tested, explained = _with_warp(solution, asked=warp)
    stretched = stretch(explained)
    contradicted = halves is not None and halves.kappa2 > limits.kappa2_wanted
    # Lifts that leave the views contradicting one another may have taken up what was no board's shape.
    left_out = [before.shift] if before is not None and (contradicted or not solution.is_lifted) else []
    left_out += [stretched[1]] if stretched is not None else []
    inflation = max(1.0, halves.kappa2) if halves is not None else 1.0
    further = series_shift(adjusted, usable.image_size, inflation)
    left_out += [further] if further is not None else []
    stated = shape.covariance if shape is not None and solution.is_lifted else None
    covariance = _covariance(adjusted, stated, left_out, inflation)
    calibration = _calibration(observations, usable, adjusted, covariance, halves)
    uncertainty = _uncertainty(calibration)
    noise = corner_noise(usable)
    views = _views(observations, usable, solution, dropped)
    quality = calibration.quality or Quality()
    seen = geometry(adjusted, usable.image_size)
    weak = identifiability(adjusted)
    judged = Evidence(
        image_size=usable.image_size,
        is_board=network.is_planar,
        views=quality.views or 0,
        views_shown=len(observations.views),
        repeats=len(solution.repeats),
        views_out=sum(
            view.without is not None and view.without.reason is DismissalReason.MISFIT for view in views
        ),
        corners_out=sum(len(view.corners_out) for view in views),
        geometry=seen,
        fx=calibration.intrinsics.fx,
        fx_std=quality.std["fx"],
        kappa2=quality.kappa2,
        rms_px=adjusted.rms_px,
        noise_px=noise,
        condition=weak.condition,
        model=adjusted.state.model,
        culprits=weak.culprits,
        sound=sound_share(adjusted, usable.image_size),
        better=_better(solution),
        edge_px=_largest(uncertainty),
        warp=tested,
        is_warped=solution.is_warped,
        shape=shape,
        is_lifted=solution.is_lifted,
        stretch=stretched[0] if stretched is not None else None,
        misfit=misfit(explained, usable.image_size, noise),
        focus=usable.focus,
        unit=usable.board.unit,
    )
    findings = judge(judged, limits)
    refused = BoardVerdict.of(findings) is BoardVerdict.REFUSE
    return CalibrationResult(
        # What was refused is worth no more than any other number to start a search from.
        calibration=replace(
            calibration,
            notes=tuple(_notes(findings)),
            grade=Grade.SEED if refused else Grade.CALIBRATED,
        ),
        findings=findings,
        evidence=judged,
        limits=limits,
        model=adjusted.state.model,
        candidates=solution.candidates,
        warp=tested,
        views=views,
        halves=halves,
        half_difference=_between_halves(calibration, adjusted.state.model, halves),
        uncertainty=uncertainty,
        observations=observations,
        versions=_versions(),
    )


def _before_the_real_board(
    solution: Solution, *, asked: bool
) -> tuple[Solution, BoardShape | None, BoardShape | None]:
    """The solution on the board as its corners show it, where they show that it is bent, and its shape.

    Returns:
        The solution, the shape as it stands behind it, and the shape as the flat board's residuals show it.
    """
    flat = board_shape(solution.adjusted)
    if flat is None or not flat.is_bent or not asked:
        return solution, flat, flat
    try:
        found = laid_on(solution.adjusted, solution.everything)
    except CalibrationError:
        found = None
    if found is None:
        return solution, flat, flat
    adjusted, everything, shape = found
    return replace(solution, adjusted=adjusted, everything=everything, is_lifted=True), shape, flat


def _better(solution: Solution) -> Candidate | None:
    """A model that the corners ask for clearly and that may not be taken, if there is one."""
    own = next((one.criterion for one in solution.candidates if one.model is solution.state.model), math.inf)
    others = [one for one in solution.candidates if one.refused is not None and one.criterion < own - CLEARLY]
    return min(others, key=lambda one: one.criterion, default=None)


def _covariance(
    adjusted: Adjusted, stated: FloatArray | None, left_out: Sequence[FloatArray], inflation: float
) -> Covariance:
    """What the residuals say, and what the models that were not taken would have made of the lens.

    The shift d to a larger model adds d·dᵀ: as much as the two models differ by (model averaging's variance between
    the models). It is no noise, so the variance factor, which multiplies everything, is taken out of it beforehand.
    """
    C = lens_covariance(adjusted)
    between = sum((np.outer(shift, shift) for shift in left_out), np.zeros_like(C.matrix))
    return Covariance.from_matrix(C.names, (C.matrix if stated is None else stated) + between / inflation)


def _model(model: str | Solvable) -> Solvable | None:
    if model == "auto":
        return None
    try:
        return Solvable(model)
    except ValueError:
        raise InputError(f"model {model!r:.40}: expected auto, {', '.join(Solvable)}") from None


def _check(observations: Observations, guess: Intrinsics | None) -> None:
    """Refuse what no detector would have written."""
    width, height = observations.image_size
    if width < 16 or height < 16:
        raise InputError(f"frames of {width}×{height} px: expected at least 16 px a side")
    if guess is not None and guess.image_size != observations.image_size:
        raise InputError(
            "the initial K is of a {}×{} frame, the corners are of {}×{}: scale it first".format(
                *guess.image_size, width, height
            )
        )
    points = len(observations.board.points)
    for view in observations.views:
        ids, pixels = view.ids, view.image_points
        if ids.ndim != 1 or pixels.shape != (len(ids), 2):
            raise InputError(f"has {ids.shape} ids for corners of shape {pixels.shape}", source=view.name)
        if len(np.unique(ids)) != len(ids) or (len(ids) and not (ids.min() >= 0 and ids.max() < points)):
            raise InputError(
                f"names points twice or beyond the {points} of {observations.board}", source=view.name
            )
        if not np.isfinite(pixels).all() or (np.abs(pixels) > 10 * max(width, height)).any():
            raise InputError("has corners far outside its frame, or none at all (NaN)", source=view.name)


def _usable(observations: Observations) -> tuple[Observations, dict[int, Dismissal]]:
    """The views that can have a pose, and why the others cannot."""
    dropped: dict[int, Dismissal] = {}
    for index, view in enumerate(observations.views):
        points = observations.object_points(view)
        if len(view.ids) < FEWEST_CORNERS:
            dropped[index] = Dismissal(
                reason=DismissalReason.TOO_FEW_CORNERS,
                message=f"{len(view.ids)} corners, need {FEWEST_CORNERS}",
            )
        elif _extent_ratio(points) < FLATTEST:
            dropped[index] = Dismissal(
                reason=DismissalReason.TOO_FEW_CORNERS, message="its corners lie on one line of the board"
            )
    views = tuple(view for index, view in enumerate(observations.views) if index not in dropped)
    least = 3 if isinstance(observations.board, Board) else 1
    if len(views) < least:
        raise CalibrationError(
            f"{len(views)} of {len(observations.views)} views show enough of the board to be used: expected at least "
            f"{least} to compute anything, 15 to trust it"
        )
    return replace(observations, views=views), dropped


def _extent_ratio(points: FloatArray) -> float:
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(extents[1] / extents[0]) if extents[0] > 0 else 0.0


def _calibration(
    observations: Observations,
    usable: Observations,
    adjusted: Adjusted,
    covariance: Covariance,
    halves: SplitHalf | None,
) -> Calibration:
    state, network = adjusted.state, adjusted.network
    values = dict(zip(state.model.parameters, state.parameters.tolist(), strict=True))
    seen = geometry(adjusted, usable.image_size)
    quality = Quality(
        rms_px=adjusted.rms_px,
        points=int(network.seen.sum()),
        views=int(network.used.sum()),
        std=covariance.std,
        covariance=covariance,
        kappa2=halves.kappa2 if halves is not None else None,
        coverage=seen.coverage.fraction,
    )
    versions, board = _versions(), observations.board
    provenance = Provenance(
        kind="board" if network.is_planar else "control-points",
        source=str(usable.board),
        tag=board.described if isinstance(board, Board) else str(board),
        # Of everything that was seen, as corners.json keeps it; the solve may have left out views.
        sha256=corners_sha256(observations),
        sources=(
            *((usable.source,) if usable.source is not None else ()),
            *(SourceFile(name=view.name, sha256=view.sha256) for view in usable.views if view.sha256),
        ),
        tool=f"calibrary {versions['calibrary']}, OpenCV {versions['opencv']}",
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


def _notes(findings: Sequence[Finding]) -> Iterator[str]:
    """What a user of the K should know."""
    verdict = BoardVerdict.of(findings)
    if verdict is not BoardVerdict.PASS:
        yield f"{verdict.value}: not good enough to be approved"
    yield from (str(finding) for finding in findings if finding.severity is not Severity.NOTE)


def _views(
    observations: Observations, usable: Observations, solution: Solution, dropped: Mapping[int, Dismissal]
) -> tuple[ViewResult, ...]:
    """Every view that was given, in its order."""
    rows = iter(range(len(usable.views)))
    return tuple(
        ViewResult(name=view.name, without=dropped[index])
        if index in dropped
        else _view(view, next(rows), usable, solution)
        for index, view in enumerate(observations.views)
    )


def _view(view: View, row: int, usable: Observations, solution: Solution) -> ViewResult:
    adjusted, state = solution.adjusted, solution.state
    seen = adjusted.network.seen[row, : len(view.ids)]
    repeated = dict(solution.repeats).get(row)
    if repeated is not None:
        of = usable.views[repeated].name
        return ViewResult(
            name=view.name,
            without=Dismissal(reason=DismissalReason.DUPLICATE, message=f"shows the pose of {of}"),
        )
    # A view rejected still has the pose it was judged by; what it misses by says why.
    alone = solution.at_its_pose(row)
    residuals = alone.linear.residuals.reshape(-1, 2)[: len(view.ids)]
    lengths = residual_lengths(alone)[0, : len(view.ids)]
    pose = (alone.state.rotations[0], alone.state.translations[0])
    if not seen.any():
        rms = float(view_rms(alone)[0])
        message = f"rms {rms:.2f} px, the others {float(np.nanmedian(view_rms(adjusted))):.2f} px"
        return ViewResult(
            name=view.name, rms_px=rms, without=Dismissal(reason=DismissalReason.MISFIT, message=message),
            rotation=pose[0], translation_mm=pose[1], residuals_px=residuals,
        )  # fmt: skip
    return ViewResult(
        name=view.name,
        rms_px=float(view_rms(adjusted)[row]),
        corners_out=tuple((int(view.ids[at]), float(lengths[at])) for at in np.flatnonzero(~seen)),
        rotation=state.rotations[row],
        translation_mm=state.translations[row],
        residuals_px=residuals,
    )


def _with_warp(solution: Solution, *, asked: bool) -> tuple[WarpTest | None, Adjusted]:
    """The test for a warped board, and the solution with all of the warp that it found.

    Where the warp was not to be solved for it is still looked at: other faults are told by what it leaves over.
    """
    adjusted = solution.adjusted
    if asked or not adjusted.network.is_planar:
        return solution.warp, adjusted
    try:
        tested, _, warped = warp_test(adjusted)
    except CalibrationError:
        return None, adjusted
    return tested, warped if tested.keeps_warp else adjusted


def _uncertainty(calibration: Calibration) -> Uncertainty | None:
    quality = calibration.quality
    if quality is None or quality.covariance is None:
        return None
    C = quality.covariance
    inflated = Covariance.from_matrix(C.names, C.matrix * quality.inflation)
    try:
        return projection_uncertainty(calibration, inflated, shape=MAP_SHAPE)
    except CalibrationError:
        return None


def _largest(uncertainty: Uncertainty | None) -> float | None:
    if uncertainty is None or not np.isfinite(uncertainty.std_px).any():
        return None
    return float(np.nanmax(uncertainty.std_px))


def _between_halves(
    calibration: Calibration, model: Solvable, halves: SplitHalf | None
) -> ProjectionDifference | None:
    """What the halves of the median split disagree about, over the frame."""
    if halves is None:
        return None
    cameras = []
    try:
        for parameters in halves.halves:
            values = dict(zip(model.parameters, parameters.tolist(), strict=True))
            K = model.intrinsics(values, calibration.intrinsics.image_size)
            cameras.append(
                replace(calibration, intrinsics=K, distortion=model.distortion(values), quality=None)
            )
        return projection_difference(cameras[0], cameras[1], shape=MAP_SHAPE)
    except (CalibrationError, InputError):
        # Halves of views that determine nothing may be no cameras at all, or see nothing in common.
        return None


def _versions() -> dict[str, str]:
    import cv2

    try:
        ours = version("calibrary")
    except PackageNotFoundError:
        ours = "unknown"
    return {"calibrary": ours, "opencv": cv2.__version__, "numpy": np.__version__}
