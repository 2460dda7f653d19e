"""Writing a registry: commits of any number of files that lose no change of another writer.

Three safeguards cover different cases. The writer's lock serialises calibrary's own writers. The parent of a commit is
fixed, so that a branch moved by any other program is not moved again. And every change states the content it started
from: an entry changed since then is a conflict, reported with both versions; retrying never overwrites it.

A commit is made without the index and the work tree. An unchanged checkout would show the commit as reverted, and the
next ``git commit -a`` would really revert it. So, before anything is written, the affected files are checked for
edits; a note with the old commit is written; the commit is made; the work tree is updated; the note is removed. A
process that finds a note finishes the step first: the writer was killed in between.
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

from calibrary.errors import RegistryError, first_of
from calibrary.progress import log
from calibrary.registry.git.errors import Conflict, FileConflictError, explain
from calibrary.registry.git.locks import WriterLock, backoff, blocking_lock, writer_lock
from calibrary.registry.git.objects import HEX, LARGEST_FILE, Blob, blob_id
from calibrary.registry.git.program import Output, check_branch
from calibrary.registry.git.repository import Repository

EMPTY_TREE = "4b825dc642cb6eb9a060e54bf8d69288fbee4904"
UPDATE_NOTE = "calibrary-sync"
OWN_INDEX = "calibrary-index"
MOST_VERSIONS: Final = 50
"""Of a file, the last ones, of which a late git may have written one."""
LATE_GIT_S: Final = 60.0
"""How far from the time of its note a killed writer, or its git, may have written files."""
LONGEST_UPDATE_NOTE = 1000
MOST_PATHSPECS = 200
MOST_LOOKED_AT = 20
INDEX_WAIT_S = 5.0
IN_PROGRESS = {
    "MERGE_HEAD": "a merge",
    "CHERRY_PICK_HEAD": "a cherry-pick",
    "REVERT_HEAD": "a revert",
    "rebase-merge": "a rebase",
    "rebase-apply": "a rebase",
}
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
    is_shown = is_checked_out(repo, ref)
    if is_shown:
        require_clean(repo, old, paths)
        begin_update(repo, ref, old)
    try:
        output = move()
        new = _commit_of(repo, lock, output)
    except BaseException:
        if is_shown and repo.tip(ref) == old:
            cancel_update(repo)
        raise
    if new is None:
        if is_shown:
            cancel_update(repo)
        return None, (output.errors.strip(),)
    if not is_shown:
        return new, ()
    behind = update_work_tree(repo, old, new, paths)
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


class FileChange(Struct, frozen=True, kw_only=True):
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
    changes: Sequence[FileChange],
    message: str,
    *,
    author: Person | None = None,
    branch: str | None = None,
    now: datetime | None = None,
) -> Written:
    """Write changes as one commit, all or none.

    Args:
        repo: the repository.
        changes: at most one per file.
        message: complete message, with trailers.
        author: author, if not the committer.
        branch: target branch; by default the one that is checked out. A new branch starts there.
        now: date of the commit.

    Raises:
        FileConflictError: a file differs from the content its change started from; nothing was written.
        RegistryError: a path or content is not allowed, uncommitted edits are in the way, or access is denied.
    """
    _check(repo, changes)
    ref = branch_ref(repo, branch)
    committer, warnings = identity(repo)
    with writer_lock(repo.common_dir, wait_s=LOCK_WAIT_S) as lock:
        shown = repo.tip(ref) if (is_shown := is_checked_out(repo, ref)) else None
        if is_shown:
            finish_update(repo)
        deadline = time.monotonic() + GIVE_UP_S + repo.stale_lock_s
        for pause_s in backoff():
            old = repo.tip(ref)
            if is_shown and old != shown:
                # The git of a killed writer has outlived it, and moved the branch but not the files.
                begin_update(repo, ref, shown)
                finish_update(repo)
                shown = old
            parent = old if old is not None or branch is None else repo.tip()
            due = effective_changes(repo, parent, changes)
            if not due:
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


def _check(repo: Repository, changes: Sequence[FileChange]) -> None:
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


def effective_changes(
    repo: Repository, commit: str | None, changes: Sequence[FileChange]
) -> list[FileChange]:
    """Return the changes that have an effect.

    Raises:
        FileConflictError: files differ from the contents their changes started from, even if they happen to equal the
            intended result (two increments by one must give two).
    """
    due: list[FileChange] = []
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


def _current_ids(repo: Repository, commit: str | None, changes: Sequence[FileChange]) -> list[str | None]:
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


def is_checked_out(repo: Repository, ref: str) -> bool:
    """Return whether the repository's work tree shows a branch.

    Raises:
        RegistryError: another linked work tree shows it, which would become out of date.
    """
    for other in _linked(repo):
        with suppress(OSError):
            if (other / "HEAD").read_text(encoding="utf-8").strip() == f"ref: {ref}":
                raise RegistryError(
                    f"{repo.path}: {ref} is checked out in another work tree ({other}); open the registry there"
                )
    return repo.work_tree is not None and repo.head_ref == ref


def _linked(repo: Repository) -> Iterable[Path]:
    """Yield the git folders of the other work trees of this repository."""
    with suppress(OSError):
        yield from (place for place in (repo.common_dir / "worktrees").iterdir() if place != repo.git_dir)
    if repo.common_dir != repo.git_dir:
        yield repo.common_dir


def require_clean(repo: Repository, tip: str | None, paths: Sequence[str]) -> None:
    """Check that no uncommitted edit affects these files.

    Raises:
        RegistryError: a file is edited, staged or untracked; or a merge is in progress.
    """
    for name, what in IN_PROGRESS.items():
        if (repo.git_dir / name).exists():
            raise RegistryError(f"{repo.path}: {what} is in progress in the work tree; finish it first")
    _wait_for_index(repo)
    blocked = _blocked(repo, paths)
    if not blocked and _is_clean_by_index(repo, tip, paths):
        return
    touched = sorted(_edited(repo, paths) | blocked)
    if touched:
        raise RegistryError(
            f"{repo.path}: {first_of(touched)}: edited and not committed; nothing was written. Commit it, or "
            f"{_aside(repo)}"
        )


def _aside(repo: Repository) -> str:
    """Return the advice how a person's edit of a file is set aside without losing it."""
    committed = f"git -C {repo.path} restore --staged --worktree -- FILE"
    return f"move it elsewhere and take back what is committed: {committed}"


def _wait_for_index(repo: Repository) -> None:
    lock = repo.git_dir / "index.lock"
    deadline = time.monotonic() + INDEX_WAIT_S
    while lock.exists():
        if time.monotonic() > deadline:
            raise RegistryError(
                f"{lock}: another git command is running in this work tree; wait for it. If none is running, "
                "it was killed: remove the file"
            )
        time.sleep(0.02)


def _edited(repo: Repository, paths: Sequence[str]) -> set[str]:
    wanted = set(paths)
    limits = list(paths) if len(paths) <= MOST_PATHSPECS else []
    options = ("--porcelain=v1", "-z", "--untracked-files=all", "--ignored=matching", "--no-renames")
    listed = repo.run("status", *options, "--", *limits).out
    found = {os.fsdecode(line[3:]) for line in listed.split(b"\0") if line}
    # git lists a folder with only ignored files as a single path.
    folders = tuple(name for name in found if name.endswith("/"))
    hidden = {path for path in wanted if path.startswith(folders) and os.path.lexists(repo.path / path)}
    return (found & wanted) | hidden


def _is_clean_by_index(repo: Repository, tip: str | None, paths: Sequence[str]) -> bool:
    """Return whether a few files are certainly unedited, from the files and the index, without starting git.

    Of the index format, this uses only that versions 2 and 3 store each file's id, two bytes of flags and its full
    name in sequence (gitformat-index(5)). All other cases are left to git.
    """
    if len(paths) > MOST_LOOKED_AT:
        return False
    try:
        index = (repo.git_dir / "index").read_bytes()
    except FileNotFoundError:
        index = b"DIRC\0\0\0\x02"
    except OSError:
        return False
    if not index.startswith((b"DIRC\0\0\0\x02", b"DIRC\0\0\0\x03")) or b"link\0\0" in index[-(1 << 16) :]:
        return False
    committed = [repo.read(tip, path) if tip is not None else None for path in paths]
    return all(
        _is_as_committed(repo.path / path, os.fsencode(path), blob, index)
        for path, blob in zip(paths, committed, strict=True)
    )


def _is_as_committed(place: Path, name: bytes, blob: Blob | None, index: bytes) -> bool:
    if blob is None:
        return not os.path.lexists(place) and name not in index
    at = index.find(bytes.fromhex(blob.oid))
    while at >= 0 and index[at + 22 : at + 23 + len(name)] != name + b"\0":
        at = index.find(bytes.fromhex(blob.oid), at + 1)
    if at < 0:
        return False
    try:
        return not place.is_symlink() and place.read_bytes() == blob.data
    except OSError:
        return False


def _blocked(repo: Repository, paths: Sequence[str]) -> set[str]:
    """Return parents of the files that are not folders: a file with that name, or a link."""
    parents = {parent for path in paths for parent in Path(path).parents if parent.parts}
    places = {parent.as_posix(): repo.path / parent for parent in parents}
    return {
        name
        for name, place in places.items()
        if place.is_symlink() or (os.path.lexists(place) and not place.is_dir())
    }


def begin_update(repo: Repository, ref: str, tip: str | None) -> None:
    """Write the note that the work tree is about to become out of date.

    Raises:
        RegistryError: the note cannot be written.
    """
    draft = repo.git_dir / f"{UPDATE_NOTE}.new"
    try:
        # A link in its place would otherwise be followed.
        draft.unlink(missing_ok=True)
        with draft.open("x", encoding="utf-8") as file:
            file.write(f"{tip or EMPTY_TREE} {ref}\n")
        draft.replace(repo.git_dir / UPDATE_NOTE)
    except OSError as error:
        raise RegistryError(
            f"{repo.git_dir}: cannot be written: {error.strerror}; nothing was committed"
        ) from None


def cancel_update(repo: Repository) -> None:
    """Remove the note, since nothing was committed. A note that cannot be removed is harmless."""
    with suppress(OSError):
        (repo.git_dir / UPDATE_NOTE).unlink()


def update_work_tree(
    repo: Repository, old: str | None, new: str, paths: Sequence[str] | None = None
) -> str | None:
    """Update the work tree from one commit to another, which differ in some paths.

    A few unedited files are written one by one, since git's merge of two whole trees takes ten times as long with ten
    thousand entries. All other cases are left to git.

    Returns:
        A warning if something was in the way; then the note stays, and the next write tries again.
    """
    if paths and not _blocked(repo, paths) and _is_clean_by_index(repo, old, paths):
        options = ("--quiet", f"--source={new}", "--staged", "--worktree")
        if _with_index(repo, "restore", *options, "--", *paths).code == 0:
            cancel_update(repo)
            return None
    moved = _with_index(repo, "read-tree", "-m", "-u", old or EMPTY_TREE, new)
    if moved.code:
        return f"committed, but the work tree could not be brought up to date: {moved.errors.strip()}"
    cancel_update(repo)
    return None


def _with_index(repo: Repository, *command: str, stdin: bytes | None = None) -> Output:
    """Run a git command that writes the index on a copy of it, which takes its place afterwards.

    A git that is killed would leave ``index.lock``, which nobody but a person may remove. The lock is here another name
    of the copy, for a moment: left behind, it is known to be ours. Each copy has a name of its own, as the git of a
    writer that was killed may go on to write into the one that it was given.
    """
    copy = f"{OWN_INDEX}-{os.getpid()}-{os.urandom(4).hex()}"
    index, own, lock = (repo.git_dir / name for name in ("index", copy, "index.lock"))
    try:
        for left in repo.git_dir.glob(f"{OWN_INDEX}*"):
            with suppress(FileNotFoundError):
                if lock.samefile(left):
                    lock.unlink()
            left.unlink(missing_ok=True)
        before = index.read_bytes() if index.exists() else None
        if before is not None:
            when = index.stat().st_mtime_ns
            own.write_bytes(before)
            # Git looks into a file that is as new as the index: by the copy's own time, an edit of just now is none.
            os.utime(own, ns=(when, when))
        done = repo.run(*command, stdin=stdin, good=(0, 1, 128), extra={"GIT_INDEX_FILE": str(own)})
        if done.code == 0:
            _wait_for_index(repo)
            try:
                os.link(own, lock)
            except FileExistsError:
                raise
            except OSError:
                # A disk without hard links.
                with lock.open("xb") as file:
                    file.write(own.read_bytes())
            if (index.read_bytes() if index.exists() else None) != before:
                lock.unlink()
                return Output(1, b"", "another git command has changed the index meanwhile")
            lock.replace(index)
        own.unlink(missing_ok=True)
    except (OSError, RegistryError) as error:
        return Output(1, b"", str(error))
    return done


def _enter_written(repo: Repository, old: str, new: str) -> None:
    """Enter in the index those files that a killed writer has brought up to date, which git would take for edits.

    Those that it left half are removed, so that git writes them again, and so are older versions: the git of a killed
    writer may go on after the next one has begun. What is removed is in the repository. What was staged or changed
    later is a person's, who may have put an older version back.
    """
    differing = repo.difference(None if old == EMPTY_TREE else old, new)
    there = [one for one in differing if (repo.path / one[0]).is_file()]
    asked = "".join(f"{path}\n" for path, _, _ in there).encode("utf-8", "surrogateescape")
    hashed = repo.run("hash-object", "--stdin-paths", stdin=asked).out.decode().split()
    staged = repo.run("diff-index", "--cached", "--name-only", "--no-renames", "-z", old).out.split(b"\0")
    noted = (repo.git_dir / UPDATE_NOTE).stat().st_mtime
    lines = []
    for (path, before, after), has in zip(there, hashed, strict=True):
        if after is not None and has == after[1]:
            lines.append(f"{after[0].decode()} {has}\t{path}\n")
        elif before is not None and has == before[1]:
            continue
        elif (
            os.fsencode(path) not in staged
            and abs((repo.path / path).stat().st_mtime - noted) <= LATE_GIT_S
            and _is_left_over(repo, path, has, (old, new))
        ):
            log.warning(
                "%s: %s: left half or older by a command that was killed; written again", repo.path, path
            )
            (repo.path / path).unlink()
    gone = [path for path, _, after in differing if not after and not os.path.lexists(repo.path / path)]
    lines += [f"0 {'0' * 40}\t{path}\n" for path in gone]
    if lines:
        text = "".join(lines).encode("utf-8", "surrogateescape")
        _with_index(repo, "update-index", "--index-info", stdin=text)


def _is_left_over(repo: Repository, path: str, oid: str, commits: Sequence[str]) -> bool:
    """Return whether a file is the beginning of one of its versions, or an earlier one of them."""
    options = ("--raw", "--no-abbrev", "--no-renames", "--format=", f"--max-count={MOST_VERSIONS}")
    real = [commit for commit in commits if commit != EMPTY_TREE]
    if oid.encode() in repo.run("log", *options, *real, "--", path).out:
        return True
    data = (repo.path / path).read_bytes()
    blobs = (repo.read(commit, path) for commit in real)
    return any(blob is not None and blob.data.startswith(data) for blob in blobs)


def finish_update(repo: Repository) -> None:
    """Finish the update of the work tree after a writer was killed between its commit and the update.

    Raises:
        RegistryError: the affected files were edited since.
    """
    note = repo.git_dir / UPDATE_NOTE
    try:
        content = note.read_bytes()[:LONGEST_UPDATE_NOTE] if os.path.lexists(note) else None
    except OSError as error:
        raise RegistryError(f"{note}: cannot be read: {error.strerror}; look at it, then remove it") from None
    if content is None:
        return
    old, _, ref = content.decode("utf-8", "replace").strip().partition(" ")
    # An incomplete note was left by a writer that was killed before its commit.
    new = repo.tip(ref) if HEX.match(old) is not None and ref == repo.head_ref else None
    if new is None or old == new:
        cancel_update(repo)
        return
    _enter_written(repo, old, new)
    blocked = update_work_tree(repo, old, new)
    if blocked is not None:
        raise RegistryError(
            f"{repo.path}: its files are older than its last commit, and some were edited by hand since; a "
            f"commit of them would undo entries. For each that git names, {_aside(repo)}. ({blocked})"
        )
