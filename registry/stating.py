"""Making of statements: what a person puts on record with a change, signed with the key that git signs with here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime

from msgspec import Struct, structs

from calibrary.errors import RegistryError
from calibrary.records import to_json
from calibrary.registry.configuration import RuleSet
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import Change, Person, identity
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.sshsig import Signer, fingerprint
from calibrary.registry.standing import Book, Chain, Epoch, Rulebook, label_subject
from calibrary.registry.statements import (
    NAMESPACE,
    RULES,
    Action,
    Body,
    Broken,
    Signed,
    content_of,
    encoded,
    ledger_files,
    parse_statement,
    statement_bytes,
    statement_path,
    subject_of,
)


class Act(Struct, frozen=True, kw_only=True):
    """What a person does with an entry.

    Attributes:
        action: propose, approve or retire.
        entry: the entry, with the label that it is to have.
        data: content of its file; None if it is not written.
        start: first day of a retirement.
        is_proposed: whether it was proposed before, by this person or another one.
        brought: files of statements that come along, from the branch with the proposal.
        blob: git's id of a file with this content that a commit has; None if the change writes it.
    """

    action: Action
    entry: Entry
    data: bytes | None
    start: date | None = None
    is_proposed: bool = True
    brought: tuple[Change, ...] = ()
    blob: str | None = None


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

    def __init__(self, repo: Repository, epoch: Epoch, author: Person | None) -> None:
        self.person = author or identity(repo)[0]
        self._signer = Signer(repo.setting("user.signingkey")) if epoch.rules.is_signed else None
        self.name: str | None = self.person.name
        if self._signer is not None:
            blob = self._signer.blob
            self.name = epoch.owners.get(fingerprint(blob)) if blob is not None else None

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
    stated = {"person": "", "made": "", "registry": book.rulebook.foundation, "rules": book.rulebook.current}
    return Body(**{**stated, **members})  # type: ignore[arg-type]  # the members of a body


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
    epoch = book.rulebook.epoch
    writer = _Writer(repo, epoch, author)
    changes, missing, warnings = [], dict[str, str](), []
    known: dict[str, list[Signed | Broken]] = {}
    labels = {label_subject(act.entry.path): act.entry.label for act in acts}
    for act in acts:
        if act.action == "label":
            continue
        if act.action == "propose" and writer.problem is not None:
            if epoch.rules.approvals.not_author:
                warnings.append(
                    f"{act.entry.id}: nobody whom registry.yaml lists proposes it, and its approval has to be by "
                    f"another person than the one who does: {writer.problem}"
                )
            continue
        writer.require()
        subject = subject_of(act.entry.path)
        there = known.setdefault(subject, book.statements(subject))
        own = {one.id for one in there}
        come = [one for one in act.brought if one.path.rpartition("/")[2] not in own]
        there += [parse_statement(one.path, one.data or b"") for one in come]
        changes += come
        body = _of_book(
            book,
            action=act.action,
            subject=subject,
            after=Chain(there).heads,
            content=content_of(act.entry),
            blob=act.blob or (blob_id(act.data) if act.data else None),
            start=act.start,
            reason=act.entry.reason if reason is None and act.action != "propose" else reason,
        )
        change, made = writer.made(body)
        there.append(made)
        if act.action == "approve" and (lacking := _lacking(book, act, there, made)) is not None:
            missing[act.entry.id] = lacking
        changes.append(change)
    for subject, label in labels.items():
        if label == book.label(subject):
            continue
        if writer.problem is not None:
            warnings.append(f"the label {label or 'of it'} is not in force: {writer.problem}")
            continue
        body = _of_book(
            book,
            action="label",
            subject=subject,
            after=Chain(book.statements(subject)).heads,
            label=label or "",
            reason=reason,
        )
        changes.append(writer.made(body)[0])
    return Stated(changes=tuple(changes), missing=missing, warnings=tuple(warnings))


def brought(snapshot: Snapshot, source: Snapshot, entry: Entry) -> tuple[Change, ...]:
    """Return the files of another branch that say who proposed or approved an entry, and that this state lacks."""
    if source.commit == snapshot.commit or not (snapshot.is_stated and source.is_stated):
        return ()
    repo, commit = source.require_git("has no statements")
    book, subject = snapshot.book, subject_of(entry.path)
    here = {one.id for one in book.statements(subject)}
    paths = [
        statement_path(one.body)
        for one in source.book.statements(subject)
        if isinstance(one, Signed)
        and one.id not in here
        and one.body.action in {"propose", "approve"}
        and one.body.content == content_of(entry)
        and book.why_not(one) is None
    ]
    files = ((path, repo.read(commit, path)) for path in paths)
    return tuple(Change(path=path, data=file.data) for path, file in files if file is not None)


def who_states(repo: Repository, epoch: Epoch) -> tuple[Person, str | None]:
    """Return git's user, and the name in statements that count as theirs; None if theirs do not count."""
    writer = _Writer(repo, epoch, None)
    return writer.person, writer.name


def _lacking(book: Book, act: Act, statements: Sequence[Signed | Broken], made: Signed) -> str | None:
    """Return what an entry lacks with an approval that was just made; None if it is in force.

    Raises:
        RegistryError: the approval has no effect.
    """
    epoch, content = book.rulebook.epoch, made.body.content or ""
    rule, person = epoch.rules.approvals, made.body.person
    refused = f"nothing was written: {act.entry.id}: "
    if not epoch.may_approve(made):
        raise RegistryError(
            f"{refused}{person} <{made.body.email}> is not among those who approve by registry.yaml"
        )
    if not act.is_proposed and (rule.not_author or rule.count > 1):
        raise RegistryError(
            f"{refused}it takes the approval of another person; add it without --approve, as a proposal"
        )
    found = book.in_force(made.subject, statements)
    if found.problem is not None:
        raise RegistryError(f"{refused}{found.problem}")
    if found.content == content:
        return None
    proposers = found.proposers.get(content, ())
    if rule.not_author and epoch.person_of(made) in proposers:
        raise RegistryError(
            f"{refused}{person} proposed it, and registry.yaml asks for the approval of another person"
        )
    if rule.not_author and not proposers:
        raise RegistryError(
            f"{refused}nobody is known to have proposed it, and registry.yaml asks for the approval of another person: "
            "'calibrary registry add' it again, signed by one of its people"
        )
    of_whom = f" of {', '.join(rule.by)}" if rule.by else ""
    keys = ", signed with a listed key" if epoch.rules.is_signed else ""
    another = " who did not propose it" if rule.not_author else ""
    return f"{found.waiting.get(content, 0)} of {rule.count} approvals{of_whom}{another}{keys}"


def state_rules(snapshot: Snapshot, rules: RuleSet, reason: str | None) -> Stated:
    """Make the statement that puts rules in force; nothing is written.

    Raises:
        RegistryError: they cannot be in force, or are already, or this person's approval does not count.
    """
    repo, _ = snapshot.require_git("has no statements")
    book = snapshot.book
    epoch = book.rulebook.epoch
    if (problem := rules.problem) is not None:
        raise RegistryError(f"nothing was written: registry.yaml: {problem}")
    if rules == epoch.rules:
        raise RegistryError("nothing was written: what registry.yaml asks for is in force already")
    writer = _Writer(repo, epoch, None)
    writer.require()
    terms = to_json(rules)
    # A second person signs the same list as the first, or the two would not be one change.
    known = next((body for body, _ in book.rulebook.waiting if body.terms == terms), None)
    lines = {
        subject: [one.id for one in those if isinstance(one, Signed)]
        for subject, those in book.read_all().items()
    }
    ledger, files = ledger_files(lines) if known is None else (dict(known.ledger or {}), {})
    body = _of_book(
        book,
        action="rules",
        subject=RULES,
        after=Chain(book.statements(RULES)).heads,
        terms=terms,
        ledger=ledger,
        reason=reason,
    )
    change, made = writer.made(body)
    if not epoch.may_approve(made):
        raise RegistryError(
            f"nothing was written: {made.body.person} is not among those who approve by the rules in force"
        )
    after = Rulebook.of([*book.statements(RULES), made], book.rulebook.foundation, book.rulebook.epochs)
    have = next((number for waiting, number in after.waiting if waiting.terms == terms), 0)
    is_in_force = after.current != book.rulebook.current
    missing = {} if is_in_force else {RULES: f"{have} of {epoch.rules.approvals.count} approvals"}
    lists = [
        Change(path=path, data=data)
        for path, data in files.items()
        if repo.read(snapshot.commit or "", path) is None
    ]
    return Stated(changes=(change, *lists), missing=missing)


def founded(
    repo: Repository, rules: RuleSet, entries: Mapping[str, tuple[Entry, str]] | None = None
) -> tuple[Change, ...]:
    """Make the files that found a registry on statements.

    Args:
        repo: repository of the registry.
        rules: rules that are in force from now on.
        entries: entries that it takes over as they are, with git's ids of their files, by path.

    Raises:
        RegistryError: the rules cannot be in force, or no key of the registry's people signs here.
    """
    if (problem := rules.problem) is not None:
        raise RegistryError(f"nothing was written: registry.yaml: {problem}")
    lines: dict[str, list[str]] = {}
    for path, (entry, oid) in (entries or {}).items():
        if entry.status is not Status.DRAFT:
            lines[subject_of(path)] = [f"{content_of(entry)} {oid} {entry.status.value}"]
        if entry.label is not None:
            lines[label_subject(path)] = [entry.label]
    ledger, files = ledger_files(lines) if lines else ({}, {})
    writer = _Writer(repo, Epoch.of(rules), None)
    writer.require()
    body = Body(action="found", subject=RULES, terms=to_json(rules), ledger=ledger, person="", made="")
    change, _ = writer.made(body)
    return (change, *(Change(path=path, data=data) for path, data in files.items()))
