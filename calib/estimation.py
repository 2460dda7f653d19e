"""Camera calibration from corners: solution, uncertainty and verdict."""

from __future__ import annotations

from typing import Final

import numpy as np

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.adjustment import adjust
from calibrary.calib.assessment import Solved, assess
from calibrary.calib.board import Board, Pattern
from calibrary.calib.board_shape import BoardShape, board_shape, laid_on
from calibrary.calib.lens_change import as_model
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import best_model, calmer
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations, View
from calibrary.calib.opencv_state import one_blas_thread
from calibrary.calib.rejection import Gate
from calibrary.calib.result import CalibrationResult, Dismissal, DismissalReason
from calibrary.calib.solve import Solution, choices, solve
from calibrary.calib.start import homographies
from calibrary.calib.verdict import LIMITS, Limits
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import CalibrationError, InputError
from calibrary.policy import FLEET, Policy
from calibrary.records import replace

FEWEST_CORNERS: Final = 6
FLATTEST: Final = 0.02
"""Ratio of the second to the first extent of a view's points on the board; below it they are collinear: no pose."""


@one_blas_thread()
def estimate(
    observations: Observations,
    model: str | Solvable = "auto",
    *,
    guess: Intrinsics | None = None,
    warp: bool = True,
    limits: Limits = LIMITS,
    policy: Policy = FLEET,
    gate: Gate | None = None,
    seed: int = 0,
) -> CalibrationResult:
    """Calibrate the camera of these views, and assess the result.

    Args:
        observations: views of one board, or of control points, by one camera at one focus setting.
        model: a :class:`~calibrary.calib.lens_models.Solvable`, or "auto" to choose it by the corners.
        guess: an initial K, such as the seed of a camera check. Needed for points that are not in a plane; the default
            is a focal length of 0.8 · max(W, H).
        warp: whether the board warp may be estimated.
        limits: limits of the verdict.
        policy: limits of σ for each use.
        gate: limits for rejecting views and corners.
        seed: random seed for splitting the views into halves.

    Raises:
        InputError: the observations are inconsistent, or the model is unknown.
        CalibrationError: the observations do not determine a camera.
    """
    solved = solved_views(observations, model, guess=guess, warp=warp, gate=gate)
    result = assess(solved, limits, policy, seed=seed)
    kappa2 = result.calibration.quality.kappa2 if result.calibration.quality else None
    if model != "auto" or kappa2 is None or kappa2 <= limits.kappa2_wanted:
        return result
    better = calmer(result.candidates, solved.solution.state.model, kappa2)
    if better is None:
        return result
    again = solved_views(observations, better[0], guess=guess, warp=warp, gate=gate)
    return replace(assess(again, limits, policy, seed=seed), candidates=better[1])


def solved_views(
    observations: Observations,
    model: str | Solvable = "auto",
    *,
    guess: Intrinsics | None = None,
    warp: bool = True,
    gate: Gate | None = None,
) -> Solved:
    """Return the solution of :func:`estimate` before its assessment.

    Raises:
        InputError: the observations are inconsistent, or the model is unknown.
        CalibrationError: the observations do not determine a camera.
    """
    chosen = Solvable.named(model)
    _check(observations, guess)
    usable, dropped = _usable(observations)
    network = Network.of(usable)
    _refuse_miscounted(usable)
    solution = solve(network, usable.image_size, model=chosen, guess=guess, warp=warp, gate=gate)
    solution, shape, before = _before_the_real_board(solution, usable.image_size, chosen, asked=warp)
    return Solved(
        observations=observations,
        usable=usable,
        dropped=dropped,
        solution=solution,
        asked_warp=warp,
        shape=shape,
        flat_shape=before,
    )


def _refuse_miscounted(observations: Observations) -> None:
    """Raise an error that names the right number of columns, if the corners fit another one."""
    columns = other_columns(observations)
    if columns is not None:
        board = observations.board
        raise CalibrationError(
            f"the corners are numbered as on a board of {columns} columns of inner corners, not as on {board}: no "
            "camera explains them; count the inner corners of a row, one fewer than its squares, and state the board "
            "again"
        )


def _before_the_real_board(
    solution: Solution, image_size: ImageSize, model: Solvable | None, *, asked: bool
) -> tuple[Solution, BoardShape | None, BoardShape | None]:
    """Adjust the solution to the board's real shape, if the corners show that the board is bent.

    The lens model is then chosen again, since with a flat board it may have absorbed the board's shape.

    Returns:
        The solution, the shape used in it, and the shape estimated from the residuals of a flat board.
    """
    flat = board_shape(solution.adjusted)
    if flat is None or not flat.is_bent or not asked:
        return solution, flat, flat
    try:
        found = laid_on(solution.adjusted, solution.everything)
        if found is None:
            return solution, flat, flat
        before, warped = solution.adjusted, solution.is_warped
        better, candidates = best_model(found[0], image_size, choices(found[0], model), warp=warped)
        if better.state.model is not solution.state.model:
            before = adjust(before.network, as_model(before.state, better.state.model), warp=warped)
            found = laid_on(before, solution.everything)
            flat = board_shape(before) or flat
    except CalibrationError:
        return solution, flat, flat
    if found is None:
        return solution, flat, flat
    adjusted, everything, shape = found
    lifted = replace(
        solution, adjusted=adjusted, everything=everything, candidates=candidates, is_lifted=True
    )
    return lifted, shape, flat


def _check(observations: Observations, guess: Intrinsics | None) -> None:
    """Reject observations that no detector would produce."""
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
        if len(set(ids.tolist())) != len(ids) or (len(ids) and not (ids.min() >= 0 and ids.max() < points)):
            raise InputError(
                f"names points twice or beyond the {points} of {observations.board}", source=view.name
            )
        if not np.isfinite(pixels).all() or (np.abs(pixels) > 10 * max(width, height)).any():
            raise InputError("has corners far outside its frame, or none at all (NaN)", source=view.name)


def _usable(observations: Observations) -> tuple[Observations, dict[int, Dismissal]]:
    """Return the views for which a pose can be determined, and the reasons for dropping the others."""
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
                reason=DismissalReason.TOO_FEW_CORNERS, message="its corners are on one line of the board"
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


COLUMN_COUNTS: Final = range(3, 61)
COUNT_FITS: Final = 0.15
"""Largest RMS deviation, in corner spacings, due to strong distortion; a wrong count deviates by whole squares."""
MISCOUNT_FITS: Final = 0.3
"""Smallest deviation at which the stated count is doubted; between the two limits, no count is called wrong."""
VIEWS_COUNTED: Final = 8
FEWEST_TO_COUNT: Final = 12


def other_columns(observations: Observations) -> int | None:
    """Return the number of columns for which the corners fit a plane, if the stated number does not; else None.

    Corners are numbered row by row, so a wrong number of columns shifts every row relative to the next. Apart from
    distortion, the image of a plane is a homography of it; the right number is the one for which every view nearly is.
    """
    board = observations.board
    if not isinstance(board, Board) or board.pattern is not Pattern.CHECKERBOARD:
        return None
    views = [view for view in observations.views if len(view.ids) >= FEWEST_TO_COUNT][:VIEWS_COUNTED]
    if not views or _misfit(views, board.columns) < MISCOUNT_FITS:
        return None
    found = {count: _misfit(views, count) for count in COLUMN_COUNTS if count != board.columns}
    best = min(found, key=lambda count: found[count])
    return best if found[best] < COUNT_FITS else None


def _misfit(views: list[View], columns: int) -> float:
    """Return the median over the views of the RMS distance from the best homography, in corner spacings."""
    return float(np.median([_off_plane(view.ids, view.image_points, columns) for view in views]))


def _off_plane(ids: IntArray, pixels: FloatArray, columns: int) -> float:
    plane = np.stack([ids % columns, ids // columns], axis=1).astype(np.float64)
    if not (np.ptp(plane, axis=0) > 0).all():
        return np.inf
    H = homographies(plane[None], pixels[None], np.ones((1, len(ids)), dtype=np.bool_))[0]
    seen = plane @ H[:, :2].T + H[:, 2]
    with np.errstate(all="ignore"):
        apart = seen[:, :2] / seen[:, 2:] - pixels
    beside = np.diff(ids) == 1
    spacing = (
        float(np.median(np.linalg.norm(np.diff(pixels, axis=0)[beside], axis=1))) if beside.any() else 0.0
    )
    rms = float(np.sqrt((apart**2).sum(axis=1).mean()))
    return rms / spacing if spacing > 0 and np.isfinite(rms) else np.inf
