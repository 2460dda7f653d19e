"""Rules of a combination: reasons to refuse calibrations before comparing parameters, and the verdict on the result.

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

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import InputError
from calibrary.jobs.calibrate_flight.run import SolvedFlight
from calibrary.jobs.combine.sources import Source
from calibrary.jobs.diff.common_numbers import common_numbers
from calibrary.policy import FLEET
from calibrary.sfm.combination import WeightedMean, shared_parameters, weighted_mean
from calibrary.sfm.tracks import FEWEST_IMAGES
from calibrary.validation import Finding, Severity

SAME_TURN_DEG: Final = 0.1
"""Largest difference of the camera's turns in two adjustments of the same images, if they determine the camera."""
NOT_MEASURED: Final = "not-measured"
CURED: Final = frozenset({"uncertain-focal-length", "uncertain-edge", "few-images", "few-views"})
"""Rules that a single calibration can fail and further ones remedy. All other shortcomings, such as a weak geometry or
a lens model that does not fit, can be common to all."""


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
