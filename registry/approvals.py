"""What readers get of an entry: the last revision that is properly approved, whatever its file in the tree says.

The statements say what is in force (:mod:`calibrary.registry.standing`); the file in ``cameras/`` is a copy of it that
people read. Where the two differ, readers get what is in force, and a remark.
"""

from __future__ import annotations

from datetime import date, timedelta
from typing import Final

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import ROOT, STATEMENTS, id_of, unit_folder
from calibrary.registry.standing import Book, InForce
from calibrary.registry.statements import content_of

__all__ = ["Evidence", "Standing", "label_subject", "standing_of", "until"]

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
) -> Standing:
    """Return what readers get of an entry.

    Args:
        book: the statements at the commit.
        repo: repository of the registry.
        path: path of the entry in ``cameras/``.
        stated: the entry in its file; None if that cannot be read.
        in_force: what the statements say of it.
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
    base = stated if is_here else _of_content(repo, path, in_force)
    if base is None and stated is None:
        # Its reader says why the file cannot be read.
        return Standing(former=former)
    if base is None:
        return Standing(
            problem=f"{path}: what is approved of it is not what its file says, and file {in_force.blobs[0][:12]} is "
            f"not in this clone{repo.unshallow_hint or '; git fetch may bring it'}",
        )
    plain = replace(
        _with_status(base, in_force.status, in_force.reason), label=book.label(label_subject(path))
    )
    entry = until(plain, in_force.until)
    remark = None
    if not is_here:
        now = "its file says something newer" if stated is not None else "its file cannot be read"
        remark = f"{now}, which nothing that counts approves: the last approved revision is used"
    return Standing(
        data=entry_yaml(entry) if entry != stated else None,
        remark=remark,
        differs=plain != stated,
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
