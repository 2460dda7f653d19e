"""Proposals: entries to write, with their changes, the findings that prevent writing, and the commit that is made."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import date
from enum import StrEnum
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.arguments import Terms
from calibrary.calibration import Provenance
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import match_key
from calibrary.provenance import HOW_MADE
from calibrary.records import Record, replace
from calibrary.registry.configuration import UNPROVEN
from calibrary.registry.entry import VERDICT_BLOCK, Entry, Status, Validity, digest
from calibrary.registry.entry_checks import Judge, check, in_order
from calibrary.registry.entry_yaml import combined, entry_yaml, lost_comments, parse_entry, parsed
from calibrary.registry.fields import FieldChange, differences
from calibrary.registry.git.history import MOVED_FROM, SOURCE_FILE, SOURCE_SHA256
from calibrary.registry.git.objects import ObjectId, blob_id
from calibrary.registry.git.repository import Repository, is_due, maintain
from calibrary.registry.git.writing import ANY, Change, Person, Written, compose, write
from calibrary.registry.paths import (
    PROPOSED,
    ROOT,
    STATEMENTS,
    SUFFIX,
    folder_of,
    in_use_path,
    model_folder,
    proposal_path,
)
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot, StoredEntry
from calibrary.registry.standing import until
from calibrary.registry.statements import Action
from calibrary.registry.stating import Act, Stated, brought, stated
from calibrary.validation import Finding, Severity


class Note(Struct, frozen=True, kw_only=True):
    """Content of the commit message of a change.

    Attributes:
        subject: one line for people.
        reason: reason for the change.
        cameras: keys of the changed entries' cameras.
        sources: (name, SHA-256) of each file that the numbers came from; the name may be missing.
        moved: (old, new) paths that connect the history of an entry.
    """

    subject: str
    reason: str | None = None
    cameras: Sequence[str] = ()
    firmware: str | None = None
    grade: str | None = None
    sources: Sequence[tuple[str | None, str]] = ()
    moved: Sequence[tuple[str, str]] = ()

    @property
    def message(self) -> str:
        """Return the commit message."""
        trailers = [("Camera", camera) for camera in self.cameras]
        trailers += [("Firmware", self.firmware or ""), ("Grade", self.grade or "")]
        for name, sha256 in self.sources:
            trailers += [(SOURCE_FILE, name or ""), (SOURCE_SHA256, sha256)]
        trailers += [("Reason", self.reason or "")]
        trailers += [(MOVED_FROM, f"{old} => {new}") for old, new in self.moved]
        return compose(self.subject, trailers=trailers)


def note_of(subject: str, entries: Sequence[Entry], reason: str | None = None) -> Note:
    """Return the note of a change of entries, with trailers for programs."""
    calibrations = [entry.calibration for entry in entries]
    grades = {calibration.grade.value for calibration in calibrations}
    firmware = {calibration.provenance.firmware for calibration in calibrations}
    made = [calibration.provenance for calibration in calibrations]
    sources = {one.sha256: (one.source, one.sha256) for one in made if one.sha256 is not None}
    return Note(
        subject=subject,
        reason=reason,
        cameras=[entry.id for entry in entries],
        firmware=firmware.pop() if len(firmware) == 1 else None,
        grade=grades.pop() if len(grades) == 1 else None,
        sources=[*sources.values()],
    )


def write_changes(
    repo: Repository,
    changes: Sequence[Change],
    note: Note,
    *,
    author: Person | None = None,
    branch: str | None = None,
    is_checked: bool = False,
) -> Written:
    """Write several files as one commit, all or none.

    Args:
        repo: repository of the registry.
        changes: changes of its files; a change of an entry states the content it started from.
        note: content of the commit message.
        author: author, if not the committer.
        branch: target branch; by default the one that is checked out.
        is_checked: whether each entry's content has already been read back.

    Raises:
        FileConflictError: an entry was changed since; nothing was written, all conflicts are reported.
        RegistryError: the content of an entry cannot be read or belongs to another path, or git cannot write it.
    """
    for change in changes:
        if change.path.startswith((ROOT, PROPOSED)):
            if change.base is ANY:
                raise RegistryError(
                    f"{change.path}: an entry is written only against its base; name the base"
                )
            if change.data is not None and not is_checked:
                _require_entry(change.path, change.data)
    written = write(repo, changes, note.message, author=author, branch=branch, combine=combined)
    if is_due(repo):
        # The commit is complete even if packing fails.
        with suppress(RegistryError):
            maintain(repo, in_background=True)
    return written


def _require_entry(path: str, data: bytes) -> None:
    entry = parsed(data, path)
    if entry.path != in_use_path(path):
        raise RegistryError(f"{path}: its camera belongs at {entry.path}")


SHORT_DIGEST: Final = re.compile("[0-9a-f]{8,40}")
NOT_APPROVED: Final = frozenset({"label", "tags", "notes"})
"""Fields that do not affect which K is used; for the reason see :mod:`calibrary.registry.standing`."""


class Proposal(Struct, frozen=True, kw_only=True):
    """An entry to write.

    Attributes:
        entry: the proposed entry.
        path: path of the file: in ``proposals/`` if it needs approval, in ``cameras/`` if it is used.
        data: content of the file; None if a proposal is withdrawn.
        current: entry that it replaces; None if there is none, or it cannot be read.
        base: blob id of the file at its path; the write fails with FileConflictError if it has changed.
        changes: changed fields; all fields of a new entry, none if nothing changes.
        warnings: warnings for the user.
        approves: blob id of the proposal that is approved; None if there is none.
        start: first day of a retirement of the days from then on; its file stays as it is.
        brought: files of statements on the branch that an approval is from.
        formers: files that it takes the place of, whose comments and order of fields stay.
        replaced: path and blob id of files removed by the same commit: the approved proposal, or a draft that an older
            version wrote to ``cameras/``.
    """

    entry: Entry
    path: str
    data: bytes | None
    current: Entry | None
    base: str | None
    changes: tuple[FieldChange, ...]
    warnings: tuple[str, ...] = ()
    replaced: tuple[tuple[str, str], ...] = ()
    approves: str | None = None
    start: date | None = None
    brought: tuple[Change, ...] = ()
    formers: tuple[bytes, ...] = ()

    @property
    def is_new(self) -> bool:
        """Whether this camera has neither an entry nor a proposal."""
        return self.base is None and self.current is None and not self.replaced

    @property
    def digest(self) -> str | None:
        """Id of the file in git, for ``approve --digest``; None if the proposal is withdrawn."""
        return blob_id(self.data) if self.data else None

    @property
    def decided(self) -> str | None:
        """Id of the file that a decision is on: of the proposal to approve, of the entry to retire."""
        is_ended = self.start is not None or self.entry.status is Status.RETIRED
        return self.approves or (self.base if is_ended else None)

    @property
    def file_changes(self) -> tuple[Change, ...]:
        """Changes of files to write."""
        gone = (Change(path=path, data=None, base=oid) for path, oid in self.replaced)
        return (Change(path=self.path, data=self.data, base=self.base), *gone)


class Fate(StrEnum):
    """What becomes of one source of several."""

    NEW = "new"
    CHANGED = "changed"
    SAME = "same"
    LEFT = "left"
    FAILED = "failed"


class AddedSource(Record):
    """A calibration of several that were added together.

    Attributes:
        source: file name relative to the folder, or the title in the catalogue.
        fate: what became of it.
        entry: id of the entry, if known.
        reason: why it was not added, or a remark.
    """

    source: str
    fate: Fate
    entry: str | None = None
    reason: str | None = None


class RowProblem(Record):
    """A row of a table that cannot be taken.

    Attributes:
        line: line number in the file; 0 for the registry.
        entry: id of the entry, or the name of the unit in the row.
        message: error, with a remedy.
    """

    line: int
    entry: str
    message: str


class Proposals(Struct, frozen=True, kw_only=True):
    """Entries that are proposed together, with the findings of the check.

    Attributes:
        items: all proposals, also those without changes.
        findings: findings of the check on everything to be written.
        verb: first word of the commit's subject, "Approve"; None for adding and updating.
        title: subject of the commit, instead of one from the changes.
        sources: what became of each source, if there were several: files of a folder, cameras of the catalogue.
        problems: rows of a table that cannot be taken; nothing is written if there are any.
        remarks: parts of a table that were not taken, with the reason.
    """

    items: tuple[Proposal, ...]
    findings: tuple[Finding, ...] = ()
    verb: str | None = None
    title: str | None = None
    sources: tuple[AddedSource, ...] = ()
    problems: tuple[RowProblem, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def due(self) -> tuple[Proposal, ...]:
        """Proposals with changes."""
        return tuple(one for one in self.items if one.changes)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that prevent writing."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    @property
    def subject(self) -> str:
        """Subject of the commit."""
        if self.title is not None:
            return self.title
        due = self.due
        verb, ending = self.verb, ""
        if verb is None:
            approved = all(one.entry.status is Status.APPROVED for one in due)
            verb = "Add" if all(one.is_new for one in due) else "Update" if approved else "Propose"
            ending = ", approved" if approved else ""
        else:
            # An entry that only states its successor is not the subject of the commit.
            about = [one for one in due if one.current is None or one.entry.status is not one.current.status]
            due = tuple(about) or due
        named = due[0].entry.id if len(due) == 1 else f"{len(due)} cameras"
        return f"{verb} {named}{ending}"


class ChangedEntry(Record):
    """A written entry.

    Attributes:
        id: longest KEY of the entry.
        path: path of its file; in proposals/ if it needs approval.
        digest: git's id of the file, which an approval refers to; None if nothing is written.
        status: new status.
        status_before: status of the entry that it replaces; None for a new one, or one that could not be read.
        is_new: whether this camera had neither an entry nor a proposal.
        changes: changed fields; none if nothing changes.
        warnings: warnings for the user.
    """

    id: str
    path: str
    digest: ObjectId | None
    status: Status
    status_before: Status | None
    is_new: bool
    changes: tuple[FieldChange, ...]
    warnings: tuple[str, ...]


class ChangeReport(Record, tag_field="schema", tag="calibrary/registry-change-1"):
    """Output of ``calibrary registry add``, ``approve``, ``retire`` and ``set`` with ``--json``.

    Attributes:
        registry: folder of the registry.
        commit: commit with the changes; None if nothing was written.
        entries: all named entries.
        findings: findings of the check on everything to be written.
        warnings: warnings about the commit.
        sources: what became of each file of a folder, or camera of the catalogue; empty for a single file.
        problems: rows of a table that cannot be taken; nothing is written if there are any.
        remarks: parts of a table that were not taken, with the reason.
    """

    registry: str
    commit: ObjectId | None
    entries: tuple[ChangedEntry, ...]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]
    sources: tuple[AddedSource, ...] = ()
    problems: tuple[RowProblem, ...] = ()
    remarks: tuple[str, ...] = ()


def change_report(place: Path, proposals: Proposals, written: Written | None) -> ChangeReport:
    """Return the report of what was written, or would be."""
    return ChangeReport(
        registry=str(place),
        commit=written.commit if written is not None else None,
        entries=tuple(
            ChangedEntry(
                id=one.entry.id,
                path=one.path,
                digest=one.digest,
                status=one.entry.status,
                status_before=one.current.status if one.current is not None else None,
                is_new=one.is_new,
                changes=one.changes,
                warnings=one.warnings,
            )
            for one in proposals.items
        ),
        findings=proposals.findings,
        warnings=written.warnings if written is not None else (),
        sources=proposals.sources,
        problems=proposals.problems,
        remarks=proposals.remarks,
    )


def require_digest(text: str) -> str:
    """Return the beginning of a digest in lower case.

    Raises:
        RegistryError: it is none.
    """
    if SHORT_DIGEST.fullmatch(text.lower()) is None:
        raise RegistryError(
            f"{text!r:.60} is not a digest: expected at least 8 hexadecimal digits, as 'calibrary registry add' "
            "prints them"
        )
    return text.lower()


def require_digests(proposals: Proposals, digests: Sequence[str]) -> None:
    """Check that what is approved or retired is what was looked at.

    Args:
        proposals: what is to be written.
        digests: git's ids of the files that were looked at, or their beginnings; none if nobody asks.

    Raises:
        RegistryError: a proposal matches no digest, or a digest matches no proposal.
    """
    left = {require_digest(text) for text in digests}
    for one in proposals.due if left else ():
        if (seen := one.decided) is None:
            continue
        of_it = {text for text in left if seen.startswith(text)}
        if not of_it:
            path = proposal_path(one.path) if one.approves is not None else one.path
            raise RegistryError(
                f"{one.entry.id}: nothing was written: what is there now has the digest {seen[:12]}; look at it "
                f"('calibrary registry show {path}') and decide on that one"
            )
        left -= of_it
    if left:
        raise RegistryError(f"nothing was written: {min(left)} is the digest of none of these")


def proposal_of(
    entry: Entry,
    current: Entry | None,
    base: str | None,
    warnings: Iterable[str] = (),
    *,
    path: str | None = None,
    replaced: tuple[tuple[str, str], ...] = (),
) -> Proposal:
    """Return a proposal with its changes; ``path`` defaults to the entry's own path."""
    changes = differences(current, entry)
    return Proposal(
        entry=entry,
        path=path or entry.path,
        data=entry_yaml(entry) if changes else b"",
        current=current,
        base=base,
        changes=changes,
        warnings=tuple(warnings),
        replaced=replaced,
    )


def needs_no_approval(one: Proposal) -> bool:
    """Return whether only fields change that an approval does not cover."""
    return {change.name for change in one.changes} <= NOT_APPROVED


def differs_in_status_only(one: Proposal) -> bool:
    """Return whether only the status and its reason change."""
    return {change.name for change in one.changes} <= {"status", "reason"}


BY_HAND: Final = "numbers changed by hand"
FREELY: Final = Terms()
"""A proposal without a reason, which overrides nothing."""
MOST_UNITS: Final = 8
"""Number of units whose K is compared with a new one if there is no entry for the model."""


def propose(
    snapshot: Snapshot,
    entries: Sequence[Entry],
    terms: Terms = FREELY,
    *,
    edited: bool = False,
    written: bytes | None = None,
) -> Proposals:
    """Propose entries, with their changes and findings; nothing is written.

    Args:
        snapshot: newest state of the registry.
        entries: entries as stated by their source and the user; their status is set here.
        terms: whether they are approved at once, why, and what is overridden.
        edited: whether they are current entries edited by a person.
        written: file of the one entry, whose comments are taken.

    Raises:
        InputError: two of the entries have the same path.
    """
    seen: set[str] = set()
    items = []
    for entry in entries:
        if entry.path in seen:
            raise InputError(
                f"several of the cameras would all be {entry.id}; distinguish them by sub-camera, lens or serial"
            )
        seen.add(entry.path)
        here = CurrentFiles.of(snapshot, entry.path)
        stated = entry
        for known in (here.proposed, here.current):
            if known is not None:
                stated = _with_current(stated, known, edited=edited)
        stated = replace(stated, label=stated.label or snapshot.label_of(stated.unit))
        one = _proposal(stated, here, Status.APPROVED if terms.approve else Status.DRAFT, terms.reason)
        items.append(replace(one, formers=(written,) if written is not None else ()))
    return checked(snapshot, items)


def checked(
    snapshot: Snapshot, items: Sequence[Proposal], verb: str | None = None, *, only_new: bool = False
) -> Proposals:
    """Add to proposals the findings of :func:`calibrary.registry.entry_checks.check` on everything to be written.

    Only entries that they can affect are read: those of their models and aliases, and those they supersede. Earlier
    errors of other entries are left to ``calibrary registry check``; with ``only_new``, earlier errors of these
    entries as well: an error in K does not prevent setting a label.
    """
    items = [_as_people_wrote(snapshot, one) for one in items]
    due = [one for one in items if one.changes]
    if not due:
        return Proposals(items=tuple(items), verb=verb)
    policy = snapshot.configuration.policy
    concerned = {*_concerned(snapshot.paths, [one.entry for one in due]), *_called_alike(snapshot, due)}
    before = {path: snapshot.read(path) for path in concerned}
    if only_new:
        before |= {one.path: snapshot.read(one.path) for one in due if one.base is not None}
    own = {one.path: one.data for one in due if one.data is not None}
    gone = {path for one in due for path, _ in one.replaced}
    last_approved = {one.entry.path: one.current for one in due if one.current is not None}
    known = set(check(before, policy)) if before else set()
    left = {path: data for path, data in before.items() if path not in gone}
    found = check({**left, **own}, policy, last_approved)
    findings = tuple(
        finding for finding in found if finding not in known or (finding.place in own and not only_new)
    )
    return Proposals(items=tuple(items), findings=findings, verb=verb)


def _as_people_wrote(snapshot: Snapshot, one: Proposal) -> Proposal:
    """Return a proposal with the comments and the order of fields of the files that its own takes the place of."""
    if not one.changes or one.data is None or one.start is not None or snapshot.repo is None:
        return one
    beside = (*(oid for _, oid in one.replaced), snapshot.paths.get(one.entry.path))
    oids = [oid for oid in (one.approves, one.base) if oid is not None] or beside
    found = []
    for oid in oids:
        # What cannot be read has no comments either.
        with suppress(RegistryError):
            found += [snapshot.repo.blob(oid)] if oid is not None else []
    formers = tuple(dict.fromkeys((*one.formers, *found)))
    data = entry_yaml(one.entry, formers)
    lost = lost_comments(data, one.entry, formers)
    said = (lost,) if lost is not None else ()
    return replace(one, formers=formers, data=data, warnings=tuple(dict.fromkeys((*one.warnings, *said))))


def judged(snapshot: Snapshot, proposals: Proposals, judge: Judge, override: str | None = None) -> Proposals:
    """Add to proposals the findings on each K that is to be written or put to use.

    Args:
        snapshot: that they were proposed for.
        proposals: entries with the findings of :func:`checked`.
        judge: weighs a K, with the entries that are beside it.
        override: reason to accept what contradicts a K, which stays with its entry; None if that is not accepted.
    """
    due = [one for one in proposals.due if one.data is not None and not _keeps_k(one)]
    gone = {path for one in due for path, _ in one.replaced}
    groups: dict[str, dict[str, Entry]] = {}
    for path in _concerned(snapshot.paths, [one.entry for one in due]):
        with suppress(InputError):
            if path not in gone:
                groups.setdefault(model_folder(path), {})[path] = parse_entry(snapshot.read(path), path)
    for one in due:
        groups.setdefault(model_folder(one.path), {})[one.path] = one.entry
    policy, items, found = snapshot.configuration.policy, {one.path: one for one in proposals.items}, []
    for one in due:
        group, entry = groups[model_folder(one.path)], one.entry
        said = [*judge(one.path, entry, group, one.current, policy)]
        if override is not None and any(finding.severity is Severity.ERROR for finding in said):
            entry = replace(entry, override=override)
            changes = differences(one.current, entry)
            items[one.path] = _as_people_wrote(snapshot, replace(one, entry=entry, changes=changes))
            said = [*judge(one.path, entry, group, one.current, policy)]
        found += said
    return replace(proposals, items=tuple(items.values()), findings=in_order([*proposals.findings, *found]))


def _keeps_k(one: Proposal) -> bool:
    """Whether the K in use stays: only what an approval does not cover changes, or it is retired."""
    if one.start is not None:
        return True
    stays = one.current is not None and one.current.is_usable
    return needs_no_approval(one) or (stays and differs_in_status_only(one))


def _called_alike(snapshot: Snapshot, due: Sequence[Proposal]) -> Iterator[str]:
    """Yield the usable entries of any camera with the same label as one to be written."""
    labels = {match_key(one.entry.label) for one in due if one.entry.label is not None}
    if labels:
        labelled = snapshot.labels.items()
        yield from (path for path, label in labelled if match_key(label) in labels and path in snapshot.paths)


def _concerned(paths: Iterable[str], entries: Sequence[Entry]) -> Iterator[str]:
    whole, folders = set(), set()
    for entry in entries:
        camera = entry.calibration.camera
        folders.add(folder_of(camera.make or "", camera.model or ""))
        # The folder of a unit, without those of thousands of other units, which it cannot affect.
        folders.add(entry.path.rpartition("/")[0] + "/")
        folders.update(folder_of(alias.make, alias.model) for alias in entry.aliases)
        if entry.supersedes is not None:
            whole.add(f"{ROOT}{entry.supersedes}{SUFFIX}")
    units: list[str] = []
    has_relative = False
    own = {entry.path for entry in entries}
    for path in paths:
        if path in whole or path.rpartition("/")[0] + "/" in folders:
            has_relative = has_relative or path not in own
            yield path
        elif len(units) < MOST_UNITS and path.rpartition("/sn-")[0] + "/" in folders:
            units.append(path)
    if not has_relative:
        yield from units


def _proposal(entry: Entry, here: CurrentFiles, status: Status, reason: str | None) -> Proposal:
    current, warnings = here.current, [*here.warnings]
    for known, path, oid in ((current, entry.path, here.oid), (here.proposed, here.path, here.proposed_oid)):
        if known is None:
            continue
        unchanged = replace(entry, status=known.status, reason=known.reason)
        if not differences(known, unchanged) and (status is Status.DRAFT or known.is_usable):
            return proposal_of(known, known, oid, warnings, path=path)
    if status is Status.APPROVED:
        return _approved_at_once(entry, here, reason, warnings)
    before = current if current is not None else here.proposed
    if current is not None and current.is_usable:
        warnings.append(f"what is {current.status.value} now stays in use until this is approved")
    if here.proposed is not None:
        warnings.append("it takes the place of an earlier proposal")
    draft = replace(entry, status=Status.DRAFT, reason=None)
    is_draft = current is not None and current.status is Status.DRAFT
    gone = ((entry.path, here.oid),) if is_draft and here.oid is not None else ()
    return proposal_of(draft, before, here.proposed_oid, warnings, path=here.path, replaced=gone)


def _approved_at_once(entry: Entry, here: CurrentFiles, reason: str | None, warnings: list[str]) -> Proposal:
    approved = replace(entry, status=Status.APPROVED, reason=reason)
    before = here.current if here.current is not None else here.proposed
    gone: tuple[tuple[str, str], ...] = ()
    if here.proposed is not None and here.proposed_oid is not None:
        if differences(here.proposed, replace(entry, status=Status.DRAFT, reason=None)):
            warnings.append(f"another K is proposed for it and goes on waiting: {here.path}")
        else:
            gone = ((here.path, here.proposed_oid),)
    return proposal_of(approved, before, here.oid, warnings, replaced=gone)


class CurrentFiles(Struct, frozen=True, kw_only=True):
    """The current entry of one camera, and the proposal for it.

    Attributes:
        path: path of the proposal, whether or not it exists.
        current, oid: entry and file id in ``cameras/``; None if there is none (the entry also if it cannot be read).
        proposed, proposed_oid: the same in ``proposals/``.
        warnings: errors of entries that cannot be read.
    """

    path: str
    current: Entry | None
    oid: str | None
    proposed: Entry | None
    proposed_oid: str | None
    warnings: tuple[str, ...]

    @classmethod
    def of(cls, snapshot: Snapshot, path: str) -> CurrentFiles:
        """Read the current files of an entry, given its path in ``cameras/``."""
        beside = proposal_path(path)
        oids = snapshot.paths.get(path), snapshot.proposed.get(beside)
        there = path in snapshot.paths, beside in snapshot.proposed
        read: list[Entry | None] = []
        warnings = []
        for is_there, place, what in ((there[0], path, "entry"), (there[1], beside, "proposal")):
            try:
                read.append(parse_entry(snapshot.read(place), place) if is_there else None)
            except InputError as error:
                read.append(None)
                warnings.append(f"the current {what} cannot be read and is replaced: {error}")
        return cls(
            path=beside,
            current=read[0],
            oid=oids[0],
            proposed=read[1],
            proposed_oid=oids[1],
            warnings=tuple(warnings),
        )


def _with_current(entry: Entry, current: Entry, *, edited: bool) -> Entry:
    """Add what the registry knows about the camera and a calibration file does not state."""
    extensions = {
        name: value
        for name, value in current.extensions.items()
        if name.startswith(("x-", "camera/")) or (name.startswith("sensor/") and entry.sensor is None)
    }
    if digest(entry.calibration) != digest(current.calibration):
        # A verdict is on the numbers that were judged, and not on those in their place.
        extensions.pop(VERDICT_BLOCK, None)
    made = _provenance(entry, current, edited=edited)
    return replace(
        entry,
        calibration=replace(entry.calibration, provenance=made),
        aliases=entry.aliases or current.aliases,
        sensor=entry.sensor or current.sensor,
        tolerance=entry.tolerance if entry.tolerance is not None else current.tolerance,
        supersedes=entry.supersedes or current.supersedes,
        label=entry.label or current.label,
        tags=entry.tags or current.tags,
        extensions={**extensions, **entry.extensions},
    )


def _provenance(entry: Entry, current: Entry, *, edited: bool) -> Provenance:
    made, before = entry.calibration.provenance, current.calibration.provenance
    if edited and _source(made) == _source(before):
        if digest(entry.calibration, entry.sensor, entry.rig) == digest(
            current.calibration, current.sensor, current.rig
        ):
            return made
        by_hand = (*(text for text in made.assumptions if text != BY_HAND), BY_HAND)
        return replace(made, assumptions=by_hand)
    if made.sha256 is not None and made.sha256 == before.sha256:
        # The same file again: what an option stated earlier still applies.
        return replace(made, **{name: getattr(made, name) or getattr(before, name) for name in HOW_MADE})
    return made


def _source(made: Provenance) -> tuple[object, ...]:
    return made.kind, made.source, made.sha256, made.sources


def propose_retirements(
    snapshot: Snapshot,
    keys: Sequence[str],
    reason: str,
    *,
    successor: str | None = None,
    start: date | None = None,
) -> Proposals:
    """Propose to retire entries, and to withdraw proposals; nothing is written.

    Args:
        snapshot: newest state of the registry.
        keys: keys of the entries, without a revision.
        reason: why.
        successor: KEY of the entry that replaces a retired one, and will state so.
        start: first day of a retirement: images of the days before keep their K.

    Raises:
        UnknownCameraError: an entry does not exist.
        RegistryError: a key is ambiguous or contains a revision, or the successor already supersedes another.
    """
    stored = {one.path: one for one in (_current(snapshot, key) for key in keys)}
    items = []
    for one in stored.values():
        if one.is_pending:
            items.append(_withdrawn(one, reason))
        elif start is not None:
            items.append(_retired_from(snapshot, one, start, reason))
        else:
            items.append(_changed(one, _with_status(one.entry, Status.RETIRED, reason)))
    if successor is not None:
        items.append(_succeeding(_current(snapshot, successor), [*stored.values()]))
    # What is wrong with a K does not keep it from being retired.
    return checked(snapshot, items, "Retire", only_new=True)


def propose_approvals(
    snapshot: Snapshot, source: Snapshot, keys: Sequence[str], terms: Terms = FREELY
) -> Proposals:
    """Propose to approve proposals; nothing is written.

    Args:
        snapshot: state in which the entries become usable.
        source: state with the proposals.
        keys: keys of the entries, without a revision.
        terms: why, the days on which an approved entry may be used instead of those it states, and whether a
            contradiction to known facts about its camera is overridden.

    Raises:
        UnknownCameraError: an entry does not exist.
        RegistryError: a key is ambiguous or contains a revision.
    """
    items: dict[str, Proposal] = {}
    validity = Validity.between(terms.valid_from, terms.valid_until)
    for key in keys:
        _refuse_revision(key)
        proposed = source.pending(key)
        here = CurrentFiles.of(snapshot, in_use_path(proposed.path))
        entry = _with_status(proposed.entry, Status.APPROVED, terms.reason)
        if validity is not None:
            entry = replace(entry, validity=validity)
        if proposed.is_pending and here.current is not None:
            # Labels and tags set since the proposal are kept: the approval does not cover them.
            entry = replace(
                entry, label=here.current.label or entry.label, tags=here.current.tags or entry.tags
            )
        is_here = here.proposed_oid is not None and here.proposed_oid == proposed.oid
        if proposed.is_pending and here.current is not None and entry.reason is None:
            same = replace(entry, reason=here.current.reason) == here.current
            entry = here.current if same else entry
        gone = ((proposed.path, here.proposed_oid),) if is_here and here.proposed_oid is not None else ()
        # Without a usable entry, the proposal is compared with itself: only the status changes.
        before = here.current if here.current is not None else proposed.entry if is_here else None
        said = brought(snapshot, source, entry)
        proposal = replace(_warned(proposal_of(entry, before, here.oid, replaced=gone)), brought=said)
        items[entry.path] = replace(proposal, approves=proposed.oid) if proposed.is_pending else proposal
    return checked(snapshot, [*items.values()], "Approve")


def _retired_from(snapshot: Snapshot, stored: StoredEntry, start: date, reason: str | None) -> Proposal:
    """Retire an entry for the days from one on; only a statement says so, and its file stays."""
    if not snapshot.is_stated:
        raise RegistryError(f"nothing was written: only statements retire from a day on; {UNPROVEN}")
    if not stored.entry.is_usable:
        raise RegistryError(f"{stored.id} is {stored.entry.status.value} already")
    before = (snapshot.committed if stored.base is not None else snapshot.read)(stored.path)
    last = until(stored.entry, start)
    return Proposal(
        entry=replace(stored.entry, reason=reason),
        path=stored.path,
        data=before,
        current=stored.entry,
        base=stored.base,
        changes=differences(stored.entry, last),
        start=start,
    )


def _withdrawn(stored: StoredEntry, reason: str | None) -> Proposal:
    """Remove a rejected proposal; it remains in the history."""
    entry = replace(stored.entry, status=Status.RETIRED, reason=reason)
    return Proposal(
        entry=entry,
        path=stored.path,
        data=None,
        current=stored.entry,
        base=stored.base,
        changes=differences(stored.entry, entry),
    )


def _current(snapshot: Snapshot, key: str) -> StoredEntry:
    _refuse_revision(key)
    return snapshot.get(key)


def _refuse_revision(key: str) -> None:
    if "@" in key:
        raise RegistryError(f"{key}: a past revision cannot be changed; name the entry without @REV")


def _with_status(entry: Entry, status: Status, reason: str | None) -> Entry:
    if entry.status is status and reason is None:
        return entry
    return replace(entry, status=status, reason=reason)


def _changed(stored: StoredEntry, entry: Entry) -> Proposal:
    return _warned(proposal_of(entry, stored.entry, stored.base, path=stored.path))


def _warned(one: Proposal) -> Proposal:
    return one if one.changes else replace(one, warnings=(f"it is already {one.entry.status.value}",))


def _succeeding(successor: StoredEntry, retired: Sequence[StoredEntry]) -> Proposal:
    if len(retired) != 1:
        raise RegistryError(
            f"an entry supersedes one other entry, found {len(retired)} to retire; retire them one by one"
        )
    [old] = retired
    if successor.path == old.path:
        raise RegistryError(f"{old.id}: an entry does not supersede itself")
    if successor.entry.supersedes not in {None, old.id}:
        raise RegistryError(
            f"{successor.id} supersedes {successor.entry.supersedes} already; correct its file first with "
            "'calibrary registry add FILE'"
        )
    return _changed(successor, replace(successor.entry, supersedes=old.id))


def save(
    registry: Registry,
    proposals: Proposals,
    terms: Terms = FREELY,
    *,
    note: Note | None = None,
    author: Person | None = None,
) -> Written:
    """Write proposals as one commit.

    Args:
        registry: the registry.
        proposals: proposals that were shown.
        terms: why, for the history, and the target branch, if it is not the one that is checked out.
        note: complete content of the commit message, instead of one derived from the entries.
        author: author of the commit; by default git's user.

    Raises:
        FileConflictError: an entry was changed since it was proposed; nothing was written.
        RegistryError: a check failed, there is nothing to write, or the registry cannot be written.
    """
    due = proposals.due
    if (damage := registry.configuration.damage) is not None:
        raise RegistryError(f"nothing was written: {damage}")
    if wrong := [*proposals.errors, *(one.message for one in proposals.problems)]:
        raise RegistryError(f"nothing was written: {wrong[0]}")
    changes = [change for one in due for change in one.file_changes]
    # Connect the history of an entry across its approval.
    moved = [(old, one.path) for one in due for old, _ in one.replaced if one.base is None]
    note = note or note_of(proposals.subject, [one.entry for one in due], terms.reason)
    snapshot = registry.branch(terms.branch)
    acts = [act for one in due if (act := _act(one)) is not None]
    if not snapshot.is_stated:
        if registry.configuration.approvals is not None and any(act.action == "approve" for act in acts):
            raise RegistryError(f"nothing was written: {UNPROVEN}")
        found = Stated()
    else:
        found = stated(snapshot, acts, terms.reason, author=author)
    if found.missing:
        named = next(iter(found.missing)) if len(acts) == 1 else f"{len(acts)} cameras"
        note = replace(note, subject=f"Approve {named}, with others to follow")
        changes = [_as_proposal(snapshot, one) for one in due if one.approves is None and not one.replaced]
    written = write_changes(
        registry.repo,
        [*changes, *found.changes],
        replace(note, moved=moved if changes else ()),
        author=author,
        branch=terms.branch,
        is_checked=True,
    )
    unused = (f"{id_} is not used yet: it has {why}" for id_, why in found.missing.items())
    paths = {path: oid for path, oid in written.paths.items() if not path.startswith(STATEMENTS)}
    return replace(written, paths=paths, warnings=(*written.warnings, *found.warnings, *unused))


def _as_proposal(snapshot: Snapshot, one: Proposal) -> Change:
    """Return the file of an entry that waits for more approvals."""
    path = proposal_path(one.path)
    draft = replace(one.entry, status=Status.DRAFT, reason=None)
    return Change(path=path, data=entry_yaml(draft, one.formers), base=snapshot.proposed.get(path))


ACTIONS: Final[Mapping[Status, Action]] = {Status.APPROVED: "approve", Status.RETIRED: "retire"}


def _act(one: Proposal) -> Act | None:
    """Return what a person states of an entry by writing it; None if that is nothing."""
    if one.data is None or (one.entry.status is Status.DRAFT and not needs_no_approval(one)):
        return None
    action: Action = "retire" if one.start is not None else ACTIONS.get(one.entry.status, "label")
    if needs_no_approval(one):
        action = "label"
    return Act(
        action=action,
        entry=one.entry,
        start=one.start,
        brought=one.brought,
    )
