"""Causes compete: each is a map T of calibrations, and the one under which B = T(A) is likeliest is named, alone.

A conversion or a turned frame that gives every number of B to the digits of a file is certain; where several do, all
of them are named. Else, if both state σ, each map is weighed by χ² of B − T(A) under the joint covariance, and what σ
explains without a map has no cause. Last come causes with numbers of their own, such as another zoom.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.projection_difference import pixel_spread
from calibrary.calibration import Calibration
from calibrary.jobs.diff.common_numbers import in_one_model
from calibrary.jobs.diff.conversions import conversions, is_made, tangential_names
from calibrary.jobs.diff.fields import names_differ, of_correction, of_direction, of_focal_lengths, of_names
from calibrary.jobs.diff.frames import CommonFrame
from calibrary.jobs.diff.lens_rays import pinholes
from calibrary.jobs.diff.numbers import Numbers
from calibrary.jobs.diff.turns import Pixels, is_turned, seen, turned, turns
from calibrary.jobs.diff.uncertainty import FLOOR_PX, spread_of
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.jobs.diff.wording import pixels
from calibrary.probability import chi_square_tail
from calibrary.records import replace

OTHER_LENS: Final = 0.01
"""RMS difference over the image after the best rotation, as a fraction of the longer side, above which it is another
lens."""
SAME_PX: Final = 5e-4
"""Pixels that differ by less are shown as 0: two models of one map."""

ODDS: Final = 1e3
"""How much likelier it is beforehand that nothing happened than any one of the causes that are weighed by σ."""
SHARE: Final = 1e-3
"""A cause whose χ² noise exceeds more rarely does not explain the difference."""


def causes(a: Calibration, b: Calibration, frame: CommonFrame) -> tuple[Structural, ...]:
    """Return the likeliest cause of what is between ``a`` and the later ``b``, after that of their image sizes."""
    if type(a.distortion) is not type(b.distortion):
        a, b = in_one_model(a, b)
    if frame.cause is None:
        return _only(_of_one_size(a, b))
    if converted := _converted(a, b):
        return (converted,)
    of_resize = _of_one_size(*in_one_model(frame.a, frame.b)) if frame.cause.kind is Kind.RESIZE else None
    return (frame.cause, *_only(of_resize))


def other_camera(
    a: Calibration, b: Calibration, numbers: Numbers, named: Sequence[Structural]
) -> Iterator[Structural]:
    """Report another camera or lens if nothing else explains the difference: no cause, no copy and no noise."""
    explained = numbers.significance.explains
    is_named = any(one.kind is not Kind.RESIZE for one in named)
    if is_named or explained or not numbers.matters or numbers.common.is_one_measurement:
        return
    apart = numbers.difference
    if names_differ(a.camera, b.camera):
        yield of_names(a, b)
    elif apart.rms_px >= OTHER_LENS * max(apart.image_size) and numbers.lens_compared:
        yield Structural(
            kind=Kind.OTHER_CAMERA,
            reason=f"projections differ by {pixels(apart.rms_px)} rms, more than any drift: another lens, or another "
            "camera",
        )


def _only(found: Structural | None) -> tuple[Structural, ...]:
    return () if found is None else (found,)


def _comparable(a: Calibration, b: Calibration) -> tuple[Calibration, Calibration]:
    return (a, b) if a.distortion is not None and b.distortion is not None else pinholes(a, b)


def _of_one_size(a: Calibration, b: Calibration) -> Structural | None:
    if is_made(b, a) or _is_one_map(a, b):
        return None
    return (
        _converted(a, b)
        or _weighed(a, b)
        or of_focal_lengths(*_comparable(a, b))
        or of_correction(a, b)
        or of_direction(a, b)
    )


def _is_one_map(a: Calibration, b: Calibration) -> bool:
    """Whether two models give each ray the same pixel."""
    if a.distortion is None or b.distortion is None or type(a.distortion) is type(b.distortion):
        return False
    at, rays = seen(a)
    return bool(len(at)) and float(np.abs(b.project(rays) - at).max()) < SAME_PX


def _converted(a: Calibration, b: Calibration) -> Structural | None:
    """The map that gives every number; where several do, the first, with the others named."""
    K, after = a.intrinsics, b.intrinsics
    centre = f"cx, cy were {K.cx:.2f}, {K.cy:.2f} and are {after.cx:.2f}, {after.cy:.2f} px"
    found = [
        (centre, Structural(kind=kind, reason=reason))
        for turn, (kind, reason) in turns(K.image_size, after.image_size).items()
        if is_turned(a, b, turn)
    ]
    found += [
        (one.shown, Structural(kind=one.kind, reason=one.reason, faulty=one.faulty))
        for one in conversions(a, b)
    ]
    if not found:
        return None
    # A quarter turn of a centred frame is one cause, not two.
    each = {one.kind: (shown, one.reason) for shown, one in found[::-1]}
    shown, likely = found[0]
    others = [text for kind, text in each.items() if kind is not likely.kind]
    told = [likely.reason, *(why if by in {"", shown} else f"{by}: {why}" for by, why in others)]
    reason = (f"{shown}: " if shown else "") + "; or ".join(told)
    return replace(likely, reason=reason, likelihood=1 / len(each))


def _weighed(a: Calibration, b: Calibration) -> Structural | None:
    """The likeliest map under the joint covariance of two measurements; None if none is needed or none does."""
    known, known_b = spread_of(a).covariance, spread_of(b).covariance
    if known is None or known_b is None:
        return None
    at, rays = seen(b)
    of_b = pixel_spread(b, known_b, lambda other: other.project(rays))
    dof = sum(std > 0 for std in known.std.values())

    def chi2(pixels_of: Pixels) -> float:
        noise = np.concatenate([pixel_spread(a, known, pixels_of), of_b], axis=-1)
        both = np.isfinite(noise).all(axis=(1, 2))
        N, d = noise[both].reshape(2 * both.sum(), -1), (pixels_of(a) - at)[both].ravel()
        return float(d @ np.linalg.solve(N @ N.T + FLOOR_PX**2 * np.eye(len(d)), d))

    nothing = chi2(lambda other: other.project(rays))
    if dof == 0 or chi_square_tail(dof, nothing) >= SHARE:
        return None
    maps = dict(_maps(a, b, rays))
    found = {cause: chi2(pixels_of) + 2 * math.log(ODDS) for cause, pixels_of in maps.items()}
    least = min(nothing, *found.values())
    weights = {cause: math.exp((least - value) / 2) for cause, value in found.items()}
    (kind, reason), value = min(found.items(), key=lambda one: one[1])
    value -= 2 * math.log(ODDS)
    if chi_square_tail(dof, value) < SHARE or value > nothing:
        return None
    return Structural(
        kind=kind,
        reason=f"{reason}: then A and B agree within σ (χ² {value:.3g} of {dof} numbers), and else they do not "
        f"({nothing:.3g})",
        likelihood=weights[kind, reason] / (sum(weights.values()) + math.exp((least - nothing) / 2)),
    )


def _maps(a: Calibration, b: Calibration, rays: FloatArray) -> Iterator[tuple[tuple[Kind, str], Pixels]]:
    """Yield what can lie between two measurements of one lens."""
    sizes = a.intrinsics.image_size, b.intrinsics.image_size
    for turn, cause in turns(*sizes).items():
        yield cause, turned(turn, rays, sizes[1])
    names = tangential_names(a, b)
    if names is not None:
        said = " and ".join(names)
        yield (Kind.TANGENTIAL_SWAP, f"{said} changed places"), _with_terms(rays, names, names[::-1], 1.0)
        yield (Kind.TANGENTIAL_SIGN, f"{said} have the opposite sign"), _with_terms(rays, names, names, -1.0)


def _with_terms(rays: FloatArray, names: Sequence[str], sources: Sequence[str], sign: float) -> Pixels:
    def pixels_of(calibration: Calibration) -> FloatArray:
        lens = calibration.distortion
        if lens is not None:
            terms = lens.coefficients
            values = {name: sign * terms[source] for name, source in zip(names, sources, strict=True)}
            calibration = replace(calibration, distortion=replace(lens, **values))
        return calibration.project(rays)

    return pixels_of
