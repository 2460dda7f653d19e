"""Checks of a registry: its entries, files, statements and configuration, at a commit, in a folder or over a range."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Annotated, Final, Literal, Self

from calibrary.errors import InputError, RegistryError
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace
from calibrary.registry.configuration import Configuration, configuration_at
from calibrary.registry.entry import Entry
from calibrary.registry.entry_checks import Judge, check, check_order, finding_of, in_order
from calibrary.registry.entry_yaml import TURNS
from calibrary.registry.git.history import changed, commit_at, not_files, parse_rev
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS, EVENTS, SUFFIX, file_path, is_entry, is_proposal
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity


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


class CheckedEntries(Mapping[str, Entry]):
    """Entries by name, read in blocks on demand, so that even many need little memory.

    Attributes:
        unreadable: error of each entry that could not be read.
    """

    def __init__(self, snapshot: Snapshot, progress: Progress | None = None) -> None:
        self.unreadable: dict[str, InputError] = {}
        self._snapshot, self._progress = snapshot, progress
        self._order = sorted((*snapshot.paths, *snapshot.proposed), key=check_order)
        self._known = frozenset(self._order)
        self._block: Mapping[str, Entry | InputError] = {}
        self._next = 0

    def __getitem__(self, name: str) -> Entry:
        if name not in self._known:
            raise KeyError(name)
        found = self._block.get(name)
        if found is None and self._next < len(self._order) and self._order[self._next] == name:
            names = self._order[self._next : self._next + BLOCK]
            self._block = dict(self._snapshot.parsed(names))
            self._next += len(names)
            if self._progress is not None:
                self._progress(self._next, len(self._order))
            found = self._block[name]
        # Out of order, for a reference from another entry.
        found = found or next(self._snapshot.parsed([name]))[1]
        if isinstance(found, InputError):
            self.unreadable[name] = found
            raise found
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._order)

    def __len__(self) -> int:
        return len(self._order)


def _checked(
    snapshot: Snapshot,
    policy: Policy,
    judge: Judge | None,
    progress: Progress | None = None,
    before: Snapshot | None = None,
) -> tuple[int, tuple[Finding, ...]]:
    """Return the number of entries of a state, and what is found on them and their files."""
    entries = CheckedEntries(snapshot, progress)
    former = before.parsed([*before.paths]) if before is not None else ()
    last_approved = {path: one for path, one in former if isinstance(one, Entry) and one.is_usable}
    found = [*check(entries, policy, last_approved, judge)]
    for name, error in entries.unreadable.items():
        is_file = is_proposal(name) or not snapshot.book.rules.approvals.count
        rule = "digest" if error.place == "digest" else "entry" if is_file else "approval"
        found.append(finding_of(file_path(name), rule, str(error)))
    return len(entries), in_order([*found, *_turned(snapshot), *_of_strays(snapshot.strays)])


def _turned(snapshot: Snapshot) -> Iterator[Finding]:
    """Find files that people see in another order than that of their text."""
    for path in snapshot.files:
        with suppress(RegistryError):
            data = snapshot.committed(path)
            turns = None if data.isascii() else TURNS.search(data.decode("utf-8", "replace"))
            if turns is not None:
                message = f"{turns[0]!a} in it turns what people see into another order than that of the text"
                yield finding_of(path, "spelling", f"{message}; take it out", Severity.WARNING)


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
    number, found = _checked(snapshot, policy or snapshot.policy, judge, progress)
    findings = (
        *_not_files(snapshot.repo.listing(snapshot.commit, CAMERAS, EVENTS, irregular=True)),
        *found,
        *_of_statements(snapshot),
        *_of_rules(snapshot.configuration, snapshot.cameras),
    )
    what = f"{count_of(number)} at {snapshot.commit[:12]}"
    return CheckDocument.of(what, number, findings, commit=snapshot.commit)


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
    number, found = _checked(
        replace(snapshot, place=root, repo=None, commit=None), policy or snapshot.policy, judge, progress
    )
    findings = (*found, *_of_rules(snapshot.configuration, snapshot.cameras))
    return CheckDocument.of(f"{count_of(number)} in the folder", number, findings)


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
    """Check the changes between two revisions: what is found after them, and was not before or is of a changed file.

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
    end = commit_at(repo, parse_rev(after)) if after is not None else newest
    at_start, at_end = (replace(snapshot, commit=commit) for commit in (start, end))
    # The rules before the change apply: a pull request cannot loosen the rules for itself.
    policy = policy or at_start.policy
    own = {file.path for file in changed(repo, start, end, CAMERAS) if file.after is not None}
    said = {path for path, _ in at_start.book.findings()}
    _, known = _checked(at_start, policy, judge)
    _, found = _checked(at_end, policy, judge, progress, at_start)
    findings = (
        *_of_configuration(repo, start, end),
        *_not_files(path for folder in (CAMERAS, EVENTS) for path in not_files(repo, start, end, folder)),
        *(one for one in found if one.place in own or one not in known),
        *_removed_statements(repo, start, end),
        *(one for one in _of_statements(at_end) if one.place not in said),
    )
    number = len({*filter(is_entry, own)})
    what = f"{count_of(number)} changed from {start[:12]} to {end[:12]}"
    return CheckDocument.of(what, number, findings, commit=end, before=start)


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


def _of_statements(snapshot: Snapshot) -> Iterator[Finding]:
    """Find statements without effect, and rules that are not in force."""
    book = snapshot.book
    for path, why in book.findings():
        yield _statement(path, f"a statement without effect: it {why}")
    if snapshot.configuration.rules != book.rules:
        yield replace(
            _statement(CONFIGURATION_FILE, "asks for other rules than those in force"),
            remedy="'calibrary registry approve registry.yaml' puts them in force",
        )


def _statement(path: str, message: str) -> Finding:
    return Finding(rule="statement", severity=Severity.WARNING, place=path, message=message)


def _removed_statements(repo: Repository, start: str, end: str) -> Iterator[Finding]:
    """Find statements that a range changes or removes: they are only ever added."""
    for file in changed(repo, start, end, EVENTS):
        if file.before is not None:
            what = "is removed" if file.after is None else "is changed"
            yield replace(
                finding_of(file.path, "statement", f"{what}; statements are only ever added"),
                remedy="take that out of the change; a new statement says what changes",
            )
