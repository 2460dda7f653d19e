"""K over time from the pixels of ordinary flights: one flight per unit and date, compared with the registered K.

Checking a flight takes about a minute, so there is a time limit. All units take turns; for each the newest
date is checked first, then the oldest, then those between.

The focal lengths of a unit, each with its own σ, are fitted by weighted least squares with three models: a constant, a
step at a change of firmware, a straight line over time. A change is reported only if it exceeds 3 σ, and as a
step or a drift only if that model fits (χ² test).

Reference: P. R. Bevington and D. K. Robinson, "Data Reduction and Error Analysis", chapters 4, 6 and 11.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import date
from itertools import pairwise, zip_longest
from time import monotonic
from typing import Final

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import RegistryError
from calibrary.jobs.audit.age import Rule
from calibrary.jobs.audit.findings import Answer, camera_words, tolerance_of, unit_name
from calibrary.jobs.audit.flights import FlightDay, Flown
from calibrary.jobs.audit.report import Change, DatedCheck, UnitOverTime, Use, Verification
from calibrary.jobs.survey.placing import Settled
from calibrary.jobs.verify.look import MOST_IMAGES, look
from calibrary.policy import Policy
from calibrary.probability import chi_square_tail, normal_tails
from calibrary.progress import Progress
from calibrary.records import replace
from calibrary.registry.paths import id_of
from calibrary.registry.resolution import RegistryIndex, Resolution
from calibrary.sfm.pixel_check import PixelVerdict
from calibrary.sfm.pixel_judging import FEWEST_IMAGES
from calibrary.validation import Finding, Severity

MOST_READ: Final = 400
"""Most images of a flight, from its middle, whose positions are read in order to choose a dozen."""
SURE_SIGMAS: Final = 2.0
"""A contradiction is an error if the K nearest to the entry within so many σ is still beyond its tolerance."""
SIGMAS: Final = 3.0
BY_CHANCE: Final = normal_tails(SIGMAS)
"""Significance level of a change: the probability that noise alone exceeds 3 σ."""
FITS: Final = 0.01
"""A step or a line fits if the probability of a larger χ² is at least this."""
FEWEST_DATES: Final = 2


class _Sample(Struct, frozen=True, kw_only=True):
    """The flight of one unit and date, and the K to be checked against its pixels."""

    flown: Flown
    part: FlightDay
    K: Calibration
    found: Resolution | None


def verify_flights(
    flown: Sequence[Flown],
    index: RegistryIndex,
    policy: Policy,
    today: date,
    *,
    minutes: float,
    progress: Progress | None,
) -> Verification:
    """Check K against the pixels of one flight per unit and date.

    Args:
        flown: the cameras.
        index: of the registry.
        policy: the limits.
        today: date assumed for images that state none.
        minutes: time after which no further flight is started.
        progress: called with (done, total, what) for each flight.
    """
    units: dict[CameraKey, list[_Sample]] = {}
    for sample in _samples(flown, index, policy, today):
        units.setdefault(replace(sample.flown.key, firmware=None), []).append(sample)
    queues = [_newest_and_oldest_first(samples) for samples in units.values()]
    due = [one for turn in zip_longest(*queues) for one in turn if one is not None]
    end, checks = monotonic() + 60 * minutes, dict[int, DatedCheck]()
    for number, sample in enumerate(due, start=1):
        if number > 1 and monotonic() > end:
            break
        of_one = _prefixed(progress, f"flight {number} of {len(due)}: ")
        checks[id(sample)] = _checked(sample, policy, of_one)
    return Verification(
        images=MOST_IMAGES,
        minutes=minutes,
        left_out=len(due) - len(checks),
        units=tuple(
            _unit(key, samples[0].flown, [checks[id(one)] for one in samples if id(one) in checks])
            for key, samples in units.items()
            if any(id(one) in checks for one in samples)
        ),
    )


def pixel_findings(done: Verification, flown: Sequence[Flown]) -> Iterator[Finding]:
    """Findings on each K that the pixels contradict, and on each K that changed over time.

    A flight with pixels that do not determine K gives no finding.
    """
    names = {replace(one.key, firmware=None): camera_words(one) for one in flown}
    for unit in done.units:
        against: dict[str, list[DatedCheck]] = {}
        for one in unit.flights:
            if one.entry is not None and one.pixels.verdict is PixelVerdict.CONTRADICTS:
                against.setdefault(one.entry, []).append(one)
        for entry, checks in against.items():
            yield _contradicted(names[unit.camera], entry, checks)
        if unit.by is not None:
            yield _change_finding(names[unit.camera], unit)


def _samples(flown: Sequence[Flown], index: RegistryIndex, policy: Policy, today: date) -> Iterator[_Sample]:
    """For each unit and date the flight with the most images, if these suffice and there is a K to check."""
    best: dict[tuple[CameraKey, date | None, str | None], tuple[Flown, FlightDay]] = {}
    for one in flown:
        for part in one.days:
            # For images without a date each folder counts as a separate flight.
            at = replace(one.key, firmware=None), part.day, part.flight if part.day is None else None
            if len(part.paths) >= FEWEST_IMAGES and (
                at not in best or len(part.paths) > len(best[at][1].paths)
            ):
                best[at] = one, part
    for one, part in best.values():
        found = _registered(one, part, index, today)
        K = _of_entry(one, found, policy) if found is not None else None
        K, found = (K, found) if K is not None else (one.camera.calibration, None)
        if K is not None:
            yield _Sample(flown=one, part=part, K=K, found=found)


def _of_entry(flown: Flown, found: Resolution, policy: Policy) -> Calibration | None:
    """The entry's K of these images, be it contradicted; None if nothing tells how they came from its frame."""
    survey = Answer(flown=flown, use=Use.USED, resolution=found).survey(policy)
    weighed = survey.weigh(survey.claims[0]) if survey is not None else None
    if weighed is None or not weighed.ways or weighed.settled is Settled.AMBIGUOUS:
        return None
    return weighed.ways[0].calibration


def _registered(flown: Flown, part: FlightDay, index: RegistryIndex, today: date) -> Resolution | None:
    if not flown.key.make or not flown.key.model:
        return None
    try:
        return index.resolve(flown.key, on=part.day or today)
    except RegistryError:
        # The audit itself reports ambiguous and unreadable entries.
        return None


def _newest_and_oldest_first(samples: Sequence[_Sample]) -> list[_Sample]:
    """Order samples: newest, oldest (these show most of a change), then those that halve the longest interval."""
    rest = sorted(samples, key=lambda one: (one.part.day or date.min, one.part.flight))
    chosen = [rest.pop()]
    while rest:
        days = [(one.part.day or date.min).toordinal() for one in chosen]

        def apart(one: _Sample, days: Sequence[int] = days) -> int:
            return min(abs((one.part.day or date.min).toordinal() - day) for day in days)

        chosen.append(max(rest, key=apart))
        rest.remove(chosen[-1])
    return chosen


def _prefixed(progress: Progress | None, before: str) -> Progress | None:
    return (lambda done, total, what: progress(done, total, before + what)) if progress is not None else None


def _checked(sample: _Sample, policy: Policy, progress: Progress | None) -> DatedCheck:
    paths = sample.part.paths
    begin = max(0, (len(paths) - MOST_READ) // 2)
    seen = look(paths[begin : begin + MOST_READ], sample.K, progress=progress)
    entry = sample.found.entry if sample.found is not None else None
    validity = entry.validity if entry is not None else None
    return DatedCheck(
        flight=sample.part.flight,
        day=sample.part.day,
        firmware=sample.flown.key.firmware,
        entry=id_of(sample.found.path) if sample.found is not None else None,
        tolerance=tolerance_of(entry, policy) if entry is not None else None,
        valid_from=validity.first if validity is not None else None,
        valid_until=validity.last if validity is not None else None,
        pixels=seen.check(sample.K, policy.source_agreement),
    )


def _unit(camera: CameraKey, flown: Flown, checks: Sequence[DatedCheck]) -> UnitOverTime:
    found = judge_over_time([*_measurements(checks)], unit_known=camera.serial is not None)
    return UnitOverTime(
        name=unit_name(camera, flown.label),
        camera=camera,
        flights=tuple(sorted(checks, key=lambda one: (one.day or date.min, one.flight))),
        **asdict(found),
    )


def _measurements(checks: Sequence[DatedCheck]) -> Iterator[Measurement]:
    """The measured focal lengths by date, without the flights that do not determine one."""
    for one in checks:
        day, fx, std = one.day, one.pixels.measured_fx, one.pixels.std
        if one.pixels.verdict is PixelVerdict.CANNOT_TELL or day is None or fx is None or std is None:
            continue
        yield Measurement(day=day, fx=fx, std=std, firmware=one.firmware)


def _contradicted(camera: str, entry: str, checks: Sequence[DatedCheck]) -> Finding:
    one, check = checks[-1], checks[-1].pixels
    nearer = abs(check.difference or 0.0) - SURE_SIGMAS * (check.std or 0.0)
    limit = one.tolerance or 0.0
    day = f" of {one.day}" if one.day is not None else ""
    others = f"; {len(checks) - 1} of its other dates contradict it too" if len(checks) > 1 else ""
    return Finding(
        rule=Rule.PIXELS,
        severity=Severity.ERROR if nearer > limit else Severity.WARNING,
        camera=camera,
        place=entry,
        measured=check.difference,
        limit=limit,
        message=f"the pixels of the flight {one.flight}{day} show {check.figures}; {check.reason}{others}",
        remedy="calibrate the camera with a board and register that, or correct the entry's days of validity",
    )


CHANGES: Final = {
    Change.DRIFT: Rule.TREND,
    Change.STEP: Rule.STEP,
    Change.UNSTEADY: Rule.UNSTEADY,
    Change.SEVERAL_UNITS: Rule.UNKNOWN_UNITS,
}


def _change_finding(camera: str, unit: UnitOverTime) -> Finding:
    unknown = unit.change is Change.SEVERAL_UNITS
    entry = next((one.entry for one in reversed(unit.flights) if one.entry is not None), None)
    remedy = (
        "calibrate it again and register that from the day on that it is for: calibrary registry add FILE "
    )
    return Finding(
        rule=CHANGES[unit.change],
        severity=Severity.NOTE if unknown else Severity.WARNING,
        camera=camera,
        place=entry,
        measured=unit.by,
        message=unit.reason,
        remedy=None if unknown else f"{remedy}--valid-from YYYY-MM-DD",
    )


class Measurement(Struct, frozen=True, kw_only=True):
    """The focal length measured from the pixels of one date.

    Attributes:
        day: of the flight.
        fx: px.
        std: relative standard deviation.
        firmware: of the camera; None if not stated.
    """

    day: date
    fx: float
    std: float
    firmware: str | None = None


class OverTime(Struct, frozen=True, kw_only=True):
    """Result of the test over all dates.

    Attributes:
        change: kind of change.
        by: relative change of fx, last minus first; None if no change is reported.
        std: standard deviation of ``by``.
        reason: explanation in one sentence.
    """

    change: Change
    by: float | None = None
    std: float | None = None
    reason: str


class _Fit(Struct, frozen=True):
    """Fit of one model: relative change, its σ, and the probability of a larger χ²."""

    by: float
    std: float
    chance: float

    @property
    def is_one(self) -> bool:
        return abs(self.by) > SIGMAS * self.std and self.chance >= FITS


def judge_over_time(measurements: Sequence[Measurement], *, unit_known: bool) -> OverTime:
    """Judge the change of K over time.

    Args:
        measurements: of one camera at one image size.
        unit_known: whether the images state the serial number; if not, a change is not attributed to a unit.
    """
    ordered = sorted(measurements, key=lambda one: (one.day, one.fx))
    if len(ordered) < FEWEST_DATES:
        dates = "one date determines" if ordered else "no date determines"
        return OverTime(change=Change.UNKNOWN, reason=f"{dates} K, need {FEWEST_DATES}")
    values = np.log([one.fx for one in ordered])
    weights = np.array([1 / one.std**2 for one in ordered])
    days = np.array([one.day.toordinal() for one in ordered], dtype=np.float64)
    constant = _chance(values, weights, np.ones((len(ordered), 1)))
    line = _line(values, weights, days)
    steps = {at: _step(values, weights, at) for at in _firmware_changes(ordered)}
    between = f"between {ordered[0].day} and {ordered[-1].day} ({len(ordered)} dates)"
    at, step = max(steps.items(), key=lambda one: (one[1].is_one, one[1].chance), default=(0, None))
    changed = constant < BY_CHANCE or line.is_one or (step is not None and step.is_one)
    if not changed:
        spread = math.sqrt(1 / float(weights.sum()))
        return OverTime(change=Change.STEADY, reason=f"constant within its σ {between}, ± {spread:.2%}")
    widest = _widest(ordered)
    if not unit_known:
        return OverTime(
            change=Change.SEVERAL_UNITS,
            by=widest.by,
            std=widest.std,
            reason=f"fx differs by {_figures(widest)} {between}; the images state no serial number, so they may be of "
            "several units",
        )
    if step is not None and step.is_one and step.chance >= line.chance * line.is_one:
        before, after = ordered[at - 1].firmware, ordered[at].firmware
        return OverTime(
            change=Change.STEP,
            by=step.by,
            std=step.std,
            reason=f"fx changed by {_figures(step)} with the firmware, from {before} to {after}, between "
            f"{ordered[at - 1].day} and {ordered[at].day}",
        )
    if line.is_one:
        return OverTime(
            change=Change.DRIFT, by=line.by, std=line.std, reason=f"fx changed by {_figures(line)} {between}"
        )
    return OverTime(
        change=Change.UNSTEADY,
        by=widest.by,
        std=widest.std,
        reason=f"fx differs by {_figures(widest)} {between}, neither steadily nor with the firmware: another focus or "
        "zoom, a lens that was replaced, or two cameras under one serial number",
    )


def _figures(fit: _Fit) -> str:
    return f"{fit.by:+.2%} ± {fit.std:.2%}"


def _firmware_changes(ordered: Sequence[Measurement]) -> list[int]:
    """Index of the first date after each change of the stated firmware."""
    return [
        at
        for at, (one, other) in enumerate(pairwise(ordered), start=1)
        if one.firmware is not None and other.firmware is not None and one.firmware != other.firmware
    ]


def _solved(
    values: FloatArray, weights: FloatArray, design: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Parameters, their covariance and χ² from weighted least squares."""
    C = np.asarray(np.linalg.inv(design.T @ (weights[:, None] * design)), dtype=np.float64)
    x = C @ design.T @ (weights * values)
    return x, C, float(weights @ (values - design @ x) ** 2)


def _chance(values: FloatArray, weights: FloatArray, design: FloatArray) -> float:
    """Probability of a larger χ² from noise alone; 1 without degrees of freedom."""
    dof = len(values) - design.shape[1]
    return chi_square_tail(dof, _solved(values, weights, design)[2]) if dof else 1.0


def _step(values: FloatArray, weights: FloatArray, at: int) -> _Fit:
    after = (np.arange(len(values)) >= at).astype(np.float64)
    return _changed(values, weights, after)


def _line(values: FloatArray, weights: FloatArray, days: FloatArray) -> _Fit:
    span = days[-1] - days[0]
    return _changed(values, weights, (days - days[0]) / max(span, 1.0))


def _changed(values: FloatArray, weights: FloatArray, share: FloatArray) -> _Fit:
    """Fit a constant plus one change in proportion to ``share`` (0 … 1 by date)."""
    design = np.column_stack([np.ones(len(values)), share])
    if float(np.ptp(share)) == 0:
        return _Fit(0.0, math.inf, 0.0)
    x, C, _ = _solved(values, weights, design)
    return _Fit(float(x[1]), math.sqrt(float(C[1, 1])), _chance(values, weights, design))


def _widest(ordered: Sequence[Measurement]) -> _Fit:
    """Difference of the two dates that differ most in units of σ, later minus earlier."""
    pairs = [
        _Fit(math.log(other.fx / one.fx), math.hypot(one.std, other.std), 1.0)
        for at, one in enumerate(ordered)
        for other in ordered[at + 1 :]
    ]
    return max(pairs, key=lambda fit: abs(fit.by) / fit.std)
