"""JSON output of the commands for an entry's history."""

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
    """Output of ``calibrary registry show --json``.

    Attributes:
        recorded: who added this calibration to the registry, from the commit.
        approved: who approved it, and in which commits; empty if it is not usable.
        against: KEY@REV it is compared with, with --diff.
        changes: fields that differ from that state.
    """

    recorded: Recorded | None
    approved: tuple[Approval, ...] = ()
    against: str | None = None
    changes: tuple[FieldChange, ...] | None = None


class LoggedCommit(Record):
    """A commit in the history.

    Attributes:
        commit: 40 hexadecimal digits.
        date: author's date.
        author, subject: as in git.
        reason: reason stated in the commit.
    """

    commit: ObjectId
    date: datetime
    author: str
    subject: str
    reason: str | None


class LoggedK(Record):
    """Intrinsics of a revision, or their change, in px."""

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float


class LoggedRevision(LoggedCommit):
    """A commit that changed an entry, or of the whole registry.

    Attributes:
        cameras: cameras named in the commit.
        path: path of the entry at that time; None for a commit of the whole registry.
        status, grade: status and grade of the entry; None if it was removed or cannot be read.
        firmware: firmware with which the calibration was made, else the range of the entry.
        K: intrinsics; None if the entry was removed or cannot be read.
        delta: difference from the previous revision; None if there is none to compare with.
    """

    cameras: tuple[str, ...]
    path: str | None
    status: Status | None
    grade: Grade | None
    firmware: str | None
    K: LoggedK | None
    delta: LoggedK | None = field(name="delta_K")


class LogReport(Record, tag_field="schema", tag="calibrary/registry-log-1"):
    """Output of ``calibrary registry log --json``.

    Attributes:
        key: key of the query; None for the whole registry.
        revisions: revisions, newest first.
    """

    key: str | None
    revisions: tuple[LoggedRevision, ...]


class BlamedField(LoggedCommit):
    """A field of an entry, and the commit that last changed it.

    Attributes:
        field: dotted name, as nested in the entry's file.
        value: current value.
    """

    field: str
    value: Field


class BlameReport(Record, tag_field="schema", tag="calibrary/registry-blame-1"):
    """Output of ``calibrary registry blame --json``.

    Attributes:
        id: id of the entry.
        fields: fields in the order of the file.
    """

    id: str
    fields: tuple[BlamedField, ...]


def log_report(revisions: Sequence[EntryRevision], key: str | None) -> LogReport:
    """Return the output of ``registry log --json``."""
    return LogReport(key=key, revisions=tuple(map(_logged, revisions)))


def blame_report(origins: Sequence[FieldOrigin], id_: str) -> BlameReport:
    """Return the output of ``registry blame --json``."""
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
    """Return the members of a :class:`LoggedCommit`."""
    revision = one.revision
    return {
        "commit": revision.commit,
        "date": revision.authored,
        "author": revision.author.name,
        "subject": revision.subject,
        "reason": one.reason,
    }
