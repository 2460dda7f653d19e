"""Comparison of an entry with the images of its camera: firmware, image size, K; and of units with each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import CalibraryError, InputError
from calibrary.evidence.conflict import disagreement
from calibrary.evidence.estimate import Source, SourceEstimate
from calibrary.image_size import same_aspect
from calibrary.jobs.audit.answers import Answer, Use, named
from calibrary.jobs.audit.rules import Rule
from calibrary.jobs.diff.comparison import compare
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.firmware import compare as compare_versions
from calibrary.registry.resolution import Resolution
from calibrary.validation import Finding, Severity

__all__ = ["Gap", "disagreements", "gaps", "tolerance_of", "unit_findings"]

MEASURED: Final = {Grade.CALIBRATED, Grade.ADJUSTED}
TOLERANCE: Final = 0.03
"""Tolerance of K as a fraction of fx, if neither the entry nor the policy states one."""


class Gap(Struct, frozen=True, kw_only=True):
    """Difference between one source in the images and the entry.

    Attributes:
        estimate: of the source.
        share: the largest difference, signed: of fx and fy as a fraction of fx, and of cx and cy, if the source
            measured them, as a fraction of the width.
        of: name of the number with this difference.
        limit: largest allowed absolute value.
    """

    estimate: SourceEstimate
    share: float
    of: str
    limit: float

    @property
    def is_beyond(self) -> bool:
        """Whether the difference exceeds the limit."""
        return abs(self.share) > self.limit


def tolerance_of(entry: Entry, policy: Policy) -> float:
    """Largest allowed difference of a K from the entry, as a fraction of fx."""
    return entry.tolerance or policy.known_camera_tolerance or TOLERANCE


def gaps(answer: Answer, policy: Policy) -> tuple[Gap, ...]:
    """The differences of all sources in the images that could contradict the entry, best source first."""
    if answer.resolution is None:
        return ()
    K, entry = answer.resolution.calibration.intrinsics, answer.resolution.entry
    tolerance = tolerance_of(entry, policy)
    found = []
    for estimate in answer.flown.camera.evidence.estimates:
        if estimate.source is Source.ASSUMED_SENSOR:
            continue
        seen, (width, _) = estimate.intrinsics, estimate.intrinsics.image_size
        apart = {"fx": seen.fx / K.fx - 1.0, "fy": seen.fy / K.fy - 1.0}
        if estimate.measured_centre:
            apart |= {"cx": (seen.cx - K.cx) / width, "cy": (seen.cy - K.cy) / width}
        of = max(apart, key=lambda name: abs(apart[name]))
        limit = max(tolerance, estimate.tolerance)
        found.append(Gap(estimate=estimate, share=apart[of], of=of, limit=limit))
    return tuple(found)


def disagreements(answer: Answer, policy: Policy) -> Iterator[Finding]:
    """Findings where the images contradict the entry that applies to them."""
    if answer.resolution is None or answer.use not in {Use.USED, Use.EXPIRED}:
        return
    yield from _firmware(answer, answer.resolution.entry)
    yield from _size(answer, answer.resolution)
    yield from _numbers(answer, gaps(answer, policy))


def _firmware(answer: Answer, entry: Entry) -> Iterator[Finding]:
    flown = answer.flown
    made_with, now = entry.calibration.provenance.firmware, flown.key.firmware
    # A stated firmware range includes the camera's firmware, otherwise this entry would not apply.
    if made_with is None or now is None or entry.firmware is not None or _may_be_same(made_with, now):
        return
    yield Finding(
        rule=Rule.FIRMWARE,
        severity=Severity.WARNING,
        camera=named(flown),
        place=answer.entry_id,
        message=f"the entry was made with firmware {made_with} and the camera flies {now}: K may have moved",
        remedy=f"calibrate it with {now} and register the result; where K is known to be the same, extend the entry: "
        f"calibrary registry add {entry.path} --firmware-range {made_with}..{now}",
    )


def _may_be_same(one: str, other: str) -> bool:
    try:
        return compare_versions(one, other) == 0
    except InputError:
        # An editor or gallery program replaces the camera's firmware by its own name: the firmware is unknown.
        return True


def _size(answer: Answer, found: Resolution) -> Iterator[Finding]:
    entry, flown = found.entry, answer.flown
    kept, seen = entry.calibration.intrinsics.image_size, found.calibration.intrinsics.image_size
    if kept == seen:
        return
    how = "another scale of the same frame" if same_aspect(kept, seen) else "a part of the frame"
    yield Finding(
        rule=Rule.SIZE,
        severity=Severity.WARNING,
        camera=named(flown),
        place=answer.entry_id,
        message=f"images are {seen[0]}×{seen[1]} and the entry is of {kept[0]}×{kept[1]}: {how}, so its K is "
        f"taken over by arithmetic ({'; '.join(found.calibration.provenance.assumptions) or 'exact'})",
        remedy="set the camera back to its full frame, or calibrate it at this size and add that",
    )


def _numbers(answer: Answer, found: Sequence[Gap]) -> Iterator[Finding]:
    chosen = answer.flown.camera.evidence.chosen
    own = next((gap for gap in found if gap.estimate is chosen), None)
    beyond = [gap for gap in found if gap.is_beyond and gap.estimate is not chosen]
    if own is not None and own.is_beyond:
        yield Finding(
            rule=Rule.DRIFT,
            severity=Severity.ERROR,
            camera=named(answer.flown),
            place=answer.entry_id,
            message=f"{own.estimate.tag} of its images says {_told(own)} from the entry, which may be off by "
            f"{own.limit:.1%}",
            remedy=f"calibrary diff {answer.entry_id} {answer.flown.example}",
        )
        return
    causes = {conflict.other: conflict.cause.value for conflict in answer.flown.camera.evidence.conflicts}
    for gap in beyond:
        if chosen is not None and not disagreement(chosen, gap.estimate) and own is not None:
            continue
        cause = causes.get(gap.estimate)
        yield Finding(
            rule=Rule.TAGS,
            severity=Severity.NOTE if own is not None else Severity.WARNING,
            camera=named(answer.flown),
            place=answer.entry_id,
            message=f"{gap.estimate.tag} says {_told(gap)} from the entry"
            + (f": {cause}" if cause else "")
            + (
                f"; {own.estimate.tag} confirms the entry, whose K stays as it is"
                if own is not None
                else "; nothing else in the images shows which is right"
            ),
            remedy=None if own is not None else f"calibrary inspect {answer.flown.example}",
        )


def unit_findings(answers: Sequence[Answer], policy: Policy) -> Iterator[Finding]:
    """Findings on units of one model that measure different K although the same entry, or none, applies to all."""
    groups: dict[CameraKey, dict[str, Answer]] = {}
    for answer in answers:
        serial = answer.flown.key.serial
        own = answer.resolution is not None and answer.resolution.entry.calibration.camera.serial is not None
        measured = answer.flown.camera.calibration
        if serial is None or own or measured is None or measured.grade not in MEASURED:
            continue
        key = replace(answer.flown.key, serial=None, firmware=None)
        groups.setdefault(key, {}).setdefault(serial, answer)
    for key, by_serial in groups.items():
        if len(by_serial) > 1:
            yield from _units(key, by_serial, policy)


def _units(key: CameraKey, by_serial: dict[str, Answer], policy: Policy) -> Iterator[Finding]:
    first, *others = by_serial.items()
    apart = []
    for serial, answer in others:
        one, other = first[1].flown.camera.calibration, answer.flown.camera.calibration
        if one is None or other is None:
            continue
        told = _told_apart(one, other, policy)
        if told is not None:
            apart.append(f"{_called(answer, serial)} against {_called(first[1], first[0])}: {told}")
    if not apart:
        return
    entry = first[1].entry_id
    shared = f"the one entry {entry} cannot be all of theirs" if entry is not None else "they have no entry"
    yield Finding(
        rule=Rule.UNITS,
        severity=Severity.WARNING,
        camera=str(key),
        place=entry,
        message=f"{len(by_serial)} units, and {shared}: {'; '.join(apart[:4])}"
        + (f"; and {len(apart) - 4} more" if len(apart) > 4 else ""),
        remedy="give each unit an entry of its own: calibrary registry add IMAGE, with an image of each",
    )


def _called(answer: Answer, serial: str) -> str:
    return answer.flown.label or f"unit {serial[:8]}"


def _told_apart(one: Calibration, other: Calibration, policy: Policy) -> str | None:
    """Difference between the K of two units in words; None if it may be noise."""
    try:
        comparison = compare(one, other, policy)
    except CalibraryError as error:
        return str(error)
    if not comparison.alarm:
        return None
    numbers = comparison.detail
    if numbers is None:
        return comparison.reasons[0]
    a, b = numbers.a.intrinsics, numbers.b.intrinsics
    return f"fx {b.fx / a.fx - 1.0:+.2%}, centre {b.cx - a.cx:+.1f} px, {b.cy - a.cy:+.1f} px"


def _told(gap: Gap) -> str:
    K = gap.estimate.intrinsics
    return f"{gap.of} = {getattr(K, gap.of):.1f} px, {gap.share:+.1%}" + (
        " of the width" if gap.of in {"cx", "cy"} else ""
    )
