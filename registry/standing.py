"""What readers get of an entry: what its statements put in force, on every day, and what its file only proposes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import date
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.records import replace
from calibrary.registry.configuration import RuleSet
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.git.errors import TooLargeError
from calibrary.registry.in_force import MOST, Content, InForce, Rulebook, in_force, label_of
from calibrary.registry.paths import EVENTS, ROOT, id_of, unit_folder
from calibrary.registry.statements import (
    RULES,
    Broken,
    Signed,
    approved_of,
    content_of,
    entry_in,
    may_end,
    parse_statement,
    subject_in,
)

Listing: TypeAlias = Callable[[str], Mapping[str, str]]
"""Returns the files of a folder, by path, with the names by which their contents are read."""
Contents: TypeAlias = Callable[[Sequence[str]], Iterable[bytes]]


class Book:
    """The statements of a registry at one state.

    Attributes:
        rulebook: the rules.
    """

    def __init__(
        self,
        listing: Listing,
        contents: Contents,
        *,
        known: str | None = None,
        followed: Collection[str] = (),
        may_be_free: bool = False,
    ) -> None:
        """Read the rules.

        Args:
            listing: lists files.
            contents: reads files.
            known: id of the foundation, if this reader has seen it before.
            followed: ids of the rules that this reader has seen in force.
            may_be_free: whether files without a foundation are used as they are.

        Raises:
            RegistryError: the foundation is missing, or is not one.
        """
        self._listing, self._contents = listing, contents
        self._every: Mapping[str, list[Signed | Broken]] | None = None
        on_rules = self.statements(RULES)
        is_free = may_be_free and not on_rules
        self.rulebook: Final = Rulebook.free() if is_free else Rulebook.of(on_rules, known, followed)

    @property
    def rules(self) -> RuleSet:
        """The rules in force."""
        return self.rulebook.people.rules

    def statements(self, subject: str) -> list[Signed | Broken]:
        """Return the statements on one subject."""
        if self._every is not None and subject != RULES:
            return self._every.get(subject, [])
        files = self._listing(f"{EVENTS}{subject}")
        own = {path: oid for path, oid in files.items() if subject_in(path) == subject}
        if len(own) > MOST:
            return [Broken(path=path, why="is one of too many") for path in own]
        return [*self._read({path: own[path] for path in sorted(own)})]

    def _read(self, files: Mapping[str, str]) -> Iterator[Signed | Broken]:
        try:
            contents = [*self._contents([*files.values()])]
        except RegistryError:
            for path, oid in files.items():
                try:
                    yield parse_statement(path, *self._contents([oid]))
                except TooLargeError as error:
                    yield Broken(path=path, why=str(error), ends=may_end(path))
                except RegistryError as error:
                    # Nobody can say what it was.
                    yield Broken(path=path, why=str(error), ends=True)
            return
        for path, data in zip(files, contents, strict=True):
            yield parse_statement(path, data)

    def read_all(self) -> Mapping[str, list[Signed | Broken]]:
        """Return all statements on entries and labels by their subject, then kept, for a reader of many."""
        if self._every is None:
            files = self._listing(EVENTS)
            found: dict[str, list[Signed | Broken]] = {}
            kept = {path: oid for path, oid in files.items() if subject_in(path) != RULES}
            for path, one in zip(kept, self._read(kept), strict=True):
                found.setdefault(subject_in(path), []).append(one)
            self._every = found
        return self._every

    def in_force(self, subject: str, here: Entry | None = None, *, expected: Collection[str] = ()) -> InForce:
        """Return what is in force of an entry.

        Args:
            subject: subject of the entry.
            here: what its file says.
            expected: ids of statements that this reader has seen before.
        """
        said = self.statements(subject)
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
        content = Content.made(approved_of(here)) if here is not None else None
        return in_force(self.rulebook, said, content)

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
    """What is in force of an entry, and what its file says.

    Attributes:
        entries: what is in force, each for its own days, first that of no particular day; one that is retired, if
            nothing is in force any more; none, if nothing ever was.
        is_here: whether its file says the first of them.
        is_proposed: whether its file says what too few people have approved.
        problem: why nobody can say what is in force; nothing is read then.
        approvals: those of the first entry.
    """

    entries: tuple[Entry, ...] = ()
    is_here: bool = False
    is_proposed: bool = False
    problem: str | None = None
    approvals: tuple[Evidence, ...] = ()

    @property
    def is_used(self) -> bool:
        """Whether anything is in force, or was, or nobody can say."""
        return bool(self.entries) or self.problem is not None


def label_subject(path: str) -> str:
    """Return the subject of the statements on the label of an entry: its unit, else the entry."""
    unit = unit_folder(path)
    return LABELS + (unit.removeprefix(ROOT).rstrip("/") if unit is not None else id_of(path))


def standing_of(book: Book, path: str, file: Entry | InputError | None, found: InForce) -> Standing:
    """Return what readers get of an entry.

    Args:
        book: the statements.
        path: path of the entry.
        file: what its file says, or why it cannot be read; None if there is no file.
        found: what the statements put in force of it.
    """
    stated, is_free = file if isinstance(file, Entry) else None, not book.rules.approvals.count
    try:
        if is_free and isinstance(file, InputError):
            return Standing(problem=str(file))
        content, periods = found.on(), found.periods
        made = {one.id: _approved(one, path) for one in found.approved.values()}
    except (RegistryError, InputError) as error:
        return Standing(problem=f"{path}: {error}")
    says = content_of(stated) if stated is not None else None
    is_known = says in {one.says for one in found.approved.values()}
    waits = says in {one.says for one in found.waiting.values()}
    is_proposed = file is not None and (waits or not is_known)
    label = book.label(label_subject(path))
    if label is None and is_free and stated is not None:
        label = stated.label

    def said(one: Content, status: Status, reason: str | None) -> Entry:
        entry = made[one.id]
        free = stated or entry
        notes = replace(entry.calibration, notes=free.notes)
        return replace(entry, status=status, reason=reason, calibration=notes, tags=free.tags, label=label)

    if content is None or not periods:
        if not found.approved:
            return Standing(is_proposed=is_proposed)
        newest = [one for one in found.approved.values() if one.says == says]
        last = max(newest or found.approved.values(), key=lambda one: (*one.rank, one.id))
        ends = sorted(found.ends, key=lambda one: (one.body.made, one.id))
        retired = said(last, Status.RETIRED, ends[-1].body.reason if ends else None)
        return Standing(entries=(retired,), is_here=last.says == says, is_proposed=is_proposed)
    approvals = sorted(found.approvals.get(content.id, ()), key=lambda one: (one.body.made, one.id))
    reason = next((one.body.reason for one in reversed(approvals) if one.body.reason), None)
    latest = sorted(periods, key=lambda period: period[0] or date.min, reverse=True)
    ordered = sorted(latest, key=lambda period: period[2] is not content)
    entries = [
        replace(
            said(one, Status.APPROVED, reason if one is content else None),
            validity=Validity.between(first, last_day),
        )
        for first, last_day, one in ordered
    ]
    return Standing(
        entries=tuple(entries),
        is_here=ordered[0][2].says == says,
        is_proposed=is_proposed,
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
    )


def _approved(content: Content, path: str) -> Entry:
    """Return the entry of a content.

    Raises:
        InputError: it is none, or of another camera.
    """
    entry = entry_in(content.entry, path)
    if entry.path != path:
        raise InputError(f"its camera belongs at {entry.path}")
    return entry
