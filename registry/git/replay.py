"""Repetition of local commits on top of a remote's, file by file; text is never merged."""

from __future__ import annotations

from collections.abc import Iterator

from calibrary.errors import RegistryError
from calibrary.registry.git.commits import File, Step
from calibrary.registry.git.errors import Conflict, FileConflictError
from calibrary.registry.git.history import ChangedFile, Revision, changed, history
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import identity, moment_after

__all__ = ["ours_on_theirs"]


def ours_on_theirs(repo: Repository, ours: str | None, theirs: str) -> tuple[list[Step], tuple[str, ...]]:
    """Return the local commits that the remote lacks, as steps on top of the remote's, and warnings.

    Authors, their dates and messages are kept; the committer and the commit date are new. Changes that the remote
    already contains are omitted, and so are commits without remaining changes.

    Raises:
        FileConflictError: both sides changed a file; all conflicts are reported.
        RegistryError: the local history contains a merge, or changes other files than those of a registry.
    """
    if ours is None:
        return [], ()
    committer, warnings = identity(repo)
    moment, skew = moment_after(repo, theirs, None)
    standing = dict[str, str | None](repo.listing(theirs))
    final = repo.listing(ours)
    steps: list[Step] = []
    conflicts: dict[str, Conflict] = {}
    for revision, files in _of_ours(repo, ours, theirs):
        due = []
        for file in files:
            repo.check_path(file.path)
            now = standing.get(file.path)
            if now == file.after or file.path in conflicts:
                continue
            if now != file.before:
                if now == final.get(file.path):
                    continue
                conflicts[file.path] = _conflict(repo, file, final.get(file.path), now)
                continue
            standing[file.path] = file.after
            due.append(File(path=file.path, data=_data(repo, file.after)))
        if due:
            steps.append(
                Step(
                    files=due,
                    message=revision.message,
                    author=revision.author,
                    authored=revision.authored,
                    committer=committer,
                    committed=moment,
                )
            )
    if conflicts:
        raise FileConflictError(
            [*conflicts.values()],
            "pull again with --ours KEY or --theirs KEY for each",
        )
    return steps, (*warnings, *skew) if steps else ()


def _of_ours(repo: Repository, ours: str, theirs: str) -> Iterator[tuple[Revision, tuple[ChangedFile, ...]]]:
    for revision in reversed(history(repo, None, f"{theirs}..{ours}")):
        if len(revision.parents) > 1:
            raise RegistryError(
                f"{repo.path}: {revision.commit[:12]} is a merge that theirs does not have; a pull does not "
                "replay merges: merge the two histories with git"
            )
        parent = revision.parents[0] if revision.parents else None
        yield revision, changed(repo, parent, revision.commit)


def _conflict(repo: Repository, file: ChangedFile, ours: str | None, theirs: str | None) -> Conflict:
    return Conflict(
        path=file.path,
        base_oid=file.before,
        base=_data(repo, file.before),
        ours=_data(repo, ours),
        theirs=_data(repo, theirs),
        theirs_oid=theirs,
    )


def _data(repo: Repository, oid: str | None) -> bytes | None:
    return repo.blob(oid) if oid is not None else None
