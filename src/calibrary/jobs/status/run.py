"""The queue of a registry: what waits for whom, what ends, what has no effect (:meth:`calibrary.Fleet.status`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from datetime import date, timedelta
from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.jobs.audit.age import Rule, age_finding, due_again
from calibrary.records import Record, replace
from calibrary.registry.configuration import ApprovalRule, Repeat
from calibrary.registry.entry import Entry
from calibrary.registry.git.history import Revision, history
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.writing import Person
from calibrary.registry.in_force import Content, People
from calibrary.registry.paths import id_of
from calibrary.registry.pending import Pending, pending
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.standing import Book
from calibrary.registry.statements import Signed, content_of, subject_of
from calibrary.registry.stating import who_states
from calibrary.validation import Finding, Severity

if TYPE_CHECKING:
    from calibrary.jobs.audit.report import AuditReport


class Kind(StrEnum):
    """Kind of a matter, most urgent first; the value is the name shown to the user."""

    NO_EFFECT = "statement without effect"
    UNREADABLE = "cannot be read"
    PROPOSAL = "proposal"
    RULES = "change of the rules"
    FLIGHTS = "flights"
    PUBLISHED = "published copy"
    CONTRADICTS = "proposal contradicts K in use"
    ENDS = "validity ends"
    AGE = "calibrate again"


class Matter(Record):
    """One thing that waits.

    Attributes:
        kind: what it is.
        what: KEY of an entry, path of a file, or address of a copy.
        text: what is the matter.
        yours: whether it waits for the person who asks; also if anybody can settle it now.
        waits_for: people by name for whom it waits; empty for anyone, or nobody in particular.
        since: day since which it waits; null if unknown.
        due: day by which it has to be done; null if there is none.
        next: command that settles it, or shows it; null if there is none.
    """

    kind: Kind
    what: str
    text: str
    yours: bool = False
    waits_for: tuple[str, ...] = ()
    since: date | None = None
    due: date | None = None
    next: str | None = None


class RegistryStatus(Record, tag_field="schema", tag="calibrary/registry-status-1"):
    """Output of ``calibrary registry status --json``.

    Attributes:
        registry: folder of the registry.
        commit: commit that was looked at; null for a plain folder.
        day: the day that counts as today.
        person: who asks, by the name of git.
        entries: number of entries.
        matters: what waits, most urgent first.
    """

    registry: str
    commit: ObjectId | None
    day: date
    person: str | None
    entries: int
    matters: tuple[Matter, ...]

    @property
    def is_waiting(self) -> bool:
        """Whether something waits for the person who asks."""
        return any(one.yours for one in self.matters)


class _Asker(Struct, frozen=True, kw_only=True):
    """Who asks, and whose approval counts.

    Attributes:
        person: as git names them; None without git.
        people: the rules in force.
        rule: what an approval takes.
        name: name in statements that count as this person's; None if theirs do not count.
        asked: names or addresses of those whose approval counts; empty for anybody's.
    """

    person: Person | None
    people: People
    rule: ApprovalRule
    name: str | None
    asked: tuple[str, ...]

    @classmethod
    def of(cls, snapshot: Snapshot) -> _Asker:
        """The person at this machine."""
        people = snapshot.book.rulebook.people
        rules = people.rules
        person, name = who_states(snapshot.repo, people) if snapshot.repo is not None else (None, None)
        asked = rules.approvals.by or tuple(one.name for one in rules.people if one.keys)
        return cls(person=person, people=people, rule=rules.approvals, name=name, asked=asked)

    def may_approve(self, had: Sequence[tuple[str, str]]) -> bool:
        """Whether an approval of this person is still wanted, given the names and addresses of those before."""
        if self.person is None or self.name is None:
            return False
        own = {self.name.lower(), self.person.email.lower()}
        # People are told apart as the rules do: by their keys, or by their addresses.
        is_signed = self.people.rules.is_signed
        me = self.name if is_signed else self.person.email.lower() or self.name
        done = {name if is_signed else email.lower() or name for name, email in had}
        return me not in done and (not self.asked or bool(own & {one.lower() for one in self.asked}))

    def others(self, had: Sequence[tuple[str, str]]) -> tuple[str, ...]:
        """The people asked for whose approval still counts."""
        done = {word.lower() for who in had for word in who}
        return tuple(one for one in self.asked if one.lower() not in done)


def status(
    snapshot: Snapshot,
    *,
    within_days: int,
    stale_after_months: int,
    audited: AuditReport | None = None,
    copy: Matter | None = None,
) -> RegistryStatus:
    """Collect what waits; for arguments and errors see :meth:`calibrary.Fleet.status`.

    ``audited`` is the audit of flights, ``copy`` what is the matter with the published copy, if anything.
    """
    today, asker = date.today(), _Asker.of(snapshot)
    parsed = dict(snapshot.parsed([*snapshot.paths]))
    matters = [
        *_without_effect(snapshot, parsed),
        *_proposals(snapshot, asker, parsed),
        *_rules(snapshot, asker),
        *_contradicting(snapshot, parsed),
        *_ending(
            parsed,
            today,
            today + timedelta(days=within_days),
            partial(snapshot.configuration.repeat_of, months=stale_after_months),
        ),
        *_flown(audited),
        *((copy,) if copy is not None else ()),
    ]
    order = {kind: number for number, kind in enumerate(Kind)}
    matters.sort(key=lambda one: (not one.yours, order[one.kind], one.due or one.since or date.max, one.what))
    return RegistryStatus(
        registry=str(snapshot.place),
        commit=snapshot.commit,
        day=today,
        person=asker.name or (asker.person.name if asker.person is not None else None),
        entries=len(parsed),
        matters=tuple(matters),
    )


def _without_effect(snapshot: Snapshot, parsed: dict[str, Entry | InputError]) -> Iterator[Matter]:
    for path, entry in parsed.items():
        if isinstance(entry, InputError):
            yield Matter(
                kind=Kind.UNREADABLE, what=id_of(path), text=str(entry), next="calibrary registry check"
            )
    for path, why in snapshot.book.findings():
        yield Matter(kind=Kind.NO_EFFECT, what=path, text=why, yours=True, next="calibrary registry check")


def _proposals(snapshot: Snapshot, asker: _Asker, parsed: dict[str, Entry | InputError]) -> Iterator[Matter]:
    for one in pending(snapshot):
        written = _written(snapshot, one)
        if isinstance(one.entry, str):
            since = _day_of(written)
            yield Matter(kind=Kind.UNREADABLE, what=one.key, text=one.entry, yours=True, since=since)
            continue
        used = parsed.get(one.path)
        if isinstance(used, Entry) and used.is_usable and content_of(used) == content_of(one.entry):
            continue  # a branch whose proposal was approved here
        yield _proposal(snapshot, asker, one, one.entry, written)


def _proposal(
    snapshot: Snapshot, asker: _Asker, one: Pending, entry: Entry, written: Revision | None
) -> Matter:
    had = [*_approvals(snapshot, one, content_of(entry))]
    by = f", proposed by {written.author.name}" if written is not None else ""
    waits = "waits for approval"
    if asker.rule.count > 1:
        waits = f"{len(asker.people.counted(had))} of {asker.rule.count} approvals"
    came = f" --from {one.branch}" if one.branch is not None else ""
    fx = entry.calibration.intrinsics.fx
    return Matter(
        kind=Kind.PROPOSAL,
        what=one.key,
        text=f"fx = {fx:.1f} px, {entry.calibration.grade.value}{by}: {waits}",
        yours=asker.may_approve(_people(had)),
        waits_for=asker.others(_people(had)),
        since=_day_of(written),
        next=f"calibrary registry approve {id_of(one.path)}{came}",
    )


def _approvals(snapshot: Snapshot, one: Pending, content: str) -> Iterator[Signed]:
    """Yield the approvals of a content that count, of the registry and of the branch on which it waits."""
    seen = set[str]()
    for book in _books(snapshot, one.branch):
        for said in book.statements(subject_of(one.path)):
            if not isinstance(said, Signed) or said.id in seen or said.body.action != "approve":
                continue
            if Content.of(said.body).says == content and book.rulebook.why_not(said) is None:
                seen.add(said.id)
                yield said


def _people(said: Sequence[Signed]) -> list[tuple[str, str]]:
    """The name and address of who made each statement."""
    return [(one.body.person, one.body.email) for one in said]


def _books(snapshot: Snapshot, branch: str | None) -> Iterator[Book]:
    """Yield the statements of a registry, then those of a branch."""
    yield snapshot.book
    if branch is not None and snapshot.repo is not None:
        with suppress(RegistryError):
            yield replace(snapshot, commit=snapshot.repo.commit_of(branch)).book


def _written(snapshot: Snapshot, one: Pending) -> Revision | None:
    """Return the commit that last wrote a proposal; None if git does not know."""
    if snapshot.repo is None or snapshot.commit is None:
        return None
    try:
        found = history(snapshot.repo, one.path, one.branch or snapshot.commit, most=1)
    except RegistryError:
        return None
    return found[0] if found else None


def _day_of(written: Revision | None) -> date | None:
    return written.committed.date() if written is not None else None


def _rules(snapshot: Snapshot, asker: _Asker) -> Iterator[Matter]:
    book, again = snapshot.book.rulebook, "calibrary registry approve registry.yaml"
    for body, number in book.waiting:
        who = [(body.person, body.email)]
        yield Matter(
            kind=Kind.RULES,
            what="registry.yaml",
            text=f"proposed by {body.person}: {number} of {asker.rule.count} approvals",
            # Who proposes a change of the rules has approved it.
            yours=asker.may_approve(who),
            waits_for=asker.others(who),
            since=date.fromisoformat(body.made[:10]) if body.made else None,
            next=again,
        )
    if not book.waiting and snapshot.configuration.rules != book.people.rules:
        text = "registry.yaml asks for other rules than those in force"
        yield Matter(
            kind=Kind.RULES, what="registry.yaml", text=text, yours=asker.may_approve(()), next=again
        )


def _contradicting(snapshot: Snapshot, parsed: dict[str, Entry | InputError]) -> Iterator[Matter]:
    if not any(True for _ in pending(snapshot)):
        return
    # What compares two K's in pixels takes longer to load than all else of a status.
    from calibrary.jobs.audit.other_statements import proposal_statements  # noqa: PLC0415  the reason above

    for one in proposal_statements(snapshot, parsed, (), snapshot.policy):
        if isinstance(one, Finding) and one.severity is not Severity.NOTE:
            yield Matter(kind=Kind.CONTRADICTS, what=one.place or "", text=one.message, next=one.remedy)


def _ending(
    parsed: dict[str, Entry | InputError], today: date, horizon: date, repeat_of: Callable[[str], Repeat]
) -> Iterator[Matter]:
    for path, entry in parsed.items():
        if isinstance(entry, InputError) or not entry.is_usable:
            continue
        id_, last = id_of(path), entry.validity.last if entry.validity is not None else None
        if last is not None and last <= horizon:
            is_over = last < today
            yield Matter(
                kind=Kind.ENDS,
                what=id_,
                text=f"its validity {'ended' if is_over else 'ends'} on {last}",
                yours=is_over,
                due=last,
                next=f"calibrary registry retire {id_} --reason 'validity over'" if is_over else None,
            )
            continue
        rule = repeat_of(path)
        due = due_again(entry, rule.months or 0)
        coming = [due] if due is not None and today < due <= horizon else []
        for day in (today, *coming):
            found = age_finding(entry, day, rule, has_flown=True)
            if found is not None and found.rule == Rule.OLD:
                # One that is old by its firmware is so today, whatever day its age makes it so.
                last = due if due is not None and due <= day else None
                yield Matter(
                    kind=Kind.AGE,
                    what=id_,
                    text=found.message,
                    yours=day <= today,
                    due=last,
                    next=found.remedy,
                )
                break


def copy_matter(snapshot: Snapshot, place: str, horizon: date) -> Matter | None:
    """Return what is the matter with a published copy of a registry; None if it is the present state, and not ending.

    Args:
        snapshot: the registry.
        place: address or folder of the copy.
        horizon: day until which it should be valid.

    Raises:
        RegistryError: the place is no address.
    """
    from calibrary.registry.published.address import normalised  # noqa: PLC0415  few ask for one
    from calibrary.registry.published.read import Published  # noqa: PLC0415  the same

    what = normalised(place)
    try:
        found = Published(what)
    except RegistryError as error:
        return Matter(kind=Kind.PUBLISHED, what=what, text=str(error), yours=True)
    repo, due, told = snapshot.repo, found.manifest.until.date(), list(found.warnings)
    if repo is None or not repo.holds(found.commit):
        told.append(f"it is of commit {found.commit[:12]}, which this registry does not have")
    elif found.commit != snapshot.commit:
        listed = repo.run("rev-list", "--left-right", "--count", f"{found.commit}...{snapshot.commit}").out
        ahead, behind = map(int, listed.split())
        apart = [f"{number} {word}" for number, word in ((ahead, "ahead"), (behind, "behind")) if number]
        told.append(f"it is {' and '.join(apart)} in commits, of {found.manifest.date:%Y-%m-%d}")
    if due <= horizon:
        told.append(f"readers refuse it from {due}; publish again before")
    if not told:
        return None
    return Matter(kind=Kind.PUBLISHED, what=what, text="; ".join(told), yours=True, due=due)


def _flown(audited: AuditReport | None) -> Iterator[Matter]:
    """What flights show: units without an entry, drift, and what else an audit warns of but age, told of each entry."""
    for one in audited.findings if audited is not None else ():
        if one.severity is not Severity.NOTE and one.rule != Rule.OLD:
            what = one.place or one.camera or ""
            yield Matter(
                kind=Kind.FLIGHTS, what=what, text=f"{one.rule}: {one.message}", yours=True, next=one.remedy
            )
