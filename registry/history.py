"""The history of an entry: its revisions, the last change of each field, and the origin of its calibration."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from itertools import pairwise
from typing import Any, Final, Literal

from msgspec import Struct, field

from calibrary.calibration import Grade
from calibrary.errors import InputError, RegistryError, UnknownCameraError
from calibrary.interop.notebook import html_table
from calibrary.records import Record
from calibrary.registry.contents import Contents
from calibrary.registry.entry import PARAMETERS, Entry, digest
from calibrary.registry.entry_yaml import parse_entry, without_status
from calibrary.registry.fields import FieldChange, entry_rows
from calibrary.registry.git import history as git_history
from calibrary.registry.git.history import SOURCE_FILE, SOURCE_SHA256, Revision
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import EVENTS, ROOT, SUFFIX, file_path
from calibrary.registry.snapshot import ListedEntry, Snapshot, StoredEntry
from calibrary.registry.statements import action_in, subject_of

DIGEST: Final = re.compile(rb"^digest: (\S+)", re.MULTILINE)


class EntryRevision(Struct, frozen=True, kw_only=True):
    """A commit that changed an entry's file, or states something of it.

    Attributes:
        revision: the commit.
        entry: what the file says after it; None if it was removed or cannot be read, or the commit changed several.
        before: what the file said before it.
    """

    revision: Revision
    entry: Entry | None = None
    before: Entry | None = None

    @property
    def reason(self) -> str | None:
        """Reason stated in the commit."""
        return next((value for key, value in self.revision.trailers if key == "Reason"), None)

    @property
    def actions(self) -> tuple[str, ...]:
        """What the statements of the commit do with the entry."""
        return tuple(
            sorted({action for path in self.revision.beside if (action := action_in(path)) is not None})
        )

    @property
    def cameras(self) -> tuple[str, ...]:
        """Cameras named in the commit."""
        return tuple(value for key, value in self.revision.trailers if key == "Camera")

    @property
    def firmware(self) -> str | None:
        """Firmware with which the calibration was made, else the range of the entry."""
        return self.entry.made_for if self.entry is not None else None

    @property
    def delta(self) -> dict[str, float] | None:
        """Change of each parameter of K; None if there is nothing to compare with."""
        if self.entry is None or self.before is None:
            return None
        one, other = self.before.calibration.intrinsics, self.entry.calibration.intrinsics
        if one.image_size != other.image_size:
            return None
        return {name: float(getattr(other, name) - getattr(one, name)) for name in PARAMETERS}


class Recorded(Record):
    """Who added a calibration to the registry, and when.

    Attributes:
        by: author of the commit.
        date: date of the commit.
        commit: 40 hexadecimal digits.
        file: name of the file that the calibration was read from; None if the commit does not state it.
    """

    by: str
    date: datetime
    commit: ObjectId
    file: str | None


class Approval(Record):
    """Approval of an entry by one person.

    Attributes:
        by: who approved.
        email: address of this person.
        date: date of the statement.
        commit: oldest commit with the statement that says so; None if this clone lacks it.
        reason: reason stated in the statement.
    """

    by: str
    email: str
    date: datetime
    commit: ObjectId | None
    reason: str | None = None


def history(
    snapshot: Snapshot, key: str | None = None, *, most: int | None = None
) -> tuple[EntryRevision, ...]:
    """Return all revisions of an entry, or of the whole registry, newest first.

    Args:
        snapshot: state of a registry in git.
        key: key of an entry; the full id for one that was removed. None for the whole registry.
        most: largest number of revisions.

    Raises:
        UnknownCameraError: the entry does not exist and never did.
        RegistryError: the registry is a plain folder.
    """
    repo, commit = snapshot.require_git("has no history")
    if key is None:
        return tuple(
            EntryRevision(revision=one) for one in git_history.history(repo, None, commit, most=most)
        )
    return of_path(repo, commit, _path(snapshot, key), most=most)


def of_path(
    repo: Repository,
    at: str,
    path: str,
    *,
    most: int | None = None,
    revisions: Sequence[Revision] | None = None,
) -> tuple[EntryRevision, ...]:
    """Return all revisions of the entry at a path up to a commit, newest first.

    Args:
        repo: repository of the registry.
        at: the commit.
        path: path of the entry.
        most: largest number of revisions.
        revisions: revisions of the file, if already known.
    """
    if revisions is None:
        # One more than requested, since the oldest is compared with its predecessor.
        beside = f"{EVENTS}{subject_of(path)}"
        revisions = git_history.history(
            repo, path, at, most=most + 1 if most is not None else None, beside=beside
        )
    entries = _entries(repo, at, revisions)
    found = zip(revisions, pairwise([*entries, None]), strict=True)
    return tuple(EntryRevision(revision=one, entry=entry, before=before) for one, (entry, before) in found)[
        :most
    ]


def recorded(repo: Repository, stored: StoredEntry) -> Recorded | None:
    """Return who added an entry's calibration: the oldest commit since which its digest is unchanged.

    Raises:
        RegistryError: the history cannot be read.
    """
    found = origin(repo, stored)
    if found is None:
        return None
    return Recorded(
        by=found.author.name,
        date=found.authored,
        commit=found.commit,
        file=_source_file(found, stored.entry.calibration.provenance.sha256),
    )


def approvals_of(repo: Repository, stored: StoredEntry) -> tuple[Approval, ...]:
    """Return the approvals of an entry that is in use.

    Raises:
        RegistryError: the history cannot be read.
    """
    standing, at = stored.standing, stored.commit
    found = []
    for one in standing.approvals if standing is not None and at is not None else ():
        revisions = git_history.history(repo, one.path, at or "")
        commit = revisions[-1].commit if revisions else None
        made = datetime.fromisoformat(one.made)
        found.append(
            Approval(
                by=one.by,
                email=one.email,
                date=made,
                commit=commit if commit not in repo.shallow_commits else None,
                reason=one.reason,
            )
        )
    return tuple(found)


def origin(repo: Repository, stored: StoredEntry) -> Revision | None:
    """Return the commit that added an entry's numbers; None in a plain folder, or if a shallow clone lacks it.

    Raises:
        RegistryError: the history cannot be read.
    """
    if stored.commit is None:
        return None
    numbers = digest(stored.entry.calibration, stored.entry.sensor, stored.entry.rig).encode()
    found = None
    for revision in git_history.history(repo, stored.path, stored.commit):
        data = next(repo.readable([revision.oid])) if revision.oid is not None else b""
        line = DIGEST.search(data)
        is_same = line is not None and line[1].strip(b'"') == numbers
        if found is not None and not is_same:
            break
        # The file may say something newer, which is proposed.
        found = revision if is_same else None
    return None if found is None or found.commit in repo.shallow_commits else found


def _path(snapshot: Snapshot, key: str) -> str:
    try:
        return file_path(snapshot.find(key))
    except UnknownCameraError:
        repo, commit = snapshot.require_git("has no history")
        gone = f"{ROOT}{key.strip('/')}{SUFFIX}"
        if git_history.history(repo, gone, commit, most=1):
            return gone
        raise


def _entries(repo: Repository, at: str, revisions: Sequence[Revision]) -> list[Entry | None]:
    """Return the entry after each commit; None if it was removed, or is not readable."""
    there = {one.oid: one.path for one in revisions if one.oid is not None}
    contents = zip(there.items(), repo.readable([*there]), strict=True)
    parsed = Contents(repo, at).parsed((oid, path, data) for (oid, path), data in contents)
    entries = {oid: entry for oid, (_, entry) in zip(there, parsed, strict=True) if isinstance(entry, Entry)}
    for oid in there.keys() - entries.keys():
        # It may be of the former layout.
        with suppress(InputError, RegistryError):
            entries[oid] = parse_entry(without_status(repo.blob(oid)), there[oid])
    return [entries.get(one.oid) if one.oid is not None else None for one in revisions]


def _source_file(revision: Revision, sha256: str | None) -> str | None:
    """Return the name of a source by its SHA-256 from the commit's trailers; without one, that of the only source."""
    names: dict[str, str | None] = {}
    name = None
    for key, value in revision.trailers:
        if key == SOURCE_FILE:
            name = value
        elif key == SOURCE_SHA256:
            names[value], name = name, None
    return names.get(sha256) if sha256 is not None else None


def story(put: Recorded | None, approved: Sequence[Approval]) -> list[tuple[str, str]]:
    """Rows of who added a calibration to the registry, who need not have made it, and of who approved it."""
    rows = []
    if put is not None:
        from_file = f", from {put.file}" if put.file is not None else ""
        rows.append(("recorded", f"{put.date:%Y-%m-%d} by {put.by}{from_file}, commit {put.commit[:12]}"))
    for one in approved:
        at = f", commit {one.commit[:12]}" if one.commit else ""
        rows.append(("approved", f"{one.date:%Y-%m-%d} by {one.by}{at}"))
    return rows


class ShownEntry(ListedEntry, tag_field="schema", tag="calibrary/registry-show-1"):
    """Output of ``calibrary registry show --json``.

    Attributes:
        recorded: who added this calibration to the registry, from the commit.
        approved: who approved it, and since which commits; empty if it is not usable, and in older registries.
        against: KEY@REV it is compared with, with --diff.
        changes: fields that differ from that state.
        use: what a solver may do with it: keep it fixed, start from it, or none.
        use_reason: why.
        stored: the entry as an object.
    """

    recorded: Recorded | None
    approved: tuple[Approval, ...] = ()
    against: str | None = None
    changes: tuple[FieldChange, ...] | None = None
    use: Literal["fixed", "start", "none"] | None = None
    use_reason: str | None = None
    stored: StoredEntry | None = None
    _unwritten = frozenset({"stored"})

    def rows(self) -> list[tuple[str, str]]:
        """Return every field as (name, value), numbers with ten digits and their uncertainty."""
        if self.stored is None:
            return []
        more = [
            ("use", f"{self.use}: {self.use_reason}" if self.use is not None else ""),
            ("file", self.path),
            ("digest of the file", (self.blob or "")[:12]),
            ("commit", (self.commit or "")[:12]),
            ("proposed", f"another K waits for approval: {self.proposal}" if self.proposal else ""),
            *story(self.recorded, self.approved),
        ]
        return [
            *entry_rows(self.stored.entry, "{:.10g}".format),
            *((name, text) for name, text in more if text),
        ]

    def _repr_html_(self) -> str:
        """Return every field as HTML, for notebooks."""
        return html_table(self.id, self.rows())


class LoggedCommit(Record):
    """A commit in the history.

    Attributes:
        commit: 40 hexadecimal digits.
        date: author's date.
        author, subject: as in git.
        reason: reason stated in the commit.
    """

    commit: ObjectId
    date: datetime
    author: str
    subject: str
    reason: str | None


class LoggedK(Record):
    """Intrinsics of a revision, or their change, in px."""

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float


class LoggedRevision(LoggedCommit):
    """A commit that changed an entry, or of the whole registry.

    Attributes:
        cameras: cameras named in the commit.
        path: path of the entry; None for a commit of the whole registry.
        actions: what the statements of the commit do with the entry.
        grade: grade of the entry; None if it was removed or cannot be read.
        firmware: firmware with which the calibration was made, else the range of the entry.
        K: intrinsics; None if the entry was removed or cannot be read.
        delta: difference from the previous revision; None if there is none to compare with.
        removed: whether the commit removed the entry.
    """

    cameras: tuple[str, ...]
    path: str | None
    actions: tuple[str, ...]
    grade: Grade | None
    firmware: str | None
    K: LoggedK | None
    delta: LoggedK | None = field(name="delta_K")
    removed: bool = False


class LogReport(Record, tag_field="schema", tag="calibrary/registry-log-1"):
    """Output of ``calibrary registry log --json``.

    Attributes:
        key: key of the query; None for the whole registry.
        revisions: revisions, newest first.
    """

    key: str | None
    revisions: tuple[LoggedRevision, ...]


def log_report(revisions: Sequence[EntryRevision], key: str | None) -> LogReport:
    """Return the output of ``registry log --json``."""
    return LogReport(key=key, revisions=tuple(map(_logged, revisions)))


def _logged(one: EntryRevision) -> LoggedRevision:
    entry, delta = one.entry, one.delta
    K = entry.calibration.intrinsics if entry is not None else None
    return LoggedRevision(
        **_commit(one),
        cameras=one.cameras,
        path=one.revision.path or None,
        actions=one.actions,
        grade=entry.calibration.grade if entry is not None else None,
        firmware=one.firmware,
        K=LoggedK(**{name: float(getattr(K, name)) for name in PARAMETERS}) if K is not None else None,
        delta=LoggedK(**delta) if delta is not None else None,
        removed=bool(one.revision.path) and one.revision.oid is None,
    )


def _commit(one: EntryRevision) -> dict[str, Any]:
    """Return the members of a :class:`LoggedCommit`."""
    revision = one.revision
    return {
        "commit": revision.commit,
        "date": revision.authored,
        "author": revision.author.name,
        "subject": revision.subject,
        "reason": one.reason,
    }
