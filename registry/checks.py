"""Reading of the checked entries' files in blocks."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from itertools import groupby
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import msgspec

from calibrary import errors
from calibrary.errors import InputError, RegistryError
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace
from calibrary.registry.configuration import UNPROVEN, Configuration, configuration_at
from calibrary.registry.contents import (
    ALIAS,
    FOLDERS,
    LABEL,
    SUPERSEDES,
    Contents,
    alias_folder,
    parsed_or_error,
    stated_names,
)
from calibrary.registry.entry import Entry
from calibrary.registry.entry_checks import Checked, Judge, check, check_order, finding_of, in_order
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import changed, commit_at, not_files, parse_rev
from calibrary.registry.git.objects import ObjectId, blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import (
    ROOT,
    STATEMENTS,
    SUFFIX,
    id_of,
    in_use_path,
    is_entry,
    is_proposal,
    model_folder,
)
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.registry.snapshot import Snapshot, paths_below, read_entry_file
from calibrary.registry.standing import UNREAD, Standing
from calibrary.registry.statements import subject_of
from calibrary.validation import Finding, Severity
from calibrary.version import __version__


class CheckDocument(Record, tag_field="schema", tag="calibrary/registry-check-1"):
    """Output of ``calibrary registry check --json``.

    Attributes:
        verdict: bad if there is an error.
        commit: checked commit; None for files in a folder.
        before: start of the checked range; None if everything was checked.
        entries: number of checked entries.
        findings: findings, sorted by path.
        what: description of what was checked.
    """

    verdict: Literal["good", "bad"]
    commit: ObjectId | None
    before: ObjectId | None
    entries: Annotated[int, Meta(ge=0)]
    findings: tuple[Finding, ...]
    what: str = ""
    _unwritten = frozenset({"what"})

    @property
    def is_good(self) -> bool:
        """Whether there is no error; there may be warnings."""
        return self.verdict == "good"

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings with severity error."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    @classmethod
    def of(
        cls,
        what: str,
        entries: int,
        findings: tuple[Finding, ...],
        *,
        commit: str | None = None,
        before: str | None = None,
    ) -> Self:
        """Make the result of a check of so many entries."""
        is_bad = any(finding.severity is Severity.ERROR for finding in findings)
        return cls(
            verdict="bad" if is_bad else "good",
            commit=commit,
            before=before,
            entries=entries,
            findings=findings,
            what=what,
        )


def count_of(count: int) -> str:
    """Return a number of entries in words."""
    return "1 entry" if count == 1 else f"{count} entries"


BLOCK: Final = 200
"""Number of entries that are read together and in memory."""

Progress = Callable[[int, int], None]
_CHECKED: Final = msgspec.msgpack.Decoder(Checked)


class EntryFiles(Mapping[str, bytes]):
    """Entries by path, read in blocks on demand, so that even 100 000 entries need little memory.

    Attributes:
        unreadable: reason for each file that could not be read; its content is empty.
    """

    def __init__(
        self,
        paths: Collection[str],
        read: Callable[[Sequence[str]], Iterable[bytes]],
        progress: Progress | None = None,
        contents: Contents | None = None,
    ) -> None:
        self.unreadable: dict[str, str] = {}
        self._parsed = contents.parsed if contents is not None else None
        self._entries: Mapping[str, Entry | InputError] | None = None
        self._order = sorted(paths, key=check_order)
        self._known = frozenset(paths)
        self._read = read
        self._progress = progress
        self._block: Mapping[str, bytes] = {}
        self._next = 0

    @classmethod
    def in_git(cls, repo: Repository, listed: Mapping[str, str], progress: Progress | None = None) -> Self:
        """Read entries by their blob ids."""
        return cls(listed, lambda names: repo.objects([listed[name] for name in names]), progress)

    def __getitem__(self, path: str) -> bytes:
        if path not in self._known:
            raise KeyError(path)
        found = self._block.get(path)
        if found is not None:
            return found
        if self._next < len(self._order) and self._order[self._next] == path:
            names = self._order[self._next : self._next + BLOCK]
            self._block, self._entries = self._contents(names), None
            self._next += len(names)
            if self._progress is not None:
                self._progress(self._next, len(self._order))
            return self._block[path]
        # Out of order, for a reference from another entry.
        return self._contents([path])[path]

    def parse(self, data: bytes, path: str) -> Entry:
        """Return the entry of one of these files.

        Raises:
            InputError: as for :func:`parse_entry`.
        """
        if self._entries is None:
            block = ((blob_id(data), path, data) for path, data in self._block.items())
            self._entries = dict(self._parsed(block)) if self._parsed is not None else {}
        found = self._entries.get(path) if self._block.get(path) == data else None
        if isinstance(found, InputError):
            raise found
        return found if found is not None else parse_entry(data, path)

    def _contents(self, names: Sequence[str]) -> dict[str, bytes]:
        try:
            return dict(zip(names, self._read(names), strict=True))
        except RegistryError as error:
            if len(names) > 1:
                return {name: self._contents([name])[name] for name in names}
            self.unreadable[names[0]] = str(error)
            return {names[0]: b""}

    def __iter__(self) -> Iterator[str]:
        return iter(self._order)

    def __len__(self) -> int:
        return len(self._order)


def completed(findings: Iterable[Finding], files: EntryFiles) -> tuple[Finding, ...]:
    """Add findings on unreadable files."""
    listed = [finding for finding in findings if finding.place not in files.unreadable]
    listed += [finding_of(path, "entry", message) for path, message in files.unreadable.items()]
    return in_order(listed)


def _of_strays(paths: Iterable[str]) -> Iterator[Finding]:
    """Find files beside the entries: one that looks like an entry is an error, as somebody may rely on it."""
    for path in paths:
        is_meant = path.endswith(SUFFIX)
        add = "'calibrary registry add FILE' puts its K where it belongs; then take the file out"
        yield Finding(
            rule="stray",
            severity=Severity.ERROR if is_meant else Severity.WARNING,
            place=path,
            message="no camera's KEY gives this path, so that nothing reads the file",
            remedy=add if is_meant else "take it out",
        )


def check_all(
    snapshot: Snapshot,
    policy: Policy | None = None,
    judge: Judge | None = None,
    *,
    progress: Progress | None = None,
) -> CheckDocument:
    """Check every entry at the snapshot's commit, or in a plain folder.

    Args:
        snapshot: state of the registry.
        policy: policy to use instead of the registry's own.
        judge: weighs each K against what is known of its camera; None leaves that out.
        progress: called with (entries done, number of entries).

    Raises:
        RegistryError: the registry cannot be listed.
    """
    if snapshot.repo is None or snapshot.commit is None:
        return check_work_tree(snapshot, policy, judge, progress=progress)
    oids = {**snapshot.paths, **snapshot.proposed}
    paths = [path for path, oid in oids.items() if oid is not None]
    files = EntryFiles(paths, snapshot.committed_many, progress, snapshot.contents)
    policy = policy or snapshot.configuration.policy
    keys = _content_keys(oids, paths, policy, judge)
    kept = snapshot.contents.cache.get(_CHECKED, keys.values())
    known = {folder: kept[key] for folder, key in keys.items() if key in kept}
    before = {*known}
    found = check(files, policy, parse=files.parse, judge=judge, known=known)
    before |= {*map(model_folder, files.unreadable)}
    snapshot.contents.cache.keep({keys[folder]: known[folder] for folder in known.keys() - before})
    findings = (
        *_not_files(snapshot.repo.listing(snapshot.commit, *FOLDERS, STATEMENTS, irregular=True)),
        *completed(found, files),
        *_of_strays(snapshot.strays),
        *of_statements(snapshot),
        *_of_rules(snapshot.configuration, snapshot.paths),
    )
    what = f"{count_of(len(files))} at {snapshot.commit[:12]}"
    return CheckDocument.of(what, len(files), findings, commit=snapshot.commit)


def _of_rules(rules: Configuration, paths: Collection[str]) -> Iterator[Finding]:
    """Find damage of the configuration, and rules of when to calibrate again that are on none of the entries."""
    if rules.damage is not None:
        yield finding_of(CONFIGURATION_FILE, "configuration", rules.damage)
    for rule in rules.repeat:
        if not any(map(rule.is_on, paths)):
            yield Finding(
                rule="configuration",
                severity=Severity.WARNING,
                place=CONFIGURATION_FILE,
                message=f"repeat: no KEY begins with {rule.of}, so it says nothing",
                remedy="write it as 'calibrary registry list' does",
            )


def _content_keys(
    oids: Mapping[str, str | None], paths: Iterable[str], policy: Policy, judge: Judge | None
) -> dict[str, str]:
    """Return for each model, by its folder, a name of all that the findings on its entries follow from."""
    package = os.walk(Path(errors.__file__).parent, followlinks=True)
    # What Python compiles when it is first asked for changes no finding.
    folders = ((folder, names) for folder, _, names in package if not folder.endswith("__pycache__"))
    times = (os.lstat(Path(folder, name)).st_mtime_ns for folder, names in folders for name in names)
    newest = max(times, default=0)
    rules = f"{__version__} {newest} {judge is not None} {policy}"
    return {
        folder: f"checked {_digest(rules, *(f'{path} {oids[path]}' for path in group))}"
        for folder, group in groupby(sorted(paths, key=check_order), key=model_folder)
    }


def _digest(*lines: str) -> str:
    return sha256("\n".join(lines).encode()).hexdigest()


def check_work_tree(
    snapshot: Snapshot,
    policy: Policy | None = None,
    judge: Judge | None = None,
    *,
    progress: Progress | None = None,
) -> CheckDocument:
    """Check the files in the folder, committed or not.

    Args:
        snapshot: as for :func:`check_all`.
        policy: as for :func:`check_all`.
        judge: as for :func:`check_all`.
        progress: as for :func:`check_all`.

    Raises:
        RegistryError: there is no work tree, or it cannot be listed.
    """
    root = snapshot.place
    if snapshot.repo is not None:
        if snapshot.repo.work_tree is None:
            raise RegistryError(f"{snapshot.place}: a bare repository has no work tree; leave out --worktree")
        root = snapshot.repo.work_tree
    every = paths_below(root)
    paths = [*filter(is_entry, every)]
    files = EntryFiles(paths, lambda names: (read_entry_file(root, name) for name in names), progress)
    findings = (
        *completed(check(files, policy or snapshot.configuration.policy, judge=judge), files),
        *_of_strays(path for path in every if not is_entry(path)),
        *_of_rules(snapshot.configuration, paths),
    )
    return CheckDocument.of(f"{count_of(len(files))} in the folder", len(files), findings)


def _not_files(paths: Iterable[str]) -> Iterator[Finding]:
    for path in paths:
        yield Finding(
            rule="regular-file",
            severity=Severity.ERROR,
            place=path,
            message="is a link or another repository, which nothing here follows; expected a file",
            remedy="take it out",
        )


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
    judge: Judge | None = None,
    *,
    progress: Progress | None = None,
) -> CheckDocument:
    """Check the changes between two revisions, and the entries that they affect.

    Affected are other entries of the same models, those with the same alias or label, and those that supersede a
    changed entry or are superseded by it. Errors that existed before the change are not reported.

    Args:
        snapshot: as for :func:`check_all`.
        before: first revision.
        after: second revision; by default that of the snapshot.
        policy: as for :func:`check_all`.
        judge: as for :func:`check_all`.
        progress: as for :func:`check_all`.

    Raises:
        RegistryError: the registry is a plain folder, or a revision does not exist.
    """
    repo, newest = snapshot.require_git("has no revisions; leave out REV..REV")
    start = commit_at(repo, parse_rev(before))
    # The rules before the change apply: a pull request cannot loosen the rules for itself.
    rules = configuration_at(repo, start) or Configuration()
    policy = policy or rules.policy
    end = commit_at(repo, parse_rev(after)) if after is not None else newest
    at_end = replace(snapshot, commit=end) if end != newest else snapshot
    every = [file for folder in FOLDERS for file in changed(repo, start, end, folder)]
    differing = [file for file in every if is_entry(file.path)]
    own = {file.path for file in differing if file.after is not None}
    new = _affected(repo, end, {file.path: file.after for file in differing})
    old = _affected(repo, start, {file.path: file.before for file in differing})
    files = EntryFiles.in_git(repo, new, progress)
    earlier_files = EntryFiles.in_git(repo, old)
    before_change = _before(repo, old, own)
    found = completed(check(files, policy, before_change, judge=judge), files)
    known = set(check(earlier_files, policy, judge=judge)) if len(own) < len(files) else set()
    findings = tuple(item for item in found if item.place in own or item not in known)
    findings = (
        *_of_configuration(repo, start, end),
        *_not_files(
            path for folder in (*FOLDERS, STATEMENTS) for path in not_files(repo, start, end, folder)
        ),
        *findings,
        *_of_strays(file.path for file in every if file.after is not None and not is_entry(file.path)),
        *_removed_statements(repo, start, end),
        *of_statements(
            at_end, sorted(_concerned(repo, start, end, {file.path for file in differing}, at_end))
        ),
    )
    what = f"{count_of(len(own))} changed from {start[:12]} to {end[:12]}"
    return CheckDocument.of(what, len(own), findings, commit=end, before=start)


def _concerned(
    repo: Repository, start: str, end: str, own: Collection[str], at_end: Snapshot
) -> Iterator[str]:
    """Yield the entries whose standing a range may change."""
    yield from (path for path in own if not is_proposal(path) and path in at_end.paths)
    for file in changed(repo, start, end, STATEMENTS):
        path = f"{file.path.removeprefix(STATEMENTS).rpartition('/')[0]}{SUFFIX}"
        if path in at_end.paths and path not in own:
            yield path


def _of_configuration(repo: Repository, start: str, end: str) -> Iterator[Finding]:
    said = configuration_at(repo, end)
    if said is not None and said.damage is not None:
        yield finding_of(CONFIGURATION_FILE, "configuration", said.damage)
    files = [repo.read(commit, CONFIGURATION_FILE) for commit in (start, end)]
    if files[0] is not None and (files[1] is None or files[0].oid != files[1].oid):
        yield Finding(
            rule="configuration",
            severity=Severity.WARNING,
            place=CONFIGURATION_FILE,
            message=f"changes; the policy of this range is that of {start[:12]}, and of the next one what it says now",
        )


def _before(repo: Repository, old: Mapping[str, str], own: Collection[str]) -> dict[str, Entry]:
    """Return the entries before the change, by path, without those that cannot be read: they are reported as such."""
    paths = sorted({in_use_path(path) for path in own} & old.keys())
    contents = repo.readable([old[path] for path in paths])
    found = ((path, parsed_or_error(path, data)) for path, data in zip(paths, contents, strict=True))
    return {path: entry for path, entry in found if isinstance(entry, Entry)}


def _affected(repo: Repository, commit: str, touched: Mapping[str, str | None]) -> dict[str, str]:
    """Return the blob ids, by path, of the changed entries at a commit and of the entries that they may affect.

    Affected are entries of the same models, those with the same alias or label, and those that supersede a changed
    entry or are superseded by it. No other entry is read.
    """
    own = {path: oid for path, oid in touched.items() if oid is not None}
    contents, models = Contents(repo, commit), {model_folder(path) for path in touched}
    folders, ids, names = set(models), {id_of(path) for path in touched}, set[tuple[str, str]]()
    # Aliases and labels of the changed entries, and the entries that they supersede.
    for path, data in zip(own, repo.readable([*own.values()]), strict=True):
        entry = parsed_or_error(path, data, require_digest=False)
        for _, kind, word, _ in stated_names(path, entry) if isinstance(entry, Entry) else ():
            names.add((kind, word))
            if kind == ALIAS:
                folders.add(alias_folder(word).rstrip("/"))
            elif kind == SUPERSEDES:
                folders.add(model_folder(f"{ROOT}{word}{SUFFIX}"))
    # Entries that refer to a changed one.
    claims = [one for kind in (ALIAS, LABEL) for one in contents.mentions(kind) if (kind, one[2]) in names]
    claims += [one for one in contents.mentions(ALIAS) if alias_folder(one[2])[:-1] in models]
    claims += [one for one in contents.mentions(SUPERSEDES) if one[2] in ids]
    folders |= {model_folder(path) for path, *_ in claims}
    # A proposal affects only the entry that it will replace.
    listed = repo.listing(commit, *sorted(folders))
    return {path: oid for path, oid in listed.items() if is_entry(path)} | own


def of_statements(snapshot: Snapshot, paths: Iterable[str] | None = None) -> Iterator[Finding]:
    """Find entries whose files differ from what is in force, and statements without effect.

    Args:
        snapshot: state of a registry in git.
        paths: paths of entries; all, and all statements, if not given.
    """
    if not snapshot.is_stated:
        if snapshot.configuration.approvals is not None:
            yield replace(
                finding_of(CONFIGURATION_FILE, "approval", f"asks for approvals, but {UNPROVEN}"),
                remedy="calibrary registry init FOLDER",
            )
        return
    wanted = [*snapshot.paths] if paths is None else [*paths]
    for path, standing in snapshot.standings(wanted).items():
        yield from _of_standing(path, standing)
    book = snapshot.book
    for path, why in book.findings(map(subject_of, wanted) if paths is not None else None):
        yield _statement(path, f"a statement without effect: it {why}")
    if paths is not None:
        return
    if snapshot.configuration.rules != book.rulebook.people.rules:
        yield replace(
            _statement(CONFIGURATION_FILE, "asks for other approvals than those in force"),
            remedy="'calibrary registry approve registry.yaml' puts them in force",
        )


def _of_standing(path: str, standing: Standing) -> Iterator[Finding]:
    if standing.problem is not None:
        yield finding_of(path, "approval", standing.problem.removeprefix(f"{path}: "))
    elif standing.remark is not None:
        # What cannot be read cannot be approved; its reader says what to do.
        approve = "'calibrary registry approve KEY' approves it; what is written by hand is not used"
        remedy = None if standing.remark.startswith(UNREAD) else approve
        yield replace(finding_of(path, "approval", standing.remark), remedy=remedy)
    elif standing.data is not None and standing.differs:
        yield replace(
            _statement(path, "its file and the statements on it differ: the statements count"),
            remedy="'calibrary registry show KEY' shows what is in force",
        )


def _statement(path: str, message: str) -> Finding:
    return Finding(rule="statement", severity=Severity.WARNING, place=path, message=message)


def _removed_statements(repo: Repository, start: str, end: str) -> Iterator[Finding]:
    """Find statements that a range changes or removes: they are only ever added."""
    for file in changed(repo, start, end, STATEMENTS):
        if file.before is not None:
            what = "is removed" if file.after is None else "is changed"
            yield replace(
                finding_of(file.path, "statement", f"{what}; statements are only ever added"),
                remedy="take that out of the change; a new statement says what changes",
            )
