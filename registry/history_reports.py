"""The history of an entry as the commands print it with ``--json``."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from msgspec import field

from calibrary.calibration import Grade
from calibrary.records import Record
from calibrary.registry.entry import Status
from calibrary.registry.entry_form import PARAMETERS
from calibrary.registry.fields import Field, FieldChange
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.history import Approval, EntryRevision, FieldOrigin, Recorded
from calibrary.registry.stored import ListedEntry

__all__ = ["BlameReport", "LogReport", "ShownEntry", "blame_report", "log_report"]


class ShownEntry(ListedEntry, tag_field="schema", tag="calibrary/registry-show-1"):
    """What calibrary registry show --json prints.

    Attributes:
        recorded: who put this calibration into the registry, by the commit that did.
        approved: who approved it, and in which commits; empty where it is not in use.
        against: KEY@REV that it is compared with, with --diff.
        changes: the fields in which it differs from that one.
    """

    recorded: Recorded | None
    approved: tuple[Approval, ...] = ()
    against: str | None = None
    changes: tuple[FieldChange, ...] | None = None


class LoggedCommit(Record):
    """A commit, as the history shows it.

    Attributes:
        commit: 40 hexadecimal digits.
        date: when its author made it.
        author, subject: as git has them.
        reason: why, as the commit states it.
    """

    commit: ObjectId
    date: datetime
    author: str
    subject: str
    reason: str | None


class LoggedK(Record):
    """The intrinsics of a revision, or how much more they are than before, in px."""

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float


class LoggedRevision(LoggedCommit):
    """One commit that changed an entry, or of the whole registry.

    Attributes:
        cameras: that the commit names.
        path: of the entry at that time; None for a commit of the whole registry.
        status, grade: of the entry; None where the commit removed it or it cannot be read.
        firmware: of the camera when the calibration was made, else of the range that the entry is of.
        K: None where the entry was removed or cannot be read.
        delta: difference from the revision before; None where there is none to compare with.
    """

    cameras: tuple[str, ...]
    path: str | None
    status: Status | None
    grade: Grade | None
    firmware: str | None
    K: LoggedK | None
    delta: LoggedK | None = field(name="delta_K")


class LogReport(Record, tag_field="schema", tag="calibrary/registry-log-1"):
    """What calibrary registry log --json prints.

    Attributes:
        key: as it was asked for; None for the whole registry.
        revisions: newest first.
    """

    key: str | None
    revisions: tuple[LoggedRevision, ...]


class BlamedField(LoggedCommit):
    """A field of an entry, and the commit that last changed it.

    Attributes:
        field: dotted, as the entry's file nests it.
        value: as it is now.
    """

    field: str
    value: Field


class BlameReport(Record, tag_field="schema", tag="calibrary/registry-blame-1"):
    """What calibrary registry blame --json prints.

    Attributes:
        id: of the entry.
        fields: in the order of its file.
    """

    id: str
    fields: tuple[BlamedField, ...]


def log_report(revisions: Sequence[EntryRevision], key: str | None) -> LogReport:
    """The revisions as ``registry log --json`` prints them."""
    return LogReport(key=key, revisions=tuple(map(_logged, revisions)))


def blame_report(origins: Sequence[FieldOrigin], id_: str) -> BlameReport:
    """The fields as ``registry blame --json`` prints them."""
    fields = (BlamedField(field=one.field, value=one.value, **_commit(one.since)) for one in origins)
    return BlameReport(id=id_, fields=tuple(fields))


def _logged(one: EntryRevision) -> LoggedRevision:
    entry, delta = one.entry, one.delta
    K = entry.calibration.intrinsics if entry is not None else None
    return LoggedRevision(
        **_commit(one),
        cameras=one.cameras,
        path=one.revision.path or None,
        status=entry.status if entry is not None else None,
        grade=entry.calibration.grade if entry is not None else None,
        firmware=one.firmware,
        K=LoggedK(**{name: float(getattr(K, name)) for name in PARAMETERS}) if K is not None else None,
        delta=LoggedK(**delta) if delta is not None else None,
    )


def _commit(one: EntryRevision) -> dict[str, Any]:
    """The members of a :class:`LoggedCommit`."""
    revision = one.revision
    return {
        "commit": revision.commit,
        "date": revision.authored,
        "author": revision.author.name,
        "subject": revision.subject,
        "reason": one.reason,
    }
