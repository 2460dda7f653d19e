"""What readers get of an entry: what its statements put in force, beside its file.

The file in ``cameras/`` is a copy of what is in force, for people; where the two differ, readers get what is in force,
and a remark.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import date, timedelta
from typing import Final

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.repository import Repository
from calibrary.registry.in_force import MOST, Content, InForce, Rulebook, in_force, label_of
from calibrary.registry.paths import ROOT, STATEMENTS, id_of, unit_folder
from calibrary.registry.statements import (
    RULES,
    Broken,
    Signed,
    content_of,
    entry_in,
    may_end,
    parse_statement,
    subject_in,
)

UNREAD: Final = "its file cannot be read"


class Book:
    """The statements at one commit.

    Attributes:
        rulebook: the rules.
    """

    def __init__(
        self, repo: Repository, commit: str, *, known: str | None = None, followed: Collection[str] = ()
    ) -> None:
        """Read the rules.

        Args:
            repo: repository of the registry.
            commit: 40 hexadecimal digits.
            known: id of the foundation, if this reader has seen it before.
            followed: ids of the rules that this reader has seen in force.

        Raises:
            RegistryError: the foundation is missing, or is not one.
        """
        self._repo, self._commit = repo, commit
        self._every: Mapping[str, list[Signed | Broken]] | None = None
        self.rulebook: Final = Rulebook.of(self.statements(RULES), known, followed)

    def statements(self, subject: str) -> list[Signed | Broken]:
        """Return the statements on one subject."""
        if self._every is not None and subject != RULES:
            return self._every.get(subject, [])
        files = self._repo.listing(self._commit, f"{STATEMENTS}{subject}")
        own = {path: oid for path, oid in files.items() if subject_in(path) == subject}
        if len(own) > MOST:
            return [Broken(path=path, why="is one of too many") for path in own]
        return [*self._read({path: own[path] for path in sorted(own)})]

    def _read(self, files: Mapping[str, str]) -> Iterator[Signed | Broken]:
        try:
            contents = [*self._repo.objects([*files.values()])]
        except RegistryError:
            for path, oid in files.items():
                try:
                    yield parse_statement(path, self._repo.blob(oid))
                except RegistryError as error:
                    yield Broken(path=path, why=str(error), ends=may_end(path))
            return
        for path, data in zip(files, contents, strict=True):
            yield parse_statement(path, data)

    def read_all(self) -> Mapping[str, list[Signed | Broken]]:
        """Return all statements on entries and labels by their subject, then kept, for a reader of many."""
        if self._every is None:
            files = self._repo.listing(self._commit, STATEMENTS)
            found: dict[str, list[Signed | Broken]] = {}
            kept = {path: oid for path, oid in files.items() if subject_in(path) != RULES}
            for path, one in zip(kept, self._read(kept), strict=True):
                found.setdefault(subject_in(path), []).append(one)
            self._every = found
        return self._every

    def in_force(
        self,
        subject: str,
        statements: Sequence[Signed | Broken] | None = None,
        *,
        expected: Collection[str] = (),
    ) -> InForce:
        """Return what is in force of an entry.

        Args:
            subject: subject of the entry.
            statements: statements on it; by default those at this commit.
            expected: ids of statements that this reader has seen before.
        """
        said = self.statements(subject) if statements is None else statements
        there = {one.id: one for one in said}
        if gone := {*expected} - there.keys():
            return InForce(
                problem=f"statement {min(gone)} on it was there before and is gone; git revert or 'calibrary registry "
                "sync' restores it"
            )
        broken = [one for one in map(there.__getitem__, expected) if isinstance(one, Broken)]
        if broken:
            return InForce(
                problem=f"a statement on it is damaged: {broken[0].path} {broken[0].why}; git revert restores it"
            )
        return in_force(self.rulebook, said)

    def label(self, subject: str) -> str | None:
        """Return the label in force of a unit; None if it has none, or two at the same time."""
        return label_of(self.rulebook, self.statements(subject))

    def findings(self, subjects: Iterable[str] | None = None) -> Iterator[tuple[str, str]]:
        """Yield path and reason of each statement without effect; of some subjects, or of all and the rules."""
        if subjects is None:
            yield from self.rulebook.problems
        for statements in self.read_all().values() if subjects is None else map(self.statements, subjects):
            for one in statements:
                why = one.why if isinstance(one, Broken) else self.rulebook.why_not(one)
                if why is not None:
                    yield one.path, why


LABELS: Final = "labels/"


class Evidence(Struct, frozen=True, kw_only=True):
    """An approval that counts.

    Attributes:
        path: path of the statement.
        by, email: who approved.
        made: when, as stated.
        reason: why.
    """

    path: str
    by: str
    email: str
    made: str
    reason: str | None = None


class Standing(Struct, frozen=True, kw_only=True):
    """What is in force of an entry, beside its file at a commit.

    Attributes:
        data: file to read in place of the one in the tree; None if that one is in force.
        remark: what differs, in words.
        problem: why nobody can say what is in force; nothing is read then.
        differs: whether the file says something else by hand, and not because a statement ends later than it says.
        approvals: its approvals.
        former: contents that were in use and are not retired, with the first day of a retirement.
    """

    data: bytes | None = None
    remark: str | None = None
    problem: str | None = None
    differs: bool = False
    approvals: tuple[Evidence, ...] = ()
    former: tuple[tuple[str, date | None], ...] = ()

    def was_approved(self, entry: Entry) -> Entry | None:
        """Return an earlier revision as it may be used today; None if it never was approved, or was retired."""
        starts = dict(self.former)
        content = content_of(entry)
        if content not in starts:
            return None
        return until(replace(entry, status=Status.APPROVED), starts[content])


def label_subject(path: str) -> str:
    """Return the subject of the statements on the label of an entry: its unit, else the entry."""
    unit = unit_folder(path)
    return LABELS + (unit.removeprefix(ROOT).rstrip("/") if unit is not None else id_of(path))


def standing_of(
    book: Book,
    path: str,
    stated: Entry | None,
    found: InForce,
    proposed: Entry | None = None,
    *,
    has_file: bool = True,
) -> Standing:
    """Return what readers get of an entry.

    Args:
        book: the statements at the commit.
        path: path of the entry in ``cameras/``.
        stated: the entry in its file; None if that cannot be read.
        found: what the statements put in force of it.
        proposed: the proposal for it, whose file shows what is approved until somebody moves it.
        has_file: whether there is a file.
    """
    ends = ((one.says, found.end_of(one)) for one in found.approved.values())
    former = tuple((says, end) for says, end in ends if end != date.min)
    try:
        content = found.on()
        entry = _approved(content, path) if content is not None else None
    except (RegistryError, InputError) as error:
        return Standing(problem=f"{path}: {error}")
    if content is None or entry is None:
        return _unapproved(stated, found, former)
    is_here = stated is not None and content_of(stated) == content.says
    is_proposed = proposed is not None and content_of(proposed) == content.says
    approvals = sorted(found.approvals[content.id], key=lambda one: (one.body.made, one.id))
    reason = next((one.body.reason for one in reversed(approvals) if one.body.reason), None)
    base = stated if is_here else proposed if is_proposed else _described(entry, stated)
    plain, label = _with_status(base or entry, Status.APPROVED, reason), book.label(label_subject(path))
    plain = replace(plain, label=label) if label != plain.label else plain
    entry = until(plain, found.end_of(content))
    remark = None
    if not is_here and not is_proposed and (has_file or proposed is None):
        newer = "its file says something newer, which nothing that counts approves"
        what = newer if stated is not None else UNREAD if has_file else "its file is gone"
        remark = f"{what}: the last approved revision is used"
    return Standing(
        data=entry_yaml(entry) if entry != stated else None,
        remark=remark,
        differs=stated is not None and plain != stated,
        approvals=tuple(
            Evidence(
                path=one.path,
                by=one.body.person,
                email=one.body.email,
                made=one.body.made,
                reason=one.body.reason,
            )
            for one in approvals
        ),
        former=former,
    )


def _approved(content: Content, path: str) -> Entry:
    """Return the entry of a content.

    Raises:
        InputError: it is none, or of another camera.
    """
    entry = entry_in(content.entry, path)
    if entry.path != path:
        raise InputError(f"what is approved of it is of {entry.id}")
    return entry


def _described(entry: Entry, stated: Entry | None) -> Entry:
    """Return an entry with what no approval covers, as its file says it."""
    if stated is None:
        return entry
    notes = replace(entry.calibration, notes=stated.calibration.notes)
    return replace(entry, calibration=notes, tags=stated.tags)


def _unapproved(
    stated: Entry | None, found: InForce, former: tuple[tuple[str, date | None], ...]
) -> Standing:
    status = Status.RETIRED if found.ends else Status.DRAFT
    ends = sorted(found.ends, key=lambda one: (one.body.made, one.id))
    reason = ends[-1].body.reason if ends else None
    # A file that cannot be read stays what it is, so that its reader says why.
    entry = _with_status(stated, status, reason) if stated is not None else None
    data = entry_yaml(entry) if entry is not None and entry != stated else None
    is_draft = status is Status.DRAFT and stated is not None and stated.status is not Status.DRAFT
    return Standing(
        data=data,
        remark="nothing that counts approves it" if is_draft else None,
        differs=data is not None,
        former=former,
    )


def _with_status(entry: Entry, status: Status, reason: str | None) -> Entry:
    """Return an entry with the status that is in force; a file of that status keeps its reason."""
    if entry.status is status:
        return entry
    return replace(entry, status=status, reason=(reason or None) if status is not Status.DRAFT else None)


def until(entry: Entry, start: date | None) -> Entry:
    """Return an entry as it is before it is retired from a day on."""
    if start is None:
        return entry
    first, last = (entry.validity.first, entry.validity.last) if entry.validity is not None else (None, None)
    end = start - timedelta(days=1)
    last = min(last, end) if last is not None else end
    if first is not None and last < first:
        return replace(entry, status=Status.RETIRED)
    return replace(entry, validity=Validity(first=first, last=last))
