"""Writing a registry: whole commits of any number of files that lose no change of another writer.

Three guards, each for what the others let through. The writer's lock keeps calibrary's own writers in a row. The
parent of a commit is pinned, so that a branch which anybody else moved meanwhile is not moved again. And every
change names the content it started from: an entry that was changed since is a conflict, reported with both
versions, and no number of retries turns that into an overwrite.
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
    """What a change may start from besides a known content."""

    ANY = "any"


ANY: Final = Base.ANY
"""For files that calibrary generates and that are not edited. Never for an entry."""


class Change(Struct, frozen=True, kw_only=True):
    """The change to one file.

    Attributes:
        data: its new content; ``None`` removes it.
        base: the id of the content it was made from; ``None`` if there must be no file yet.
    """

    path: str
    data: bytes | None
    base: str | Base | None = None


class Written(Struct, frozen=True, kw_only=True):
    """What a write came to.

    Attributes:
        commit: the branch's commit afterwards.
        parent: the one before it; the same if everything stood there already.
        paths: files that were changed, with their new ids (``None``: removed).
        warnings: what a person should know of it.
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
    """Make one commit of some changes, all or none of them.

    Args:
        repo: the repository.
        changes: at most one a file.
        message: whole, trailers included.
        author: whose work it is, if not the committer's.
        branch: where to; what is checked out if left out. A new one begins at what is checked out.
        now: the moment it is dated.
        empty: make a commit that only says something, where there are no changes.

    Raises:
        FileConflictError: a file is not what its change started from; nothing was written.
        RegistryError: a path or content that no registry holds, work of a person's in the way, no access.
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
    """The changes that alter something.

    Raises:
        FileConflictError: files are not what their changes started from; even if by chance they have become what
            the change would make of them, for two who count up by one have counted up by two.
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
    """The current ids of the files that change."""
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
    """The full name of a branch to write to.

    Raises:
        RegistryError: none was named and none is checked out.
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
    """When a commit is dated: now, but not before its parent, or a look at the registry by date would go wrong.

    A parent dated days ahead was made by a clock that was wrong: then the true time is kept, with a warning.
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
    """Who commits, from git's variables or configuration; else the login's name, with a warning."""
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
    """A person's name as text, also where it was written in another encoding than UTF-8."""
    return os.fsencode(text or "").decode("utf-8", "replace").strip()
