"""Combine several calibrations of one camera if they agree.

Different cameras are never averaged. Calibrations are refused if their files state different units, image sizes, focus
or lens models, and then by χ² with the full covariances. Differences that noise explains are averaged; if the scatter
is larger than stated, the combined σ is inflated accordingly.

What is kept fixed needs calibrations with a tested σ. A program's formal σ is not tested, and several files do not
change that: errors common to all (a fixed principal point, a flight that does not separate focal length from height) do
not appear as scatter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import date
from itertools import combinations
from typing import Final

import numpy as np

from calibrary.calib.assessment import notes_of
from calibrary.calib.verdict import BoardVerdict
from calibrary.calib.verdict_rules import graver_first
from calibrary.calibration import Calibration, CameraKey, Covariance, Grade, Provenance, Quality, SourceFile
from calibrary.errors import InputError
from calibrary.jobs.calibrate.run import Told
from calibrary.jobs.calibrate_flight.run import SolvedFlight
from calibrary.jobs.combine.report import CombinationReport, CombinedSource
from calibrary.jobs.combine.sources import Source
from calibrary.jobs.diff.common_numbers import common_numbers
from calibrary.policy import FLEET
from calibrary.probability import two_digits
from calibrary.provenance import HOW_MADE
from calibrary.records import replace
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.combination import (
    Difference,
    WeightedMean,
    difference,
    explanation,
    shared_parameters,
    weighted_mean,
)
from calibrary.sfm.season import Drift, of_one_model, solve_season
from calibrary.sfm.tracks import FEWEST_IMAGES
from calibrary.validation import Finding, Severity
from calibrary.version import __version__

SAME_TURN_DEG: Final = 0.1
"""Largest difference of the camera's turns in two adjustments of the same images, if they determine the camera."""
NOT_MEASURED: Final = "not-measured"
CURED: Final = frozenset({"uncertain-focal-length", "few-images", "few-views"})
"""Rules that a single calibration can fail and further ones remedy. All other shortcomings, such as a weak geometry, a
lens model that does not fit, or corners of the frame that none has seen, can be common to all."""


def obstacles(sources: Sequence[Source]) -> Iterator[Finding]:
    """Yield the reasons to refuse a combination before comparing parameters."""
    for source in sources:
        if source.calibration.grade not in {Grade.CALIBRATED, Grade.ADJUSTED}:
            yield _error(
                NOT_MEASURED,
                f"{source.label} is of grade {source.calibration.grade.value}: {source.calibration.grade.meaning}",
                "combine what was measured only",
            )
        if len(sources) > 1 and source.covariance is None:
            yield _error(
                "no-covariance",
                f"{source.label} states no covariance, so that nothing says what it counts for",
                "solve it again, or give the program's own file with its covariance",
            )
    yield from _other_cameras(sources)
    yield from _copies(sources)
    covariances = [C for one in sources if (C := one.covariance) is not None]
    if len(covariances) == len(sources) > 1 and _sizes(sources) == 1:
        cameras = [one.calibration for one in sources]
        try:
            shared_parameters(cameras, covariances)
            weighted_mean(cameras, covariances)
        except InputError as error:
            yield _error("other-lens-model", error.message, "solve all of them with one --lens-model")


def _sizes(sources: Sequence[Source]) -> int:
    return len({one.calibration.intrinsics.image_size for one in sources})


def _other_cameras(sources: Sequence[Source]) -> Iterator[Finding]:
    keys = [one.calibration.camera for one in sources]
    for name in CameraKey.__struct_fields__:
        if name in {"image_size", "firmware"}:
            continue
        stated = {str(value).strip().casefold(): str(value) for key in keys if (value := getattr(key, name))}
        if len(stated) > 1:
            listed = " and ".join(sorted(stated.values()))
            yield _error(
                "other-camera",
                f"the files are of several cameras: {name} {listed}",
                "combine those of one unit",
            )
    if _sizes(sources) > 1:
        listed = ", ".join(
            "{} {}×{}".format(one.label, *one.calibration.intrinsics.image_size) for one in sources
        )
        yield _error(
            "other-frame",
            f"the image sizes differ: {listed}; whether one is a crop or a scale of the other, no file says",
            "combine those of one image size",
        )
    focus = sorted({text for one in sources if (text := one.calibration.provenance.focus)})
    if len(focus) > 1:
        yield _error(
            "other-focus", f"the lens was focused differently: {' and '.join(focus)}", "combine one focus"
        )


def _copies(sources: Sequence[Source]) -> Iterator[Finding]:
    for one, two in combinations(sources, 2):
        mine, theirs = (
            {file.sha256 for file in source.calibration.provenance.sources} for source in (one, two)
        )
        if one.file is not None and two.file is not None and one.file.sha256 == two.file.sha256:
            why = "are the same file"
        elif both := len(mine & theirs):
            why = f"have {both} of the files in common that they were made from"
        elif _sizes((one, two)) == 1 and common_numbers(one.calibration, two.calibration).is_one_measurement:
            why = "have numbers in common to the last digit, as one measurement has"
        else:
            continue
        yield _same(f"{one.label} and {two.label} {why}")


def _same(which: str) -> Finding:
    return _error(
        "same-observations",
        f"{which}: counted twice, they would make σ smaller than it is",
        "leave one of them out",
    )


def same_images(flights: Sequence[tuple[str, SolvedFlight]]) -> Iterator[Finding]:
    """Yield the flights with images in common, which no hash shows if one of them is another program's result.

    Cameras count anew on every card, so equal names are no more than a hint; how the camera turned from one image to
    the next is the same, in whatever frame, only where the images are.
    """
    for (label, one), (other, two) in combinations(flights, 2):
        mine, theirs = (
            {
                name: R
                for name, R, used in zip(b.tracks.names, b.scene.rotations, b.tracks.used, strict=True)
                if used
            }
            for b in (one.found.bundle, two.found.bundle)
        )
        both = sorted(mine.keys() & theirs.keys())
        if len(both) < FEWEST_IMAGES:
            continue
        turns, others = (
            R[1:] @ R[:-1].transpose(0, 2, 1)
            for R in (np.stack([its[name] for name in both]) for its in (mine, theirs))
        )
        cosines = (np.sum(turns * others, axis=(1, 2)) - 1) / 2
        if np.median(cosines) > math.cos(math.radians(SAME_TURN_DEG)):
            yield _same(
                f"{label} and {other} are of one flight: {len(both)} of their images have one name and attitude"
            )


def judged(sources: Sequence[Source], fx_std: float | None, camera: Calibration) -> Iterator[Finding]:
    """Yield the findings against the result.

    Args:
        sources: calibrations that agree, or a single one.
        fx_std: standard deviation of the result's fx, px.
        camera: the resulting calibration.
    """
    formal = [one.label for one in sources if one.quality.kappa2 is None and one.fx_std is not None]
    if formal:
        yield Finding(
            rule="formal-sigma",
            severity=Severity.UNPROVEN,
            message=f"σ of {', '.join(formal)} is that of the program that made it: no halves of its images were "
            "compared, and no principal point held and freed",
            remedy=("leave it out, or " if len(sources) > 1 else "")
            + "solve its observations here: calibrate flight --from FOLDER",
        )
    # What further calibrations cure, one alone does not.
    cured = CURED if len(sources) > 1 else frozenset()
    short = {source.label: source.shortcomings - cured for source in sources}
    if any(short.values()):
        yield Finding(
            rule="provisional-source",
            severity=Severity.UNPROVEN,
            message=f"{', '.join(label for label, rules in short.items() if rules)} did not pass"
            + (" for what further calibrations may have in common with them" if len(sources) > 1 else "")
            + f": {', '.join(sorted(frozenset().union(*short.values())))}",
            remedy="do what their own reports say, or leave them out",
        )
    if fx_std is None:
        yield Finding(
            rule="unknown-uncertainty",
            severity=Severity.UNPROVEN,
            message="no standard deviation is stated",
            remedy="solve it again, or give the program's own file with its covariance",
        )
        return
    spread = fx_std / camera.intrinsics.fx
    if not spread <= FLEET.fixed_sigma_focal:
        yield Finding(
            rule="uncertain-focal-length",
            severity=Severity.UNPROVEN if spread <= FLEET.start_sigma_focal else Severity.ERROR,
            measured=spread,
            limit=FLEET.fixed_sigma_focal,
            message=f"the standard deviation of fx is {spread:.2%}, need {FLEET.fixed_sigma_focal:.2%}",
            remedy="combine more calibrations, of flights with cross strips at a second height or oblique images",
        )


def agreement(sources: Sequence[Source], together: WeightedMean, inflation: float) -> Iterator[Finding]:
    """Yield notes on the agreement of the calibrations, and by how much the result's variance grew for it."""
    days = sorted(day for one in sources if (day := day_of(one)) is not None)
    span = f", of {days[0]} to {days[-1]}," if days and days[0] < days[-1] else ""
    yield Finding(
        rule="consistent",
        severity=Severity.NOTE,
        measured=together.chi2 / together.dof,
        message=f"{len(sources)} calibrations{span} agree: χ² is {together.chi2:.1f} with {together.dof} degrees of "
        f"freedom (p = {together.p:.2g})"
        + (f"; σ is multiplied by {math.sqrt(inflation):.2f} for it" if inflation > 1 else ""),
    )
    firmware = sorted({text for one in sources if (text := one.calibration.camera.firmware)})
    if len(firmware) > 1:
        yield Finding(
            rule="several-firmwares",
            severity=Severity.NOTE,
            message=f"they are of firmware {' and '.join(firmware)}, and agree nevertheless",
        )


def day_of(source: Source) -> date | None:
    """Return the date of a calibration; None if it states none, or not a full date."""
    text = source.calibration.provenance.date
    try:
        return date.fromisoformat(text[:10]) if text is not None else None
    except ValueError:
        return None


def _error(rule: str, message: str, remedy: str) -> Finding:
    return Finding(rule=rule, severity=Severity.ERROR, message=message, remedy=remedy)


COMBINATION: Final = "combination"
"""Kind of provenance."""
LEVEL: Final = 0.001
"""Smallest probability at which noise counts as the explanation."""
LEAST_CHANCE: Final = 1e-12
DAYS: Final = 365.25
DRIFTED: Final = 3.0
"""Number of σ from which a drift is found."""


def combined(sources: Sequence[Source], told: Told) -> CombinationReport:
    """Combine calibrations, or report why not.

    Args:
        sources: one or more calibrations; a single one is only judged by what it states.
        told: camera, day and operator as the user states them; without a day, the latest of the sources.

    Raises:
        InputError: there are no sources.
    """
    if not sources:
        raise InputError("expected calibrations to combine")
    rows = tuple(map(_row, sources))
    if findings := graver_first(obstacles(sources)):
        return _report(findings, None, rows, None)
    covariances = _covariances(sources)
    if len(sources) == 1:
        findings = graver_first(judged(sources, sources[0].fx_std, sources[0].calibration))
        return _report(findings, _with_camera(sources[0].calibration, told, findings), rows, None)
    cameras = [one.calibration for one in sources]
    together = weighted_mean(cameras, covariances)
    rows = tuple(_held_against(sources, at) for at in range(len(sources)))
    if together.p < LEVEL:
        return _report((_contradiction(sources, rows, together),), None, rows, together)
    whole = _combined(sources, together, told)
    std = together.covariance.std.get("fx")
    inflated = std * math.sqrt(together.scatter) if std is not None else None
    findings = graver_first(
        (*judged(sources, inflated, whole), *agreement(sources, together, together.scatter))
    )
    return _report(findings, replace(whole, notes=tuple(notes_of(findings))), rows, together)


def _report(
    findings: tuple[Finding, ...],
    calibration: Calibration | None,
    rows: tuple[CombinedSource, ...],
    together: WeightedMean | None,
    drift: Drift | None = None,
) -> CombinationReport:
    verdict = BoardVerdict.of(findings)
    return CombinationReport(
        verdict=verdict,
        findings=findings,
        unwritten=None,
        dropped=(),
        calibration=calibration if verdict is not BoardVerdict.REFUSE else None,
        sources=rows,
        chi2=together.chi2 if together is not None else None,
        dof=together.dof if together is not None else None,
        p=together.p if together is not None else None,
        drift=drift,
    )


def solved_together(flights: Sequence[tuple[str, SolvedFlight]], told: Told) -> CombinationReport:
    """Solve flights of one camera together, by their observations, or report why not.

    What only their geometry or their number made weak counts here, so that a flight may be one that is refused alone.

    Args:
        flights: two or more, with their labels.
        told: camera, day and operator as the user states them; without a day, the last of the flights.

    Raises:
        CalibrationError: a flight, or all together, do not determine a camera.
    """
    labels = [label for label, _ in flights]
    alike = of_one_model([one.found for _, one in flights])
    solved = [replace(one, found=found) for (_, one), found in zip(flights, alike, strict=True)]
    alone = [one.assessed() for one in solved]
    sources = [
        Source(label=label, calibration=one.dated(its, told).calibration)
        for label, one, its in zip(labels, solved, alone, strict=True)
    ]
    obstructing = [one for one in obstacles(sources) if one.rule != NOT_MEASURED]
    if findings := graver_first([*obstructing, *same_images(flights)]):
        return _report(findings, None, tuple(map(_row, sources)), None)
    cameras, covariances = [one.calibration for one in sources], _covariances(sources)
    together = weighted_mean(cameras, covariances)
    rows = tuple(_held_against(sources, at) for at in range(len(sources)))
    years, apart = _years(sources), None
    if together.p < LEVEL:
        apart = explanation(cameras, covariances, years)
        if apart is None or apart.others or apart.p < LEVEL:
            return _report((_contradiction(sources, rows, together),), None, rows, together)
    season = solve_season(alike, [one.uncertainty for one in alone], years, labels)
    first = solved[0]
    views = tuple(
        replace(view, name=f"{label}/{view.name}")
        for label, one in zip(labels, solved, strict=True)
        for view in one.about.views
    )
    result = flight_result(
        season.whole,
        about=replace(first.about, views=views),
        scale=max(one.scale for one in solved),
        versions=first.versions,
        known=season.known,
    ).result
    findings = graver_first(
        (*result.findings, *_of_drift(season.drift), *agreement(sources, together, season.known.inflation))
    )
    days = sorted(filter(None, map(day_of, sources)))
    day = told.stated.date or (days[-1] if days else None)
    made = replace(
        result.calibration.provenance,
        kind=COMBINATION,
        tag=", ".join(labels),
        date=day.isoformat() if day is not None else None,
    )
    calibration = replace(
        result.calibration,
        camera=told.camera(_key(sources)),
        provenance=told.stated.of(made),
        notes=tuple(notes_of(findings)),
    )
    return _report(findings, calibration, rows, together, season.drift)


def _of_drift(drift: Drift | None) -> Iterator[Finding]:
    """Yield how the camera changed; what is within 3 σ is a note."""
    if drift is None:
        return
    changes = (drift.focal, drift.cx, drift.cy)
    found = any(abs(one) > DRIFTED * std for one, std in zip(changes, drift.std, strict=True))
    f, x, y = drift.std
    yield Finding(
        rule="drift",
        severity=Severity.WARNING if found else Severity.NOTE,
        measured=drift.focal,
        message=f"{'' if found else 'no drift is certain: '}a year changes fx by {drift.focal:+.3%} ± {f:.3%}, "
        f"cx by {drift.cx:+.2f} ± {x:.2f} px and cy by {drift.cy:+.2f} ± {y:.2f} px. K is that of the last day, and "
        "σ includes this",
        remedy="calibrate anew before K has moved by more than it is known to" if found else None,
    )


def _row(source: Source) -> CombinedSource:
    return CombinedSource(
        label=source.label,
        date=source.calibration.provenance.date,
        fx=source.calibration.intrinsics.fx,
        fx_std=source.fx_std,
        kappa2=source.quality.kappa2,
    )


def _held_against(sources: Sequence[Source], at: int) -> CombinedSource:
    """Compare one calibration with all others together."""
    rest = [one for number, one in enumerate(sources) if number != at]
    mine, others = _weighed([sources[at]]), _weighed(rest)
    apart = difference(mine, others)
    pair = weighted_mean([mine.calibration, others.calibration], [mine.covariance, others.covariance])
    return replace(
        _row(sources[at]),
        off_px=apart.px if apart is not None else None,
        off_std_px=apart.std_px if apart is not None else None,
        p=pair.p,
    )


def _weighed(sources: Sequence[Source]) -> WeightedMean:
    return weighted_mean([one.calibration for one in sources], _covariances(sources))


def _covariances(sources: Sequence[Source]) -> list[Covariance]:
    return [C for one in sources if (C := one.covariance) is not None]


def _years(sources: Sequence[Source]) -> list[float] | None:
    """Return the days in years; None if not all are known."""
    known = [day.toordinal() / DAYS for one in sources if (day := day_of(one)) is not None]
    return known if len(known) == len(sources) else None


def _contradiction(
    sources: Sequence[Source], rows: Sequence[CombinedSource], together: WeightedMean
) -> Finding:
    """Return the finding that refuses contradictory calibrations, with the likeliest explanation."""
    days = [day_of(one) for one in sources]
    apart = explanation([one.calibration for one in sources], _covariances(sources), _years(sources))
    chance = f"{together.p:.1g}" if together.p > LEAST_CHANCE else f"less than {LEAST_CHANCE:g}"
    labels = [one.label for one in sources]
    rule, remedy = "inconsistent", "leave out what is of another camera, or of another time"
    if apart is None:
        message = f"{' and '.join(labels)} disagree" + (
            f": {_source_list(rows)}" if len(rows) > 2 else _by(rows[0])
        )
        if len(rows) == 2 and (cut := _before_and_after(days, (0,))) is not None:
            message += f". If they are of one camera, it changed between {cut[0]} and {cut[1]}"
    elif apart.p < LEVEL:
        message = f"no two groups of the files agree within themselves; {_source_list(rows)}"
    elif not apart.others:
        rule, remedy = "drift", "calibrate anew, and combine what is of one season"
        first, last = min(day for day in days if day), max(day for day in days if day)
        message = f"the camera changed by {_px(apart.between)} from {first} to {last}, at a constant rate"
    else:
        others = [labels[at] for at in apart.others]
        rest = [label for at, label in enumerate(labels) if at not in apart.others]
        verb = "disagrees" if len(others) == 1 else "disagree"
        message = f"{', '.join(others)} {verb} with {', '.join(rest)} by {_px(apart.between)}"
        if (cut := _before_and_after(days, apart.others)) is not None:
            rule = "drift" if len(others) > 1 else rule
            message += f". The camera may have changed between {cut[0]} and {cut[1]}"
    return Finding(
        rule=rule,
        severity=Severity.ERROR,
        measured=together.p,
        limit=LEVEL,
        message=f"{message}. The chance of so much from noise alone is {chance}, so they are not combined",
        remedy=remedy,
    )


def _by(row: CombinedSource) -> str:
    if row.off_px is None or row.off_std_px is None:
        return ""
    return f" by {_px(Difference(px=row.off_px, std_px=row.off_std_px))}"


def _px(between: Difference) -> str:
    return f"{two_digits(between.px)} ± {between.std_px:.1g} px at the most"


def _source_list(rows: Sequence[CombinedSource]) -> str:
    return ", ".join(
        f"{row.label} is {two_digits(row.off_px)} ± {row.off_std_px:.1g} px from the others"
        for row in rows
        if row.off_px is not None
    )


def _before_and_after(days: Sequence[date | None], others: Sequence[int]) -> tuple[date, date] | None:
    """Return the last day of the earlier group and the first of the later; None if the groups overlap in time."""
    mine = [day for at, day in enumerate(days) if at in others and day is not None]
    rest = [day for at, day in enumerate(days) if at not in others and day is not None]
    if len(mine) + len(rest) < len(days):
        return None
    if max(mine) < min(rest):
        return max(mine), min(rest)
    return (max(rest), min(mine)) if max(rest) < min(mine) else None


def _combined(sources: Sequence[Source], together: WeightedMean, told: Told) -> Calibration:
    qualities = [one.quality for one in sources]
    weights = [quality.points for quality in qualities]
    known = [
        (points, q.rms_px)
        for points, q in zip(weights, qualities, strict=True)
        if points and q.rms_px is not None
    ]
    points = sum(count for count, _ in known)
    quality = Quality(
        rms_px=math.sqrt(sum(count * rms**2 for count, rms in known) / points) if points else None,
        points=sum(filter(None, weights)) or None,
        views=sum(q.views or 0 for q in qualities) or None,
        std=together.covariance.std,
        covariance=together.covariance,
        kappa2=together.chi2 / together.dof,
        coverage=max((q.coverage for q in qualities if q.coverage is not None), default=None),
    )
    days = sorted(found for one in sources if (found := day_of(one)) is not None)
    newest = told.stated.date or (days[-1] if days else None)
    files: dict[str, SourceFile] = {}
    for one in sources:
        of_it = one.calibration.provenance.sources
        files |= {file.sha256: file for file in ((one.file, *of_it) if one.file is not None else of_it)}
    made = Provenance(
        kind=COMBINATION,
        tag=", ".join(one.file.name if one.file is not None else one.label for one in sources),
        sources=tuple(files.values()),
        tool=f"calibrary {__version__}",
        date=newest.isoformat() if newest is not None else None,
    )
    agreed = {
        name: _agreed([getattr(one.calibration.provenance, name) for one in sources])
        for name in HOW_MADE
        if name not in {"tool", "date", "operator"}
    }
    grades = [one.calibration.grade for one in sources]
    return replace(
        together.calibration,
        camera=told.camera(_key(sources)),
        grade=max(grades, key=lambda grade: grade.rank),
        quality=quality,
        provenance=told.stated.of(replace(made, **agreed)),
        notes=(),
        extras=(),
    )


def _with_camera(camera: Calibration, told: Told, findings: Sequence[Finding]) -> Calibration:
    return replace(
        camera, camera=told.camera(camera.camera), notes=(*notes_of(findings), *camera.notes), extras=()
    )


def _key(sources: Sequence[Source]) -> CameraKey:
    """Merge the camera keys of the files: each field from the first file that states it."""
    keys = [one.calibration.camera for one in sources]
    stated = {
        name: next((value for key in keys if (value := getattr(key, name)) is not None), None)
        for name in CameraKey.__struct_fields__
    }
    firmware = _agreed([key.firmware for key in keys])
    return CameraKey(
        **stated | {"firmware": firmware, "image_size": sources[0].calibration.intrinsics.image_size}
    )


def _agreed(values: Sequence[str | None]) -> str | None:
    """Return the only stated value; None if there are none or several."""
    stated = {value for value in values if value is not None}
    return stated.pop() if len(stated) == 1 else None
