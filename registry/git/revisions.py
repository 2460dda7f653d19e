"""``KEY@REV``: which state of the registry is meant.

REV is a commit, a tag or a branch, as git names them; a date (``2026-05-01``: that day's end, in UTC, as all dates
without a zone); or ``firmware:01.09``, the newest revision of that very entry which was made for that firmware.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from calibrary.errors import RegistryError
from calibrary.registry.git.history import at_date
from calibrary.registry.git.repository import Repository

__all__ = ["Firmware", "Named", "OnDate", "Rev", "commit_at", "parse_rev", "split_key"]

DATE = re.compile(r"\d{4}-\d{2}-\d{2}(?P<time>[T ]\d{2}:\d{2}(:\d{2})?(Z|[+-]\d{2}:?\d{2})?)?\Z")
NAME = re.compile(r"[\w./~^@{}+-]+\Z")


@dataclass(frozen=True, slots=True)
class Named:
    """A commit, tag or branch."""

    name: str


@dataclass(frozen=True, slots=True)
class OnDate:
    """The state at a moment, in UTC."""

    moment: datetime


@dataclass(frozen=True, slots=True)
class Firmware:
    """The newest revision of an entry that was made for a firmware."""

    version: str


Rev = Named | OnDate | Firmware


def split_key(text: str) -> tuple[str, Rev | None]:
    """A key and, behind the first ``@``, its revision."""
    key, at, rev = text.partition("@")
    return key, parse_rev(rev) if at else None


def parse_rev(text: str) -> Rev:
    """What kind of revision a text is.

    A tag that looks like a date is reached as ``refs/tags/2026-05-01``.

    Raises:
        RegistryError: it is none.
    """
    if text.startswith("firmware:"):
        version = text.removeprefix("firmware:").strip()
        if version and version.isprintable():
            return Firmware(version)
    elif DATE.match(text):
        return OnDate(_moment(text))
    elif NAME.match(text) and not text.startswith("-") and len(text) <= 250:
        return Named(text)
    raise RegistryError(
        f"{text!r} is no revision: wanted a commit, tag or branch, a date such as 2026-05-01, or firmware:01.09"
    )


def _moment(text: str) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        is_day = len(text) == len("2026-05-01")
        return moment + timedelta(days=1, seconds=-1) if is_day else moment.astimezone(UTC)
    except (ValueError, OverflowError):
        raise RegistryError(
            f"{text!r} is no date: wanted one such as 2026-05-01 or 2026-05-01T12:30Z"
        ) from None


def commit_at(repo: Repository, rev: Rev | None) -> str:
    """The commit that a revision means; for a firmware the newest, since that is searched in an entry's history.

    Raises:
        RegistryError: there is none, or none yet.
    """
    if isinstance(rev, Named):
        return repo.commit_of(rev.name)
    tip = repo.tip()
    if tip is None:
        raise RegistryError(f"{repo.path}: an empty registry, without a first commit")
    return at_date(repo, rev.moment, tip) if isinstance(rev, OnDate) else tip
