"""Writing a registry: commits of any number of files that lose no change of another writer.

Three safeguards cover different cases. The writer's lock serialises calibrary's own writers. The parent of a commit is
fixed, so that a branch moved by any other program is not moved again. And every change states the content it started
from: an entry changed since then is a conflict, reported with both versions; retrying never overwrites it.
"""

from __future__ import annotations

import getpass
import os
import socket
import time
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from enum import Enum
from functools import partial
from typing import Final

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.progress import log
from calibrary.registry.git import worktree
from calibrary.registry.git.commits import File, Person, Step, advance, land
from calibrary.registry.git.errors import Conflict, FileConflictError
from calibrary.registry.git.locks import backoff, writer_lock
from calibrary.registry.git.names import check_branch
from calibrary.registry.git.objects import LARGEST_FILE, blob_id
from calibrary.registry.git.repository import Repository

__all__ = ["ANY", "Base", "Change", "Written", "branch_ref", "identity", "moment_after", "still_due", "write"]

LOCK_WAIT_S = 120.0
GIVE_UP_S = 30.0
SKEW = timedelta(days=1)
FEW = 200


class Base(Enum):
    """Starting points of a change other than a known content."""

    ANY = "any"


ANY: Final = Base.ANY
"""For generated files that are not edited; never for an entry."""


class Change(Struct, frozen=True, kw_only=True):
    """A change of one file.

    Attributes:
        data: new content; ``None`` removes the file.
        base: id of the content it was made from; ``None`` if the file must not exist yet.
    """

    path: str
    data: bytes | None
    base: str | Base | None = None


class Written(Struct, frozen=True, kw_only=True):
    """Result of a write.

    Attributes:
        commit: commit of the branch afterwards.
        parent: commit before; the same if nothing had to be written.
        paths: changed files with their new ids (``None``: removed).
        warnings: warnings for the user.
    """

    commit: str
    parent: str | None
    paths: dict[str, str | None]
    warnings: tuple[str, ...] = ()


def write(
    repo: Repository,
    changes: Sequence[Change],
    message: str,
    *,
    author: Person | None = None,
    branch: str | None = None,
    now: datetime | None = None,
    empty: bool = False,
) -> Written:
    """Write changes as one commit, all or none.

    Args:
        repo: the repository.
        changes: at most one per file.
        message: complete message, with trailers.
        author: author, if not the committer.
        branch: target branch; by default the one that is checked out. A new branch starts there.
        now: date of the commit.
        empty: make a commit even without changes, for its message.

    Raises:
        FileConflictError: a file differs from the content its change started from; nothing was written.
        RegistryError: a path or content is not allowed, uncommitted edits are in the way, or access is denied.
    """
    _check(repo, changes)
    ref = branch_ref(repo, branch)
    committer, warnings = identity(repo)
    with writer_lock(repo.common_dir, wait_s=LOCK_WAIT_S) as lock:
        if worktree.shows(repo, ref):
            worktree.catch_up(repo)
        deadline = time.monotonic() + GIVE_UP_S + repo.stale_lock_s
        for pause_s in backoff():
            old = repo.tip(ref)
            parent = old if old is not None or branch is None else repo.tip()
            due = still_due(repo, parent, changes)
            if not due and (changes or not empty):
                return Written(commit=_nothing_due(repo, parent), parent=parent, paths={}, warnings=warnings)
            moment, skew = moment_after(repo, parent, now)
            step = Step(
                files=[File(path=change.path, data=change.data) for change in due],
                message=message,
                author=author or committer,
                authored=moment,
                committer=committer,
                committed=moment,
            )
            paths = {file.path: blob_id(file.data) if file.data is not None else None for file in step.files}
            move = partial(land, repo, ref, parent, [step], old)
            new, warned = advance(repo, lock, ref, old, [*paths], move)
            if new is not None:
                return Written(commit=new, parent=parent, paths=paths, warnings=(*warnings, *skew, *warned))
            if time.monotonic() > deadline:
                raise RegistryError(
                    f"{repo.path}: {ref} kept moving, or stayed locked; nothing was written, try again "
                    f"({' '.join(warned)})"
                )
            log.info("%s: %s was moved by another writer; trying again", repo.path, ref)
            time.sleep(pause_s)
    raise AssertionError  # backoff() has no end


def _check(repo: Repository, changes: Sequence[Change]) -> None:
    seen = set()
    for change in changes:
        if repo.check_path(change.path) in seen:
            raise RegistryError(f"{change.path} is changed twice; expected one change per file")
        seen.add(change.path)
        if change.data is not None and len(change.data) > LARGEST_FILE:
            raise RegistryError(f"{change.path}: {len(change.data)} bytes, expected at most {LARGEST_FILE}")


def _nothing_due(repo: Repository, parent: str | None) -> str:
    if parent is None:
        raise RegistryError(f"{repo.path}: nothing to write; the first commit needs a file")
    return parent


def still_due(repo: Repository, commit: str | None, changes: Sequence[Change]) -> list[Change]:
    """Return the changes that have an effect.

    Raises:
        FileConflictError: files differ from the contents their changes started from, even if they happen to equal the
            intended result (two increments by one must give two).
    """
    due: list[Change] = []
    conflicts = []
    for change, theirs in zip(changes, _standing(repo, commit, changes), strict=True):
        if change.base is ANY or change.base == theirs:
            becomes = blob_id(change.data) if change.data is not None else None
            due += [change] if becomes != theirs else []
            continue
        conflicts.append(
            Conflict(
                path=change.path,
                base_oid=change.base if isinstance(change.base, str) else None,
                base=_content(repo, change.base),
                ours=change.data,
                theirs=_content(repo, theirs),
                theirs_oid=theirs,
            )
        )
    if conflicts:
        raise FileConflictError(conflicts, "read the current entry and propose the change again")
    return due


def _standing(repo: Repository, commit: str | None, changes: Sequence[Change]) -> list[str | None]:
    """Return the current ids of the files to change."""
    if commit is None:
        return [None] * len(changes)
    if len(changes) > FEW:
        files = repo.listing(commit)
        return [files.get(change.path) for change in changes]
    found = [repo.read(commit, change.path) for change in changes]
    return [blob.oid if blob is not None else None for blob in found]


def _content(repo: Repository, oid: str | Base | None) -> bytes | None:
    if oid is None or isinstance(oid, Base):
        return None
    try:
        return repo.blob(oid)
    except RegistryError:
        return None


def branch_ref(repo: Repository, branch: str | None) -> str:
    """Return the full name of a branch to write to.

    Raises:
        RegistryError: no branch is given and none is checked out.
    """
    if branch is not None:
        return f"refs/heads/{check_branch(branch)}"
    ref = repo.head_ref
    if ref is None or not ref.startswith("refs/heads/"):
        raise RegistryError(
            f"{repo.path}: HEAD is detached, so a commit would belong to no branch; check one out: git -C "
            f"{repo.path} switch main"
        )
    check_branch(ref.removeprefix("refs/heads/"))
    return ref


def moment_after(
    repo: Repository, parent: str | None, now: datetime | None
) -> tuple[datetime, tuple[str, ...]]:
    """Return the date of a commit: now, but not before its parent, so that lookups by date work; and warnings.

    If the parent is dated days ahead, its clock was wrong: then the true time is used, with a warning.
    """
    moment = (now or datetime.now(UTC)).astimezone()
    if parent is None:
        return moment, ()
    before = datetime.fromtimestamp(repo.committed_at(parent), UTC)
    if before <= moment:
        return moment, ()
    if before - moment <= SKEW:
        return before.astimezone(moment.tzinfo), ()
    return moment, (
        f"the commit before this one is dated {before:%Y-%m-%d %H:%M} UTC, ahead of this machine's clock; reading "
        "the registry by date will be wrong until then",
    )


def identity(repo: Repository) -> tuple[Person, tuple[str, ...]]:
    """Return the committer from git's variables or configuration; else the login name, with a warning."""
    name = _name(os.environ.get("GIT_COMMITTER_NAME") or repo.setting("user.name"))
    email = _name(os.environ.get("GIT_COMMITTER_EMAIL") or repo.setting("user.email"))
    if name and email:
        return Person(name=name, email=email), ()
    try:
        login = getpass.getuser()
    except (KeyError, OSError, ImportError):
        login = "unknown"
    host = socket.gethostname() or "localhost"
    person = Person(name=name or login, email=email or f"{login}@{host}")
    return person, (
        f"git does not know who you are, so the history names {person.name} <{person.email}>; to be named right: "
        "git config --global user.name 'Your Name' and git config --global user.email you@example.com",
    )


def _name(text: str | None) -> str:
    """Return a person's name as text, also if it is not encoded in UTF-8."""
    return os.fsencode(text or "").decode("utf-8", "replace").strip()
