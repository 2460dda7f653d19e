"""Findings of an audit: on the registry's answer for each camera that flew, on its K against the images, on entries."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import date
from shlex import quote
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import AmbiguousEntryError, CalibraryError, InputError, RegistryError
from calibrary.jobs.audit.age import Rule, age_finding
from calibrary.jobs.audit.flights import Flown
from calibrary.jobs.audit.report import FlownSource, Use
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.survey import Against, Claim, Survey, Weighed, of_entry, of_images
from calibrary.jobs.survey.limits import known_tolerance
from calibrary.jobs.survey.placing import Settled
from calibrary.jobs.survey.relating import gap, limit_between
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.configuration import Repeat
from calibrary.registry.entry import Entry, Status
from calibrary.registry.firmware import compare as compare_versions
from calibrary.registry.paths import id_of
from calibrary.registry.resolution import RegistryIndex, Resolution
from calibrary.validation import GIVE_FILES, RULES, Finding, Severity

MOST_NEAR: Final = 3
ENTRY: Final = "the entry"
"""Name of the claim of the entry that applies to a camera: always the first of its survey."""


class Answer(Struct, frozen=True, kw_only=True):
    """A camera that flew, and the registry's answer for it.

    Attributes:
        flown: the camera.
        use: whether the entry may be used.
        resolution: the entry at the images' size; None if there is none.
        finding: what is wrong with the answer, or None.
    """

    flown: Flown
    use: Use
    resolution: Resolution | None = None
    finding: Finding | None = None

    @property
    def entry_id(self) -> str | None:
        """The entry's id."""
        return id_of(self.resolution.path) if self.resolution is not None else None

    def survey(self, policy: Policy, *more: Claim) -> Survey | None:
        """What the images, their entry and more state of them; None without an entry that may be used."""
        if self.resolution is None or self.use not in {Use.USED, Use.EXPIRED}:
            return None
        camera, state = self.flown.camera, self.flown.camera.states[0]
        entry = replace(of_entry(self.resolution, policy), name=ENTRY)
        claims = (entry, *of_images(camera.evidence, camera.key, policy), *more)
        # What programs did to the images is told of all of them at once.
        return Survey(state.metadata, claims, policy)


def camera_words(flown: Flown) -> str:
    """The camera in words, with its unit and firmware."""
    key = flown.key
    label = f"{flown.label}, " if flown.label is not None else ""
    unit = f", unit {key.serial[:8]}" if key.serial is not None else ""
    firmware = f", firmware {key.firmware}" if key.firmware is not None else ""
    return f"{label}{key}{unit}{firmware}"


def unit_name(camera: CameraKey, label: str | None) -> str:
    """A unit in words: its label, its camera, and the first digits of the hash of its serial number."""
    model = (
        " ".join(text for text in (camera.make, camera.model, camera.sub_camera) if text) or "unnamed camera"
    )
    called = f"{label}, " if label is not None else ""
    return f"{called}{model}" + (f", unit {camera.serial[:8]}" if camera.serial is not None else "")


def answer_to(flown: Flown, index: RegistryIndex, today: date) -> Answer:
    """Resolve a camera in the registry for the last day on which it flew.

    An entry that must not be used is looked for by why: one for other days, a draft, a retired one, in this order,
    because what to do differs.
    """
    key = flown.key
    if not key.make or not key.model:
        return Answer(flown=flown, use=Use.NONE, finding=_nameless(flown))
    try:
        found = index.resolve(key, on=flown.last or today)
        if found is not None:
            return Answer(flown=flown, use=Use.USED, resolution=found)
        for use, statuses in (
            (Use.EXPIRED, None),
            (Use.DRAFT, {Status.DRAFT}),
            (Use.RETIRED, {Status.RETIRED}),
        ):
            found = index.resolve(key) if statuses is None else index.resolve(key, statuses=statuses)
            if found is not None:
                return Answer(flown=flown, use=use, resolution=found, finding=_unusable(flown, use, found))
        near = index.near(key, on=flown.last or today)
    except RegistryError as error:
        finding = Finding(
            rule=Rule.SEVERAL if isinstance(error, AmbiguousEntryError) else Rule.BROKEN,
            severity=Severity.ERROR,
            camera=camera_words(flown),
            message=str(error),
            remedy="calibrary registry check",
        )
        return Answer(flown=flown, use=Use.NONE, finding=finding)
    nearest = "; ".join(f"{id_of(one.path)}: {one.reason}" for one in near[:MOST_NEAR])
    finding = Finding(
        rule=Rule.NO_ENTRY,
        severity=Severity.ERROR,
        camera=camera_words(flown),
        message=f"{_count(flown)} and no entry in use is of this camera"
        + (f" ({nearest})" if nearest else ""),
        remedy=f"calibrary onboard {quote(str(flown.example.parent))}",
    )
    return Answer(flown=flown, use=Use.NONE, finding=finding)


def _nameless(flown: Flown) -> Finding:
    missing = "no make" if flown.key.model else "no model" if flown.key.make else "neither make nor model"
    return Finding(
        rule=Rule.NAMELESS,
        severity=Severity.WARNING,
        camera=camera_words(flown),
        message=f"{_count(flown)} that name {missing}, by which an entry is found, such as {flown.camera.names[0]}",
        remedy=GIVE_FILES,
    )


def _unusable(flown: Flown, use: Use, found: Resolution) -> Finding:
    entry, id_ = found.entry, id_of(found.path)
    why = f" ({entry.reason})" if entry.reason else ""
    if use is Use.DRAFT:
        rule, text = Rule.DRAFT, "and its entry is a draft, which no run uses"
        remedy = f"calibrary registry show {id_}, then calibrary registry approve {id_}"
    elif use is Use.RETIRED:
        rule, text = Rule.RETIRED, f"and its entry is retired{why}"
        remedy = (
            f"calibrate the camera again and add that: calibrary onboard {quote(str(flown.example.parent))}"
        )
    else:
        day = f" on {flown.last}" if flown.last is not None else ""
        rule, text = Rule.EXPIRED, f"and its entry is valid {entry.validity}{why}, not{day or ' today'}"
        remedy = (
            f"calibrate it again; where K is known to be the same: calibrary registry set {id_} "
            f"valid-until=YYYY-MM-DD, then calibrary registry approve {id_}"
        )
    return Finding(
        rule=rule,
        severity=Severity.ERROR,
        camera=camera_words(flown),
        place=id_,
        message=f"{_count(flown)} {text}",
        remedy=remedy,
    )


def _count(flown: Flown) -> str:
    images = "1 image" if flown.images == 1 else f"{flown.images} images"
    days = f", last on {flown.last}" if flown.last is not None else ""
    return f"it flew ({images}{days})"


def tolerance_of(entry: Entry, policy: Policy) -> float:
    """Largest allowed difference of a K from the entry, as a fraction of fx."""
    return entry.tolerance or known_tolerance(policy)


def compared(survey: Survey | None, chosen: str | None) -> tuple[FlownSource, ...]:
    """What the images state, each compared with their entry.

    Args:
        survey: of the camera.
        chosen: the tag that gives the images' own K.
    """
    weighed = survey.weigh(survey.claims[0]) if survey is not None else None
    if survey is None or weighed is None or weighed.settled is Settled.AMBIGUOUS:
        return ()
    entry = weighed.ways[0]
    return tuple(
        FlownSource(
            tag=one.claim.name,
            grade=one.calibration.grade,
            fx=one.fx,
            tolerance=one.claim.rounding,
            difference=gap(one, entry),
            limit=limit_between(one.claim, entry.claim),
            contradicts=any(one is other.one for other in weighed.against),
            chosen=one.claim.name == chosen,
        )
        for one in survey.placed
        if one is not entry
    )


def disagreements(answer: Answer, survey: Survey | None) -> Iterator[Finding]:
    """Findings where the images contradict the entry that applies to them."""
    if survey is None or answer.resolution is None:
        return
    weighed = survey.weigh(survey.claims[0])
    yield from _firmware(answer, answer.resolution.entry)
    yield from _frame(answer, answer.resolution, weighed)
    for one in weighed.findings:
        if one.rule in RULES and one.severity is not Severity.PASS:
            yield _about(answer, Rule.UNLIKELY, Severity.ERROR, one.message, one.remedy)
    if weighed.settled is not Settled.AMBIGUOUS:
        yield from _contradictions(answer, weighed)


def _about(
    answer: Answer, rule: Rule, severity: Severity, message: str, remedy: str | None = None
) -> Finding:
    return Finding(
        rule=rule,
        severity=severity,
        camera=camera_words(answer.flown),
        place=answer.entry_id,
        message=message,
        remedy=remedy,
    )


def _firmware(answer: Answer, entry: Entry) -> Iterator[Finding]:
    flown = answer.flown
    made_with, now = entry.calibration.provenance.firmware, flown.key.firmware
    # A stated firmware range includes the camera's firmware, otherwise this entry would not apply.
    if made_with is None or now is None or entry.firmware is not None or _may_be_same(made_with, now):
        return
    yield _about(
        answer,
        Rule.FIRMWARE,
        Severity.WARNING,
        f"the entry was made with firmware {made_with} and the camera flies {now}: K may have moved",
        f"calibrate it with {now} and register the result; where K is known to be the same, in the registry's "
        f"folder: calibrary registry add {entry.path} --firmware-range {made_with}..{now}",
    )


def _may_be_same(one: str, other: str) -> bool:
    try:
        return compare_versions(one, other) == 0
    except InputError:
        # An editor or gallery program replaces the camera's firmware by its own name: the firmware is unknown.
        return True


def _frame(answer: Answer, found: Resolution, weighed: Weighed) -> Iterator[Finding]:
    """Findings on images that are not the frame that was calibrated."""
    stated = found.entry.calibration
    if (doubt := answer.flown.camera.doubt(stated)) is not None:
        message = f"{doubt}: nothing shows that the entry's K describes them"
        yield _about(answer, Rule.EDITED, Severity.WARNING, message, GIVE_FILES)
        return
    kept, seen = stated.intrinsics.image_size, answer.flown.camera.states[0].metadata.size
    if kept == seen:
        return
    sizes = f"images are {seen[0]}×{seen[1]} and the entry is of {kept[0]}×{kept[1]}"
    back = "set the camera back to its full frame, or " if seen < kept else ""
    remedy = f"{back}calibrate it at this size and add that"
    if weighed.settled is Settled.AMBIGUOUS:
        yield _about(answer, Rule.SIZE, Severity.ERROR, f"{sizes}: {weighed.use.why}", remedy)
        return
    taken = weighed.ways[0].reading
    how = "; ".join((*taken.steps, *(f"assumed: {one}" for one in taken.assumes)))
    yield _about(answer, Rule.SIZE, Severity.WARNING, f"{sizes}, so its K is taken over: {how}", remedy)


def _contradictions(answer: Answer, weighed: Weighed) -> Iterator[Finding]:
    """Findings on what the images state against their entry.

    What extract would use against the entry is drift. Of another unit than the entry's it is a note, because units of
    a model differ.
    """
    chosen = answer.flown.camera.evidence.chosen
    first = next(
        (one for one in weighed.believed if chosen is not None and one.one.claim.name == chosen.tag), None
    )
    if first is not None:
        # The other sources are not reported besides: the one that extract would use is against the entry already.
        yield _drifted(answer, first)
        return
    for one in weighed.against:
        cause = answer.flown.camera.evidence.cause(one.one.claim.name)
        yield _about(
            answer,
            Rule.TAGS,
            Severity.NOTE if one.shown_by else Severity.WARNING,
            one.message + (f" ({cause})" if cause else ""),
            None if one.shown_by else f"calibrary inspect {quote(str(answer.flown.example))}",
        )


def _drifted(answer: Answer, against: Against) -> Finding:
    """Finding on the K of images that is not that of their entry."""
    whose = "; the entry is not known to be of this unit, and units of a model differ"
    whose = "" if against.is_sure else whose
    return _about(
        answer,
        Rule.DRIFT if against.is_sure else Rule.UNITS,
        Severity.ERROR if against.is_sure else Severity.NOTE,
        f"{against.message}{whose}",
        f"calibrary diff {answer.entry_id} {quote(str(answer.flown.example))}",
    )


def unit_findings(answers: Sequence[Answer], policy: Policy) -> Iterator[Finding]:
    """Findings on units of one model that measure different K although the same entry, or none, applies to all."""
    groups: dict[CameraKey, dict[str, Answer]] = {}
    for answer in answers:
        serial = answer.flown.key.serial
        own = answer.resolution is not None and answer.resolution.entry.calibration.camera.serial is not None
        measured = answer.flown.camera.calibration
        if serial is None or own or measured is None or not measured.grade.is_measured:
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
        remedy="give each unit an entry of its own: calibrary registry add "
        f"{quote(str(first[1].flown.example))}, and so an image of each",
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


def entry_findings(
    parsed: Mapping[str, Entry | InputError],
    flew: Collection[str],
    today: date,
    repeat_of: Callable[[str], Repeat],
) -> Iterator[Finding]:
    """Findings on the entries themselves: broken files, age and validity.

    Args:
        parsed: the entries by path; the error of one that cannot be read.
        flew: paths of the entries of cameras that flew.
        today: the date that counts as today.
        repeat_of: when the calibration at a path is to be made again.
    """
    for path, entry in parsed.items():
        if isinstance(entry, InputError):
            yield Finding(
                rule=Rule.BROKEN,
                severity=Severity.ERROR,
                place=id_of(path),
                message=str(entry),
                remedy="calibrary registry check",
            )
            continue
        if entry.is_usable:
            yield from _stale(id_of(path), entry, today, repeat_of(path), has_flown=path in flew)


def _stale(id_: str, entry: Entry, today: date, rule: Repeat, *, has_flown: bool) -> Iterator[Finding]:
    validity = entry.validity
    # Of an entry that flew, the answer for its camera says so already.
    if validity is not None and validity.last is not None and validity.last < today and not has_flown:
        yield Finding(
            rule=Rule.OVER,
            severity=Severity.WARNING,
            place=id_,
            message=f"it is {entry.status.value} and valid {validity}, which is over",
            remedy=f"calibrary registry retire {id_} --reason 'validity over'",
        )
    age = age_finding(entry, today, rule, has_flown=has_flown)
    if age is not None:
        yield age
    elif not has_flown:
        yield Finding(
            rule=Rule.NOT_FLOWN,
            severity=Severity.NOTE,
            place=id_,
            message="no image of its camera is among these flights",
        )
