"""The work tree of a registry: updated after every commit, never overwriting edits.

A commit is made without the index and the work tree. An unchanged checkout would show the commit as reverted, and the
next ``git commit -a`` would really revert it. So, before anything is written, the affected files are checked for
edits; a note with the old commit is written; the commit is made; the work tree is updated; the note is removed. A
process that finds a note finishes the step first: the writer was killed in between.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from calibrary.errors import RegistryError, first_of
from calibrary.registry.git.objects import HEX, Blob
from calibrary.registry.git.repository import Repository

__all__ = ["EMPTY_TREE", "begin_update", "finish_update", "require_clean", "sync"]

EMPTY_TREE = "4b825dc642cb6eb9a060e54bf8d69288fbee4904"
UPDATE_NOTE = "calibrary-sync"
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
            f"{repo.path}: {first_of(touched)}: edited and not committed; nothing was written. Commit it, or stash "
            f"it: git -C {repo.path} stash --include-untracked"
        )


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


def sync(repo: Repository, old: str | None, new: str, paths: Sequence[str] | None = None) -> str | None:
    """Update the work tree from one commit to another, which differ in some paths.

    A few unedited files are written one by one, since git's merge of two whole trees takes ten times as long with ten
    thousand entries. All other cases are left to git.

    Returns:
        A warning if something was in the way; then the note stays, and the next write tries again.
    """
    if paths and not _blocked(repo, paths) and _is_clean_by_index(repo, old, paths):
        options = ("--quiet", f"--source={new}", "--staged", "--worktree")
        if repo.run("restore", *options, "--", *paths, good=(0, 1, 128)).code == 0:
            cancel_update(repo)
            return None
    moved = repo.run("read-tree", "-m", "-u", old or EMPTY_TREE, new, good=(0, 128))
    if moved.code:
        return f"committed, but the work tree could not be brought up to date: {moved.errors.strip()}"
    cancel_update(repo)
    return None


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
    blocked = sync(repo, old, new)
    if blocked is not None:
        raise RegistryError(
            f"{repo.path}: its files are older than its last commit, and some were edited by hand since; a "
            f"commit of them would undo entries. Put them aside: git -C {repo.path} stash; then: git -C "
            f"{repo.path} reset --hard. ({blocked})"
        )
