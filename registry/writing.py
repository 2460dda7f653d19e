"""Changes of a registry's files as commits, each checked before it is written and described by a note."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import MOVED_FROM
from calibrary.registry.git.repository import Repository, is_due, maintain
from calibrary.registry.git.writing import ANY, Change, Person, Written, compose, write
from calibrary.registry.paths import PROPOSED, ROOT, in_use_path

__all__ = ["SOURCE_FILE", "SOURCE_SHA256", "Note", "note_of", "parsed", "write_changes"]

SOURCE_FILE: Final = "Source-File"
SOURCE_SHA256: Final = "Source-Sha256"


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
    written = write(repo, changes, note.message, author=author, branch=branch)
    if is_due(repo):
        # The commit is complete even if packing fails.
        with suppress(RegistryError):
            maintain(repo, in_background=True)
    return written


def parsed(data: bytes, path: str, *, require_digest: bool = True) -> Entry:
    """Return the entry in a registry's file.

    Raises:
        RegistryError: the file cannot be read; the message states where and why.
    """
    try:
        return parse_entry(data, path, require_digest=require_digest)
    except InputError as error:
        raise RegistryError(str(error)) from None


def _require_entry(path: str, data: bytes) -> None:
    entry = parsed(data, path)
    if entry.path != in_use_path(path):
        raise RegistryError(f"{path}: its camera belongs at {entry.path}")
