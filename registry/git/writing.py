"""Writing a registry: commits of any number of files that lose no change of another writer.

Three safeguards cover different cases. The writer's lock serialises calibrary's own writers. The parent of a commit is
fixed, so that a branch moved by any other program is not moved again. And every change states the content it started
from: an entry changed since then is a conflict, reported with both versions; retrying never overwrites it.
"""

from __future__ import annotations

import getpass
import os
import re
import socket
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.progress import log
from calibrary.registry.git import worktree
from calibrary.registry.git.errors import Conflict, FileConflictError, explain
from calibrary.registry.git.locks import WriterLock, backoff, blocking_lock, writer_lock
from calibrary.registry.git.names import check_branch
from calibrary.registry.git.objects import HEX, LARGEST_FILE, blob_id
from calibrary.registry.git.program import Output
from calibrary.registry.git.repository import Repository

__all__ = [
    "ANY",
    "Base",
    "Change",
    "File",
    "Person",
    "Step",
    "Trailers",
    "Written",
    "advance",
    "branch_ref",
    "build",
    "compose",
    "effective_changes",
    "identity",
    "is_signing",
    "land",
    "moment_after",
    "move_branch",
    "stream",
    "subject_of",
    "trailers_of",
    "write",
]

BUILD_REF = "refs/calibrary/build"
NO_COMMIT = "0" * 40
CRASH_REPORT = re.compile(r"dumping crash report to (?P<path>\S*fast_import_crash_\d+)")
MOVED_BY_ANOTHER = (
    "Not updating refs/",
    "but expected",
    "reference already exists",
    "unable to resolve reference",
)


def advance(
    repo: Repository,
    lock: WriterLock,
    ref: str,
    old: str | None,
    paths: Sequence[str],
    move: Callable[[], Output],
) -> tuple[str | None, tuple[str, ...]]:
    """Move a branch, and the work tree if it shows the branch.

    Args:
        repo: the repository.
        lock: the writer's lock, held.
        ref: full name of the branch.
        old: commit of the branch when it was read.
        paths: files that change.
        move: makes the commits and moves the branch; the last word of its output is the new commit.

    Returns:
        The new commit, or ``None`` if another writer was faster and a retry makes sense; and git's output.

    Raises:
        RegistryError: it failed permanently, or uncommitted edits are in the way; nothing was changed.
    """
    is_shown = worktree.is_checked_out(repo, ref)
    if is_shown:
        worktree.require_clean(repo, old, paths)
        worktree.begin_update(repo, ref, old)
    try:
        output = move()
        new = _commit_of(repo, lock, output)
    except BaseException:
        if is_shown and repo.tip(ref) == old:
            worktree.cancel_update(repo)
        raise
    if new is None:
        if is_shown:
            worktree.cancel_update(repo)
        return None, (output.errors.strip(),)
    if not is_shown:
        return new, ()
    behind = worktree.sync(repo, old, new, paths)
    return new, (behind,) if behind else ()


def _commit_of(repo: Repository, lock: WriterLock, output: Output) -> str | None:
    if output.code == 0:
        new = output.out.split()[-1].decode("ascii", "replace") if output.out.strip() else ""
        if HEX.match(new) is None:
            raise RegistryError(
                f"{repo.path}: git reported no commit: {output.out[:200]!r} {output.errors.strip()}"
            )
        return new
    _remove_crash_report(repo, output.errors)
    if any(sign in output.errors for sign in MOVED_BY_ANOTHER):
        return None
    in_the_way = blocking_lock(output.errors)
    if in_the_way is not None:
        lock.remove_stale(in_the_way, older_than_s=repo.stale_lock_s)
        return None
    raise RegistryError(f"{repo.path}: nothing was written: {explain(output.errors)}")


def _remove_crash_report(repo: Repository, errors: str) -> None:
    """Remove the report that a failed fast-import leaves in the repository."""
    found = CRASH_REPORT.search(errors)
    if found is not None:
        report = Path(os.path.realpath(repo.path / found["path"]))
        if report.is_relative_to(repo.git_dir):
            with suppress(OSError):
                report.unlink()


def land(repo: Repository, ref: str, parent: str | None, steps: Sequence[Step], old: str | None) -> Output:
    """Make commits on a parent and move a branch to the last one."""
    if old in {None, parent} and not is_signing(repo):
        return _fast_import(repo, stream(ref, parent, steps))
    built = build(repo, parent, steps)
    return built if built.code else move_branch(repo, ref, old, built.out.split()[-1].decode())


def build(repo: Repository, parent: str | None, steps: Sequence[Step]) -> Output:
    """Make commits without a branch; the output is their ids, one per line."""
    built = _fast_import(repo, stream(BUILD_REF, parent, steps), "--force")
    if built.code or not is_signing(repo):
        return built
    signed: list[str] = []
    for commit, step in zip(built.out.split(), steps, strict=True):
        above = signed[-1] if signed else parent
        made = repo.run(
            "commit-tree",
            "-S",
            *(("-p", above) if above else ()),
            "-F",
            "-",
            f"{commit.decode()}^{{tree}}",
            stdin=step.message.encode(),
            extra=_identity_variables("AUTHOR", step.author, step.authored)
            | _identity_variables("COMMITTER", step.committer, step.committed),
        )
        signed.append(made.out.decode().strip())
    return Output(0, "".join(f"{commit}\n" for commit in signed).encode(), built.errors)


def _identity_variables(role: str, person: Person, moment: datetime) -> dict[str, str]:
    return {
        f"GIT_{role}_NAME": person.name,
        f"GIT_{role}_EMAIL": person.email,
        f"GIT_{role}_DATE": f"{int(moment.timestamp())} {moment:%z}",
    }


def move_branch(repo: Repository, ref: str, old: str | None, new: str) -> Output:
    """Move a branch from its known commit to another, and delete the temporary ref in the same transaction."""
    # With the old value, update-ref is a compare-and-swap; zeros mean that the branch must not exist yet.
    orders = f"update {ref} {new} {old or NO_COMMIT}\n"
    if repo.tip(BUILD_REF) is not None:
        orders += f"delete {BUILD_REF}\n"
    moved = repo.run("update-ref", "-m", "calibrary", "--stdin", stdin=orders.encode(), good=(0, 1, 128))
    return Output(moved.code, new.encode(), moved.errors)


def _fast_import(repo: Repository, written: bytes, *options: str) -> Output:
    command = ("fast-import", "--quiet", "--date-format=raw", *options)
    return repo.run(*command, stdin=written, good=(0, 1, 128))


def is_signing(repo: Repository) -> bool:
    """Return whether the user's configuration asks for signed commits."""
    return (repo.setting("commit.gpgsign") or "").lower() in {"true", "yes", "on", "1"}


DROPPED = str.maketrans("", "", "<>\n\r\0")


class Person(Struct, frozen=True, kw_only=True):
    """Author or committer of a commit."""

    name: str
    email: str

    def at(self, moment: datetime) -> bytes:
        """Return the person in git's form, with the time in seconds and its time zone."""
        name, email = (text.translate(DROPPED).strip() for text in (self.name, self.email))
        return f"{name or email} <{email}> {int(moment.timestamp())} {moment:%z}".encode()


class File(Struct, frozen=True, kw_only=True):
    """A file of a commit.

    Attributes:
        data: its new content; ``None`` removes the file.
    """

    path: str
    data: bytes | None


class Step(Struct, frozen=True, kw_only=True):
    """A commit of a stream.

    Attributes:
        authored: original time of the change; ``committed`` is the time of this commit.
    """

    files: Sequence[File]
    message: str
    author: Person
    authored: datetime
    committer: Person
    committed: datetime


def stream(ref: str, parent: str | None, steps: Sequence[Step]) -> bytes:
    """Return a fast-import stream of successive commits on a ref; git prints the id of each.

    Args:
        ref: full name of the branch, ``refs/heads/…``.
        parent: 40 hex digits of the commit that was read; ``None`` starts a history.
        steps: at least one.

    Raises:
        RegistryError: a time has no time zone.
    """
    # Without it, git commits a stream that breaks off, and reports success.
    parts = [b"feature done\n"]
    origin = parent
    for number, step in enumerate(steps, start=1):
        parts += _commit(ref, origin, step, number)
        origin = f":{number}"
    parts.append(b"done\n")
    return b"".join(parts)


def _commit(ref: str, origin: str | None, step: Step, number: int) -> Iterable[bytes]:
    if step.authored.tzinfo is None or step.committed.tzinfo is None:
        raise RegistryError("the time of a commit states no zone: expected one with an offset from UTC")
    yield f"commit {ref}\nmark :{number}\n".encode()
    yield b"author " + step.author.at(step.authored) + b"\n"
    yield b"committer " + step.committer.at(step.committed) + b"\n"
    yield from _data(step.message.replace("\0", "").encode())
    if origin is not None:
        # The commit that was read: git does not move the branch if another writer has moved it since.
        yield f"from {origin}\n".encode()
    # Removals first: a file may replace a folder that this commit empties.
    for file in sorted(step.files, key=lambda file: file.data is not None):
        if file.data is None:
            yield f"D {file.path}\n".encode()
        else:
            yield f"M 100644 inline {file.path}\n".encode()
            yield from _data(file.data)
    yield f"get-mark :{number}\n".encode()


def _data(content: bytes) -> Iterable[bytes]:
    yield b"data %d\n" % len(content)
    yield content
    yield b"\n"


Trailers = Sequence[tuple[str, str]]

TRAILER = re.compile(r"(?P<key>[A-Za-z][A-Za-z0-9-]*): (?P<value>.*)")
LONGEST_SUBJECT = 100
LONGEST_VALUE = 500


def compose(subject: str, *, body: str = "", trailers: Trailers = ()) -> str:
    """Return a commit message; line breaks and control characters in values become blanks."""
    first = _line(subject, LONGEST_SUBJECT) or "Change the registry"
    paragraphs = [first]
    if body.strip():
        paragraphs.append("\n".join(_line(line, LONGEST_VALUE) for line in body.strip().splitlines()))
    lines = [f"{key}: {text}" for key, value in trailers if (text := _line(value, LONGEST_VALUE))]
    if lines:
        paragraphs.append("\n".join(lines))
    return "\n\n".join(paragraphs) + "\n"


def subject_of(message: str) -> str:
    """Return the first line of a message."""
    return message.strip().partition("\n")[0]


def trailers_of(message: str) -> tuple[tuple[str, str], ...]:
    """Return the trailers of a message: its last paragraph, if all lines of it are trailers."""
    paragraphs = [part for part in re.split(r"\n[ \t]*\n", message.strip()) if part.strip()]
    if len(paragraphs) < 2:
        return ()
    found = [TRAILER.fullmatch(line) for line in paragraphs[-1].splitlines()]
    pairs = tuple((match["key"], match["value"].strip()) for match in found if match)
    return pairs if len(pairs) == len(found) else ()


def _line(text: str, longest: int) -> str:
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    folded = " ".join(printable.split())
    return folded if len(folded) <= longest else f"{folded[: longest - 1]}…"


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
        if worktree.is_checked_out(repo, ref):
            worktree.finish_update(repo)
        deadline = time.monotonic() + GIVE_UP_S + repo.stale_lock_s
        for pause_s in backoff():
            old = repo.tip(ref)
            parent = old if old is not None or branch is None else repo.tip()
            due = effective_changes(repo, parent, changes)
            if not due and (changes or not empty):
                return Written(
                    commit=_unchanged_tip(repo, parent), parent=parent, paths={}, warnings=warnings
                )
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


def _unchanged_tip(repo: Repository, parent: str | None) -> str:
    if parent is None:
        raise RegistryError(f"{repo.path}: nothing to write; the first commit needs a file")
    return parent


def effective_changes(repo: Repository, commit: str | None, changes: Sequence[Change]) -> list[Change]:
    """Return the changes that have an effect.

    Raises:
        FileConflictError: files differ from the contents their changes started from, even if they happen to equal the
            intended result (two increments by one must give two).
    """
    due: list[Change] = []
    conflicts = []
    for change, theirs in zip(changes, _current_ids(repo, commit, changes), strict=True):
        # The branch's own compare-and-swap is not enough: a retry on the new tip would overwrite a newer calibration.
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


def _current_ids(repo: Repository, commit: str | None, changes: Sequence[Change]) -> list[str | None]:
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
