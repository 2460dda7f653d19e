"""Checks of all entries of a registry, at a commit or in the work tree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from calibrary.errors import RegistryError
from calibrary.policy import Policy
from calibrary.registry.checks.approval import never_approved
from calibrary.registry.checks.entries import check
from calibrary.registry.checks.files import EntryFiles, Progress, completed
from calibrary.registry.checks.findings import Checked, CheckReport, count_of
from calibrary.registry.folder import entry_paths, proposal_paths, read_entry_file
from calibrary.registry.paths import CAMERAS, PROPOSALS, is_entry
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

__all__ = ["FOLDERS", "check_all", "check_work_tree"]

FOLDERS: Final = (CAMERAS, PROPOSALS)


def check_all(
    snapshot: Snapshot, policy: Policy | None = None, *, progress: Progress | None = None
) -> Checked:
    """Check every entry at the snapshot's commit, or in a plain folder.

    Args:
        snapshot: state of the registry.
        policy: policy to use instead of the registry's own.
        progress: called with (entries done, number of entries).

    Raises:
        RegistryError: the registry cannot be listed.
    """
    if snapshot.repo is None or snapshot.commit is None:
        return check_work_tree(snapshot, policy, progress=progress)
    paths = [*snapshot.paths, *filter(is_entry, snapshot.proposed)]
    files = EntryFiles(paths, snapshot.read_many, progress, snapshot.contents)
    found = check(files, policy or snapshot.configuration.policy, parse=files.parse)
    report = completed(found, files, files)
    report = CheckReport(
        entries=report.entries,
        findings=(
            *_not_files(snapshot.repo.irregular(snapshot.commit, *FOLDERS)),
            *report.findings,
            *never_approved(snapshot, snapshot.repo, snapshot.commit),
        ),
    )
    return Checked(
        what=f"{count_of(len(files))} at {snapshot.commit[:12]}", commit=snapshot.commit, report=report
    )


def check_work_tree(
    snapshot: Snapshot, policy: Policy | None = None, *, progress: Progress | None = None
) -> Checked:
    """Check the files in the folder, committed or not.

    Args:
        snapshot: as for :func:`check_all`.
        policy: as for :func:`check_all`.
        progress: as for :func:`check_all`.

    Raises:
        RegistryError: there is no work tree, or it cannot be listed.
    """
    root = snapshot.place
    if snapshot.repo is not None:
        if snapshot.repo.work_tree is None:
            raise RegistryError(f"{snapshot.place}: a bare repository has no work tree; leave out --worktree")
        root = snapshot.repo.work_tree
    files = EntryFiles(
        [*entry_paths(root), *proposal_paths(root)],
        lambda names: (read_entry_file(root, name) for name in names),
        progress,
    )
    report = completed(check(files, policy or snapshot.configuration.policy), files, files)
    return Checked(what=f"{count_of(len(files))} in the folder", commit=None, report=report)


def _not_files(paths: Iterable[str]) -> Iterator[Finding]:
    for path in paths:
        yield Finding(
            rule="regular-file",
            severity=Severity.ERROR,
            place=path,
            message="is a link or another repository, which nothing here follows; expected a file",
            remedy="take it out",
        )
