"""Making of statements: what a person puts on record with a change, signed with the key that git signs with here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime

from msgspec import Struct, structs

from calibrary.errors import RegistryError
from calibrary.records import to_json
from calibrary.registry.configuration import RuleSet
from calibrary.registry.entry import Entry
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import Change, Person, identity
from calibrary.registry.in_force import Content, People, Rulebook, in_force, lost
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.sshsig import Signer, fingerprint
from calibrary.registry.standing import Book, label_subject
from calibrary.registry.statements import (
    NAMESPACE,
    RULES,
    Action,
    Body,
    Broken,
    Signed,
    approved_of,
    content_of,
    encoded,
    id_in,
    parse_statement,
    statement_bytes,
    statement_path,
    subject_of,
)


class Act(Struct, frozen=True, kw_only=True):
    """What a person does with an entry.

    Attributes:
        action: approve, retire or label.
        entry: the entry, with the label that it is to have.
        start: first day of a retirement.
        brought: files of statements that come along, from the branch with the proposal.
    """

    action: Action
    entry: Entry
    start: date | None = None
    brought: tuple[Change, ...] = ()


class Stated(Struct, frozen=True, kw_only=True):
    """The statements of a change.

    Attributes:
        changes: their files.
        missing: what entries lack to be used, by their id.
        warnings: warnings for the user.
    """

    changes: tuple[Change, ...] = ()
    missing: Mapping[str, str] = {}
    warnings: tuple[str, ...] = ()


class _Writer:
    """A person at this machine, who states under some rules."""

    def __init__(self, repo: Repository, people: People, author: Person | None) -> None:
        self.person = author or identity(repo)[0]
        self._signer = Signer(repo.setting("user.signingkey")) if people.rules.is_signed else None
        self.name: str | None = self.person.name
        if self._signer is not None:
            blob = self._signer.blob
            self.name = people.owners.get(fingerprint(blob)) if blob is not None else None

    @property
    def problem(self) -> str | None:
        """Why nothing that is stated here would count; None if it would."""
        if self.name is not None or self._signer is None:
            return None
        why = self._signer.problem or "user.signingkey is a key of none of them"
        return f"what is stated counts only if a key of the people of registry.yaml signs it, and {why}"

    def require(self) -> None:
        """Refuse to state what would not count.

        Raises:
            RegistryError: it would not.
        """
        if (problem := self.problem) is not None:
            raise RegistryError(f"nothing was written: {problem}")

    def made(self, body: Body) -> tuple[Change, Signed]:
        """Return the file of a statement, and the statement as a reader sees it."""
        body = structs.replace(
            body,
            person=self.name or self.person.name,
            email=self.person.email,
            made=datetime.now(UTC).isoformat(timespec="seconds"),
        )
        armored = self._signer.sign(encoded(body), NAMESPACE) if self._signer is not None else ""
        data, path = statement_bytes(body, armored), statement_path(body)
        read = parse_statement(path, data)
        if isinstance(read, Broken):
            raise RegistryError(f"nothing was written: the statement {read.why}")
        return Change(path=path, data=data), read


def _of_book(book: Book, **members: object) -> Body:
    return Body(**{"person": "", "made": "", "registry": book.rulebook.foundation, **members})  # type: ignore[arg-type]  # the members of a body


def stated(
    snapshot: Snapshot, acts: Sequence[Act], reason: str | None, *, author: Person | None = None
) -> Stated:
    """Make the statements of a change; nothing is written.

    Args:
        snapshot: state to which they are added.
        acts: what is done with each entry.
        reason: why.
        author: who does it; by default git's user.

    Raises:
        RegistryError: what this person states would not count, or cannot be signed.
    """
    repo, _ = snapshot.require_git("has no statements")
    book = snapshot.book
    writer = _Writer(repo, book.rulebook.people, author)
    changes, missing, warnings = [], dict[str, str](), []
    known: dict[str, list[Signed | Broken]] = {}
    labels = {label_subject(act.entry.path): act.entry.label for act in acts}
    for act in acts:
        if act.action == "label":
            continue
        writer.require()
        subject = subject_of(act.entry.path)
        there = known.setdefault(subject, [*book.statements(subject)])
        own = {one.id for one in there}
        come = [one for one in act.brought if id_in(one.path) not in own]
        there += [parse_statement(one.path, one.data or b"") for one in come]
        changes += come
        change, made = writer.made(_body(book, act, there, reason))
        there.append(made)
        if act.action == "approve" and (lacking := _lacking(book, act, there, made)) is not None:
            missing[act.entry.id] = lacking
        # Who says the same again within a second has said it.
        changes += [change] if made.id not in own else []
    for subject, label in labels.items():
        if label == book.label(subject):
            continue
        if writer.problem is not None:
            warnings.append(f"the label {label or 'of it'} is not in force: {writer.problem}")
            continue
        over = tuple(one.id for one in book.statements(subject))
        body = _of_book(book, action="label", subject=subject, over=over, label=label or "", reason=reason)
        changes.append(writer.made(body)[0])
    return Stated(changes=tuple(changes), missing=missing, warnings=tuple(warnings))


def _body(book: Book, act: Act, there: Sequence[Signed | Broken], reason: str | None) -> Body:
    """Return what is stated; who approves what another has approved before states the same."""
    subject, said = subject_of(act.entry.path), act.entry.reason if reason is None else reason
    if act.action == "retire":
        return _of_book(book, action="retire", subject=subject, start=act.start, reason=said)
    found = in_force(book.rulebook, there)
    content, says = approved_of(act.entry), content_of(act.entry)
    # All of them, so that one of another branch that is given up leaves no gap.
    replaces = {one.id for one in found.approved.values() if one.says != says}
    restores = {one.id for one in found.ends}
    for one in sorted((*found.waiting.values(), *found.heads()), key=lambda one: one.id):
        if one.says == says and replaces <= {*one.replaces} and restores <= {*one.restores}:
            replaces, restores = {*one.replaces}, {*one.restores}
            break
    return _of_book(
        book,
        action="approve",
        subject=subject,
        content=content,
        replaces=tuple(sorted(replaces)),
        restores=tuple(sorted(restores)),
        reason=said,
    )


def brought(snapshot: Snapshot, source: Snapshot, entry: Entry) -> tuple[Change, ...]:
    """Return the files of another branch that say who proposed or approved an entry, and that this state lacks."""
    if source.commit == snapshot.commit or not (snapshot.is_stated and source.is_stated):
        return ()
    repo, commit = source.require_git("has no statements")
    book, subject = snapshot.book, subject_of(entry.path)
    here = {one.id for one in book.statements(subject)}
    paths = [
        one.path
        for one in source.book.statements(subject)
        if isinstance(one, Signed)
        and one.id not in here
        and one.body.action == "approve"
        and Content.of(one.body).says == content_of(entry)
        and book.rulebook.why_not(one) is None
    ]
    files = ((path, repo.read(commit, path)) for path in paths)
    return tuple(Change(path=path, data=file.data) for path, file in files if file is not None)


def who_states(repo: Repository, people: People) -> tuple[Person, str | None]:
    """Return git's user, and the name in statements that count as theirs; None if theirs do not count."""
    writer = _Writer(repo, people, None)
    return writer.person, writer.name


def _lacking(book: Book, act: Act, statements: Sequence[Signed | Broken], made: Signed) -> str | None:
    """Return what an entry lacks with an approval that was just made; None if it is in force.

    Raises:
        RegistryError: the approval has no effect.
    """
    people, content = book.rulebook.people, Content.of(made.body)
    rule, person = people.rules.approvals, made.body.person
    refused = f"nothing was written: {act.entry.id}: "
    if not people.may_approve(made):
        raise RegistryError(
            f"{refused}{person} <{made.body.email}> is not among those who approve by registry.yaml"
        )
    found = in_force(book.rulebook, statements)
    if found.problem is not None:
        raise RegistryError(f"{refused}{found.problem}")
    if content.id in found.approved:
        return None
    of_whom = f" of {', '.join(rule.by)}" if rule.by else ""
    keys = ", signed with a listed key" if people.rules.is_signed else ""
    have = len(people.counted(found.approvals[content.id]))
    return f"{have} of {rule.count} approvals{of_whom}{keys}"


def state_rules(snapshot: Snapshot, rules: RuleSet, reason: str | None) -> Stated:
    """Make the statement that puts rules in force; nothing is written.

    Raises:
        RegistryError: they cannot be in force, or are already, or this person's approval does not count.
    """
    repo, _ = snapshot.require_git("has no statements")
    book = snapshot.book.rulebook
    if (problem := rules.problem) is not None:
        raise RegistryError(f"nothing was written: registry.yaml: {problem}")
    if rules == book.people.rules:
        raise RegistryError("nothing was written: what registry.yaml asks for is in force already")
    writer = _Writer(repo, book.people, None)
    writer.require()
    terms = to_json(rules)
    every = snapshot.book.read_all().values()
    under = structs.replace(book, chain={**book.chain, "": People(rules=rules)})
    keeps, over = lost(book, under, every), {*book.open}
    for known, _ in book.waiting:
        # A second person signs the same as the first, or the two would not be one change.
        if known.terms == terms and keeps <= {*known.keeps}:
            keeps, over = {*known.keeps}, {*known.over}
    body = _of_book(
        snapshot.book,
        action="rules",
        subject=RULES,
        previous=book.current,
        terms=terms,
        keeps=tuple(sorted(keeps)),
        over=tuple(sorted(over)),
        reason=reason,
    )
    change, made = writer.made(body)
    if not book.people.may_approve(made):
        raise RegistryError(
            f"nothing was written: {made.body.person} is not among those who approve by the rules in force"
        )
    after = Rulebook.of([*snapshot.book.statements(RULES), made], book.foundation, book.chain)
    have = next((number for waiting, number in after.waiting if waiting.terms == terms), 0)
    missing = (
        {}
        if after.current != book.current
        else {RULES: f"{have} of {book.people.rules.approvals.count} approvals"}
    )
    return Stated(changes=(change,), missing=missing)


def founded(repo: Repository, rules: RuleSet) -> tuple[Change, ...]:
    """Make the files that found a registry on statements.

    Args:
        repo: repository of the registry.
        rules: rules that are in force from now on.

    Raises:
        RegistryError: the rules cannot be in force, or no key of the registry's people signs here.
    """
    if (problem := rules.problem) is not None:
        raise RegistryError(f"nothing was written: registry.yaml: {problem}")
    writer = _Writer(repo, People(rules=rules), None)
    writer.require()
    body = Body(action="found", subject=RULES, terms=to_json(rules), person="", made="")
    return (writer.made(body)[0],)
