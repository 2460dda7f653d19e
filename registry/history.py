"""The history of an entry: its revisions, the commit that each field is from, and who recorded its calibration."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from typing import Final

from msgspec import Struct

from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.records import Record
from calibrary.registry.entry import Entry
from calibrary.registry.entry_form import PARAMETERS
from calibrary.registry.fields import Field, entry_fields
from calibrary.registry.git import history as git_history
from calibrary.registry.git.history import Revision
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository
from calibrary.registry.index import index_at
from calibrary.registry.paths import ROOT, SUFFIX, proposal_path
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry
from calibrary.registry.writing import SOURCE_FILE, SOURCE_SHA256

__all__ = [
    "Approval",
    "EntryRevision",
    "FieldOrigin",
    "Recorded",
    "blame",
    "history",
    "of_path",
    "origin",
    "recorded",
]

DIGEST: Final = re.compile(rb"^digest: (.+?)\s*$", re.MULTILINE)


class EntryRevision(Struct, frozen=True, kw_only=True):
    """One commit that changed an entry.

    Attributes:
        revision: by whom and when.
        entry: as it left the entry; None where it removed it, wrote none that can be read, or is of several.
        before: as the entry was before it.
    """

    revision: Revision
    entry: Entry | None = None
    before: Entry | None = None

    @property
    def reason(self) -> str | None:
        """Why, as the commit says."""
        return next((value for key, value in self.revision.trailers if key == "Reason"), None)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Whose entries the commit names."""
        return tuple(value for key, value in self.revision.trailers if key == "Camera")

    @property
    def firmware(self) -> str | None:
        """Of the camera when the calibration was made, else of the range that the entry is of."""
        if self.entry is None:
            return None
        ranged = self.entry.firmware
        return self.entry.calibration.provenance.firmware or (str(ranged) if ranged is not None else None)

    @property
    def delta(self) -> dict[str, float] | None:
        """How much each number of K is more than before; None where there is nothing to compare with."""
        if self.entry is None or self.before is None:
            return None
        one, other = self.before.calibration.intrinsics, self.entry.calibration.intrinsics
        if one.image_size != other.image_size:
            return None
        return {name: float(getattr(other, name) - getattr(one, name)) for name in PARAMETERS}


class FieldOrigin(Struct, frozen=True, kw_only=True):
    """One field of an entry and the commit that last changed it."""

    field: str
    value: Field
    since: EntryRevision


class Recorded(Record):
    """Who put a calibration into the registry, and when.

    Attributes:
        by: the commit's author.
        date: of the commit.
        commit: 40 hexadecimal digits.
        file: name of the file that the calibration was read from; None where the commit does not say it.
    """

    by: str
    date: datetime
    commit: ObjectId
    file: str | None


class Approval(Record):
    """One person's approval of an entry.

    Attributes:
        by: the commit's author.
        email: of the author.
        date: of the commit.
        commit: 40 hexadecimal digits.
        reason: why, as the commit states it.
    """

    by: str
    email: str
    date: datetime
    commit: ObjectId
    reason: str | None = None


def history(
    snapshot: Snapshot, key: str | None = None, *, most: int | None = None
) -> tuple[EntryRevision, ...]:
    """Every revision of an entry, or of the whole registry, newest first.

    Args:
        snapshot: of a registry in git.
        key: of an entry; one that was removed by its whole id. None is the registry.
        most: at most this many.

    Raises:
        UnknownCameraError: there is no such entry and never was.
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
    """Every revision of the entry at a path up to a commit, newest first.

    Args:
        repo: the registry's.
        at: the commit.
        path: of the entry.
        most: at most this many.
        revisions: the revisions of the file, where they are known.
    """
    if revisions is None:
        # One more than asked for, since the oldest of them is compared with the one before it.
        revisions = git_history.history(repo, path, at, most=most + 1 if most is not None else None)
    entries = _entries(repo, at, revisions)
    found = zip(revisions, pairwise([*entries, None]), strict=True)
    return tuple(EntryRevision(revision=one, entry=entry, before=before) for one, (entry, before) in found)[
        :most
    ]


def blame(snapshot: Snapshot, key: str) -> tuple[FieldOrigin, ...]:
    """Each field of an entry as it is, with the commit that last changed it.

    Raises:
        UnknownCameraError: there is no such entry.
        RegistryError: it cannot be read.
    """
    if "@" in key:
        raise RegistryError(f"{key}: only the current entry can be examined; name it without @REV")
    stored = snapshot.get(key)
    revisions = history(snapshot, stored.id)
    # Each revision's fields are asked for once, and not once for every field.
    fields_of = [entry_fields(one.entry) if one.entry is not None else None for one in revisions]
    return tuple(
        FieldOrigin(field=name, value=value, since=revisions[_unchanged_for(fields_of, name, value)])
        for name, value in entry_fields(stored.entry).items()
    )


def recorded(repo: Repository, stored: StoredEntry) -> Recorded | None:
    """Who put an entry's calibration into the registry: the oldest commit since which its digest is the same.

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


def origin(repo: Repository, stored: StoredEntry) -> Revision | None:
    """The commit that brought an entry's numbers; None in a plain folder, and where a shallow clone lacks it.

    Raises:
        RegistryError: the history cannot be read.
    """
    if stored.commit is None:
        return None
    found, digest = _oldest_like(repo, stored.path, stored.commit, None)
    if found is None or found.commit in repo.cut:
        return None
    beside = proposal_path(found.path)
    if beside != found.path and found.parents and repo.read(found.parents[0], beside) is not None:
        # It was approved there; the proposal's own history names who proposed it.
        earlier, _ = _oldest_like(repo, beside, found.parents[0], digest)
        return earlier or found
    return found


def _oldest_like(
    repo: Repository, path: str, at: str, digest: bytes | None
) -> tuple[Revision | None, bytes | None]:
    """The oldest revision since which a file's digest is the same: the one named, or its newest."""
    found = None
    for revision in git_history.history(repo, path, at):
        line = DIGEST.search(repo.blob(revision.oid)) if revision.oid is not None else None
        if line is None or (digest is not None and line[1] != digest):
            break
        found, digest = revision, line[1]
    return found, digest


def _path(snapshot: Snapshot, key: str) -> str:
    try:
        return snapshot.find(key)
    except UnknownCameraError:
        repo, commit = snapshot.require_git("has no history")
        gone = f"{ROOT}{key.strip('/')}{SUFFIX}"
        if git_history.history(repo, gone, commit, most=1):
            return gone
        raise


def _entries(repo: Repository, at: str, revisions: Sequence[Revision]) -> list[Entry | None]:
    """As each commit left it; None where it removed it, or what it wrote is not an entry."""
    there = {one.oid: one.path for one in revisions if one.oid is not None}
    contents = zip(there.items(), repo.read_many([*there]), strict=True)
    parsed = index_at(repo, at).parsed((oid, path, data) for (oid, path), data in contents)
    entries = {oid: entry for oid, (_, entry) in zip(there, parsed, strict=True) if isinstance(entry, Entry)}
    return [entries.get(one.oid) if one.oid is not None else None for one in revisions]


def _unchanged_for(fields_of: Sequence[dict[str, Field] | None], name: str, value: Field) -> int:
    """Place of the oldest revision, from the newest on without a gap, that has a field's value."""
    oldest = 0
    for at, fields in enumerate(fields_of):
        if fields is None or fields.get(name) != value:
            break
        oldest = at
    return oldest


def _source_file(revision: Revision, sha256: str | None) -> str | None:
    """Name of a source by its sha256, as the commit's trailers pair them; of the only one without a sha256."""
    names: dict[str, str | None] = {}
    name = None
    for key, value in revision.trailers:
        if key == SOURCE_FILE:
            name = value
        elif key == SOURCE_SHA256:
            names[value], name = name, None
    return names.get(sha256) if sha256 is not None else None
