"""K over time from the pixels of ordinary flights: one flight per unit and date, compared with the registered K.

Checking a flight takes about a minute, so there is a time limit. All units take turns; for each the newest
date is checked first, then the oldest, then those between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from itertools import zip_longest
from time import monotonic
from typing import Annotated, Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import RegistryError
from calibrary.jobs.audit.agreement import tolerance_of
from calibrary.jobs.audit.answers import named, unit_name
from calibrary.jobs.audit.flights import FlightDay, Flown
from calibrary.jobs.audit.over_time import Change, Measurement, judge_over_time
from calibrary.jobs.audit.rules import Rule
from calibrary.jobs.verify.look import MOST_IMAGES, look
from calibrary.policy import Policy
from calibrary.progress import Progress
from calibrary.records import Meta, Record, replace
from calibrary.registry.paths import id_of
from calibrary.registry.resolution import RegistryIndex, Resolution
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict
from calibrary.sfm.pixel_judging import FEWEST_IMAGES
from calibrary.validation import Finding, Severity

__all__ = ["MINUTES", "DatedCheck", "UnitOverTime", "Verification", "pixel_findings", "verify_flights"]

MINUTES: Final = 15
"""Default time limit in minutes."""
MOST_READ: Final = 400
"""Most images of a flight, from its middle, whose positions are read in order to choose a dozen."""
SURE_SIGMAS: Final = 2.0


class DatedCheck(Record):
    """Check of K against the pixels of one flight.

    Attributes:
        flight: name of the folder.
        day: date of its images; None if they state none.
        firmware: of the camera, as stated by its images.
        entry: id of the entry that gives K for that day; None if K is from the images' own tags.
        tolerance: of that entry, as a fraction of fx.
        valid_from, valid_until: validity of the entry; None for an open end.
        pixels: result of the check of that K.
    """

    flight: str
    day: date | None
    firmware: str | None
    entry: str | None
    tolerance: float | None
    valid_from: date | None
    valid_until: date | None
    pixels: PixelCheck


class UnitOverTime(Record):
    """K of one unit over time, at one image size.

    Attributes:
        name: label, camera and first digits of the hash of its serial number.
        camera: camera key without firmware.
        flights: the checked flights, one per date, oldest first.
        change: kind of change of K, from the flights with pixels that determine it.
        by: relative change of fx; None if no change is stated.
        std: standard deviation of ``by``.
        reason: explanation in one sentence.
    """

    name: str
    camera: CameraKey
    flights: tuple[DatedCheck, ...]
    change: Change
    by: float | None
    std: float | None
    reason: str


class Verification(Record):
    """Check of K against the pixels of several flights.

    Attributes:
        images: largest number of images chosen from a flight.
        minutes: the time limit.
        left_out: number of flights not checked because of the time limit.
        units: the units with at least one checked flight.
    """

    images: Annotated[int, Meta(ge=1)]
    minutes: Annotated[float, Meta(gt=0)]
    left_out: Annotated[int, Meta(ge=0)]
    units: tuple[UnitOverTime, ...]


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
    minutes: float = MINUTES,
    progress: Progress | None = None,
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
    for sample in _samples(flown, index, today):
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
    names = {replace(one.key, firmware=None): named(one) for one in flown}
    for unit in done.units:
        against: dict[str, list[DatedCheck]] = {}
        for one in unit.flights:
            if one.entry is not None and one.pixels.verdict is PixelVerdict.CONTRADICTS:
                against.setdefault(one.entry, []).append(one)
        for entry, checks in against.items():
            yield _contradicted(names[unit.camera], entry, checks)
        if unit.by is not None:
            yield _changed(names[unit.camera], unit)


def _samples(flown: Sequence[Flown], index: RegistryIndex, today: date) -> Iterator[_Sample]:
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
        K = found.calibration if found is not None else one.camera.calibration
        if K is not None:
            yield _Sample(flown=one, part=part, K=K, found=found)


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
        change=found.change,
        by=found.by,
        std=found.std,
        reason=found.reason,
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


def _changed(camera: str, unit: UnitOverTime) -> Finding:
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
