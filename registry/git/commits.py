"""Making commits and moving a branch onto them, in one step that either happened or did not.

Without signatures one ``git fast-import`` writes the objects and moves the branch. A signature needs the finished
tree first, and a replay moves a branch to where fast-import alone would not (it only goes forward): both build
on a ref of ours and then move the branch by ``git update-ref``, in one transaction that also removes that ref.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.registry.git import worktree
from calibrary.registry.git.failures import explain
from calibrary.registry.git.fast_import import Person, Step, stream
from calibrary.registry.git.locks import WriterLock, lock_in_the_way
from calibrary.registry.git.objects import HEX
from calibrary.registry.git.repository import Output, Repository

__all__ = ["advance", "build", "is_signing", "land", "move_branch"]

BUILD_REF = "refs/calibrary/build"
NOBODY = "0" * 40
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
    """Move a branch, and what shows it.

    Args:
        repo: the repository.
        lock: the writer's lock, held.
        ref: the branch's full name.
        old: where it was seen to stand.
        paths: the files that differ afterwards.
        move: makes and moves; its last word is the new commit.

    Returns:
        the new commit, or ``None`` if somebody was quicker and it may be tried again; and what was told of it.

    Raises:
        RegistryError: it failed for good, or a person's work is in the way; nothing was changed.
    """
    shown = worktree.shows(repo, ref)
    if shown:
        worktree.require_clean(repo, old, paths)
        worktree.begin(repo, ref, old)
    try:
        output = move()
        new = _commit(repo, lock, output)
    except BaseException:
        if shown and repo.tip(ref) == old:
            worktree.give_up(repo)
        raise
    if new is None:
        if shown:
            worktree.give_up(repo)
        return None, (output.told.strip(),)
    if not shown:
        return new, ()
    behind = worktree.sync(repo, old, new, paths)
    return new, (behind,) if behind else ()


def _commit(repo: Repository, lock: WriterLock, output: Output) -> str | None:
    if output.code == 0:
        new = output.out.split()[-1].decode("ascii", "replace") if output.out.strip() else ""
        if HEX.match(new) is None:
            raise RegistryError(
                f"{repo.path}: git told no commit: {output.out[:200]!r} {output.told.strip()}"
            )
        return new
    _sweep(repo, output.told)
    if any(sign in output.told for sign in OVERTAKEN):
        return None
    in_the_way = lock_in_the_way(output.told)
    if in_the_way is not None:
        lock.heal(in_the_way, older_than_s=repo.stale_lock_s)
        return None
    raise RegistryError(f"{repo.path}: nothing was written: {explain(output.told)}")


def _sweep(repo: Repository, told: str) -> None:
    """Remove the report that a failed fast-import leaves in the repository."""
    found = CRASH_REPORT.search(told)
    if found is not None:
        report = Path(os.path.realpath(repo.path / found["path"]))
        if report.is_relative_to(repo.git_dir):
            with suppress(OSError):
                report.unlink()


def land(repo: Repository, ref: str, parent: str | None, steps: Sequence[Step], old: str | None) -> Output:
    """Make commits on a parent and move a branch onto the last."""
    if old in {None, parent} and not is_signing(repo):
        return _fast_import(repo, stream(ref, parent, steps))
    built = build(repo, parent, steps)
    return built if built.code else move_branch(repo, ref, old, built.out.split()[-1].decode())


def build(repo: Repository, parent: str | None, steps: Sequence[Step]) -> Output:
    """Make commits that no branch stands on yet; their ids, one a line."""
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
    return Output(0, "".join(f"{commit}\n" for commit in signed).encode(), built.told)


def _as(role: str, person: Person, moment: datetime) -> dict[str, str]:
    return {
        f"GIT_{role}_NAME": person.name,
        f"GIT_{role}_EMAIL": person.email,
        f"GIT_{role}_DATE": f"{int(moment.timestamp())} {moment:%z}",
    }


def move_branch(repo: Repository, ref: str, old: str | None, new: str) -> Output:
    """Move a branch from where it was seen to a commit; what we built on goes in the same transaction."""
    orders = f"update {ref} {new} {old or NOBODY}\n"
    if repo.tip(BUILD_REF) is not None:
        orders += f"delete {BUILD_REF}\n"
    moved = repo.run("update-ref", "-m", "calibrary", "--stdin", stdin=orders.encode(), good=(0, 1, 128))
    return Output(moved.code, new.encode(), moved.told)


def _fast_import(repo: Repository, written: bytes, *options: str) -> Output:
    command = ("fast-import", "--quiet", "--date-format=raw", *options)
    return repo.run(*command, stdin=written, good=(0, 1, 128))


def is_signing(repo: Repository) -> bool:
    """Whether the person's configuration asks for signed commits."""
    return (repo.setting("commit.gpgsign") or "").lower() in {"true", "yes", "on", "1"}
