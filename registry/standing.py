"""What the statements of a registry put in force: rules, and for each entry the content that readers get.

Everything follows from the tree of one commit. An approval counts if its person may approve by the rules that it names,
and no retirement ends it. A retirement ends every approval that does not name it, so that of two at the same time the
retirement wins. What could end an approval and cannot be read, or is not properly signed, refuses its entry: an answer
would be a guess. The file in ``cameras/`` is a copy of what is in force, for people; where the two differ, readers get
what is in force, and a remark.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import date, timedelta
from typing import Final

from msgspec import Struct, structs

from calibrary.errors import InputError, RegistryError
from calibrary.records import replace
from calibrary.registry.configuration import RuleSet
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import ROOT, STATEMENTS, id_of, unit_folder
from calibrary.registry.statements import (
    FOUNDATION,
    RULES,
    Body,
    Broken,
    Signed,
    content_of,
    ledger_path,
    line_key,
    parse_statement,
    rule_set,
    sha256,
    state_after,
)

FORMER: Final = "was made under former rules, by a key of nobody in those in force"
MOST: Final = 10_000
"""Statements on one subject that are read; a person makes one at a time."""
UNREAD: Final = "its file cannot be read"


class Epoch(Struct, frozen=True, kw_only=True):
    """Rules that were in force at some time.

    Attributes:
        rules: the rules.
        owners: people by the fingerprints of their keys.
        closed: digests of the list of all statements when they ended; None if they are in force.
    """

    rules: RuleSet
    owners: Mapping[str, str]
    closed: Mapping[str, str] | None = None

    @classmethod
    def of(cls, rules: RuleSet) -> Epoch:
        """Return rules as they are in force."""
        return cls(rules=rules, owners={key: one.name for key, one in rules.owners.items()})

    def person_of(self, one: Signed) -> str | None:
        """Return who made a statement; None if it is not signed by a key of the person that it names."""
        if not self.rules.is_signed:
            return one.body.email.lower() or one.body.person
        person = self.owners.get(one.key or "")
        if person is None or person != one.body.person:
            return None
        known = next(known for known in self.rules.people if known.name == person)
        return person if known.counts_on(one.body.made[:10]) else None

    def why_not(self, one: Signed) -> str | None:
        """Return why a statement is of nobody here; None if it counts."""
        if self.person_of(one) is not None:
            return None
        if one.key is None:
            return "is not signed"
        if one.key in self.owners:
            return f"is signed by a key of {self.owners[one.key]}, and names {one.body.person}, or not on their days"
        return f"is signed by {one.key}, a key of nobody in the rules"

    def may_approve(self, one: Signed) -> bool:
        """Return whether the person of a statement is among those asked for; where people have keys, by their key."""
        if self.rules.is_signed:
            return not self.rules.approvals.by or self.person_of(one) in self.rules.approvals.by
        by = {*map(str.lower, self.rules.approvals.by)}
        return not by or bool({one.body.person.lower(), one.body.email.lower()} & by)

    def suffice(self, changes: Iterable[Signed]) -> bool:
        """Return whether enough different people made statements that change the rules."""
        return len({self.person_of(one) for one in changes}) >= self.rules.approvals.count

    def is_enough(self, approvals: Iterable[Signed], proposers: Collection[str]) -> bool:
        """Return whether approvals of one content suffice; ``proposers`` are the people who proposed it."""
        return len(self.counted(approvals, proposers)) >= self.rules.approvals.count

    def counted(self, approvals: Iterable[Signed], proposers: Collection[str]) -> set[str]:
        """Return the different people whose approvals count."""
        people = {self.person_of(one) for one in approvals if self.may_approve(one)} - {None}
        if self.rules.approvals.not_author:
            # Without a proposer that is known, everybody might be the one.
            people = people - {*proposers} if proposers else set()
        return {one for one in people if one is not None}


class Rulebook(Struct, frozen=True, kw_only=True):
    """The rules of a registry, from its foundation to those in force.

    Attributes:
        founding: the foundation.
        epochs: rules by their id.
        current: id of the rules in force.
        problems: path and reason of each statement on the rules without effect.
        waiting: changes of the rules that lack approvals, with the number that they have.
    """

    founding: Signed
    epochs: Mapping[str, Epoch]
    current: str
    problems: tuple[tuple[str, str], ...] = ()
    waiting: tuple[tuple[Body, int], ...] = ()

    @property
    def foundation(self) -> str:
        """Id of the foundation, by which a statement names its registry."""
        return self.founding.id

    @property
    def adopted(self) -> Mapping[str, str]:
        """Digests of the list of what the foundation took over."""
        return self.founding.body.ledger or {}

    @property
    def epoch(self) -> Epoch:
        """The rules in force."""
        return self.epochs[self.current]

    @classmethod
    def of(
        cls, statements: Sequence[Signed | Broken], known: str | None, followed: Collection[str] = ()
    ) -> Rulebook:
        """Follow the changes of the rules.

        Args:
            statements: those whose subject is the rules.
            known: id of the foundation, if this reader has seen it before.
            followed: ids of the rules that this reader has seen in force.

        Raises:
            RegistryError: there is not exactly one foundation, its rules are not valid, or nobody can say which of two
                changes counts.
        """
        problems = [(one.path, one.why) for one in statements if isinstance(one, Broken)]
        good = [one for one in statements if isinstance(one, Signed)]
        first = [one for one in good if one.body.action == FOUNDATION and known in {None, one.id}]
        if len(first) != 1:
            what = "the statement that it was founded with" if not first else f"{len(first)} foundations"
            hint = f" {known}" if known is not None and not first else ""
            raise RegistryError(
                f"{STATEMENTS}{RULES}/: {what}{hint}{' is missing' if not first else ', expected one'}; nobody can say "
                "what is approved: 'git log -- statements' shows who changed it, and git revert undoes it"
            )
        [founding] = first
        problems += [
            (_path(one), "is another registry's foundation")
            for one in good
            if one.body.action == FOUNDATION and one is not founding
        ]
        try:
            rules = rule_set(founding.body)
        except InputError as error:
            raise RegistryError(f"{_path(founding)}: {error}") from None
        epochs, current = {}, state_after("", founding.body)
        changes = Chain([one for one in good if one.body.action == "rules"])
        waiting: list[tuple[Body, int]] = []
        while True:
            epoch = Epoch.of(rules)
            epochs[current] = epoch
            found = _change(current, epoch, changes, founding.id, followed)
            problems += found.problems
            if found.body is None or found.rules is None:
                waiting = [*found.waiting]
                break
            epochs[current] = Epoch(rules=rules, owners=epoch.owners, closed=found.body.ledger or {})
            current, rules = state_after(current, found.body), found.rules
            if current in epochs:
                break
        return cls(
            founding=founding,
            epochs=epochs,
            current=current,
            problems=tuple(problems),
            waiting=tuple(waiting),
        )


def _path(one: Signed) -> str:
    return f"{STATEMENTS}{one.subject}/{one.id}"


class _Change(Struct, frozen=True, kw_only=True):
    """What follows some rules, and what would and does not."""

    body: Body | None = None
    rules: RuleSet | None = None
    problems: tuple[tuple[str, str], ...] = ()
    waiting: tuple[tuple[Body, int], ...] = ()


def _change(
    current: str, epoch: Epoch, changes: Chain, foundation: str, followed: Collection[str]
) -> _Change:
    """Return the change of some rules that has enough approvals under them."""
    problems, signed, terms = [], dict[str, list[Signed]](), dict[str, RuleSet]()
    for one in changes.all.values():
        if one.body.rules != current:
            continue
        person = epoch.person_of(one)
        if one.body.registry != foundation:
            problems.append((_path(one), "is of another registry"))
        elif person is None or not epoch.may_approve(one):
            problems.append((_path(one), epoch.why_not(one) or f"is by {person}, who does not approve here"))
        else:
            signed.setdefault(state_after(current, one.body), []).append(one)
    enough = {after: those for after, those in signed.items() if epoch.suffice(those)}
    waiting = tuple(
        (those[0].body, len({*map(epoch.person_of, those)}))
        for after, those in signed.items()
        if after not in enough
    )
    for after, those in enough.items():
        try:
            terms[after] = rule_set(those[0].body)
        except InputError as error:
            problems.append((f"{STATEMENTS}{RULES}", f"a change of the rules has no effect: {error}"))
    standing = [after for after in terms if after in followed]
    if len(standing) != 1:
        standing = _standing(epoch, {after: (enough[after], terms[after]) for after in terms}, changes)
    if len(standing) > 1:
        problems.append((f"{STATEMENTS}{RULES}", BOTH))
    if len(standing) == 1:
        body, rules = enough[standing[0]][0].body, terms[standing[0]]
        return _Change(body=body, rules=rules, problems=tuple(problems))
    return _Change(problems=tuple(problems), waiting=waiting)


BOTH: Final = (
    "two changes of the rules at the same time: neither counts until a third is made that knows both ('calibrary "
    "registry approve registry.yaml')"
)


def _standing(
    epoch: Epoch, changes: Mapping[str, tuple[Sequence[Signed], RuleSet]], chain: Chain
) -> list[str]:
    """Return those of some changes of the same rules, each with enough approvals, that count beside the others.

    A change counts if its approvals suffice without the keys that another one takes out, so that nobody who is taken
    out forbids it; and if no other was approved by enough people who knew it.

    Raises:
        RegistryError: there are changes, and none of them counts.
    """

    def is_known_to(after: str, other: str) -> bool:
        own = {one.id for one in changes[after][0]}
        return epoch.suffice([one for one in changes[other][0] if own <= chain.before(one.id)])

    left = [after for after in changes if not any(is_known_to(after, other) for other in changes)]
    gone = {after: epoch.owners.keys() - rules.owners.keys() for after, (_, rules) in changes.items()}
    standing = [
        after
        for after in left
        if all(
            epoch.suffice([one for one in changes[after][0] if one.key not in gone[other]])
            for other in changes.keys() - {after}
        )
    ]
    if changes and not standing:
        paths = sorted(_path(those[0]) for those, _ in changes.values())
        raise RegistryError(
            f"{' and '.join(paths)}: changes of the rules take out each other's signers; nobody can say who decides: "
            f"'git log -- {STATEMENTS}{RULES}' shows who made them; remove the file of the wrong one"
        )
    return standing


class Adopted(Struct, frozen=True, kw_only=True):
    """What a foundation took over of one entry."""

    content: str
    blob: str
    status: Status


class InForce(Struct, frozen=True, kw_only=True):
    """What the statements on an entry put in force.

    Attributes:
        content: digest of the content that may be used; None if there is none.
        blobs: git's ids of files with that content.
        status: approved or retired; draft if nothing was ever approved.
        until: first day from which it is retired.
        reason: why it is approved or retired.
        approvals: approvals of it; empty if the foundation took it over.
        former: contents that were in use and are not retired, with the first day of a retirement.
        waiting: numbers of people who approved a content, as long as they are too few.
        proposers: people who proposed a content.
        problem: why nobody can say what is in force.
    """

    content: str | None = None
    blobs: tuple[str, ...] = ()
    status: Status = Status.DRAFT
    until: date | None = None
    reason: str | None = None
    approvals: tuple[Signed, ...] = ()
    former: tuple[tuple[str, date | None], ...] = ()
    waiting: Mapping[str, int] = {}
    proposers: Mapping[str, Collection[str]] = {}
    problem: str | None = None


class Chain:
    """The statements on one subject, ordered by what each names."""

    def __init__(self, statements: Iterable[Signed | Broken]) -> None:
        self.broken = [one for one in statements if isinstance(one, Broken)]
        self.all = {one.id: one for one in statements if isinstance(one, Signed)}
        self._ancestors: dict[str, frozenset[str]] = {}

    @property
    def missing(self) -> str | None:
        """Return the id of a statement that another one names and that is not there."""
        there = {*self.all, *(one.id for one in self.broken)}
        return next((name for one in self.all.values() for name in one.body.after if name not in there), None)

    @property
    def heads(self) -> tuple[str, ...]:
        """Return the ids of the newest statements."""
        named = {name for one in self.all.values() for name in one.body.after}
        return tuple(sorted(self.all.keys() - named))

    def before(self, name: str) -> frozenset[str]:
        """Return the ids of all statements that one was made after."""
        todo = [name]
        while todo:
            top = todo[-1]
            after = [other for other in self.all[top].body.after if other in self.all]
            if rest := [other for other in after if other not in self._ancestors]:
                todo += rest
                continue
            self._ancestors[top] = frozenset(after).union(*(self._ancestors[other] for other in after))
            todo.pop()
        return self._ancestors[name]

    def in_order(self) -> list[Signed]:
        """Return the statements, each after those that it names."""
        return sorted(self.all.values(), key=lambda one: (len(self.before(one.id)), one.id))


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
        self._parts: dict[str, dict[str, list[str]] | None] = {}
        self._every: Mapping[str, list[Signed | Broken]] | None = None
        self.rulebook: Final = Rulebook.of(self.statements(RULES), known, followed)

    def statements(self, subject: str) -> list[Signed | Broken]:
        """Return the statements on one subject."""
        if self._every is not None and subject != RULES:
            found = self._every.get(subject, [])
            return found if len(found) <= MOST else [_too_many(subject, len(found))]
        files = self._repo.listing(self._commit, f"{STATEMENTS}{subject}")
        own = {path: oid for path, oid in files.items() if path.count("/") == subject.count("/") + 2}
        if len(own) > MOST:
            return [_too_many(subject, len(own))]
        return [*self._read({path: own[path] for path in sorted(own)})]

    def _read(self, files: Mapping[str, str]) -> Iterator[Signed | Broken]:
        try:
            contents = [*self._repo.objects([*files.values()])]
        except RegistryError:
            for path, oid in files.items():
                try:
                    yield parse_statement(path, self._repo.blob(oid))
                except RegistryError as error:
                    yield Broken(path=path, why=str(error))
            return
        for path, data in zip(files, contents, strict=True):
            yield parse_statement(path, data)

    def read_all(self) -> Mapping[str, list[Signed | Broken]]:
        """Return all statements on entries and labels by their subject, then kept, for a reader of many."""
        if self._every is None:
            files = self._repo.listing(self._commit, STATEMENTS)
            found: dict[str, list[Signed | Broken]] = {}
            kept = {path: oid for path, oid in files.items() if not path.startswith(_NOT_ENTRIES)}
            for path, one in zip(kept, self._read(kept), strict=True):
                found.setdefault(path.removeprefix(STATEMENTS).rpartition("/")[0], []).append(one)
            self._every = found
        return self._every

    def why_not(self, one: Signed) -> str | None:
        """Return why a statement has no effect; None if it counts."""
        book = self.rulebook
        if one.body.registry != book.foundation:
            return "is of another registry"
        epoch = book.epochs.get(one.body.rules)
        if epoch is None:
            return "was made under rules that were never in force here"
        if (why := epoch.why_not(one)) is not None:
            return why
        if epoch.closed is None or one.id in {
            line.split()[0] for line in self._lines(epoch.closed, one.subject)
        }:
            return None
        if one.body.action != "retire":
            return "was made under former rules, and not known when they ended"
        if self.rulebook.epoch.rules.is_signed and one.key not in self.rulebook.epoch.owners:
            return FORMER
        return None

    def _lines(self, ledger: Mapping[str, str], subject: str) -> list[str]:
        """Return what a list says of a subject.

        Raises:
            RegistryError: the part of the list is missing, or is another one.
        """
        key = line_key(subject)
        digest = ledger.get("", ledger.get(sha256(subject.encode())[:2]))
        if digest is None:
            return []
        if digest not in self._parts:
            blob = self._repo.read(self._commit, ledger_path(digest))
            whole = blob is not None and sha256(blob.data) == digest
            self._parts[digest] = _by_subject(blob.data) if blob is not None and whole else None
        lines = self._parts[digest]
        if lines is None:
            raise RegistryError(f"{ledger_path(digest)} is missing or was edited; git revert restores it")
        return lines.get(key, [])

    def adopted(self, subject: str) -> Adopted | None:
        """Return what the foundation took over of an entry; errors as for :meth:`in_force`."""
        for line in self._lines(self.rulebook.adopted, subject):
            content, blob, status = line.split()
            return Adopted(content=content, blob=blob, status=Status(status))
        return None

    def adopted_label(self, subject: str) -> str | None:
        """Return the label that the foundation took over for a unit."""
        return next(iter(self._lines(self.rulebook.adopted, subject)), None)

    def in_force(
        self,
        subject: str,
        statements: Iterable[Signed | Broken] | None = None,
        *,
        expected: Collection[str] = (),
        have: Callable[[], str | None] = lambda: None,
    ) -> InForce:
        """Return what is in force of an entry.

        Args:
            subject: subject of the entry.
            statements: statements on it; by default those at this commit.
            expected: ids of statements that this reader has seen before.
            have: returns the content of its file, which decides between two that were approved at the same time.
        """
        chain = Chain(self.statements(subject) if statements is None else [*statements])
        try:
            return self._in_force(subject, chain, expected, have)
        except RegistryError as error:
            return InForce(problem=str(error))

    def _in_force(
        self, subject: str, chain: Chain, expected: Collection[str], have: Callable[[], str | None]
    ) -> InForce:
        if (problem := self._problem(chain, expected)) is not None:
            return InForce(problem=problem)
        counting = [one for one in chain.in_order() if self.why_not(one) is None]
        adopted = self.adopted(subject)
        closed = [epoch.closed for epoch in self.rulebook.epochs.values() if epoch.closed is not None]
        sealed = {line.split()[0] for ledger in closed for line in self._lines(ledger, subject)}
        if gone := sealed - chain.all.keys():
            return InForce(problem=f"statement {min(gone)} on it is missing; git revert restores it")
        return _Ledger(chain, counting, adopted, self.rulebook).in_force(have)

    def _problem(self, chain: Chain, expected: Collection[str]) -> str | None:
        if gone := {*expected} - chain.all.keys() - {one.id for one in chain.broken}:
            return (
                f"statement {min(gone)} on it was there before and is gone; git revert or 'calibrary registry sync' "
                "restores it"
            )
        if (missing := chain.missing) is not None:
            return f"statement {missing} on it is missing, which another one names; git revert restores it"
        for one in chain.broken:
            is_of_it = one.body is not None and one.path == f"{STATEMENTS}{one.body.subject}/{one.id}"
            ends = one.body is None or (is_of_it and one.body.action == "retire")
            if ends or one.id in expected:
                what = (
                    f"a statement that it is to {one.body.action}"
                    if one.body is not None
                    else "a statement on it"
                )
                return f"{what} is damaged: {one.path} {one.why}; git revert restores it"
        for signed in chain.all.values():
            if signed.body.action == "retire" and (why := self.why_not(signed)) not in {None, FORMER}:
                return (
                    f"somebody states that it is to {signed.body.action}, and that statement {why}: "
                    f"{_path(signed)}; sign it or remove it"
                )
        return None

    def label(self, subject: str) -> str | None:
        """Return the label in force of a unit; None if it has none, or two at the same time."""
        chain = Chain(self.statements(subject))
        try:
            good = {one.id: one for one in chain.all.values() if self.why_not(one) is None}
            named = {name for one in good.values() for name in chain.before(one.id)}
            newest = {one.body.label for name, one in good.items() if name not in named}
            if not newest:
                return self.adopted_label(subject)
        except RegistryError:
            return None
        return (newest.pop() or None) if len(newest) == 1 else None

    def findings(self) -> Iterator[tuple[str, str]]:
        """Yield path and reason of each statement without effect."""
        yield from self.rulebook.problems
        for statements in self.read_all().values():
            for one in statements:
                why = one.why if isinstance(one, Broken) else self.why_not(one)
                if why is not None:
                    yield one.path if isinstance(one, Broken) else _path(one), why


_NOT_ENTRIES: Final = (f"{STATEMENTS}{RULES}/", f"{STATEMENTS}closed/")


def _too_many(subject: str, number: int) -> Broken:
    return Broken(path=f"{STATEMENTS}{subject}", why=f"has {number} files, and {MOST} are read")


class _Ledger:
    """Takes the statements of one entry in order."""

    def __init__(
        self, chain: Chain, counting: Sequence[Signed], adopted: Adopted | None, book: Rulebook
    ) -> None:
        self._before = chain.before
        self._book = book
        self._adopted = adopted
        self._retired = [one for one in counting if one.body.action == "retire" and one.body.start is None]
        self._starts = [one for one in counting if one.body.action == "retire" and one.body.start is not None]
        self._proposers: dict[str, set[str]] = {}
        for one in counting:
            if one.body.action == "propose" and one.body.content is not None:
                self._proposers.setdefault(one.body.content, set()).add(self._person(one) or "")
        self._approvals = [
            one
            for one in counting
            if one.body.action == "approve" and one.body.content is not None and not self._is_ended(one)
        ]

    def _person(self, one: Signed) -> str | None:
        return self._book.epochs[one.body.rules].person_of(one)

    def _is_ended(self, one: Signed) -> bool:
        """Whether a retirement that it does not know ends an approval."""
        before = self._before(one.id)
        return any(ending.id not in before for ending in self._retired)

    def _is_enough(self, approvals: Sequence[Signed], content: str) -> bool:
        proposers = self._proposers.get(content, set())
        return any(
            self._book.epochs[rules].is_enough(
                [one for one in approvals if one.body.rules == rules], proposers
            )
            for rules in {one.body.rules for one in approvals}
        )

    def _start(self, approvals: Iterable[Signed]) -> date | None:
        """First day of a retirement that one of these approvals does not know."""
        approvals = [*approvals]
        days = [
            one.body.start
            for one in self._starts
            if one.body.start is not None
            and (not approvals or any(one.id not in self._before(other.id) for other in approvals))
        ]
        return min(days, default=None)

    def in_force(self, have: Callable[[], str | None]) -> InForce:
        """Return what is in force after the last statement."""
        active: dict[str, list[Signed]] = {}
        used: dict[str, list[Signed]] = {}
        current: list[str] = []
        adopted = self._adopted
        if adopted is not None and adopted.status.is_usable and not self._retired:
            used[adopted.content], current = [], [adopted.content]
        for one in self._approvals:
            content = str(one.body.content)
            own = active.setdefault(content, [])
            own.append(one)
            if not self._is_enough(own, content):
                continue
            known = {name for other in own for name in self._before(other.id)}
            for other, approvals in active.items():
                if other != content:
                    approvals[:] = [that for that in approvals if that.id not in known]
            current = [that for that in current if that != content and self._stands(that, active)]
            current.append(content)
            used[content] = [*own]
        former = tuple((content, self._start(approvals)) for content, approvals in used.items())
        waiting = {one: self._waiting(one, approvals) for one, approvals in active.items()}
        if not current:
            found = self._without(former)
            return structs.replace(found, waiting=waiting, proposers=self._proposers)
        content = current[0] if len(current) == 1 else have() or ""
        if content not in current:
            return InForce(
                problem="several contents of it were approved at the same time: approve one of them again"
            )
        approvals = used[content]
        blobs = [one.body.blob for one in reversed(approvals) if one.body.blob is not None]
        if adopted is not None and adopted.content == content:
            blobs.append(adopted.blob)
        return InForce(
            content=content,
            blobs=tuple(dict.fromkeys(blobs)),
            status=Status.APPROVED,
            until=self._start(approvals),
            reason=next((one.body.reason for one in reversed(approvals) if one.body.reason), None),
            approvals=tuple(approvals),
            former=former,
            waiting=waiting,
            proposers=self._proposers,
        )

    def _waiting(self, content: str, approvals: Sequence[Signed]) -> int:
        """Number of people who approved a content under the rules in force."""
        now = [one for one in approvals if one.body.rules == self._book.current]
        return len(self._book.epoch.counted(now, self._proposers.get(content, set())))

    def _stands(self, content: str, active: Mapping[str, list[Signed]]) -> bool:
        """Whether a content is still approved beside another one: what the foundation took over never is."""
        return self._is_enough(active.get(content, []), content)

    def _without(self, former: tuple[tuple[str, date | None], ...]) -> InForce:
        if self._retired:
            reason = self._retired[-1].body.reason
            return InForce(status=Status.RETIRED, reason=reason, former=former)
        if self._adopted is not None and self._adopted.status is Status.RETIRED:
            return InForce(status=Status.RETIRED, former=former)
        return InForce(former=former)


def _by_subject(data: bytes) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in data.decode("utf-8", "replace").splitlines():
        key, _, rest = line.partition(" ")
        found.setdefault(key, []).append(rest)
    return found


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
        approvals: its approvals; empty if the foundation took it over.
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
    repo: Repository,
    path: str,
    stated: Entry | None,
    in_force: InForce,
    proposed: Entry | None = None,
) -> Standing:
    """Return what readers get of an entry.

    Args:
        book: the statements at the commit.
        repo: repository of the registry.
        path: path of the entry in ``cameras/``.
        stated: the entry in its file; None if that cannot be read.
        in_force: what the statements say of it.
        proposed: the proposal for it, which is what is approved until somebody moves its file.
    """
    if in_force.problem is not None:
        return Standing(problem=f"{path}: {in_force.problem}")
    former = in_force.former
    if in_force.content is None:
        # A file that cannot be read stays what it is, so that its reader says why.
        entry = _with_status(stated, in_force.status, in_force.reason) if stated is not None else None
        data = entry_yaml(entry) if entry is not None and entry != stated else None
        is_draft = (
            in_force.status is Status.DRAFT and stated is not None and stated.status is not Status.DRAFT
        )
        return Standing(
            data=data,
            remark="nothing that counts approves it" if is_draft else None,
            differs=data is not None,
            former=former,
        )
    is_here = stated is not None and content_of(stated) == in_force.content
    is_proposed = proposed is not None and content_of(proposed) == in_force.content
    base = stated if is_here else proposed if is_proposed else _of_content(repo, path, in_force)
    if base is None and stated is None:
        # Its reader says why the file cannot be read.
        return Standing(former=former)
    if base is None:
        return Standing(
            problem=f"{path}: what is approved of it is not what its file says, and file {in_force.blobs[0][:12]} is "
            f"not in this clone{repo.unshallow_hint or '; git fetch may bring it'}"
        )
    plain, label = _with_status(base, in_force.status, in_force.reason), book.label(label_subject(path))
    plain = replace(plain, label=label) if label != plain.label else plain
    entry = until(plain, in_force.until)
    remark = None
    if not is_here and not is_proposed and (stated is not None or proposed is None):
        newer = "its file says something newer, which nothing that counts approves"
        remark = f"{newer if stated is not None else UNREAD}: the last approved revision is used"
    return Standing(
        data=entry_yaml(entry) if entry != stated else None,
        remark=remark,
        differs=stated is not None and plain != stated,
        approvals=_adopted(book)
        if not in_force.approvals
        else tuple(
            Evidence(
                path=f"{STATEMENTS}{one.subject}/{one.id}",
                by=one.body.person,
                email=one.body.email,
                made=one.body.made,
                reason=one.body.reason,
            )
            for one in in_force.approvals
        ),
        former=former,
    )


def _adopted(book: Book) -> tuple[Evidence, ...]:
    founding = book.rulebook.founding
    return (
        Evidence(
            path=f"{STATEMENTS}{founding.subject}/{founding.id}",
            by=founding.body.person,
            email=founding.body.email,
            made=founding.body.made,
            reason="was in use before statements said so",
        ),
    )


def _of_content(repo: Repository, path: str, in_force: InForce) -> Entry | None:
    """Return the entry of the approved content from a file that an approval names."""
    for blob in in_force.blobs:
        try:
            entry = parse_entry(repo.blob(blob), path)
        except (InputError, RegistryError):
            continue
        if content_of(entry) == in_force.content:
            return entry
    return None


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
