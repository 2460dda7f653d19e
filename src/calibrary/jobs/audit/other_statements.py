"""Whether calibration files among the images, and proposals on any branch, state the K that is in use.

``diff`` compares each with the entry in use. What states a K and cannot be compared is returned with the reason, so
that an audit never says that nothing is to be done where it did not look.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import Final

from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import CalibraryError, InputError
from calibrary.jobs.audit.age import Rule
from calibrary.jobs.audit.findings import ENTRY, Answer, camera_words
from calibrary.jobs.audit.report import NotCompared, Use
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.diff.wording import percent
from calibrary.jobs.extract.calibration_files import (
    CalibrationsOfFile,
    may_be_calibration,
    read_calibration_files,
)
from calibrary.jobs.images.folders import walk
from calibrary.jobs.survey import Weighed, of_file
from calibrary.jobs.survey.limits import foreign
from calibrary.jobs.survey.placing import Settled
from calibrary.parsers.files import is_image
from calibrary.policy import Policy
from calibrary.registry.entry import Entry, Status, noted
from calibrary.registry.paths import id_of
from calibrary.registry.pending import Pending, pending
from calibrary.registry.resolution import resolve
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity, Verdict

Statement = Finding | NotCompared
IN_USE: Final = frozenset({Use.USED, Use.EXPIRED})


def proposal_statements(
    snapshot: Snapshot, parsed: Mapping[str, Entry | InputError], answers: Sequence[Answer], policy: Policy
) -> Iterator[Statement]:
    """Compare what waits for approval on any branch with the entries in use.

    Args:
        snapshot: of the registry.
        parsed: its entries by path; the error of one that cannot be read.
        answers: for the cameras that flew, which a proposal may be for whatever its path.
        policy: with the limits.
    """
    for one in pending(snapshot):
        if isinstance(one.entry, str):
            yield NotCompared(what=one.key, reason=one.entry)
        else:
            yield from _proposed(one, one.entry, parsed, answers, policy)


def _proposed(
    one: Pending,
    entry: Entry,
    parsed: Mapping[str, Entry | InputError],
    answers: Sequence[Answer],
    policy: Policy,
) -> Iterator[Statement]:
    draft = entry.as_draft
    used: dict[str, tuple[str | None, Calibration, Calibration]] = {}
    where = f" on the branch {one.branch}" if one.branch is not None else ""
    came = f" --from {one.branch}" if one.branch is not None else ""
    for answer in answers:
        if answer.use is Use.NONE and resolve({one.path: draft}, answer.flown.key, statuses={Status.DRAFT}):
            yield Finding(
                rule=Rule.WAITING,
                severity=Severity.NOTE,
                camera=camera_words(answer.flown),
                message=f"its K, {entry.calibration.grade}, is proposed{where}, and no run uses it unapproved",
                remedy=f"calibrary registry show {one.key}, then calibrary registry approve {id_of(one.path)}{came}",
            )
        if answer.resolution is None or answer.use not in IN_USE or answer.entry_id is None:
            continue
        found = resolve({one.path: draft}, answer.flown.key, statuses={Status.DRAFT})
        if found is not None and answer.resolution.path != one.path:
            here = (camera_words(answer.flown), answer.resolution.calibration, found.calibration)
            used.setdefault(answer.entry_id, here)
    current = parsed.get(one.path)
    if not used and isinstance(current, Entry) and current.is_usable:
        used[current.id] = (None, noted(current), noted(entry))
    for id_, (camera, K, other) in used.items():
        said = _difference(K, other, policy)
        if said is None:
            continue
        text, alarm = said
        if alarm is None:
            yield NotCompared(what=one.key, reason=f"with {id_} in use: {text}")
            continue
        yield Finding(
            rule=Rule.WAITING,
            severity=Severity.WARNING if alarm else Severity.NOTE,
            camera=camera,
            place=id_,
            message=f"another K, {other.grade.value}, is proposed{where} and not used before it is approved: {text}",
            remedy=f"calibrary diff {id_} {one.key}, then calibrary registry approve {id_of(one.path)}{came}",
        )


def file_statements(
    folders: Sequence[Path], registry: Path, answers: Sequence[Answer], policy: Policy
) -> Iterator[Statement]:
    """Compare the calibration files in the audited folders with the entries of the cameras that flew there.

    Args:
        folders: that were audited.
        registry: its files are no calibrations of a flight.
        answers: for the cameras that flew.
        policy: with the limits.
    """
    flown = [(answer, {path.parent for day in answer.flown.days for path in day.paths}) for answer in answers]
    seen: set[Path] = set()
    for root in folders:
        for folder, paths in _by_folder(root, registry).items():
            new = [path for path in paths if path.resolve() not in seen]
            seen |= {path.resolve() for path in new}
            here = _that_flew(folder, root, flown)
            if not new or not here:
                continue
            found, unreadable = read_calibration_files(new, root, [answer.flown.camera for answer in here])
            yield from (NotCompared(what=name, reason=reason) for name, reason in unreadable)
            for file in found:
                yield from _statements_of_file(file, root / file.label, here, policy)


def _by_folder(root: Path, registry: Path) -> dict[Path, list[Path]]:
    found: dict[Path, list[Path]] = {}
    inside = registry.resolve()
    for entry in walk(root, recursive=True, unreadable=[]):
        path = Path(entry.path)
        if not entry.is_file() or is_image(path) or path.resolve().is_relative_to(inside):
            continue
        if may_be_calibration(entry):
            found.setdefault(path.parent, []).append(path)
    return found


def _that_flew(folder: Path, root: Path, flown: Sequence[tuple[Answer, set[Path]]]) -> Sequence[Answer]:
    """The cameras with images in a folder or below it; else those of the nearest folder above it that has any."""
    while True:
        here = [answer for answer, places in flown if any(one.is_relative_to(folder) for one in places)]
        if here or folder in {root, folder.parent}:
            return here
        folder = folder.parent


def _statements_of_file(
    file: CalibrationsOfFile, path: Path, answers: Sequence[Answer], policy: Policy
) -> Iterator[Statement]:
    """Weigh a file by the images and the entries of the cameras that it may be of.

    A start for another program's adjustment states no K. For a camera without an entry in use, the lack of it is a
    finding already.
    """
    metric = [one for one in file.calibrations if one.grade.is_metric]
    outcomes: list[tuple[Answer, Weighed]] = []
    others = []
    for answer in answers:
        own = [one for one in metric if foreign(one, answer.flown.key) is None]
        claims = [of_file(file.label, one, policy.source_agreement) for one in own]
        survey = answer.survey(policy, *claims)
        if survey is None:
            continue
        others += [why for one in metric if (why := foreign(one, answer.flown.key)) is not None]
        placed = [one for one in map(survey.weigh, claims) if one.ways]
        if placed:
            outcomes.append((answer, min(placed, key=_least_against)))
    if others and not outcomes:
        yield NotCompared(what=file.label, reason=others[0])
    entries = sorted({answer.entry_id or "" for answer, _ in outcomes})
    if len(metric) == 1 and len(entries) > 1:
        if not any(not one.believed or _is_of_entry(one) for _, one in outcomes):
            reason = f"it does not say of which camera it is, and it is the K of none of {', '.join(entries)}"
            yield NotCompared(what=file.label, reason=reason)
        return
    told, where = set[str](), quote(os.path.normpath(path))
    for answer, weighed in outcomes:
        id_ = answer.entry_id or ""
        if weighed.verdict is Verdict.VALID or weighed.computed or id_ in told or _is_of_entry(weighed):
            continue
        told.add(id_)
        if weighed.settled is Settled.AMBIGUOUS:
            yield NotCompared(what=file.label, reason=weighed.use.why)
            continue
        grade, used = weighed.claim.calibration.grade, answer.resolution
        camera = used.entry.calibration.camera if used is not None else weighed.claim.calibration.camera
        yield Finding(
            rule=Rule.FILE,
            severity=Severity.WARNING if grade.is_measured else Severity.NOTE,
            camera=camera_words(answer.flown),
            place=id_,
            message=f"{file.label} among its images states another K, {grade.value}: {weighed.findings[0].message}",
            remedy=f"calibrary diff {id_} {where}, then move it away, or if it is right calibrary registry add {where} "
            + _flags(camera),
        )


def _least_against(weighed: Weighed) -> tuple[int, float]:
    """Of several cameras of a file the one that stands best, and then is nearest to the entry."""
    apart = max((abs(one.one.fx / weighed.ways[0].fx - 1.0) for one in weighed.believed), default=0.0)
    return len(weighed.believed), apart


def _is_of_entry(weighed: Weighed) -> bool:
    """Whether a file states the K of the entry in use: what the images say of that is said of the entry."""
    return any(one.claim.name == ENTRY for one in (*weighed.copies, *weighed.confirmed_by))


def _flags(camera: CameraKey) -> str:
    """The flags that state a camera; of a serial number only the hash is known."""
    stated = {
        "--make": camera.make,
        "--model": camera.model,
        "--sub-camera": camera.sub_camera,
        "--lens": camera.lens,
        "--focal-mm": f"{camera.focal_mm:g}" if camera.focal_mm is not None else None,
        "--capture-mode": camera.capture_mode,
        "--serial": "NUMBER" if camera.serial is not None else None,
    }
    return " ".join(f"{flag} {quote(value)}" for flag, value in stated.items() if value is not None)


def _difference(K: Calibration, other: Calibration, policy: Policy) -> tuple[str, bool | None] | None:
    """How another K of a camera differs from that in use, and whether it matters (None: not comparable).

    None if they are the same.
    """
    try:
        found = compare(K, other, policy)
    except CalibraryError as error:
        return error.why, None
    if found.verdict is found.verdict.IDENTICAL:
        return None
    focal = (
        f"fx {percent(other.intrinsics.fx / K.intrinsics.fx - 1.0)}, " if found.numbers is not None else ""
    )
    return f"{focal}{found.reasons[0]} ({found.verdict.value})", found.alarm
