"""Checking a registry: all of it, what changed between two revisions, or what lies in the work tree."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final, Literal

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace
from calibrary.registry.approvals import all_said, came_to_use, digest_as_proposed, unmet
from calibrary.registry.check import CheckReport, check, check_order
from calibrary.registry.configuration import CONFIGURATION_FILE, Configuration, configuration_at
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.folder import entry_paths, proposal_paths, read_entry_file
from calibrary.registry.git.history import changed, commit_at, history, parse_rev
from calibrary.registry.git.objects import ObjectId, blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.signatures import signatures
from calibrary.registry.index import (
    ALIAS,
    LABEL,
    SUPERSEDES,
    Index,
    claimed_folder,
    index_at,
    parsed_or_error,
    said,
)
from calibrary.registry.paths import (
    CAMERAS,
    PROPOSALS,
    ROOT,
    SUFFIX,
    check_path,
    id_of,
    in_use_path,
    is_entry,
    is_proposal,
)
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry
from calibrary.validation import Finding, Severity

__all__ = [
    "CheckDocument",
    "Checked",
    "check_all",
    "check_range",
    "check_signatures",
    "check_work_tree",
    "document_of",
    "parse_range",
]

FOLDERS: Final = (CAMERAS, PROPOSALS)
BLOCK: Final = 250
"""Entries that are read at once; one by one, waiting for git takes a third of a check."""

Progress = Callable[[int, int], None]


class CheckDocument(Record, tag_field="schema", tag="calibrary/registry-check-1"):
    """What ``calibrary registry check --json`` prints.

    Attributes:
        verdict: bad where there is an error or an unsigned commit.
        commit: that was checked; None for files that lie in a folder.
        before: where a range begins; None where everything was checked.
        entries: how many were checked.
        findings: in the order of their paths.
        unsigned: commits without a signature by a person on the list, and why; None where that was not asked.
    """

    verdict: Literal["good", "bad"]
    commit: ObjectId | None
    before: ObjectId | None
    entries: Annotated[int, Meta(ge=0)]
    findings: tuple[Finding, ...]
    unsigned: tuple[str, ...] | None


class Checked(Struct, frozen=True, kw_only=True):
    """What a check came to.

    Attributes:
        what: was checked, in words.
        commit: of the entries, None for files that lie somewhere.
        before: where a range begins.
        report: what was found.
    """

    what: str
    commit: str | None
    before: str | None = None
    report: CheckReport


def parse_range(text: str) -> tuple[str, str | None]:
    """The two ends of REV..REV; an end that is left out is the newest commit.

    Raises:
        RegistryError: it is not a range.
    """
    before, dots, after = text.partition("..")
    if not dots or not before or after.startswith("."):
        raise RegistryError(
            f"{text!r} is not a range of revisions, expected REV..REV, such as origin/main..HEAD"
        )
    return before, after or None


def check_all(
    snapshot: Snapshot, policy: Policy | None = None, *, progress: Progress | None = None
) -> Checked:
    """Every entry at the snapshot's commit, or in a plain folder.

    Args:
        snapshot: of the registry.
        policy: in place of the registry's own.
        progress: called with how many entries are done, and of how many.

    Raises:
        RegistryError: the registry cannot be listed.
    """
    if snapshot.repo is None or snapshot.commit is None:
        return check_work_tree(snapshot, policy, progress=progress)
    paths = {**snapshot.paths, **_entries_of(snapshot.proposed)}
    files = _Files(paths, snapshot.read_many, progress, snapshot.contents)
    found = check(files, policy or snapshot.configuration.policy, parse=files.parse)
    report = _completed(found, files, files)
    report = CheckReport(
        entries=report.entries,
        findings=(
            *_no_files(snapshot.repo.irregular(snapshot.commit, *FOLDERS)),
            *report.findings,
            *_never_approved(snapshot, snapshot.repo, snapshot.commit),
        ),
    )
    return Checked(
        what=f"{_entries(len(files))} at {snapshot.commit[:12]}", commit=snapshot.commit, report=report
    )


def _never_approved(snapshot: Snapshot, repo: Repository, commit: str) -> Iterator[Finding]:
    """Entries in use without the approvals that were asked for when they came to use."""
    rule = snapshot.configuration.approvals
    if rule is None:
        return
    said = all_said(repo, commit)
    for stored in snapshot.entries(unreadable=lambda _: None):
        digest = digest_as_proposed(stored.entry)
        if not stored.entry.is_usable or unmet(repo, stored, rule, said.get(digest, ())) is None:
            continue
        first = came_to_use(repo, stored)
        base = first.parents[0] if first is not None and first.parents else None
        then = configuration_at(repo, base).approvals if base is not None else rule
        lacking = unmet(repo, stored, then, said.get(digest, ())) if then is not None else None
        if lacking is not None:
            yield _lacking_approvals(stored.path, stored.entry, lacking)


def _lacking_approvals(path: str, entry: Entry, lacking: str) -> Finding:
    return replace(
        _error(path, "approval", f"is {entry.status.value} with {lacking}"),
        remedy="'calibrary registry approve KEY' records an approval; a status written by hand is none",
    )


def _entries_of(proposed: Mapping[str, str | None]) -> dict[str, str | None]:
    return {path: oid for path, oid in proposed.items() if is_entry(path)}


def _no_files(paths: Iterable[str]) -> Iterator[Finding]:
    for path in paths:
        yield Finding(
            rule="regular-file",
            severity=Severity.ERROR,
            place=path,
            message="is a link or another repository, which nothing here follows; expected a file",
            remedy="take it out",
        )


def check_work_tree(
    snapshot: Snapshot, policy: Policy | None = None, *, progress: Progress | None = None
) -> Checked:
    """The files as they lie in the folder, committed or not.

    Args:
        snapshot: as of :func:`check_all`.
        policy: as of :func:`check_all`.
        progress: as of :func:`check_all`.

    Raises:
        RegistryError: there is no work tree, or it cannot be listed.
    """
    root = snapshot.place
    if snapshot.repo is not None:
        if snapshot.repo.work_tree is None:
            raise RegistryError(f"{snapshot.place}: a bare repository has no work tree; leave out --worktree")
        root = snapshot.repo.work_tree
    files = _Files(
        [*entry_paths(root), *proposal_paths(root)],
        lambda names: (read_entry_file(root, name) for name in names),
        progress,
    )
    report = _completed(check(files, policy or snapshot.configuration.policy), files, files)
    return Checked(what=f"{_entries(len(files))} in the folder", commit=None, report=report)


def check_range(
    snapshot: Snapshot,
    before: str,
    after: str | None,
    policy: Policy | None = None,
    *,
    progress: Progress | None = None,
) -> Checked:
    """What changed between two revisions, and what that means for entries it meets.

    Those it meets are the others of its models, those that claim a name, and those that supersede. What was wrong
    with them before is left out.

    Args:
        snapshot: as of :func:`check_all`.
        before: the revision that was.
        after: the one that is; the snapshot's own when left out.
        policy: as of :func:`check_all`.
        progress: as of :func:`check_all`.

    Raises:
        RegistryError: the registry is a plain folder, or there is no such revision.
    """
    repo, newest = snapshot.require_git("has no revisions; leave out REV..REV")
    start = commit_at(repo, parse_rev(before))
    # A change is judged by the rules that were before it: no pull request loosens its own.
    rules = configuration_at(repo, start)
    policy = policy or rules.policy
    end = commit_at(repo, parse_rev(after)) if after is not None else newest
    differing = [file for folder in FOLDERS for file in changed(repo, start, end, folder)]
    own = {file.path for file in differing if file.after is not None}
    new = _met(repo, end, {file.path: file.after for file in differing})
    old = _met(repo, start, {file.path: file.before for file in differing})
    files = _Files(new, _in_git(repo, new), progress)
    was = _Files(old, _in_git(repo, old))
    former = _former(repo, old, own)
    found = _completed(check(files, policy, former), files, own).findings
    known = set(check(was, policy).findings) if len(own) < len(files) else set()
    findings = tuple(item for item in found if item.place in own or item not in known)
    findings = (
        *_of_configuration(repo, start, end),
        *findings,
        *_unapproved(repo, end, new, own, former, rules),
    )
    return Checked(
        what=f"{_entries(len(own))} changed from {start[:12]} to {end[:12]}",
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


def _unapproved(
    repo: Repository,
    end: str,
    listed: Mapping[str, str],
    own: Collection[str],
    former: Mapping[str, Entry],
    rules: Configuration,
) -> Iterator[Finding]:
    """Entries that came to use without the approvals that the registry asks for."""
    paths = sorted(path for path in own if not is_proposal(path))
    if rules.approvals is None:
        return
    for path, data in zip(paths, repo.read_many([listed[path] for path in paths]), strict=True):
        try:
            entry = parse_entry(data, path)
        except InputError:
            continue
        was = former.get(path)
        if not entry.is_usable or (
            was is not None and was.is_usable and digest_as_proposed(was) == digest_as_proposed(entry)
        ):
            continue
        lacking = unmet(
            repo, StoredEntry(entry=entry, path=path, oid=listed[path], commit=end), rules.approvals
        )
        if lacking is not None:
            yield _lacking_approvals(path, entry, lacking)


def _former(repo: Repository, old: Mapping[str, str], own: Collection[str]) -> dict[str, Entry]:
    """What was in use where something is changed; what cannot be read says nothing."""
    paths = sorted({in_use_path(path) for path in own} & old.keys())
    found = {}
    for path, data in zip(paths, repo.read_many([old[path] for path in paths]), strict=True):
        with suppress(InputError):
            found[path] = parse_entry(data, path)
    return found


def check_signatures(
    snapshot: Snapshot, signers: Path | None, *, before: str | None = None, after: str | None = None
) -> tuple[str, ...]:
    """The commits that no person on the list signed, each with the reason; of all history, or after a revision.

    Args:
        snapshot: of the registry.
        signers: a file as of ssh-keygen(1), "ALLOWED SIGNERS"; without one only OpenPGP keys are known.
        before: the revision after which commits count; all of them when left out.
        after: the last revision; the snapshot's own when left out.

    Raises:
        RegistryError: the registry is a plain folder, or git cannot tell.
    """
    repo, newest = snapshot.require_git("has no commits to be signed")
    end = commit_at(repo, parse_rev(after)) if after is not None else newest
    span = f"{commit_at(repo, parse_rev(before))}..{end}" if before is not None else end
    commits = [revision.commit for revision in history(repo, None, span)]
    return tuple(str(found) for found in signatures(repo, commits, signers) if not found.is_good)


def document_of(done: Checked, unsigned: tuple[str, ...] | None) -> CheckDocument:
    """A check, and the commits that are not signed by a person on the list; None where that was not asked."""
    return CheckDocument(
        verdict="good" if done.report.is_good and not unsigned else "bad",
        commit=done.commit,
        before=done.before,
        entries=done.report.entries,
        findings=done.report.findings,
        unsigned=unsigned,
    )


class _Files(Mapping[str, bytes]):
    """Entries that are read some hundred at a time as they are asked for, so that a hundred thousand need no memory.

    Attributes:
        unreadable: files that could not be read, with the reason; they have no content here.
    """

    def __init__(
        self,
        paths: Collection[str],
        read: Callable[[Sequence[str]], Iterable[bytes]],
        progress: Progress | None = None,
        index: Index | None = None,
    ) -> None:
        self.unreadable: dict[str, str] = {}
        self._index = index
        self._entries: Mapping[str, Entry | InputError] = {}
        self._order = sorted(paths, key=check_order)
        self._known = frozenset(paths)
        self._read = read
        self._progress = progress
        self._block: Mapping[str, bytes] = {}
        self._next = 0

    def __getitem__(self, path: str) -> bytes:
        if path not in self._known:
            raise KeyError(path)
        found = self._block.get(path)
        if found is not None:
            return found
        if self._next < len(self._order) and self._order[self._next] == path:
            names = self._order[self._next : self._next + BLOCK]
            self._block = self._had(names)
            self._entries = self._parsed(self._block)
            self._next += len(names)
            if self._progress is not None:
                self._progress(self._next, len(self._order))
            return self._block[path]
        # Another entry speaks of this one, out of turn.
        return self._had([path])[path]

    def _parsed(self, block: Mapping[str, bytes]) -> dict[str, Entry | InputError]:
        """The entries of a block as an earlier run has read them, by the id that their bytes have now."""
        if self._index is None:
            return {}
        return dict(self._index.parsed((blob_id(data), path, data) for path, data in block.items()))

    def parse(self, data: bytes, path: str) -> Entry:
        """The entry in a file of these.

        Raises:
            InputError: as of :func:`parse_entry`.
        """
        found = self._entries.get(path) if self._block.get(path) == data else None
        if isinstance(found, InputError):
            raise found
        return found if found is not None else parse_entry(data, path)

    def _had(self, names: Sequence[str]) -> dict[str, bytes]:
        try:
            return dict(zip(names, self._read(names), strict=True))
        except RegistryError as error:
            if len(names) > 1:
                return {name: self._had([name])[name] for name in names}
            self.unreadable[names[0]] = str(error)
            return {names[0]: b""}

    def __iter__(self) -> Iterator[str]:
        return iter(self._order)

    def __len__(self) -> int:
        return len(self._order)


def _in_git(repo: Repository, listed: Mapping[str, str]) -> Callable[[Sequence[str]], Iterable[bytes]]:
    return lambda names: repo.read_many([listed[name] for name in names])


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"


def _completed(report: CheckReport, files: _Files, paths: Iterable[str]) -> CheckReport:
    """With files that could not be read, and those that no registry could have written.

    A name may be one that some disk or git would stumble over, whatever is in the file.
    """
    listed = [finding for finding in report.findings if finding.place not in files.unreadable]
    listed += [_error(path, "entry", message) for path, message in files.unreadable.items()]
    for path in paths:
        try:
            check_path(path)
        except RegistryError as error:
            listed.append(_error(path, "place", f"{error}; move it"))
    listed.sort(key=lambda finding: (finding.place or "", finding.rule, finding.message))
    return CheckReport(entries=report.entries, findings=tuple(listed))


def _error(path: str, rule: str, message: str) -> Finding:
    said = message.removeprefix(f"{path}: ")
    return Finding(rule=rule, severity=Severity.ERROR, place=path, message=said)


def _met(repo: Repository, commit: str, touched: Mapping[str, str | None]) -> dict[str, str]:
    """The id, by path, of the changed entries of a state, and of every other that one of them may meet.

    These are what lies beside it for its models, what claims a name of theirs or is claimed by them, and what
    supersedes them or is superseded, and what has the label of one. No other entry is read, however many there are.
    """
    own = {path: oid for path, oid in touched.items() if oid is not None}
    index, models = index_at(repo, commit), {_model(path) for path in touched}
    folders, ids, names = set(models), {id_of(path) for path in touched}, set[tuple[str, str]]()
    # What one of them claims, supersedes or is called by.
    for path, data in zip(own, repo.read_many([*own.values()]), strict=True):
        entry = parsed_or_error(path, data, require_digest=False)
        for _, kind, word, _ in said(path, entry) if isinstance(entry, Entry) else ():
            names.add((kind, word))
            if kind == ALIAS:
                folders.add(claimed_folder(word).rstrip("/"))
            elif kind == SUPERSEDES:
                folders.add(_model(f"{ROOT}{word}{SUFFIX}"))
    # What speaks of one of them.
    claims = [one for kind in (ALIAS, LABEL) for one in index.mentions(kind) if (kind, one[2]) in names]
    claims += [one for one in index.mentions(ALIAS) if claimed_folder(one[2])[:-1] in models]
    claims += [one for one in index.mentions(SUPERSEDES) if one[2] in ids]
    folders |= {_model(path) for path, *_ in claims}
    # A proposal meets nothing but what it is to replace.
    return repo.listing(commit, *sorted(folders)) | own


def _model(path: str) -> str:
    return "/".join(in_use_path(path).split("/")[:3])
