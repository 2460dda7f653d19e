"""Changes of entries: proposed with the findings that prevent writing, then written as one commit."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import date, timedelta
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Final

from msgspec import Struct

from calibrary.arguments import Terms
from calibrary.calibration import Provenance
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import match_key
from calibrary.provenance import HOW_MADE
from calibrary.records import Record, replace
from calibrary.registry.entry import VERDICT_BLOCK, Entry, Status, Validity, digest
from calibrary.registry.entry_checks import Judge, check, in_order
from calibrary.registry.entry_yaml import entry_yaml, lost_comments, parsed
from calibrary.registry.fields import FieldChange, differences
from calibrary.registry.git.history import SOURCE_FILE, SOURCE_SHA256
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository, is_due, maintain
from calibrary.registry.git.writing import ANY, FileChange, Person, Written, compose, write
from calibrary.registry.paths import (
    EVENTS,
    ROOT,
    SUFFIX,
    file_path,
    folder_of,
    is_proposal,
    model_folder,
    proposed_name,
)
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot, StoredEntry
from calibrary.registry.statements import content_of
from calibrary.registry.stating import Change, brought, stated
from calibrary.validation import Finding, Severity


def message_of(
    subject: str,
    entries: Sequence[Entry] = (),
    reason: str | None = None,
    sources: Mapping[str, str | None] = MappingProxyType({}),
) -> str:
    """Return the commit message of a change of entries, with trailers for programs.

    Args:
        subject: one line for people.
        entries: changed entries.
        reason: reason for the change.
        sources: names of further files that the numbers came from, by their SHA-256.
    """
    calibrations = [entry.calibration for entry in entries]
    made = [calibration.provenance for calibration in calibrations]
    trailers = [("Camera", entry.id) for entry in entries]
    for name, said in (
        ("Firmware", {one.firmware or "" for one in made}),
        ("Grade", {one.grade.value for one in calibrations}),
    ):
        trailers += [(name, one) for one in said] if len(said) == 1 else []
    own = {one.sha256: one.source for one in made if one.sha256 is not None}
    for sha256, source in {**sources, **own}.items():
        trailers += [(SOURCE_FILE, source or ""), (SOURCE_SHA256, sha256)]
    return compose(subject, trailers=[*trailers, ("Reason", reason or "")])


def write_changes(
    repo: Repository,
    changes: Sequence[FileChange],
    message: str,
    *,
    author: Person | None = None,
    branch: str | None = None,
    is_checked: bool = False,
) -> Written:
    """Write several files as one commit, all or none.

    Args:
        repo: repository of the registry.
        changes: changes of its files; a change of an entry states the content it started from.
        message: commit message.
        author: author, if not the committer.
        branch: target branch; by default the one that is checked out.
        is_checked: whether each entry's content has already been read back.

    Raises:
        FileConflictError: an entry was changed since; nothing was written, all conflicts are reported.
        RegistryError: the content of an entry cannot be read or belongs to another path, or git cannot write it.
    """
    for change in changes:
        if change.path.startswith(ROOT):
            if change.base is ANY:
                raise RegistryError(
                    f"{change.path}: an entry is written only against its base; name the base"
                )
            if change.data is not None and not is_checked:
                _require_entry(change.path, change.data)
    written = write(repo, changes, message, author=author, branch=branch)
    if is_due(repo):
        # The commit is complete even if packing fails.
        with suppress(RegistryError):
            maintain(repo, in_background=True)
    return written


def _require_entry(path: str, data: bytes) -> None:
    entry = parsed(data, path)
    if entry.path != path:
        raise RegistryError(f"{path}: its camera belongs at {entry.path}")


SHORT_DIGEST: Final = re.compile("[0-9a-f]{8,40}")


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
    """Changes that are proposed together, with the findings of the check.

    Attributes:
        items: all of them, also those by which nothing changes.
        findings: findings of the check on everything to be written.
        title: subject of the commit, instead of one from the changes.
        sources: what became of each source, if there were several: files of a folder, cameras of the catalogue.
        problems: rows of a table that cannot be taken; nothing is written if there are any.
        remarks: parts of a table that were not taken, with the reason.
    """

    items: tuple[Change, ...]
    findings: tuple[Finding, ...] = ()
    title: str | None = None
    sources: tuple[AddedSource, ...] = ()
    problems: tuple[RowProblem, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def due(self) -> tuple[Change, ...]:
        """Those by which anything changes."""
        return tuple(one for one in self.items if one.fields)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that prevent writing."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    def subject(self, missing: Mapping[str, str]) -> str:
        """Return the subject of the commit, given what entries lack to be used."""
        if self.title is not None:
            return self.title
        # An entry that only states its successor is not the subject of the commit.
        about = [one for one in self.due if one.action == self.due[0].action] or [*self.due]
        named = about[0].id if len(about) == 1 else f"{len(about)} cameras"
        if missing:
            return f"Approve {named}, with others to follow"
        return f"{SUBJECTS[about[0].action]} {named}"


SUBJECTS: Final = {
    "add": "Add",
    "approve": "Approve",
    "retire": "Retire",
    "withdraw": "Withdraw",
    "set": "Set",
}
"""First words of the commits of changes, by their actions."""


class ChangedEntry(Record):
    """A changed entry.

    Attributes:
        id: longest KEY of the entry.
        path: path of its file.
        digest: git's id of the file, which an approval refers to; None if nothing is written.
        status: new status.
        status_before: status before; None for a new one, or one that could not be read.
        is_new: whether this camera had no entry.
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
                id=one.id,
                path=one.path,
                digest=one.digest,
                status=one.after.status,
                status_before=one.before.status if one.before is not None else None,
                is_new=one.is_new,
                changes=one.fields,
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
        digests: git's ids of the contents that were looked at, or their beginnings; none if nobody asks.

    Raises:
        RegistryError: a change matches no digest, or a digest matches no change.
    """
    left = {require_digest(text) for text in digests}
    for one in proposals.due if left else ():
        if one.seen is None:
            continue
        of_it = {text for text in left if one.seen.startswith(text)}
        if not of_it:
            raise RegistryError(
                f"{one.id}: nothing was written: what is there now has the digest {one.seen[:12]}; look at it "
                f"('calibrary registry show {one.id}') and decide on that one"
            )
        left -= of_it
    if left:
        raise RegistryError(f"nothing was written: {min(left)} is the digest of none of these")


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
        formers = (written,) if written is not None else ()
        items.append(replace(_added(snapshot, entry, terms, edited=edited), formers=formers))
    return checked(snapshot, items)


def _added(snapshot: Snapshot, entry: Entry, terms: Terms, *, edited: bool) -> Change:
    """Return the change by which an entry gets a new content."""
    path, warnings = entry.path, list[str]()
    current, proposed = (_known(snapshot, name, warnings) for name in (path, proposed_name(path)))
    for known in (proposed, current):
        if known is not None:
            entry = _with_current(entry, known, edited=edited)
    entry = replace(entry, label=entry.label or snapshot.label_of(entry.unit))
    is_free = not snapshot.book.rules.approvals.count
    is_retired = current is not None and not current.is_usable
    is_approved = terms.approve or (is_free and is_retired)
    status = Status.APPROVED if is_approved or is_free else Status.DRAFT
    after, base = (
        replace(entry, status=status, reason=terms.reason if is_approved else None),
        _base(snapshot, path),
    )
    for known in (current, proposed):
        same = known is not None and not differences(known.as_draft, entry.as_draft)
        if known is not None and same and (known.is_usable or (known is proposed and not is_approved)):
            return Change(
                action="add", before=known, after=known, base=base, fields=(), warnings=tuple(warnings)
            )
    if current is not None and current.is_usable and not (is_approved or is_free):
        warnings.append(f"what is {current.status.value} now stays in use until this is approved")
    if proposed is not None and differences(proposed.as_draft, entry.as_draft):
        warnings.append("it takes the place of an earlier proposal")
    before = current if current is not None else proposed
    return Change(
        action="approve" if is_approved else "add",
        before=before,
        after=after,
        why=terms.reason,
        data=entry_yaml(after),
        base=base,
        fields=differences(before, after),
        warnings=tuple(warnings),
    )


def _known(snapshot: Snapshot, name: str, warnings: list[str]) -> Entry | None:
    """Return an entry that there is; if it cannot be read, None, with a warning."""
    try:
        stored = snapshot.at(name)
    except RegistryError as error:
        warnings.append(f"the current entry cannot be read and is replaced: {error}")
        return None
    return stored.entry if stored is not None else None


def _base(snapshot: Snapshot, path: str) -> str | None:
    return snapshot.cameras.get(path)


def checked(snapshot: Snapshot, items: Sequence[Change], *, only_new: bool = False) -> Proposals:
    """Add to changes the findings of :func:`calibrary.registry.entry_checks.check` on everything to be written.

    Only entries that they can affect are read: those of their models and aliases, and those they supersede. Earlier
    errors of other entries are left to ``calibrary registry check``; with ``only_new``, earlier errors of these
    entries as well: an error in K does not prevent setting a label.
    """
    items = [_as_people_wrote(snapshot, one) for one in items]
    due = [one for one in items if one.fields]
    if not due:
        return Proposals(items=tuple(items))
    before = _beside(snapshot, due)
    after = {**_left(before, due), **{_name(one): one.after for one in due if one.action != "withdraw"}}
    last_approved = {one.path: one.before for one in due if one.before is not None and one.before.is_usable}
    known, own = set(check(before, snapshot.policy)), {one.path for one in due}
    findings = tuple(
        finding
        for finding in check(after, snapshot.policy, last_approved)
        if finding not in known or (finding.place in own and not only_new)
    )
    return Proposals(items=tuple(items), findings=findings)


def _name(one: Change) -> str:
    """Return the name of the entry that a change makes."""
    return proposed_name(one.path) if one.after.status is Status.DRAFT else one.path


def _beside(snapshot: Snapshot, due: Sequence[Change]) -> dict[str, Entry]:
    """Return the entries that changes can affect, by name, with those that they change."""
    concerned = {*_concerned(snapshot.cameras, [one.after for one in due]), *_called_alike(snapshot, due)}
    concerned |= {one.path for one in due} & snapshot.cameras.keys()
    standings = snapshot.standings(sorted(concerned))
    names = [path for path, one in standings.items() if one.is_used]
    names += [proposed_name(path) for path, one in standings.items() if one.is_proposed]
    return {name: one for name, one in snapshot.parsed(names) if isinstance(one, Entry)}


def _left(before: Mapping[str, Entry], due: Sequence[Change]) -> dict[str, Entry]:
    """Return the entries that stay as they are, but for those in force: what is proposed gives way."""
    gone = {proposed_name(one.path) for one in due if one.action != "retire"}
    return {name: one for name, one in before.items() if name not in gone}


def _as_people_wrote(snapshot: Snapshot, one: Change) -> Change:
    """Return a change with the comments and the order of fields of the files that its own takes the place of."""
    if one.data is None or one.action == "withdraw" or snapshot.repo is None:
        return one
    found = []
    for oid in (one.seen, one.base):
        # What cannot be read has no comments either.
        with suppress(RegistryError):
            found += [snapshot.repo.blob(oid)] if oid is not None else []
    formers = tuple(dict.fromkeys((*one.formers, *found)))
    data = entry_yaml(one.after, formers)
    lost = lost_comments(data, one.after, formers)
    said = (lost,) if lost is not None else ()
    return replace(one, formers=formers, data=data, warnings=tuple(dict.fromkeys((*one.warnings, *said))))


def judged(snapshot: Snapshot, proposals: Proposals, judge: Judge, override: str | None = None) -> Proposals:
    """Add to changes the findings on each K that is to be written or put to use.

    Args:
        snapshot: that they were proposed for.
        proposals: changes with the findings of :func:`checked`.
        judge: weighs a K, with the entries that are beside it.
        override: reason to accept what contradicts a K, which stays with its entry; None if that is not accepted.
    """
    due = [one for one in proposals.due if one.action in {"add", "approve"}]
    left = _left(_beside(snapshot, due), due) if due else {}
    groups: dict[str, dict[str, Entry]] = {}
    for name, entry in (*left.items(), *((_name(one), one.after) for one in due)):
        groups.setdefault(model_folder(name), {})[name] = entry
    items, found = {one.path: one for one in proposals.items}, []
    for one in due:
        group, after = groups[model_folder(one.path)], one.after
        said = [*judge(_name(one), after, group, one.before, snapshot.policy)]
        if override is not None and any(finding.severity is Severity.ERROR for finding in said):
            after = replace(after, override=override)
            new = replace(one, after=after, data=entry_yaml(after), fields=differences(one.before, after))
            items[one.path] = _as_people_wrote(snapshot, new)
            said = [*judge(_name(one), after, group, one.before, snapshot.policy)]
        found += [replace(finding, place=file_path(finding.place or "")) for finding in said]
    return replace(proposals, items=tuple(items.values()), findings=in_order([*proposals.findings, *found]))


def _called_alike(snapshot: Snapshot, due: Sequence[Change]) -> Iterator[str]:
    """Yield the entries of any camera with the same label as one to be written."""
    labels = {match_key(one.after.label) for one in due if one.after.label is not None}
    if labels:
        labelled = snapshot.labels.items()
        yield from (
            path for path, label in labelled if match_key(label) in labels and path in snapshot.cameras
        )


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
    """Propose to retire entries, and to withdraw what is only proposed; nothing is written.

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
            items.append(_withdrawn(snapshot, one, reason))
        else:
            items.append(_retired(one, start, reason))
    if successor is not None:
        items.append(_succeeding(_current(snapshot, successor), [*stored.values()], reason))
    # What is wrong with a K does not keep it from being retired.
    return checked(snapshot, items, only_new=True)


def _retired(stored: StoredEntry, start: date | None, reason: str) -> Change:
    before = stored.entry
    after = _until(before, start) if start is not None else replace(before, status=Status.RETIRED)
    after = replace(after, reason=reason)
    is_new = before.is_usable
    if start is not None and not is_new:
        raise RegistryError(f"{stored.id} is {before.status.value} already")
    return Change(
        action="retire",
        before=before,
        after=after,
        why=reason,
        base=stored.base,
        seen=stored.oid,
        start=start,
        fields=differences(before, after) if is_new else (),
        warnings=() if is_new else (f"it is already {before.status.value}",),
    )


def _until(entry: Entry, start: date) -> Entry:
    """Return an entry as it is before it is retired from a day on."""
    first, last = (entry.validity.first, entry.validity.last) if entry.validity is not None else (None, None)
    end = start - timedelta(days=1)
    last = min(last, end) if last is not None else end
    if first is not None and last < first:
        return replace(entry, status=Status.RETIRED)
    return replace(entry, validity=Validity(first=first, last=last))


def _withdrawn(snapshot: Snapshot, stored: StoredEntry, reason: str) -> Change:
    """Take a rejected content out of its file, which says again what is in force; it stays in the history."""
    after = replace(stored.entry, status=Status.RETIRED, reason=reason)
    used = snapshot.approved(stored.path)
    return Change(
        action="withdraw",
        before=stored.entry,
        after=after,
        why=reason,
        data=entry_yaml(used) if used is not None else None,
        base=stored.base,
        seen=stored.oid,
        fields=differences(stored.entry, after),
    )


def propose_approvals(
    snapshot: Snapshot, source: Snapshot, keys: Sequence[str], terms: Terms = FREELY
) -> Proposals:
    """Propose to approve what is proposed; nothing is written.

    Args:
        snapshot: state in which the entries become usable.
        source: state with what is proposed.
        keys: keys of the entries, without a revision.
        terms: why, the days on which an approved entry may be used instead of those it states, and whether a
            contradiction to known facts about its camera is overridden.

    Raises:
        UnknownCameraError: an entry does not exist.
        RegistryError: a key is ambiguous or contains a revision.
    """
    items: dict[str, Change] = {}
    validity = Validity.between(terms.valid_from, terms.valid_until)
    for key in keys:
        _refuse_revision(key)
        proposed = source.filed(key)
        used = proposed if not proposed.is_pending else _in_use_as(snapshot, proposed)
        if used is None or validity is not None:
            items[proposed.path] = _approved(snapshot, source, proposed, validity, terms)
        else:
            entry, said = used.entry, (f"it is already {used.entry.status.value}",)
            items[proposed.path] = Change(
                action="approve", before=entry, after=entry, base=used.base, fields=(), warnings=said
            )
    return checked(snapshot, [*items.values()])


def _in_use_as(snapshot: Snapshot, proposed: StoredEntry) -> StoredEntry | None:
    """Return the entry that is in force if that is what is proposed, as on a branch that was approved already."""
    with suppress(RegistryError):
        now = snapshot.approved(proposed.path)
        if now is not None and content_of(now) == content_of(proposed.entry):
            return snapshot.at(proposed.path)
    return None


def _approved(
    snapshot: Snapshot, source: Snapshot, proposed: StoredEntry, validity: Validity | None, terms: Terms
) -> Change:
    warnings = list[str]()
    current, file = _known(snapshot, proposed.path, warnings), snapshot.file(proposed.path)
    after = replace(proposed.entry, status=Status.APPROVED, reason=terms.reason)
    after = replace(after, validity=validity) if validity is not None else after
    if source.commit != snapshot.commit and file is not None:
        # Labels and tags that are here already are kept: the approval does not cover them.
        after = replace(after, label=file.label or after.label, tags=file.tags or after.tags)
    before = current if current is not None else proposed.entry
    is_filed = file is not None and file == after.as_draft
    return Change(
        action="approve",
        before=before,
        after=after,
        why=terms.reason,
        data=None if is_filed else entry_yaml(after),
        base=_base(snapshot, proposed.path),
        seen=proposed.oid,
        fields=differences(before, after),
        warnings=tuple(warnings),
        brought=brought(snapshot, source, after),
    )


def _current(snapshot: Snapshot, key: str) -> StoredEntry:
    if not is_proposal(key):
        _refuse_revision(key)
    return snapshot.get(key)


def _refuse_revision(key: str) -> None:
    if "@" in key:
        raise RegistryError(f"{key}: a past revision cannot be changed; name the entry without @REV")


def _succeeding(successor: StoredEntry, retired: Sequence[StoredEntry], reason: str) -> Change:
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
    before = successor.entry
    after = replace(before, supersedes=old.id)
    return Change(
        action="approve" if before.is_usable else "add",
        before=before,
        after=after,
        why=reason,
        data=entry_yaml(after),
        base=successor.base,
        fields=differences(before, after),
    )


class Saved(Written, frozen=True, kw_only=True):
    """Written changes.

    Attributes:
        missing: what entries that were approved lack to be used, by their id.
    """

    missing: Mapping[str, str] = {}


def save(
    registry: Registry,
    proposals: Proposals,
    terms: Terms = FREELY,
    *,
    message: str | None = None,
    author: Person | None = None,
) -> Saved:
    """Write changes as one commit.

    Args:
        registry: the registry.
        proposals: changes that were shown.
        terms: why, for the history, and the target branch, if it is not the one that is checked out.
        message: message of the commit, instead of one derived from the changes.
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
    found = stated(registry.branch(terms.branch), due, author=author)
    message = message or message_of(
        proposals.subject(found.missing), [one.after for one in due], terms.reason
    )
    written = write_changes(
        registry.repo,
        [*(file for one in due for file in one.files), *found.changes],
        message,
        author=author,
        branch=terms.branch,
        is_checked=True,
    )
    unused = (f"{id_} is not used yet: it has {why}" for id_, why in found.missing.items())
    return Saved(
        commit=written.commit,
        parent=written.parent,
        paths={path: oid for path, oid in written.paths.items() if not path.startswith(EVENTS)},
        warnings=(*written.warnings, *found.warnings, *unused),
        missing=found.missing,
    )
