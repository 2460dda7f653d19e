"""What is in force: a pure function of the statements of a registry, whatever their order, branch and time.

1. A statement counts if it names this registry and its key is of a person in the rules in force; without keys, its
   e-mail is the person. What a change of the rules keeps counts on.
2. A content is approved if as many different people as the rules ask for approved exactly it, or if a change of the
   rules keeps it. Where they ask for nobody, what the file in ``cameras/`` says is approved too, and replaces all else.
3. A retirement ends the contents that it names, or all that do not name it under ``restores``; on all days, or from its
   day on.
4. Of the contents that are approved, not ended and valid, those count that no other such content replaces, itself or
   through contents that were approved. Of several the one with the later first day counts, then the one with the later
   date; if two different ones are left, nobody can say.
5. What may be a retirement and cannot be read, or more than :data:`MOST` statements, refuses its entry and no other.
6. The rules are those of the foundation, then of each change that enough of its people signed. Of two changes of the
   same rules the one counts that this reader has followed, else the one whose signers suffice without the keys that the
   other takes out, and which knows the other; if neither's suffice, the registry is refused; else neither counts yet.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import date, timedelta
from functools import cached_property
from typing import Any, Final, TypeAlias

from msgspec import Struct, structs

from calibrary.errors import InputError, RegistryError
from calibrary.registry.configuration import ApprovalRule, RuleSet
from calibrary.registry.paths import EVENTS
from calibrary.registry.statements import (
    DIGITS,
    FOUNDATION,
    RULES,
    Body,
    Broken,
    Signed,
    canonical,
    rule_set,
    sha256,
    state_after,
)

FREE: Final = RuleSet(approvals=ApprovalRule(count=0))
"""The rules of files without any: what stands in ``cameras/`` is used."""
FORMER: Final = "was made under former rules, by a key of nobody in those in force"
MOST: Final = 10_000
"""Statements on one subject that are read; a person makes one at a time."""


class People(Struct, frozen=True, kw_only=True, dict=True):
    """The people of some rules, by whom a statement counts."""

    rules: RuleSet

    @cached_property
    def owners(self) -> Mapping[str, str]:
        """People by the fingerprints of their keys."""
        return {key: one.name for key, one in self.rules.owners.items()}

    def person_of(self, one: Signed) -> str | None:
        """Return who made a statement; None if it is not signed by a key of the person that it names."""
        if not self.rules.is_signed:
            return one.body.email.lower() or one.body.person
        person = self.owners.get(one.key or "")
        return person if person == one.body.person else None

    def why_not(self, one: Signed) -> str | None:
        """Return why a statement is of nobody here; None if it counts."""
        if self.person_of(one) is not None:
            return None
        if one.key is None:
            return "is not signed"
        if one.key in self.owners:
            return f"is signed by a key of {self.owners[one.key]}, and names {one.body.person}"
        return f"is signed by {one.key}, a key of nobody in the rules"

    def may_approve(self, one: Signed) -> bool:
        """Return whether the person of a statement is among those asked for; where people have keys, by their key."""
        if self.rules.is_signed:
            return not self.rules.approvals.by or self.person_of(one) in self.rules.approvals.by
        by = {*map(str.lower, self.rules.approvals.by)}
        return not by or bool({one.body.person.lower(), one.body.email.lower()} & by)

    def counted(self, approvals: Iterable[Signed]) -> set[str]:
        """Return the different people whose approvals count."""
        people = {self.person_of(one) for one in approvals if self.may_approve(one)}
        return {one for one in people if one is not None}

    def suffice(self, approvals: Iterable[Signed]) -> bool:
        """Return whether enough different people approve."""
        return len(self.counted(approvals)) >= max(self.rules.approvals.count, 1)


class Rulebook(Struct, frozen=True, kw_only=True):
    """The rules of a registry, from its foundation to those in force.

    Attributes:
        founding: the foundation.
        chain: rules by their id, those in force last.
        kept: ids of what changes of the rules keep.
        problems: path and reason of each statement on the rules without effect.
        waiting: changes of the rules that lack approvals, with the number that they have.
        open: ids of the changes of the rules in force that do not count.
    """

    founding: Signed
    chain: dict[str, People]
    kept: frozenset[str] = frozenset()
    problems: tuple[tuple[str, str], ...] = ()
    waiting: tuple[tuple[Body, int], ...] = ()
    open: tuple[str, ...] = ()

    @property
    def foundation(self) -> str:
        """Id of the foundation, by which a statement names its registry."""
        return self.founding.id

    @property
    def current(self) -> str:
        """Id of the rules in force."""
        return next(reversed(self.chain))

    @property
    def people(self) -> People:
        """The rules in force."""
        return self.chain[self.current]

    def why_not(self, one: Signed) -> str | None:
        """Return why a statement has no effect; None if it counts."""
        if one.body.registry != self.foundation:
            return "is of another registry"
        if one.id in self.kept or (why := self.people.why_not(one)) is None:
            return None
        if one.key is not None and any(one.key in former.owners for former in self.chain.values()):
            return why if one.key in self.people.owners else FORMER
        return why

    @classmethod
    def free(cls) -> Rulebook:
        """Return the rules of files without any."""
        founding = Body(action=FOUNDATION, subject=RULES, person="", made="")
        return cls(founding=Signed(path="", body=founding, key=None), chain={"": People(rules=FREE)})

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
        founding = _foundation([one for one in good if one.body.action == FOUNDATION], known)
        others = [one for one in good if one.body.action == FOUNDATION and one is not founding]
        problems += [(one.path, "is another registry's foundation") for one in others]
        try:
            chain = {state_after(founding.body): People(rules=rule_set(founding.body))}
        except InputError as error:
            raise RegistryError(f"{founding.path}: {error}") from None
        changes, kept = [one for one in good if one.body.action == RULES], set[str]()
        while True:
            current = next(reversed(chain))
            own = [one for one in changes if one.body.previous == current]
            found = _Changes(own, chain[current], founding.id)
            after = found.winner(followed)
            problems += found.problems
            if after is None or after in chain:
                break
            chain[after] = found.terms[after]
            kept |= {*found.made[after][0].body.keeps}
        return cls(
            founding=founding,
            chain=chain,
            kept=frozenset(kept),
            problems=tuple(problems),
            waiting=tuple((those[0].body, found.have(those)) for those in found.waiting),
            open=tuple(sorted(found.made)),
        )


def _foundation(statements: Sequence[Signed], known: str | None) -> Signed:
    first = [one for one in statements if known in {None, one.id}]
    if len(first) == 1:
        return first[0]
    what = "the statement that it was founded with" if not first else f"{len(first)} foundations"
    hint = f" {known}" if known is not None and not first else ""
    raise RegistryError(
        f"{EVENTS}{RULES}/: {what}{hint}{' is missing' if not first else ', expected one'}; nobody can say "
        "what is approved: 'git log -- events' shows who changed it, and git revert undoes it"
    )


BOTH: Final = (
    "two changes of the rules at the same time: neither counts until a third is made that knows both ('calibrary "
    "registry approve registry.yaml')"
)


class _Changes:
    """The changes of some rules.

    Attributes:
        made: statements that count, by the rules that they would put in force.
        terms: those rules, of changes with enough statements.
        waiting: the statements of each other change.
        problems: path and reason of each statement without effect.
    """

    def __init__(self, changes: Iterable[Signed], people: People, foundation: str) -> None:
        self.made: dict[str, list[Signed]] = {}
        self.problems: list[tuple[str, str]] = []
        self._people = people
        for one in changes:
            if one.body.registry != foundation:
                self.problems.append((one.path, "is of another registry"))
            elif people.person_of(one) is None or not people.may_approve(one):
                who = f"is by {one.body.person}, who does not approve here"
                self.problems.append((one.path, people.why_not(one) or who))
            else:
                self.made.setdefault(state_after(one.body), []).append(one)
        self.terms: dict[str, People] = {}
        self.waiting = [those for those in self.made.values() if not people.suffice(those)]
        for after, those in self.made.items():
            try:
                if people.suffice(those):
                    self.terms[after] = People(rules=rule_set(those[0].body))
            except InputError as error:
                self.problems.append((those[0].path, f"is a change of the rules without effect: {error}"))

    def have(self, those: Iterable[Signed]) -> int:
        """Return the number of people who made a change."""
        return len(self._people.counted(those))

    def winner(self, followed: Collection[str]) -> str | None:
        """Return the id of the rules that follow; None if no change counts.

        Raises:
            RegistryError: two changes take out each other's signers.
        """
        pairs = [(one, other) for one in self.terms for other in self.terms if one < other]
        for after in self.terms:
            if all(self._beats(after, other, followed) for other in self.terms if other != after):
                return after
        if torn := next((pair for pair in pairs if not any(map(self._stands, pair, reversed(pair)))), None):
            paths = " and ".join(sorted(self.made[one][0].path for one in torn))
            raise RegistryError(
                f"{paths}: changes of the rules take out each other's signers; nobody can say who decides: "
                f"'git log -- {EVENTS}{RULES}' shows who made them; remove the file of the wrong one"
            )
        if pairs:
            self.problems.append((f"{EVENTS}{RULES}", BOTH))
        return None

    def _stands(self, one: str, other: str) -> bool:
        """Whether the signers of a change suffice without the keys that another takes out."""
        gone = self._people.owners.keys() - self.terms[other].owners.keys()
        return self._people.suffice(said for said in self.made[one] if said.key not in gone)

    def _beats(self, one: str, other: str, followed: Collection[str]) -> bool:
        if (one in followed) != (other in followed):
            return one in followed
        knows = other in self.made[one][0].body.over
        return self._stands(one, other) and (knows or not self._stands(other, one))


class Content(Struct, frozen=True, kw_only=True):
    """What approvals put to use for an entry.

    Attributes:
        id: 32 hexadecimal digits, of all that follows.
        says: digest of the entry; see :func:`calibrary.registry.statements.content_of`.
        replaces, restores: as approvals state them.
        entry: the entry as approvals hold it.
    """

    id: str
    says: str
    replaces: tuple[str, ...]
    restores: tuple[str, ...]
    entry: Mapping[str, Any]

    @classmethod
    def of(cls, body: Body) -> Content:
        """Return the content of an approval."""
        return cls.made(body.content or {}, body.replaces, body.restores)

    @classmethod
    def made(
        cls, entry: Mapping[str, Any], replaces: tuple[str, ...] = (), restores: tuple[str, ...] = ()
    ) -> Content:
        """Return the content of an entry as approvals hold it."""
        says = sha256(canonical(dict(entry)))
        name = canonical({"says": says, "replaces": [*replaces], "restores": [*restores]})
        digits = sha256(name)[:DIGITS]
        return cls(id=digits, says=says, replaces=replaces, restores=restores, entry=entry)

    @property
    def rank(self) -> tuple[str, str]:
        """What decides between contents of which none replaces another."""
        first, _ = self._days
        return first, str((self.entry.get("provenance") or {}).get("date") or "")

    @property
    def _days(self) -> tuple[str, str]:
        days = self.entry.get("validity") or {}
        return str(days.get("from") or ""), str(days.get("until") or "9999")

    @property
    def edges(self) -> Iterator[date]:
        """Yield the days on which it begins, or is over."""
        first, last = self._days
        if first:
            yield date.fromisoformat(first)
        if last < "9999":
            yield date.fromisoformat(last) + timedelta(days=1)

    def is_of(self, day: date | None) -> bool:
        """Return whether it is valid on a day; on any, if no day is given."""
        first, last = self._days
        return day is None or first <= day.isoformat() <= last


class InForce(Struct, frozen=True, kw_only=True):
    """What the statements on an entry put in force.

    Attributes:
        approved: contents with enough approvals, by their id.
        approvals: approvals that count, by the id of the content.
        waiting: contents that lack approvals, by their id.
        ends: retirements that count.
        problem: why nobody can say what is in force.
    """

    approved: Mapping[str, Content] = {}
    approvals: Mapping[str, Sequence[Signed]] = {}
    waiting: Mapping[str, Content] = {}
    ends: Sequence[Signed] = ()
    problem: str | None = None

    def end_of(self, one: Content) -> date | None:
        """Return the first day from which a content is retired, the first of all for every day; None if it is not."""
        days = [
            said.body.start or date.min
            for said in self.ends
            if (
                one.id in said.body.contents
                if said.body.contents is not None
                else said.id not in one.restores
            )
        ]
        return min(days, default=None)

    def heads(self, day: date | None = None) -> list[Content]:
        """Return the contents that no other replaces, valid on a day; on any, if none is given."""
        live = []
        for one in self.approved.values():
            end = self.end_of(one)
            is_over = end is not None and (end == date.min or (day is not None and end <= day))
            if one.is_of(day) and not is_over:
                live.append(one)
        gone, todo = set[str](), [name for one in live for name in one.replaces]
        while todo:
            if (name := todo.pop()) not in gone:
                gone.add(name)
                todo += self.approved[name].replaces if name in self.approved else ()
        return [one for one in live if one.id not in gone]

    def on(self, day: date | None = None) -> Content | None:
        """Return the content in force on a day; whatever the day, if none is given. None if there is none.

        Raises:
            RegistryError: nobody can say which.
        """
        if self.problem is not None:
            raise RegistryError(self.problem)
        heads = self.heads(day)
        best = [one for one in heads if one.rank == max(other.rank for other in heads)]
        if len({one.says for one in best}) > 1:
            names = " and ".join(sorted(one.says[:12] for one in best))
            raise RegistryError(
                f"several contents of it were approved at the same time ({names}): approve one of them again"
            )
        return min(best, key=lambda one: one.id, default=None)

    @property
    def periods(self) -> list[Period]:
        """What is in force on which days, earliest first.

        Raises:
            RegistryError: nobody can say of some days.
        """
        starts = {said.body.start for said in self.ends if said.body.start is not None}
        edges = sorted(starts.union(*(one.edges for one in self.approved.values())))
        found: list[Period] = []
        before: Content | None = None
        for first, following in zip([None, *edges], [*edges, None], strict=True):
            content = self.on(first or date.min)
            last = following - timedelta(days=1) if following is not None else None
            if content is not None:
                begin = found.pop()[0] if content is before else first
                found.append((begin, last, content))
            before = content
        return found


Period: TypeAlias = "tuple[date | None, date | None, Content]"
"""The first and the last day of a content; None for an open end."""


def in_force(book: Rulebook, statements: Sequence[Signed | Broken], here: Content | None = None) -> InForce:
    """Return what the statements on one entry put in force.

    Args:
        book: the rules.
        statements: those on the entry.
        here: what its file says, which counts where the rules ask for nobody's approval.
    """
    if len(statements) > MOST:
        return InForce(problem=f"has {len(statements)} statements, and {MOST} are read")
    contents, approvals, ends = dict[str, Content](), dict[str, list[Signed]](), list[Signed]()
    for one in statements:
        if isinstance(one, Broken):
            if one.ends:
                return InForce(
                    problem=f"a retirement may be damaged: {one.path} {one.why}; git revert restores it"
                )
            continue
        why = book.why_not(one)
        if one.body.action == "approve":
            content = Content.of(one.body)
            contents[content.id] = content
            approvals.setdefault(content.id, []).extend([one] if why is None else ())
        elif one.body.action == "retire" and why is None:
            ends.append(one)
        elif one.body.action == "retire" and why != FORMER:
            return InForce(
                problem=f"somebody states that it is to retire, and that statement {why}: {one.path}; sign it or "
                "remove it"
            )
    approved = {
        name: one
        for name, one in contents.items()
        if name in book.kept or book.people.suffice(approvals[name])
    }
    if here is not None and not book.people.rules.approvals.count:
        others = tuple(name for name, one in approved.items() if one.says != here.says)
        approved = {**approved, here.id: structs.replace(here, replaces=others)}
    waiting = {name: one for name, one in contents.items() if name not in approved and approvals[name]}
    return InForce(approved=approved, approvals=approvals, waiting=waiting, ends=ends)


def label_of(book: Rulebook, statements: Iterable[Signed | Broken]) -> str | None:
    """Return the label in force of a unit; None if it has none, or two at the same time."""
    good = [one for one in statements if isinstance(one, Signed) and book.why_not(one) is None]
    over = {name for one in good for name in one.body.over}
    newest = {one.body.label for one in good if one.id not in over}
    return (newest.pop() or None) if len(newest) == 1 else None


def lost(book: Rulebook, after: Rulebook, every: Iterable[Sequence[Signed | Broken]]) -> set[str]:
    """Return the ids of what counts under some rules and would not under others."""
    found = set[str]()
    for statements in every:
        now, then = in_force(book, statements), in_force(after, statements)
        found |= now.approved.keys() - then.approved.keys()
        good = (
            one for one in statements if isinstance(one, Signed) and one.body.action in {"retire", "label"}
        )
        found |= {one.id for one in good if book.why_not(one) is None and after.why_not(one) is not None}
    return found
