"""Making commits and moving a branch to them, atomically.

A message is a line for people, then trailers for programs, as ``git interpret-trailers`` reads them. Without
signatures, one ``git fast-import`` writes the objects and moves the branch. Two commands make this atomic: with
``feature done``, an incomplete stream is an error instead of a partial commit; and ``from <commit>`` names the parent
that was read, so that git refuses to move a branch that another writer has moved (git-fast-import(1)). A signature
requires the finished tree first, and a replay moves a branch to a commit that is not a descendant, which fast-import
refuses. Both build on a temporary ref, and then move the branch by ``git update-ref``, in one transaction that also
deletes that ref.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.registry.git import worktree
from calibrary.registry.git.errors import explain
from calibrary.registry.git.locks import WriterLock, lock_in_the_way
from calibrary.registry.git.objects import HEX
from calibrary.registry.git.program import Output
from calibrary.registry.git.repository import Repository

__all__ = [
    "File",
    "Person",
    "Step",
    "Trailers",
    "advance",
    "build",
    "compose",
    "is_signing",
    "land",
    "move_branch",
    "stream",
    "subject_of",
    "trailers_of",
]

BUILD_REF = "refs/calibrary/build"
NO_COMMIT = "0" * 40
CRASH_REPORT = re.compile(r"dumping crash report to (?P<path>\S*fast_import_crash_\d+)")
OVERTAKEN = ("Not updating refs/", "but expected", "reference already exists", "unable to resolve reference")


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
    shown = worktree.shows(repo, ref)
    if shown:
        worktree.require_clean(repo, old, paths)
        worktree.begin(repo, ref, old)
    try:
        output = move()
        new = _commit_of(repo, lock, output)
    except BaseException:
        if shown and repo.tip(ref) == old:
            worktree.give_up(repo)
        raise
    if new is None:
        if shown:
            worktree.give_up(repo)
        return None, (output.errors.strip(),)
    if not shown:
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
    _sweep(repo, output.errors)
    if any(sign in output.errors for sign in OVERTAKEN):
        return None
    in_the_way = lock_in_the_way(output.errors)
    if in_the_way is not None:
        lock.heal(in_the_way, older_than_s=repo.stale_lock_s)
        return None
    raise RegistryError(f"{repo.path}: nothing was written: {explain(output.errors)}")


def _sweep(repo: Repository, errors: str) -> None:
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
            extra=_as("AUTHOR", step.author, step.authored)
            | _as("COMMITTER", step.committer, step.committed),
        )
        signed.append(made.out.decode().strip())
    return Output(0, "".join(f"{commit}\n" for commit in signed).encode(), built.errors)


def _as(role: str, person: Person, moment: datetime) -> dict[str, str]:
    return {
        f"GIT_{role}_NAME": person.name,
        f"GIT_{role}_EMAIL": person.email,
        f"GIT_{role}_DATE": f"{int(moment.timestamp())} {moment:%z}",
    }


def move_branch(repo: Repository, ref: str, old: str | None, new: str) -> Output:
    """Move a branch from its known commit to another, and delete the temporary ref in the same transaction."""
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
