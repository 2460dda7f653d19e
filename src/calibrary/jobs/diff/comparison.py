"""Two calibrations of one camera compared: in numbers, in pixels, on the ground, against their noise; and a verdict.

Significance and size are two questions. The first is χ² = dᵀ (C₁ + C₂)⁻¹ d, of all parameters of a common model, of
K alone and of the focal lengths alone, the least likely of the three counting three times (Bonferroni): a change of
one number must not drown in eight others. Where the models differ it is the projection's. The second is what is
left between the two projections when the camera may turn (:mod:`calibrary.calib.projection_difference`). Either
alone raises false alarms: a good calibration tells changes that no map would show, and a poor one moves by whole
pixels from day to day. A drift is both, and both in the same thing: that cx moved, which turning the camera undoes,
does not turn the noise of pixels in the frame's corners into a drift.

Where a change is significant but its size is uncertain, it is taken for large until it is shown to be small (as in a
test of equivalence: D. J. Schuirmann, "A comparison of the two one-sided tests procedure", 1987). Otherwise a focal
length that moved by just the limit would raise the alarm in every second comparison only.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Final

import numpy as np
from scipy.special import chdtrc, chdtri

from calibrary.arrays import FloatArray
from calibrary.calib.projection_difference import ProjectionDifference, projection_difference
from calibrary.calibration import Calibration
from calibrary.errors import CalibrationError, FrameError
from calibrary.jobs.diff.frames import common_frame
from calibrary.jobs.diff.priors import Spread, spread_of
from calibrary.jobs.diff.structure import Kind, Structural, signatures
from calibrary.policy import FLEET, Policy
from calibrary.records import Meta, Record, replace

__all__ = ["ChangeVerdict", "ChiSquare", "Comparison", "Ground", "Numbers", "Parameter", "compare"]


SAME: Final = 1e-9
"""Two numbers this near, relative to the larger, are one number written twice."""

K_NAMES: Final = ("fx", "fy", "cx", "cy")

MOVED_SIGMAS: Final = 1.96
"""A focal length nearer than this to what it was is not what a significant change is about."""
SURELY_SIGMAS: Final = 2.326
"""One side, 99 %: a change is below a limit if with this much added it still is."""
SURE_LEVEL: Final = 0.01
"""Of a pixel that moved: what noise does anywhere in the frame with this chance (Scheffé's simultaneous bound)."""


class ChangeVerdict(StrEnum):
    """What a comparison comes to."""

    IDENTICAL = "identical"
    NOISE = "within noise"
    NEGLIGIBLE = "significant but negligible"
    DRIFT = "drift"
    STRUCTURAL = "structural"


class Parameter(Record):
    """One number of both calibrations.

    Attributes:
        name: fx, fy, cx, cy, skew, or a coefficient of the distortion.
        a, b: None where the calibration has no such number.
        std_a, std_b: None where nothing is known of it.
        delta: b less a.
        z: delta in standard deviations of the difference.
    """

    name: str
    a: float | None
    b: float | None
    std_a: float | None
    std_b: float | None
    delta: float | None
    z: float | None

    @classmethod
    def of(
        cls,
        name: str,
        a: float | None,
        b: float | None,
        std_a: float | None = None,
        std_b: float | None = None,
    ) -> Parameter:
        """With the difference and what it is in standard deviations."""
        delta = b - a if a is not None and b is not None else None
        std = float(np.hypot(std_a, std_b)) if std_a is not None and std_b is not None else 0.0
        z = delta / std if delta is not None and std > 0 else None
        return cls(name=name, a=a, b=b, std_a=std_a, std_b=std_b, delta=delta, z=z)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChiSquare:
    """One test of whether some parameters differ by more than noise.

    Attributes:
        of: which parameters, in words.
        value: dᵀ C⁻¹ d.
        dof: how many parameters they are.
    """

    of: str
    value: float
    dof: int

    @property
    def p(self) -> float:
        """Chance of a value this large from noise alone."""
        return float(chdtrc(self.dof, self.value))


class Ground(Record):
    """What a difference does to a map.

    Attributes:
        altitude_m: above ground.
        gsd_cm: ground sampling distance there, looking straight down.
        rms_cm, max_cm: of the difference in pixels, on the ground.
        height_cm: error of heights by the difference in focal length, positive where B sees farther down.
    """

    altitude_m: Annotated[float, Meta(gt=0)]
    gsd_cm: Annotated[float, Meta(ge=0)]
    rms_cm: Annotated[float, Meta(ge=0)]
    max_cm: Annotated[float, Meta(ge=0)]
    height_cm: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Numbers:
    """What can be said once both calibrations are in one frame.

    Attributes:
        a, b: in that frame.
        parameters: every number of both.
        difference: between the projections, over the frame.
        p: chance of a difference this large from noise alone.
        chi2: the tests that were made on the parameters; empty where the models differ.
        focal_change: Δf / f, of fx or fy, whichever is larger.
        focal_std: of that change.
        sure_px: largest difference among the pixels that noise does not explain, 0 where it explains all.
        spread_a, spread_b: what either is uncertain by, and how that is known.
        lens_compared: False where one of the two distortions is unknown and K alone was compared.
    """

    a: Calibration
    b: Calibration
    parameters: tuple[Parameter, ...]
    difference: ProjectionDifference
    p: float
    chi2: tuple[ChiSquare, ...]
    focal_change: float
    focal_std: float
    sure_px: float
    spread_a: Spread
    spread_b: Spread
    lens_compared: bool

    def ground(self, altitude_m: float) -> Ground:
        """What the difference does to a map made from a height."""
        gsd_cm = 100 * altitude_m / self.a.intrinsics.fx
        return Ground(
            altitude_m=altitude_m,
            gsd_cm=gsd_cm,
            rms_cm=self.difference.rms_px * gsd_cm,
            max_cm=self.difference.max_px * gsd_cm,
            height_cm=100 * altitude_m * self.focal_change,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Two calibrations and what lies between them.

    Attributes:
        a, b: as they were given.
        verdict: what it comes to.
        alarm: whether a person has to look: a drift, or a change of kind that is no mere resize.
        reasons: why, in sentences.
        structural: changes of kind.
        steps: what brought both to one frame.
        numbers: None where nothing does, which is then a change of kind.
    """

    a: Calibration
    b: Calibration
    verdict: ChangeVerdict
    alarm: bool
    reasons: tuple[str, ...]
    structural: tuple[Structural, ...]
    steps: tuple[str, ...]
    numbers: Numbers | None


def compare(a: Calibration, b: Calibration, policy: Policy = FLEET) -> Comparison:
    """Hold the later calibration ``b`` against ``a``.

    Raises:
        FrameError: no scale and no crop brings the two to one frame, and no signature says why.
        CalibrationError: they see too little in common.
    """
    structural = signatures(a, b)
    try:
        frame = common_frame(a, b)
    except FrameError as error:
        if not structural:
            raise
        return Comparison(
            a=a,
            b=b,
            verdict=ChangeVerdict.STRUCTURAL,
            alarm=True,
            reasons=(*(one.reason for one in structural), error.message),
            structural=structural,
            steps=(),
            numbers=None,
        )
    numbers = _numbers(frame.a, frame.b)
    verdict, reasons = _judged(numbers, structural, policy)
    grave = any(one.kind is not Kind.RESIZE for one in structural)
    return Comparison(
        a=a,
        b=b,
        verdict=verdict,
        alarm=grave or _is_drift(numbers, policy),
        reasons=reasons,
        structural=structural,
        steps=frame.steps,
        numbers=numbers,
    )


def _numbers(a: Calibration, b: Calibration) -> Numbers:
    lens_compared = a.distortion is not None and b.distortion is not None
    one, two = (a, b) if lens_compared else (_without_lens(a), _without_lens(b))
    spread_a, spread_b = spread_of(one), spread_of(two)
    measured = spread_a.is_measured and spread_b.is_measured
    covariances = (spread_a.covariance, spread_b.covariance)
    difference = projection_difference(
        one, two, covariances=covariances, trusted_px=1.0 if measured else float("inf")
    )
    if not difference.region.any():
        difference = projection_difference(one, two, covariances=covariances, trusted_px=float("inf"))
    chi2 = _tests(one, two, spread_a, spread_b)
    if chi2:
        p = min(1.0, len(chi2) * min(test.p for test in chi2))
    elif difference.p is not None:
        p = difference.p
    else:
        raise CalibrationError("neither calibration says how far it can be trusted, not even by its grade")
    focal_change, focal_std = max(
        (_focal_change(one, two, spread_a, spread_b, name) for name in K_NAMES[:2]),
        key=lambda pair: abs(pair[0]),
    )
    parameters = max(len(spread_a.covariance.names), len(spread_b.covariance.names))
    return Numbers(
        a=a,
        b=b,
        parameters=_parameters(a, b, spread_a, spread_b),
        difference=difference,
        p=p,
        chi2=chi2,
        focal_change=focal_change,
        focal_std=focal_std,
        sure_px=_sure_px(difference, parameters),
        spread_a=spread_a,
        spread_b=spread_b,
        lens_compared=lens_compared,
    )


def _focal_change(a: Calibration, b: Calibration, one: Spread, two: Spread, name: str) -> tuple[float, float]:
    """Of fx or fy, relative, and its standard deviation."""
    f_a, f_b = float(getattr(a.intrinsics, name)), float(getattr(b.intrinsics, name))
    std = np.hypot(one.covariance.std[name] / f_a, two.covariance.std[name] / f_b)
    return f_b / f_a - 1, float(std)


def _sure_px(difference: ProjectionDifference, parameters: int) -> float:
    """The largest difference in the region that is more than noise of that many parameters does anywhere in it."""
    if difference.std_px is None:
        return difference.max_px
    lengths, bound = difference.lengths_px, float(np.sqrt(chdtri(parameters, SURE_LEVEL)))
    with np.errstate(invalid="ignore"):
        sure = difference.region & (lengths > bound * difference.std_px)
    return float(lengths[sure].max(initial=0.0))


def _without_lens(calibration: Calibration) -> Calibration:
    return replace(calibration, distortion=None)


def _tests(a: Calibration, b: Calibration, one: Spread, two: Spread) -> tuple[ChiSquare, ...]:
    names = one.covariance.names
    if type(a.distortion) is not type(b.distortion) or names != two.covariance.names:
        return ()
    parts = {"all parameters": names, "K": K_NAMES, "focal lengths": K_NAMES[:2]}
    tests = []
    for of, part in parts.items():
        d = np.array([_value(b, name) - _value(a, name) for name in part])
        value, dof = _chi2(d, one.covariance.of(part) + two.covariance.of(part))
        tests.append(ChiSquare(of=of, value=value, dof=dof))
    return tuple(tests)


def _chi2(d: FloatArray, C: FloatArray) -> tuple[float, int]:
    """Over the parameters that are not exact; what is exact in both is a part of the model, no measurement."""
    free = np.diag(C) > 0
    d, C = d[free], C[np.ix_(free, free)]
    scale = np.sqrt(np.diag(C))
    inverse = np.linalg.pinv(C / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    return float((d / scale) @ inverse @ (d / scale)), int(free.sum())


def _parameters(a: Calibration, b: Calibration, one: Spread, two: Spread) -> tuple[Parameter, ...]:
    std_a, std_b = one.covariance.std, two.covariance.std
    lenses = [c.distortion.coefficients if c.distortion is not None else {} for c in (a, b)]
    skew = ("skew",) if a.intrinsics.skew or b.intrinsics.skew else ()
    # Where the models differ a name they share means two things, and neither is subtracted from the other.
    same_model = type(a.distortion) is type(b.distortion)
    rows = [
        Parameter.of(
            name,
            float(getattr(a.intrinsics, name)),
            float(getattr(b.intrinsics, name)),
            std_a.get(name),
            std_b.get(name),
        )
        for name in (*K_NAMES, *skew)
    ]
    if same_model:
        rows += [
            Parameter.of(name, lenses[0][name], lenses[1][name], std_a.get(name), std_b.get(name))
            for name in lenses[0]
        ]
    else:
        rows += [Parameter.of(name, value, None, std_a.get(name)) for name, value in lenses[0].items()]
        rows += [Parameter.of(name, None, value, None, std_b.get(name)) for name, value in lenses[1].items()]
    return tuple(rows)


def _value(calibration: Calibration, name: str) -> float:
    if name in K_NAMES:
        return float(getattr(calibration.intrinsics, name))
    lens = calibration.distortion
    return lens.coefficients[name] if lens is not None else 0.0


def _judged(
    numbers: Numbers, structural: tuple[Structural, ...], policy: Policy
) -> tuple[ChangeVerdict, tuple[str, ...]]:
    measured = _measured(numbers)
    if structural:
        return ChangeVerdict.STRUCTURAL, (*(one.reason for one in structural), f"in one frame, {measured}")
    if _is_same(numbers):
        return ChangeVerdict.IDENTICAL, ("every number is the same",)
    if not numbers.p < policy.drift_significance:
        return ChangeVerdict.NOISE, (f"{measured}, and noise does as much in {numbers.p:.0%} of all cases",)
    chance = f"noise would do so with a chance of {numbers.p:.1g}"
    if not _is_drift(numbers, policy):
        limits = f"{policy.drift_focal:.2%} and {policy.drift_px:g} px"
        return ChangeVerdict.NEGLIGIBLE, (
            f"{measured}; {chance}, but what noise does not explain stays below {limits}",
        )
    if _moves_pixels(numbers, policy) or abs(numbers.focal_change) >= policy.drift_focal:
        return ChangeVerdict.DRIFT, (f"{measured}; {chance}",)
    known = f"the focal lengths' change is known to ± {numbers.focal_std:.3%} only"
    return ChangeVerdict.DRIFT, (
        f"{measured}; {chance}, and {known}: {policy.drift_focal:.2%} cannot be ruled out",
    )


def _measured(numbers: Numbers) -> str:
    seen = numbers.difference
    return (
        f"focal lengths differ by {numbers.focal_change:+.3%} and projections by {seen.rms_px:.3g} px rms, "
        f"{seen.max_px:.3g} px at most, the camera turned by {seen.rotation_deg:.3g}°"
    )


def _is_same(numbers: Numbers) -> bool:
    if type(numbers.a.distortion) is not type(numbers.b.distortion):
        return numbers.lens_compared and numbers.difference.max_px < SAME * max(
            numbers.a.intrinsics.image_size
        )
    return all(
        row.a is not None and row.b is not None and abs(row.a - row.b) <= SAME * max(abs(row.a), abs(row.b))
        for row in numbers.parameters
    )


def _is_drift(numbers: Numbers, policy: Policy) -> bool:
    if not numbers.p < policy.drift_significance:
        return False
    return _moves_pixels(numbers, policy) or _moves_focal_length(numbers, policy)


def _moves_pixels(numbers: Numbers, policy: Policy) -> bool:
    return numbers.sure_px >= policy.drift_px


def _moves_focal_length(numbers: Numbers, policy: Policy) -> bool:
    """Whether the focal length is what moved, and not surely by less than the limit."""
    change, std = abs(numbers.focal_change), numbers.focal_std
    return change >= MOVED_SIGMAS * std and change + SURELY_SIGMAS * std >= policy.drift_focal
