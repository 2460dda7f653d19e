"""Uncertainty of a calibration and of a difference between two, and whether it explains the difference.

A K without a covariance is not exact. The uncertainty of its focal length depends on its origin: an EXIF
focal length is rounded and nominal, a maker's table describes the type and not the unit, and in a bundle
adjustment focal length and height are correlated. What is usual for a grade tells whether a difference proves a
change, and is no noise: only measured standard deviations are propagated.

Only measured covariances of both can explain a difference between other calibrations. If one of two independent
measurements has none, it is assumed to be somewhat more uncertain than the other. Between two copies of one
measurement there is no noise.

Two tests are made, each at half the significance level. The first takes the largest difference over all
pixels in units of its standard deviation, and compares it with the distribution of this maximum under noise
(sampled from the propagated covariance, because neighbouring pixels are correlated). The second tests the
image scale, on which heights in a map depend.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from enum import StrEnum
from typing import Annotated, Final

from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, np
from calibrary.calib.projection_difference import ProjectionDifference
from calibrary.calibration import Calibration, Covariance, Grade
from calibrary.errors import CalibrationError
from calibrary.jobs.diff.common_numbers import K_NAMES, Common, has_other_source, values_of
from calibrary.jobs.diff.lens_rays import axial, is_one_lens
from calibrary.jobs.diff.wording import listed
from calibrary.probability import normal_tails
from calibrary.records import Meta, Record


class Prior(Struct, frozen=True, kw_only=True):
    """Typical relative standard deviations.

    Attributes:
        focal: of fx and fy together.
        aspect: of fx / fy.
        centre: of cx and cy, as a fraction of the width.
        lens: of the displacement of the corners by the distortion.
    """

    focal: float
    aspect: float
    centre: float
    lens: float


PRIORS: Final = {
    Grade.CALIBRATED: Prior(focal=0.001, aspect=0.0002, centre=0.0005, lens=0.01),
    Grade.ADJUSTED: Prior(focal=0.002, aspect=0.0005, centre=0.001, lens=0.02),
    Grade.DESIGN: Prior(focal=0.003, aspect=0.001, centre=0.005, lens=0.1),
    Grade.DERIVED: Prior(focal=0.015, aspect=0.005, centre=0.01, lens=0.2),
    Grade.PRIOR: Prior(focal=0.05, aspect=0.02, centre=0.02, lens=0.5),
    Grade.SEED: Prior(focal=0.3, aspect=0.05, centre=0.05, lens=1.0),
}
"""Makers' tables agree with a unit's focal length to about 0.3 %, EXIF to 1 … 2 %. Calibrations of one unit from
several sets of frames scatter by 0.05 … 0.1 %, three times as much as their own solves state."""


class Spread(Struct, frozen=True, kw_only=True):
    """Measured uncertainty of a calibration's parameters.

    Attributes:
        covariance: of K and the distortion coefficients, including the variance factor if known; None if it states
            none, at least for K.
        source: where it is from, in words.
        silent: coefficients that were measured and for which none is stated.
    """

    covariance: Covariance | None
    source: str
    silent: tuple[str, ...] = ()

    @property
    def known(self) -> Covariance:
        """The covariance; raises CalibrationError if it is not stated."""
        if self.covariance is None:
            raise CalibrationError("no standard deviation of its focal length is stated")
        return self.covariance


def spread_of(calibration: Calibration, held: Collection[str] | None = None) -> Spread:
    """The calibration's covariance with its variance factor; else its standard deviations.

    A parameter without a stated σ that is 0, or that ``held`` names, was fixed by the model: it has variance 0.

    Args:
        calibration: with its quality.
        held: parameters that were given, not measured; by default all for which nothing is stated.
    """
    quality, names = calibration.quality, _names(calibration)
    if quality is not None and quality.covariance is not None and "fx" in quality.covariance.names:
        stated, C = quality.covariance.names, _padded(quality.covariance, names)
        how, lacks = "its own covariance", ""
    elif quality is not None and {"fx", "fy"} <= quality.std.keys():
        stated, C = tuple(quality.std), np.diag(np.square([quality.std.get(name, 0.0) for name in names]))
        how, lacks = "its own standard deviations", ", without their correlations"
    else:
        usual = f"a K of grade {calibration.grade.value} is usually known to {PRIORS[calibration.grade].focal:.1%} of f"
        return Spread(covariance=None, source=f"none stated; {usual}")
    values = values_of(calibration)
    silent = tuple(
        name for name in names if held is not None and values[name] and name not in (*stated, *held, *K_NAMES)
    )
    lacks += f"; none of {listed(silent)}" if silent else ""
    inflated = f", × κ² = {quality.inflation:.2g}" if quality.inflation > 1 else ""
    return Spread(
        covariance=Covariance.from_matrix(names, C * quality.inflation),
        source=f"{how}{inflated}{lacks}",
        silent=silent,
    )


def std_of(calibration: Calibration, name: str) -> float:
    """Measured standard deviation of one parameter, including the variance factor; 0 if unknown."""
    quality = calibration.quality
    if quality is None:
        return 0.0
    covariance = quality.covariance.std if quality.covariance is not None else {}
    return quality.std.get(name, covariance.get(name, 0.0)) * math.sqrt(quality.inflation)


def _names(calibration: Calibration) -> tuple[str, ...]:
    """K, and the coefficients that can vary by themselves: of a splined lens none."""
    lens = calibration.distortion
    coefficients = lens.names() if lens is not None else ()
    return (
        "fx",
        "fy",
        "cx",
        "cy",
        *(name for name in coefficients if isinstance(getattr(lens, name), float)),
    )


def _padded(covariance: Covariance, names: tuple[str, ...]) -> FloatArray:
    known = [name for name in names if name in covariance.names]
    at = [names.index(name) for name in known]
    C = np.zeros((len(names), len(names)))
    C[np.ix_(at, at)] = covariance.of(tuple(known))
    return C


FLOOR_PX: Final = 0.02
"""Smallest standard deviation assumed for a pixel, whatever the covariance states."""
DRAWS: Final = 2000
EVERY: Final = 2
"""Step on the grid for the sampling; the fields are smooth."""
TAIL: Final = 0.01
"""Probability at which the tail of the maximum's distribution is matched."""

BORROWED: Final = 1.5
"""Standard deviations assumed for a calibration that states none, as a multiple of the other's: calibration sessions
of one kind differ by this much."""

USUAL_SIGMAS: Final = 2.6
"""Calibrations that differ by at most as many of their grades' typical standard deviations are no proof of a change."""
CENTRE_SIGMAS: Final = 4.0
"""The same for the principal point: a camera that turns takes most of what it moved."""


class Basis(StrEnum):
    """Basis of the uncertainty of a difference."""

    BOTH = "both state their uncertainty"
    PARTIAL = "the coefficients without a stated σ are taken to be as usual for their grades"
    ONE = "one states its uncertainty and the other is taken to be 1.5 times as uncertain"
    TYPICAL = "what calibrations of their grades are usually worth"
    NONE = "unknown: at least one states no uncertainty"
    COPY = "none: both hold one measurement"


class Scale(Struct, frozen=True, kw_only=True):
    """Change of the image scale between two projections.

    Attributes:
        change: relative, along x or y, whichever is larger; positive if B magnifies more.
        std: standard deviation of the change; None without a covariance.
    """

    change: float
    std: float | None


class Significance(Record):
    """Significance of a difference.

    Attributes:
        basis: basis of the uncertainty of the difference.
        p: twice the smaller of the two tests' probabilities of such a difference from noise alone; null if no
            uncertainty may be assumed, or if what is usual stands in for noise.
        explains: whether noise explains every part of the difference that matters; null if no uncertainty may be
            assumed.
        spread_a, spread_b: source of the standard deviations of a and b.
    """

    basis: Basis
    p: Annotated[float, Meta(ge=0, le=1)] | None
    explains: bool | None
    spread_a: str
    spread_b: str


def basis_of(a: Calibration, b: Calibration, spreads: tuple[Spread, Spread], common: Common) -> Basis:
    """Basis of the uncertainty of the difference between two calibrations."""
    if common.is_copy:
        return Basis.COPY
    measured = [spread.covariance is not None for spread in spreads]
    if all(measured):
        return Basis.PARTIAL if any(spread.silent for spread in spreads) else Basis.BOTH
    if common.is_one_measurement or not has_other_source(a, b):
        return Basis.NONE
    whole = not any(spread.silent for spread in spreads)
    if any(measured) and whole and a.grade.is_measured and b.grade.is_measured:
        return Basis.ONE
    return Basis.TYPICAL


def covariances_of(basis: Basis, spreads: tuple[Spread, Spread]) -> tuple[Covariance, Covariance] | None:
    """Covariances of both calibrations according to the basis; None if they are not measured."""
    one, two = (spread.covariance for spread in spreads)
    if basis is Basis.BOTH and one is not None and two is not None:
        return one, two
    measured = one or two
    if basis is not Basis.ONE or measured is None:
        return None
    # The propagation treats both models alike, so a multiple of one covariance represents both.
    both, none = _times(measured, 1 + BORROWED**2), _times(measured, 0.0)
    return (both, none) if one is not None else (none, both)


def is_usual(a: Calibration, b: Calibration) -> bool:
    """Whether calibrations of these grades usually differ by as much, in K and in what the lens does."""
    before, after = axial(a), axial(b)
    priors, width = [PRIORS[one.grade] for one in (a, b)], before.image_size[0]
    focal = [std_of(one, "fx") / one.intrinsics.fx or PRIORS[one.grade].focal for one in (a, b)]
    moved = math.hypot(after.cx - before.cx, after.cy - before.cy)
    shares = (
        (math.log(after.fx * after.fy / (before.fx * before.fy)) / 2, USUAL_SIGMAS, focal),
        (
            math.log(after.fx * before.fy / (before.fx * after.fy)),
            USUAL_SIGMAS,
            [one.aspect for one in priors],
        ),
        (moved / width, CENTRE_SIGMAS, [one.centre for one in priors]),
    )
    of_lens = USUAL_SIGMAS * math.hypot(*(prior.lens for prior in priors))
    return is_one_lens(a, b, within=of_lens) is not False and all(
        abs(change) <= most * math.hypot(*stds) for change, most, stds in shares
    )


def image_scale(difference: ProjectionDifference) -> Scale:
    """Image scale along x and y fitted to the difference, each pixel weighted by its variance."""
    region = difference.region
    std = difference.std_px[region] if difference.std_px is not None else np.ones(int(region.sum()))
    known = 1 / (std**2 + FLOOR_PX**2)
    found = []
    for axis in (0, 1):
        at = difference.pixels[region][:, axis]
        weights = known * (at - np.average(at, weights=known))
        weights = weights / float(weights @ at)
        noise = difference.noise[region][:, axis] if difference.noise is not None else None
        found.append(
            Scale(
                change=float(weights @ difference.vectors[region][:, axis]),
                std=float(np.linalg.norm(weights @ noise)) if noise is not None else None,
            )
        )
    return max(found, key=lambda scale: abs(scale.change))


def noise_test(
    difference: ProjectionDifference, scale: Scale, *, level: float, matters_px: float, matters_scale: float
) -> tuple[float, bool] | None:
    """Compare a difference with its propagated noise.

    Args:
        difference: with noise.
        scale: of the same difference.
        level: significance level; noise is not an explanation below it.
        matters_px: pixels that differ by less need no explanation.
        matters_scale: a smaller change of scale needs no explanation.

    Returns:
        Its probability from noise alone, and whether noise explains what matters of it; None without a covariance.
    """
    if difference.noise is None:
        return None
    whitening = _whitening(difference.noise)
    z = np.linalg.norm(np.einsum("rcij,rcj->rci", whitening, np.nan_to_num(difference.vectors)), axis=-1)
    z = np.where(difference.region, z, 0.0)
    tail = _tail(whitening @ difference.noise, difference.region)
    large: BoolArray = np.asarray(difference.region & (np.nan_to_num(difference.lengths_px) >= matters_px))
    by_pixel = min(1.0, tail * _rayleigh(float(z.max(initial=0.0))))
    of_large = min(1.0, tail * _rayleigh(float(z[large].max(initial=0.0))))
    by_scale = _two_sided(scale)
    pixels_explained = of_large >= level / 2
    scale_explained = by_scale >= level / 2 or abs(scale.change) < matters_scale
    return min(1.0, 2 * min(by_pixel, by_scale)), pixels_explained and scale_explained


def _two_sided(scale: Scale) -> float:
    # Where the frame's corners have no ray, the scale is unknown (NaN) and needs no explanation.
    if scale.std is None or not scale.change or not math.isfinite(scale.change):
        return 1.0
    return normal_tails(scale.change / scale.std) if scale.std > 0 else 0.0


def _whitening(noise: FloatArray) -> FloatArray:
    """Whitening matrices W (R, C, 2, 2): WᵀW is the inverse of each pixel's covariance."""
    C = noise @ np.swapaxes(noise, -1, -2) + FLOOR_PX**2 * np.eye(2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(C)))


def _tail(whitened: FloatArray, region: BoolArray) -> float:
    """Ratio of the probability that the maximum over all pixels exceeds a large z to that for a single pixel.

    Estimated by sampling at the z that the maximum exceeds with a probability of 1 %; it is nearly constant
    beyond.
    """
    rows = (slice(None, None, EVERY), slice(None, None, EVERY))
    inside = region[rows]
    if not inside.any():
        return 1.0
    noise = whitened[rows][inside]
    draws = np.random.default_rng(0).standard_normal((noise.shape[-1], DRAWS))
    fields = (noise.reshape(-1, noise.shape[-1]) @ draws).reshape(len(noise), 2, DRAWS)
    z = float(np.quantile(np.sqrt((fields**2).sum(axis=1).max(axis=0)), 1 - TAIL))
    return max(1.0, TAIL / max(_rayleigh(z), 1e-300))


def _rayleigh(z: float) -> float:
    """Probability that the length of a two-dimensional standard normal vector exceeds z."""
    return math.exp(-z * z / 2) if math.isfinite(z) else 0.0


def _times(covariance: Covariance, factor: float) -> Covariance:
    return Covariance.from_matrix(covariance.names, covariance.matrix * factor)
