"""A registry as its users hold it: states of files at commits, and changes of them with a reason.

It knows paths and bytes. What an entry must look like is a function that is handed in: every content is shown to
it before anything is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.registry.git import maintenance
from calibrary.registry.git.creating import create
from calibrary.registry.git.fast_import import Person
from calibrary.registry.git.history import MOVED_FROM, ChangedFile, Revision, changed, history
from calibrary.registry.git.messages import compose
from calibrary.registry.git.objects import Blob
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.revisions import commit_at, parse_rev
from calibrary.registry.git.writing import ANY, Change, Written, write
from calibrary.registry.layout import CAMERAS, check_path

__all__ = ["ATTRIBUTES", "Check", "Note", "Registry", "Snapshot"]

Check = Callable[[str, bytes], None]
"""Given a path and its content to be; raises what is wrong with it."""

ATTRIBUTES = b"*.yaml text eol=lf\n*.md text eol=lf\n*.yml text eol=lf\n*.json text eol=lf\n"
"""``.gitattributes``: the bytes of an entry are the same in every checkout, or its digest would not hold."""

KEPT = 4
PATCHED_FROM = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """What the history says of a change.

    Attributes:
        subject: one line for people.
        reason: why.
        cameras: whose entries they are, as keys.
        sources: sha256 of each file that the numbers came from.
    """

    subject: str
    reason: str | None = None
    cameras: Sequence[str] = ()
    firmware: str | None = None
    grade: str | None = None
    sources: Sequence[str] = ()
    moved: Sequence[tuple[str, str]] = ()

    @property
    def message(self) -> str:
        """As a commit message."""
        trailers = [("Camera", camera) for camera in self.cameras]
        trailers += [("Firmware", self.firmware or ""), ("Grade", self.grade or "")]
        trailers += [("Source-Sha256", digest) for digest in self.sources]
        trailers += [("Reason", self.reason or "")]
        trailers += [(MOVED_FROM, f"{old} => {new}") for old, new in self.moved]
        return compose(self.subject, trailers=trailers)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The entries of a registry at a commit.

    Attributes:
        commit: 40 hex digits.
        paths: the id of every file below ``cameras/``, by path.
    """

    commit: str
    paths: Mapping[str, str]


class Registry:
    """A fleet's calibrations in git. Safe to share between threads and to carry over a fork.

    Attributes:
        repo: the repository.
    """

    def __init__(self, repo: Repository, *, check: Check | None = None) -> None:
        self.repo = repo
        self._check = check
        self._snapshots: dict[str, Snapshot] = {}

    @classmethod
    def open(cls, path: Path, *, check: Check | None = None, durable: bool = True) -> Registry:
        """A registry that is there, bare or checked out.

        Raises:
            RegistryError: there is none, or it is of a kind that is not read.
        """
        return cls(Repository.open(path, durable=durable, check_path=check_path), check=check)

    @classmethod
    def init(
        cls,
        path: Path,
        files: Mapping[str, bytes],
        *,
        bare: bool = False,
        check: Check | None = None,
        durable: bool = True,
    ) -> tuple[Registry, Written]:
        """A new registry with its first commit.

        ``files`` is what stands in it from the start, by path; ``.gitattributes`` is added.

        Raises:
            RegistryError: there is a repository already, files stand in the way, or a path is none.
        """
        registry = cls(create(path, bare=bare, durable=durable, check_path=check_path), check=check)
        files = {".gitattributes": ATTRIBUTES} | dict(files)
        changes = [Change(path=name, data=data) for name, data in files.items()]
        written = registry.put_many(changes, Note(subject="Begin a registry of camera calibrations"))
        maintenance.index_paths(registry.repo)
        return registry, written

    @classmethod
    def clone(cls, url: str, path: Path, *, check: Check | None = None, durable: bool = True) -> Registry:
        """A copy of another registry, checked out.

        Raises:
            RegistryError: the address is none, cannot be reached, or the folder is taken.
        """
        registry = cls(clone(url, path, durable=durable, check_path=check_path), check=check)
        maintenance.index_paths(registry.repo)
        return registry

    def commit(self, rev: str | None = None) -> str:
        """The commit that a revision means; the newest if left out.

        Raises:
            RegistryError: there is none.
        """
        return commit_at(self.repo, parse_rev(rev) if rev is not None else None)

    def snapshot(self, rev: str | None = None) -> Snapshot:
        """All entries' paths at a revision; a state that was seen before costs one look at the branch."""
        commit = self.commit(rev)
        known = self._snapshots.get(commit)
        if known is None:
            known = Snapshot(commit, MappingProxyType(self._paths(commit)))
            self._remember(known)
        return known

    def _paths(self, commit: str) -> dict[str, str]:
        last = next(reversed([*self._snapshots.values()]), None)
        if last is None or len(last.paths) < PATCHED_FROM:
            return self.repo.listing(commit, CAMERAS)
        paths = dict(last.paths)
        for file in changed(self.repo, last.commit, commit, CAMERAS):
            if file.after is None:
                paths.pop(file.path, None)
            else:
                paths[file.path] = file.after
        return paths

    def _remember(self, snapshot: Snapshot) -> None:
        kept = [*self._snapshots.items()][1 - KEPT :]
        self._snapshots = {**dict(kept), snapshot.commit: snapshot}

    def read(self, path: str, rev: str | None = None) -> Blob:
        """A file at a revision, its hash checked; its id is the ``base`` of a change to it.

        Raises:
            UnknownCameraError: it is not there.
            RegistryError: there is no such revision.
        """
        commit = self.commit(rev)
        blob = self.repo.read(commit, path)
        if blob is None:
            raise UnknownCameraError(f"{path}: no such entry at {rev or 'the newest commit'} ({commit[:12]})")
        return blob

    def read_all(self, snapshot: Snapshot) -> Iterator[tuple[str, bytes]]:
        """Every entry of a snapshot with its content, in the order of their paths."""
        paths = sorted(snapshot.paths)
        contents = self.repo.read_many([snapshot.paths[path] for path in paths])
        return zip(paths, contents, strict=True)

    def put(
        self, path: str, data: bytes | None, note: Note, *, base: str | None, author: Person | None = None
    ) -> Written:
        """Write one entry.

        ``data`` is its content, or ``None`` to remove it; ``base`` the id of the content that was read before,
        or ``None`` if it is new.

        Raises:
            FileConflictError: somebody has changed it since; nothing was written.
            RegistryError: it cannot be written.
        """
        return self.put_many([Change(path=path, data=data, base=base)], note, author=author)

    def put_many(
        self,
        changes: Sequence[Change],
        note: Note,
        *,
        author: Person | None = None,
        branch: str | None = None,
    ) -> Written:
        """Write several files as one commit: all of them or none.

        Raises:
            FileConflictError: somebody has changed one since; nothing was written, all of them are told.
            RegistryError: they cannot be written.
        """
        for change in changes:
            if change.path.startswith(f"{CAMERAS}/"):
                if change.base is ANY:
                    raise RegistryError(
                        f"{change.path}: an entry is never overwritten blindly; name its base"
                    )
                if self._check is not None and change.data is not None:
                    self._check(change.path, change.data)
        written = write(self.repo, changes, note.message, author=author, branch=branch)
        if maintenance.is_due(self.repo):
            # What was written is written, whatever becomes of the packing.
            with suppress(RegistryError):
                maintenance.maintain(self.repo, in_background=True)
        return written

    def move(self, old: str, new: str, data: bytes, note: Note, *, base: str) -> Written:
        """Give an entry another path, and a content to match, in one commit that its history goes on across.

        ``base`` is the id of the content under the old path.

        Raises:
            FileConflictError: somebody has changed it since, or stands at the new path; nothing was written.
            RegistryError: it cannot be written.
        """
        told = Note(
            subject=note.subject,
            reason=note.reason,
            cameras=note.cameras,
            firmware=note.firmware,
            grade=note.grade,
            sources=note.sources,
            moved=((old, new),),
        )
        changes = [Change(path=old, data=None, base=base), Change(path=new, data=data)]
        return self.put_many(changes, told)

    def history(
        self, path: str | None = None, rev: str | None = None, *, most: int | None = None
    ) -> tuple[Revision, ...]:
        """Every revision of an entry, or of everything, newest first; an old path is followed back."""
        return history(self.repo, path, self.commit(rev), most=most)

    def changed(self, before: str | None, after: str | None = None) -> tuple[ChangedFile, ...]:
        """The entries that differ between two revisions; from nothing if the first is left out."""
        start = self.commit(before) if before is not None else None
        return changed(self.repo, start, self.commit(after), CAMERAS)
