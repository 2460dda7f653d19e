"""Conversion between distortion models with fixed K: in closed form, else by least squares.

Changing the signs is not a conversion: a distorted → undistorted polynomial with inverted signs is wrong by
tens of pixels at the corners of an ordinary lens. Without a closed form, the model is fitted to the rays of
the image's pixels, and the remaining error is measured on a finer grid than the one used for the fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache, partial
from typing import Final, TypeAlias

import msgspec

from calibrary.arrays import FloatArray, np
from calibrary.calibration import Calibration, CameraKey, ImageSize, Intrinsics, Provenance
from calibrary.distortion import Distortion, NoDistortion, SplinedStereographic, exact
from calibrary.distortion.base import perspective
from calibrary.distortion.inverse_model import InverseModel
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.parsers.format import NOT_UNDERSTOOD, Capacity, Fit, UnknownLens
from calibrary.records import replace

DEFAULT_MAX_ERROR_PX = 0.05
"""Half of the resolution of good feature matching; a smaller error does not affect a reconstruction."""

EXACT = 1e-12
"""Relative tolerance for equality; covers decimals with 17 digits and a change of origin."""

YOUR_WORD: Final = "--drop-distortion"
"""The flag by which a user says that a distortion may be lost."""

NO_SOURCE: Final = Provenance(kind="")
FITTED_GRID = 25
MEASURED_GRID = 49
RINGS, RING = 16, 12
"""Circles about the axis, each half as wide as the one before, and the points of each."""


@cache
def _around() -> FloatArray:
    """Return points of a square about the origin; made at first use, as NumPy takes long to load."""
    return np.asarray(np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * 2), axis=-1).reshape(-1, 2))


def refit(
    calibration: Calibration,
    target: type[Distortion],
    *,
    intrinsics: Intrinsics | None = None,
    focal_is_free: bool = False,
    terms: int | None = None,
    at_most_px: float = math.inf,
) -> tuple[Calibration, Fit] | None:
    """Fit the coefficients of ``target`` so that the projections are closest to those of the calibration.

    Args:
        calibration: the original, with a known distortion.
        target: the model to fit.
        intrinsics: the K to use with the new coefficients, if it cannot be the original's.
        focal_is_free: whether to fit a common factor of its focal lengths as well.
        terms: number of the target's first coefficients that are fitted, and the others 0; None for all.
        at_most_px: largest useful error; a model with a larger one may not be searched for to the end.

    Returns:
        The calibration with the new lens, and the quality of the fit; None if the model cannot represent a
        ray of the image (a perspective model for a fisheye beyond 90°), or none that does was found. Splines are not
        fitted.
    """
    K = intrinsics or calibration.intrinsics
    if issubclass(target, SplinedStereographic):
        return None
    pixels, rays = _pixel_grid(calibration, FITTED_GRID)
    if not len(rays):
        return None

    terms = len(target.names()) if terms is None else terms

    def stretched(unknowns: FloatArray) -> Intrinsics:
        factor = math.exp(unknowns[terms]) if focal_is_free else 1.0
        return replace(K, fx=K.fx * factor, fy=K.fy * factor)

    def residuals(unknowns: FloatArray, *, limited: bool = False) -> FloatArray | None:
        try:
            model, at = _model(target, unknowns[:terms]), stretched(unknowns)
        except (InputError, OverflowError):  # outside the model's domain, such as a sensor tilted by 90°
            return None
        with np.errstate(all="ignore"):
            if limited:
                missed = _pixels(at, model.distort_rays(rays)) - pixels
            elif isinstance(model, InverseModel):
                # Its formula runs the other way, so this is the distance in an image without distortion.
                missed = at.fx * (model.undistort_unlimited(_normalised(at, pixels)) - perspective(rays))
            else:
                missed = _pixels(at, model.distort_unlimited(rays)) - pixels
        return missed.ravel() if np.isfinite(missed).all() else None

    start = _start(calibration, target, terms, free=int(focal_is_free))
    unknowns = _searched(residuals, terms + focal_is_free, start, at_most_px)
    if unknowns is None:
        return None
    fitted = replace(calibration, intrinsics=stretched(unknowns), distortion=_model(target, unknowns[:terms]))
    return fitted, compare(calibration, fitted)


def _searched(
    residuals: Callable[..., FloatArray | None], number: int, start: FloatArray | None, at_most_px: float
) -> FloatArray | None:
    """The unknowns of a lens that does not end inside the image.

    Where a model ends takes ten times as long to find as what its formula gives, and the nearest seldom ends there.
    """
    unknowns = least_squares(residuals, number, start)
    if unknowns is None or residuals(unknowns, limited=True) is not None:
        return unknowns
    missed = residuals(unknowns)
    if missed is None or math.sqrt(2.0 * np.mean(missed**2)) > at_most_px:
        return None
    return least_squares(partial(residuals, limited=True), number, start)


def _start(calibration: Calibration, target: type[Distortion], terms: int, *, free: int) -> FloatArray | None:
    """Initial values: the coefficients of the same lens; None for zeros, if the model cannot represent it exactly."""
    same = exact(calibration.distortion, target) if calibration.distortion is not None else None
    return np.array([*[*same.coefficients.values()][:terms], *[0.0] * free]) if same is not None else None


def compare(original: Calibration, copy: Calibration) -> Fit:
    """Compare the projection of ``copy`` with that of ``original``.

    If the copy states no distortion, K is compared, and how far the distortion that is lost moves pixels. If it states
    that there is none, all of the difference is lost distortion.
    """
    if copy.distortion is None and original.distortion is not None:
        fit = compare(replace(original, distortion=None), copy)
        return msgspec.structs.replace(fit, lost_px=displacement(original, copy.intrinsics))
    fit = _compared(original, copy)
    if isinstance(copy.distortion, NoDistortion) and original.distortion is not None and not fit.exact:
        straight = isinstance(original.distortion, NoDistortion) or _is_straight(original.distortion)
        return fit if straight else msgspec.structs.replace(fit, lost_px=fit.max_px)
    return fit


def _is_straight(lens: Distortion) -> bool:
    return exact(lens, NoDistortion) is not None


def _compared(original: Calibration, copy: Calibration) -> Fit:
    model = copy.distortion.model if copy.distortion is not None else "unknown"
    if _same_intrinsics(original.intrinsics, copy.intrinsics) and _same_map(original, copy):
        return Fit(model=model, radius_px=_corner_radius(original.intrinsics))
    if copy.distortion is original.distortion and _is_seen_everywhere(original):
        pixels = _grid(original.intrinsics.image_size, MEASURED_GRID)
        moved = _pixels(copy.intrinsics, _normalised(original.intrinsics, pixels))
    else:
        pixels, rays = _pixel_grid(original, MEASURED_GRID)
        with np.errstate(all="ignore"):
            moved = copy.project(rays)
    covered = len(pixels) / MEASURED_GRID**2
    if not len(pixels):
        return Fit(model=model, exact=False, rms_px=math.inf, max_px=math.inf, radius_px=0.0, covered=0.0)
    # A ray without a projection in the copy counts as an infinite error.
    missed = _apart(moved, pixels, math.inf)
    K = original.intrinsics
    # A tiny coefficient may have a large relative difference without affecting any ray.
    is_exact = bool(missed.max() <= EXACT * _scale(K))
    return Fit(
        model=model,
        exact=is_exact and K.image_size == copy.intrinsics.image_size,
        rms_px=float(np.sqrt(np.mean(missed**2))),
        max_px=float(missed.max()) if is_exact else _peak(original, copy, pixels, missed, math.inf),
        radius_px=float(np.linalg.norm(pixels - [K.cx, K.cy], axis=1).max()),
        covered=covered,
    )


def displacement(calibration: Calibration, K: Intrinsics | None = None) -> float:
    """Largest distance in px over the image by which the distortion moves a pixel; 0 if it is unknown.

    Args:
        calibration: the camera.
        K: of the copy without a distortion, if something of K is lost with it.
    """
    if calibration.distortion is None or _is_straight(calibration.distortion):
        return 0.0
    pixels, rays = _pixel_grid(calibration, MEASURED_GRID)
    pinhole = replace(calibration, intrinsics=K or calibration.intrinsics, distortion=NoDistortion())
    # A ray that a pinhole cannot see has no pixel to be moved to.
    moved = _apart(pinhole.project(rays), pixels, 0.0)
    return _peak(calibration, pinhole, pixels, moved, 0.0)


def _apart(there: FloatArray, pixels: FloatArray, unseen: float) -> FloatArray:
    """Distances in px; ``unseen`` where there is no pixel."""
    apart = np.linalg.norm(there - pixels, axis=1)
    return np.where(np.isfinite(apart), apart, unseen)


def _peak(
    original: Calibration, copy: Calibration, pixels: FloatArray, missed: FloatArray, unseen: float
) -> float:
    """The largest difference in px between the pixels of a grid: at the axis, and around the worst of the grid.

    A rational lens can be wrong within a few pixels of the axis, where its numerator and denominator do not cancel.
    """
    K = original.intrinsics
    angle = np.linspace(0.0, 2.0 * math.pi, RING, endpoint=False)
    radius = _corner_radius(K) * 0.5 ** np.arange(2, 2 + RINGS)
    about = np.column_stack([np.cos(angle), np.sin(angle)])
    look = (radius[:, None, None] * about + [K.cx, K.cy]).reshape(-1, 2)
    worst = float(missed.max(initial=0.0))
    if not math.isfinite(worst) or not len(pixels):
        return worst
    at = pixels[missed.argmax()]
    cells = np.array(K.image_size) / (MEASURED_GRID - 1)
    for step in (1.0, 0.25, 0.0625):
        cell = np.minimum(cells, float(np.hypot(*(at - [K.cx, K.cy]))))
        look = np.vstack([look, at + step * cell * _around()])
        inside = ((look >= 0.0) & (look <= K.image_size)).all(axis=1)
        seen, rays = _seen_at(original, look[inside])
        if len(seen):
            with np.errstate(all="ignore"):
                there = _apart(copy.project(rays), seen, unseen)
            if there.max() > worst:
                worst, at = float(there.max()), seen[there.argmax()]
        look = np.empty((0, 2))
    return worst


def adapt(
    calibration: Calibration,
    capacity: Capacity,
    *,
    max_error_px: float,
    drop_distortion: bool = False,
    offers: bool = True,
) -> Calibration:
    """The closest calibration that a format can represent.

    It is exactly equal if the format has a suitable model; else it uses the first of the format's models, in
    order of preference, within the default limit; else, if the caller allows a larger error, the best of all.

    Args:
        calibration: the original.
        capacity: of the format.
        max_error_px: largest accepted difference anywhere in the image.
        drop_distortion: whether K alone is written if the format has no place for a distortion, and an unknown
            distortion as none if the format always states one.
        offers: whether a refusal ends with the flag that accepts the error.

    Raises:
        UnsupportedModelError: no model is within the limit, the message states the error of the best one; or a
            distortion would be lost.
    """
    K, distortion = _within_capacity(calibration.intrinsics, capacity), calibration.distortion
    of_k = compare(calibration, replace(calibration, intrinsics=K)) if calibration.intrinsics != K else None
    holds_k = of_k is None or of_k.max_px <= min(max_error_px, DEFAULT_MAX_ERROR_PX)
    if distortion is None or not capacity.has_lens:
        lens = (
            _unknown(calibration, capacity, drop_distortion=drop_distortion)
            if distortion is None
            else _none(calibration, capacity, max_error_px, drop_distortion=drop_distortion)
        )
        if of_k is not None and of_k.max_px > max_error_px:
            raise UnsupportedModelError(_without(calibration.intrinsics, K, of_k, offers=offers))
        return replace(calibration, intrinsics=K, distortion=lens)
    for model in capacity.models if holds_k else ():
        same = exact(distortion, model)
        if same is distortion and K is calibration.intrinsics:
            return calibration
        if same is not None:
            return replace(calibration, intrinsics=K, distortion=same)
    best = _nearest(calibration, capacity, K, holds_k=holds_k, max_error_px=max_error_px)
    names = ", ".join(model.model for model in capacity.models)
    if best is None:
        raise UnsupportedModelError(
            f"the {distortion.model} model has no counterpart among {names}; none shows all that it does within "
            f"{max_error_px:g} px"
        )
    if best[1].max_px <= max_error_px:
        return best[0]
    if not holds_k:
        raise UnsupportedModelError(_without(calibration.intrinsics, K, best[1], offers=offers))
    raise UnsupportedModelError(
        f"the {distortion.model} model has no exact counterpart among {names}; with the nearest {best[1].model} "
        f"projections {_misses(best[1], offers=offers)}"
    )


def _unknown(calibration: Calibration, capacity: Capacity, *, drop_distortion: bool) -> Distortion | None:
    """What is written of a distortion that is unknown.

    Raises:
        UnsupportedModelError: the file would say that there is none, or the calibration's own states one, and the user
            does not say so.
    """
    if capacity.unknown_lens is UnknownLens.STATED:
        return None
    stated = dict(calibration.extras).get(NOT_UNDERSTOOD)
    if stated is not None and not drop_distortion:
        raise UnsupportedModelError(
            f"the file states a distortion that was not understood, {stated}, and it would be lost; state it in the "
            f"format's own words, or give {YOUR_WORD} to write K without it"
        )
    if capacity.unknown_lens is UnknownLens.FREE:
        free = next(model for model in capacity.models if model.names())
        return free(**dict.fromkeys(free.names(), 0.0))
    if capacity.unknown_lens is UnknownLens.NONE and drop_distortion:
        return NoDistortion()
    if capacity.unknown_lens is UnknownLens.NONE:
        raise UnsupportedModelError(
            "the distortion is unknown, and a file of this format would say that there is none; expected a calibration "
            f"that has it, or {YOUR_WORD} if there is none"
        )
    names = ", ".join(model.model for model in capacity.models)
    raise UnsupportedModelError(
        f"the distortion is unknown, and a file of this format always states one ({names}); expected a calibration "
        "that has it"
    )


def _none(
    calibration: Calibration, capacity: Capacity, max_error_px: float, *, drop_distortion: bool
) -> Distortion | None:
    """What is written of a distortion for which the format has no place.

    Raises:
        UnsupportedModelError: it moves pixels, and the user does not accept that it is lost.
    """
    lost = displacement(calibration)
    if lost > max_error_px and not drop_distortion:
        raise UnsupportedModelError(
            f"the format has no place for a distortion, and one of up to {lost:.4g} px would be lost; choose another "
            f"format, or give {YOUR_WORD}{accepted_with(lost, or_else=True)} to accept that"
        )
    return NoDistortion() if capacity.models else None


def reason_for_fit(calibration: Calibration, capacity: Capacity) -> str | None:
    """Reason why a format needs a refit of a calibration, which takes up to a second; None if it needs none."""
    lens, K = calibration.distortion, calibration.intrinsics
    if (
        lens is not None
        and capacity.has_lens
        and all(exact(lens, model) is None for model in capacity.models)
    ):
        return f"has no {lens.model} model"
    held = _within_capacity(K, capacity)
    if (
        held == K
        or compare(calibration, replace(calibration, intrinsics=held)).max_px <= DEFAULT_MAX_ERROR_PX
    ):
        return None
    return f"has no place for {_lost(K, held)}"


def _nearest(
    calibration: Calibration, capacity: Capacity, K: Intrinsics, *, holds_k: bool, max_error_px: float
) -> tuple[Calibration, Fit] | None:
    """The first of the format's models with a small enough error, else the best; None if none can be fitted."""
    best: tuple[Calibration, Fit] | None = None
    enough = min(max_error_px, DEFAULT_MAX_ERROR_PX)
    lens = calibration.distortion or NoDistortion()
    same = [model for model in capacity.models if exact(lens, model) is not None]
    # With another K the same lens is closest, or a lens with affine terms that compensate.
    for model in [model for model in same if model is same[0] or "b1" in model.names()] or capacity.models:
        candidate = refit(
            calibration, model, intrinsics=K, focal_is_free=not holds_k, at_most_px=max_error_px
        )
        if candidate is None:
            continue
        if candidate[1].max_px <= enough:
            return candidate
        if best is None or candidate[1].max_px < best[1].max_px:
            best = candidate
    return best


def _without(before: Intrinsics, K: Intrinsics, fit: Fit, *, offers: bool) -> str:
    """Sentence on what a format cannot represent of a K, and the smallest resulting error."""
    return f"the format has no place for {_lost(before, K)}; without it, projections {_misses(fit, offers=offers)}"


def _lost(before: Intrinsics, K: Intrinsics) -> str:
    lost = [
        f"{name} of {old:.6g} px"
        for name, old, new in (
            ("skew", before.skew, K.skew),
            ("an fx − fy", before.fx - before.fy, K.fx - K.fy),
            ("a cx − W/2", before.cx - K.image_size[0] / 2, K.cx - K.image_size[0] / 2),
            ("a cy − H/2", before.cy - K.image_size[1] / 2, K.cy - K.image_size[1] / 2),
        )
        if old != new
    ]
    return ", ".join(lost)


def accepted_with(error_px: float, *, or_else: bool = False) -> str:
    """The flag and value that would accept an error, two digits, rounded up: at the end of a refusal, or after "or"."""
    if not math.isfinite(error_px):
        return ""
    step = 10.0 ** (math.floor(math.log10(error_px)) - 1)
    flag = f"--max-error-px {math.ceil(error_px / step) * step:.6g}"
    return f" or {flag}" if or_else else f"; give {flag} to accept that"


def _misses(fit: Fit, *, offers: bool) -> str:
    offer = accepted_with(fit.max_px) if offers else ""
    return f"are off by rms {fit.rms_px:.3g} px, max {fit.max_px:.3g} px{offer}"


def _within_capacity(K: Intrinsics, capacity: Capacity) -> Intrinsics:
    """K without the parameters that the format cannot represent; the loss is included in the measured error."""
    if K.skew and not capacity.skew:
        K = replace(K, skew=0.0)
    if K.fx != K.fy and not capacity.two_focals:
        mean = (K.fx + K.fy) / 2
        K = replace(K, fx=mean, fy=mean)
    if not capacity.off_centre:
        width, height = K.image_size
        K = replace(K, cx=width / 2, cy=height / 2)
    return K


def _scale(K: Intrinsics) -> float:
    """Length in px relative to which differences are judged."""
    return max(*K.image_size, K.fx, K.fy)


def _same_intrinsics(a: Intrinsics, b: Intrinsics) -> bool:
    if a == b:
        return True
    scale = _scale(a)
    pairs = zip((a.fx, a.fy, a.cx, a.cy, a.skew), (b.fx, b.fy, b.cx, b.cy, b.skew), strict=True)
    return a.image_size == b.image_size and all(abs(x - y) <= EXACT * scale for x, y in pairs)


def _same_map(original: Calibration, copy: Calibration) -> bool:
    if copy.distortion is None or copy.distortion == original.distortion:
        return True
    before = exact(original.distortion or NoDistortion(), type(copy.distortion))
    if before is None:
        return False
    one, two = before.coefficients, copy.distortion.coefficients
    pairs = zip(one.values(), two.values(), strict=False)
    return one.keys() == two.keys() and all(abs(x - y) <= EXACT * max(abs(x), abs(y)) for x, y in pairs)


def _pixel_grid(calibration: Calibration, steps: int) -> tuple[FloatArray, FloatArray]:
    """Grid of pixels over the whole image, including the corners, with their rays; pixels without a ray are omitted."""
    return _seen_by(
        replace(calibration, camera=CameraKey(), quality=None, provenance=NO_SOURCE, notes=(), extras=()),
        steps,
    )


@lru_cache(maxsize=8)
def _seen_by(geometry: Calibration, steps: int) -> tuple[FloatArray, FloatArray]:
    """Cached computation of :func:`_pixel_grid`, because one calibration is compared with copies from many formats."""
    pixels, rays = _seen_at(geometry, _grid(geometry.intrinsics.image_size, steps))
    for array in (pixels, rays):
        array.setflags(write=False)
    return pixels, rays


def _seen_at(calibration: Calibration, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Those of some pixels that have a ray, and their rays."""
    rays = calibration.unproject(pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    pixels = calibration.project(rays)
    shown = np.isfinite(pixels).all(axis=1)
    return pixels[shown], rays[shown]


def _is_seen_everywhere(calibration: Calibration) -> bool:
    """Whether every pixel certainly has a ray; False means unknown."""
    K, lens = calibration.intrinsics, calibration.distortion or NoDistortion()
    width, height = K.image_size
    corners = _normalised(K, np.array([[0, 0], [width, 0], [0, height], [width, height]], dtype=np.float64))
    return lens.covers(float(np.hypot(*corners.T).max()))


def _grid(image_size: ImageSize, steps: int) -> FloatArray:
    u, v = np.meshgrid(*(np.linspace(0.0, side, steps) for side in image_size))
    return np.column_stack([u.ravel(), v.ravel()])


def _normalised(K: Intrinsics, pixels: FloatArray) -> FloatArray:
    y = (pixels[:, 1] - K.cy) / K.fy
    return np.column_stack([(pixels[:, 0] - K.cx - K.skew * y) / K.fx, y])


def _pixels(K: Intrinsics, xy: FloatArray) -> FloatArray:
    return np.column_stack([K.fx * xy[:, 0] + K.skew * xy[:, 1] + K.cx, K.fy * xy[:, 1] + K.cy])


def _corner_radius(K: Intrinsics) -> float:
    width, height = K.image_size
    return max(math.hypot(x - K.cx, y - K.cy) for x in (0, width) for y in (0, height))


def _model(target: type[Distortion], coefficients: FloatArray) -> Distortion:
    return target(
        **{
            **dict.fromkeys(target.names(), 0.0),
            **dict(zip(target.names(), coefficients.tolist(), strict=False)),
        }
    )


Residuals: TypeAlias = Callable[[FloatArray], "FloatArray | None"]
"""Function that returns residuals in px for the unknowns; None where it is not defined."""

ROUNDS = 20
ENOUGH = 1e-5
"""Relative decrease of the sum of squares below which the iteration stops."""

FIRST_STEP = 1e-6
SMALL_MOVE_PX, LARGE_MOVE_PX = 1e-4, 1.0
"""Range in px of the pixel displacement by a difference step: large enough for ten digits, small enough for
linearity."""


def least_squares(residuals: Residuals, unknowns: int, start: FloatArray | None = None) -> FloatArray | None:
    """Minimise by the Levenberg–Marquardt method from ``start``, or zeros; None if the start cannot be evaluated.

    The polynomial models are linear in their coefficients and need two iterations. If a step makes the model
    non-monotonic inside the image, there are no residuals and the step is shortened, as any step that
    increases the error.
    """
    x = np.zeros(unknowns) if start is None else start
    missed = residuals(x)
    if missed is None or not unknowns:
        return x if missed is not None else None
    steps = np.full(unknowns, FIRST_STEP)
    damping = 1e-9
    for _ in range(ROUNDS):
        jacobian = _jacobian(residuals, x, missed, steps)
        if jacobian is None:
            return x
        scale: FloatArray = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        cost, gain = float(missed @ missed), 0.0
        q, r = np.linalg.qr(jacobian / scale)
        wanted = np.concatenate([-(q.T @ missed), np.zeros(unknowns)])
        while damping < 1e12:
            stacked = np.vstack([r, math.sqrt(damping) * np.eye(unknowns)])
            shift = np.linalg.lstsq(stacked, wanted, rcond=None)[0] / scale
            trial = residuals(x + shift)
            with np.errstate(over="ignore"):
                trial_cost = float(trial @ trial) if trial is not None else math.inf
            if trial is not None and trial_cost < cost:
                gain = 1.0 - trial_cost / cost
                x, missed, damping = x + shift, trial, max(damping / 10, 1e-15)
                break
            damping *= 10
        if gain < ENOUGH:
            return x
    return x


def _jacobian(
    residuals: Residuals, x: FloatArray, missed: FloatArray, steps: FloatArray
) -> FloatArray | None:
    """Jacobian by finite differences, each with a step that moves some pixel by about 0.01 px; None if not possible.

    The effect of a coefficient of r⁶ depends on the field of view by ten orders of magnitude, so suitable
    steps are searched; ``steps`` keeps them for the next iteration.
    """
    columns: list[FloatArray] = []
    for index, unit in enumerate(np.eye(len(x))):
        found = _column(residuals, x, missed, steps[index] * unit)
        if found is None:
            return None
        column, steps[index] = found
        columns.append(column)
    return np.column_stack(columns)


def _column(
    residuals: Residuals, x: FloatArray, missed: FloatArray, shift: FloatArray
) -> tuple[FloatArray, float] | None:
    """A derivative and its step; zeros for a coefficient without effect."""
    for _ in range(8):
        step = float(shift.sum())
        moved = residuals(x + shift)
        if moved is None:
            # The model is not monotonic for the forward step: use a smaller backward step.
            shift = -0.1 * shift
            continue
        moves = float(np.abs(moved - missed).max())
        if SMALL_MOVE_PX <= moves <= LARGE_MOVE_PX:
            return (moved - missed) / step, step
        shift = shift * (1e3 if moves == 0.0 else math.sqrt(SMALL_MOVE_PX * LARGE_MOVE_PX) / moves)
    return (np.zeros_like(missed), FIRST_STEP) if moved is not None and moves == 0.0 else None
