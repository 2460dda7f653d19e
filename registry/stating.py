"""Changes of entries, and the making of statements: what a person puts on record with one, signed with their key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime
from typing import Literal

from msgspec import Struct, structs

from calibrary.errors import RegistryError
from calibrary.records import to_json
from calibrary.registry.configuration import RuleSet
from calibrary.registry.entry import Entry
from calibrary.registry.fields import FieldChange
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, Person, identity
from calibrary.registry.in_force import Content, People, Rulebook, in_force, lost
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.sshsig import Signer, fingerprint
from calibrary.registry.standing import Book, label_subject
from calibrary.registry.statements import (
    NAMESPACE,
    RULES,
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

Action = Literal["add", "approve", "retire", "withdraw", "set"]
"""What a person does: put a content into its file, approve one, retire or withdraw it, or set what is free of that."""


class Change(Struct, frozen=True, kw_only=True):
    """What a person does with an entry: from the flags to the check, the statement, the commit and the screen.

    Attributes:
        action: what it is.
        before: the entry as it was; None if there is none, or it cannot be read.
        after: the entry as it will be.
        why: reason for it.
        data: what its file will say; None if the file stays, or goes.
        base: blob id of its file; the write fails with FileConflictError if it has changed.
        seen: id of the content that is decided on; None if that is nobody's decision.
        start: first day of a retirement of the days from then on.
        fields: what differs between before and after; all of a new entry, none if nothing changes.
        warnings: warnings for the user.
        brought: files of statements that come along, from the branch with the proposal.
        formers: files that it takes the place of, whose comments and order of fields stay.
    """

    action: Action
    before: Entry | None
    after: Entry
    why: str | None = None
    data: bytes | None = None
    base: str | None = None
    seen: str | None = None
    start: date | None = None
    fields: tuple[FieldChange, ...]
    warnings: tuple[str, ...] = ()
    brought: tuple[FileChange, ...] = ()
    formers: tuple[bytes, ...] = ()

    @property
    def id(self) -> str:
        """KEY of the entry."""
        return self.after.id

    @property
    def path(self) -> str:
        """Path of its file."""
        return self.after.path

    @property
    def is_new(self) -> bool:
        """Whether its camera had no entry."""
        return self.before is None and self.base is None

    @property
    def digest(self) -> str | None:
        """Id in git of its file afterwards, for ``approve --digest``; None if it goes."""
        return blob_id(self.data) if self.data is not None else None if self.is_gone else self.base

    @property
    def is_gone(self) -> bool:
        """Whether its file goes."""
        return self.action == "withdraw" and self.data is None

    @property
    def files(self) -> tuple[FileChange, ...]:
        """Changes of files, beside the statements."""
        if self.data is None and not self.is_gone:
            return ()
        return (FileChange(path=self.path, data=self.data, base=self.base),)


class Stated(Struct, frozen=True, kw_only=True):
    """The statements of a change.

    Attributes:
        changes: their files.
        missing: what entries lack to be used, by their id.
        warnings: warnings for the user.
    """

    changes: tuple[FileChange, ...] = ()
    missing: Mapping[str, str] = {}
    warnings: tuple[str, ...] = ()


class _Writer:
    """A person at this machine, who states under some rules."""

    def __init__(
        self, repo: Repository, people: People, author: Person | None, now: datetime | None = None
    ) -> None:
        self._now = now
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

    def made(self, body: Body) -> tuple[FileChange, Signed]:
        """Return the file of a statement, and the statement as a reader sees it."""
        body = structs.replace(
            body,
            person=self.name or self.person.name,
            email=self.person.email,
            made=(self._now or datetime.now(UTC)).isoformat(timespec="seconds"),
        )
        armored = self._signer.sign(encoded(body), NAMESPACE) if self._signer is not None else ""
        data, path = statement_bytes(body, armored), statement_path(body)
        read = parse_statement(path, data)
        if isinstance(read, Broken):
            raise RegistryError(f"nothing was written: the statement {read.why}")
        return FileChange(path=path, data=data), read


def _of_book(book: Book, **members: object) -> Body:
    return Body(**{"person": "", "made": "", "registry": book.rulebook.foundation, **members})  # type: ignore[arg-type]  # the members of a body


def stated(
    snapshot: Snapshot,
    changes: Sequence[Change],
    *,
    author: Person | None = None,
    now: datetime | None = None,
) -> Stated:
    """Make the statements of changes; nothing is written.

    Args:
        snapshot: state to which they are added.
        changes: what is done with each entry.
        author: who does it; by default git's user.
        now: when; by default now.

    Raises:
        RegistryError: what this person states would not count, or cannot be signed.
    """
    repo, _ = snapshot.require_git("has no statements")
    book = snapshot.book
    writer = _Writer(repo, book.rulebook.people, author, now)
    files, missing, warnings = [], dict[str, str](), []
    known: dict[str, list[Signed | Broken]] = {}
    for one in changes:
        if one.action not in {"approve", "retire"}:
            continue
        writer.require()
        subject = subject_of(one.path)
        there = known.setdefault(subject, [*book.statements(subject)])
        own = {said.id for said in there}
        come = [said for said in one.brought if id_in(said.path) not in own]
        there += [parse_statement(said.path, said.data or b"") for said in come]
        files += come
        file, made = writer.made(_body(snapshot, one, there))
        there.append(made)
        if one.action == "approve" and (lacking := _lacking(book, one.id, there, made)) is not None:
            missing[one.id] = lacking
        # Who says the same again within a second has said it.
        files += [file] if made.id not in own else []
    labels = {label_subject(one.path): one for one in changes if one.action in {"approve", "set"}}
    for subject, one in labels.items():
        if (label := one.after.label) == book.label(subject):
            continue
        if writer.problem is not None:
            warnings.append(f"the label {label or 'of it'} is not in force: {writer.problem}")
            continue
        over = tuple(said.id for said in book.statements(subject))
        body = _of_book(book, action="label", subject=subject, over=over, label=label or "", reason=one.why)
        files.append(writer.made(body)[0])
    return Stated(changes=tuple(files), missing=missing, warnings=tuple(warnings))


def _body(snapshot: Snapshot, one: Change, there: Sequence[Signed | Broken]) -> Body:
    """Return what is stated; who approves what another has approved before states the same."""
    book, subject = snapshot.book, subject_of(one.path)
    file = snapshot.file(one.path)
    found = in_force(book.rulebook, there, Content.made(approved_of(file)) if file is not None else None)
    if one.action == "retire":
        # Where nobody approves, it ends what is there now: what is written later says nothing of it.
        contents = tuple(sorted(found.approved)) if not book.rules.approvals.count else None
        return _of_book(
            book, action="retire", subject=subject, contents=contents, start=one.start, reason=one.why
        )
    content, says = approved_of(one.after), content_of(one.after)
    # All of them, so that one of another branch that is given up leaves no gap.
    replaces = {each.id for each in found.approved.values() if each.says != says}
    restores = {each.id for each in found.ends}
    for each in sorted((*found.waiting.values(), *found.heads()), key=lambda each: each.id):
        if each.says == says and replaces <= {*each.replaces} and restores <= {*each.restores}:
            replaces, restores = {*each.replaces}, {*each.restores}
            break
    return _of_book(
        book,
        action="approve",
        subject=subject,
        content=content,
        replaces=tuple(sorted(replaces)),
        restores=tuple(sorted(restores)),
        reason=one.why,
    )


def brought(snapshot: Snapshot, source: Snapshot, entry: Entry) -> tuple[FileChange, ...]:
    """Return the files of another branch that say who proposed or approved an entry, and that this state lacks."""
    if source.commit == snapshot.commit:
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
    return tuple(FileChange(path=path, data=file.data) for path, file in files if file is not None)


def who_states(repo: Repository, people: People) -> tuple[Person, str | None]:
    """Return git's user, and the name in statements that count as theirs; None if theirs do not count."""
    writer = _Writer(repo, people, None)
    return writer.person, writer.name


def _lacking(book: Book, id_: str, statements: Sequence[Signed | Broken], made: Signed) -> str | None:
    """Return what an entry lacks with an approval that was just made; None if it is in force.

    Raises:
        RegistryError: the approval has no effect.
    """
    people, content = book.rulebook.people, Content.of(made.body)
    rule, person = people.rules.approvals, made.body.person
    refused = f"nothing was written: {id_}: "
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


def founded(
    repo: Repository, rules: RuleSet, *, author: Person | None = None, now: datetime | None = None
) -> tuple[FileChange, ...]:
    """Make the files that found a registry on statements.

    Args:
        repo: repository of the registry.
        rules: rules that are in force from now on.
        author: who does it; by default git's user.
        now: when; by default now.

    Raises:
        RegistryError: the rules cannot be in force, or no key of the registry's people signs here.
    """
    if (problem := rules.problem) is not None:
        raise RegistryError(f"nothing was written: registry.yaml: {problem}")
    writer = _Writer(repo, People(rules=rules), author, now)
    writer.require()
    body = Body(action="found", subject=RULES, terms=to_json(rules), person="", made="")
    return (writer.made(body)[0],)
