"""Check of the changes between two revisions of a registry."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from calibrary.errors import RegistryError
from calibrary.policy import Policy
from calibrary.registry.checks.approval import unapproved
from calibrary.registry.checks.entries import check
from calibrary.registry.checks.files import EntryFiles, Progress, completed, readable_entries
from calibrary.registry.checks.findings import Checked, CheckReport, count_of
from calibrary.registry.checks.whole import FOLDERS
from calibrary.registry.configuration import CONFIGURATION_FILE, configuration_at
from calibrary.registry.entry import Entry
from calibrary.registry.git.history import changed, commit_at, parse_rev
from calibrary.registry.git.repository import Repository
from calibrary.registry.index import ALIAS, LABEL, SUPERSEDES, claimed_folder, index_at, parsed_or_error, said
from calibrary.registry.paths import ROOT, SUFFIX, id_of, in_use_path, model_folder
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

__all__ = ["check_range", "parse_range"]


def parse_range(text: str) -> tuple[str, str | None]:
    """Split REV..REV into its ends; an omitted second end is None, the newest commit.

    Raises:
        RegistryError: the text is not a range.
    """
    before, dots, after = text.partition("..")
    if not dots or not before or after.startswith("."):
        raise RegistryError(
            f"{text!r} is not a range of revisions, expected REV..REV, such as origin/main..HEAD"
        )
    return before, after or None


def check_range(
    snapshot: Snapshot,
    before: str,
    after: str | None,
    policy: Policy | None = None,
    *,
    progress: Progress | None = None,
) -> Checked:
    """Check the changes between two revisions, and the entries that they affect.

    Affected are other entries of the same models, those with the same alias or label, and those that supersede a
    changed entry or are superseded by it. Errors that existed before the change are not reported.

    Args:
        snapshot: as for :func:`check_all`.
        before: first revision.
        after: second revision; by default that of the snapshot.
        policy: as for :func:`check_all`.
        progress: as for :func:`check_all`.

    Raises:
        RegistryError: the registry is a plain folder, or a revision does not exist.
    """
    repo, newest = snapshot.require_git("has no revisions; leave out REV..REV")
    start = commit_at(repo, parse_rev(before))
    # The rules before the change apply: a pull request cannot loosen the rules for itself.
    rules = configuration_at(repo, start)
    policy = policy or rules.policy
    end = commit_at(repo, parse_rev(after)) if after is not None else newest
    differing = [file for folder in FOLDERS for file in changed(repo, start, end, folder)]
    own = {file.path for file in differing if file.after is not None}
    new = _affected(repo, end, {file.path: file.after for file in differing})
    old = _affected(repo, start, {file.path: file.before for file in differing})
    files = EntryFiles.in_git(repo, new, progress)
    was = EntryFiles.in_git(repo, old)
    former = _former(repo, old, own)
    found = completed(check(files, policy, former), files, own).findings
    known = set(check(was, policy).findings) if len(own) < len(files) else set()
    findings = tuple(item for item in found if item.place in own or item not in known)
    findings = (
        *_of_configuration(repo, start, end),
        *findings,
        *unapproved(repo, end, new, own, former, rules),
    )
    return Checked(
        what=f"{count_of(len(own))} changed from {start[:12]} to {end[:12]}",
        commit=end,
        before=start,
        report=CheckReport(entries=len(own), findings=findings),
    )


def _of_configuration(repo: Repository, start: str, end: str) -> Iterator[Finding]:
    files = [repo.read(commit, CONFIGURATION_FILE) for commit in (start, end)]
    if files[0] is not None and (files[1] is None or files[0].oid != files[1].oid):
        yield Finding(
            rule="configuration",
            severity=Severity.WARNING,
            place=CONFIGURATION_FILE,
            message=f"changes; this range is judged by what it said at {start[:12]}, the next one by what it says now",
        )


def _former(repo: Repository, old: Mapping[str, str], own: Collection[str]) -> dict[str, Entry]:
    """Return the usable entries before the change, by path."""
    return dict(readable_entries(repo, old, sorted({in_use_path(path) for path in own} & old.keys())))


def _affected(repo: Repository, commit: str, touched: Mapping[str, str | None]) -> dict[str, str]:
    """Return the blob ids, by path, of the changed entries at a commit and of the entries that they may affect.

    Affected are entries of the same models, those with the same alias or label, and those that supersede a changed
    entry or are superseded by it. No other entry is read.
    """
    own = {path: oid for path, oid in touched.items() if oid is not None}
    index, models = index_at(repo, commit), {model_folder(path) for path in touched}
    folders, ids, names = set(models), {id_of(path) for path in touched}, set[tuple[str, str]]()
    # Aliases and labels of the changed entries, and the entries that they supersede.
    for path, data in zip(own, repo.read_many([*own.values()]), strict=True):
        entry = parsed_or_error(path, data, require_digest=False)
        for _, kind, word, _ in said(path, entry) if isinstance(entry, Entry) else ():
            names.add((kind, word))
            if kind == ALIAS:
                folders.add(claimed_folder(word).rstrip("/"))
            elif kind == SUPERSEDES:
                folders.add(model_folder(f"{ROOT}{word}{SUFFIX}"))
    # Entries that refer to a changed one.
    claims = [one for kind in (ALIAS, LABEL) for one in index.mentions(kind) if (kind, one[2]) in names]
    claims += [one for one in index.mentions(ALIAS) if claimed_folder(one[2])[:-1] in models]
    claims += [one for one in index.mentions(SUPERSEDES) if one[2] in ids]
    folders |= {model_folder(path) for path, *_ in claims}
    # A proposal affects only the entry that it will replace.
    return repo.listing(commit, *sorted(folders)) | own
