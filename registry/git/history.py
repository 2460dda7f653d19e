"""The history of a file, the differences between two commits, and the commit of a revision (``@REV``).

``log.showRoot=false`` in a user's configuration would hide the first revision of every entry, and other options would
add colours or detect renames by similarity; so every such option is set explicitly.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta, timezone

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.registry.git.objects import HEX, REGULAR, Blob, Member
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import Person, subject_of, trailers_of

SOURCE_FILE = "Source-File"
SOURCE_SHA256 = "Source-Sha256"
FIELDS = ("%H", "%P", "%an", "%ae", "%ad", "%cn", "%ce", "%cd", "%B")
LOG = (
    "log",
    f"--format={'%x00'.join(FIELDS)}%x00",
    "--date=raw",
    "--encoding=UTF-8",
    "--no-color",
    "--no-decorate",
    "--no-ext-diff",
    "--no-mailmap",
    "--no-notes",
    "--raw",
    "--no-abbrev",
    "--no-renames",
    "--no-show-signature",
    "--no-textconv",
)


class Revision(Struct, frozen=True, kw_only=True):
    """A commit that changed a file, or others beside it.

    Attributes:
        path: the file.
        oid: id of its content then; ``None`` if it was not there.
        authored: original time of the change; ``committed`` is the time of this commit.
        beside: the other files asked for that it changed; of a merge none are known.
    """

    commit: str
    parents: tuple[str, ...]
    path: str
    oid: str | None
    author: Person
    authored: datetime
    committer: Person
    committed: datetime
    message: str
    beside: tuple[str, ...] = ()

    @property
    def subject(self) -> str:
        """First line of the message."""
        return subject_of(self.message)

    @property
    def trailers(self) -> tuple[tuple[str, str], ...]:
        """Trailers of the message, such as ``("Reason", "new lens")``."""
        return trailers_of(self.message)


class ChangedFile(Struct, frozen=True, kw_only=True):
    """A file that differs between two commits; an id is ``None`` if the file does not exist there."""

    path: str
    before: str | None
    after: str | None


def history(
    repo: Repository, path: str | None, at: str, *, most: int | None = None, beside: str | None = None
) -> tuple[Revision, ...]:
    """Return all revisions of a file up to a commit, newest first.

    In a shallow clone it ends at the boundary (``repo.is_shallow``), where a file looks as if it had been added.

    Args:
        repo: the repository.
        path: the file; ``None`` for all commits, without contents.
        at: 40 hex digits, or a range of two with ``..``.
        most: largest number of revisions.
        beside: a folder whose changes count as well.
    """
    limit = (f"--max-count={most}",) if most is not None else ()
    where = ("--", path, *((beside,) if beside is not None else ())) if path is not None else ()
    return tuple(
        _revision(
            fields,
            path,
            _content(repo, fields[0], files, path) if path is not None else None,
            tuple(name for name, _ in _contents(files) if name != path),
        )
        for fields, files in _logged(repo, *limit, at, *where)
    )


def histories(
    repo: Repository, at: str, beside: Callable[[str], str]
) -> dict[str, tuple[Revision, ...]] | None:
    """Return all revisions of every file, by path, as :func:`history` lists them, from a single pass over the commits.

    None if the history contains merges: git then decides for each file separately which side's commits count. Files
    with names that git prints in quotes are omitted.

    Args:
        repo: the repository.
        at: 40 hex digits.
        beside: returns the path of the file that a path lies beside, or the path itself.
    """
    if repo.run("rev-list", "--merges", "--max-count=1", at).out.strip():
        return None
    found: dict[str, list[Revision]] = {}
    for fields, files in reversed(_logged(repo, at)):
        changed: dict[str, dict[str, str | None]] = {}
        for name, oid in _contents(files):
            changed.setdefault(beside(name), {})[name] = oid
        for path, own in changed.items():
            before = found.setdefault(path, [])
            oid = own[path] if path in own else before[-1].oid if before else None
            before.append(_revision(fields, path, oid, tuple(name for name in own if name != path)))
    return {path: tuple(reversed(those)) for path, those in found.items() if not path.startswith('"')}


def _logged(repo: Repository, *what: str) -> list[tuple[list[str], str]]:
    """Return, for each commit of git log, its fields and the lines of its files."""
    printed = repo.run(*LOG, *what).out.decode("utf-8", "replace")
    # git prints the files of a commit before the first field of the next commit.
    parts = printed.split("\0")
    size = len(FIELDS)
    logged = []
    for start in range(0, len(parts) - size, size):
        commit = parts[start].rpartition("\n")[2]
        if HEX.match(commit) is None:
            raise RegistryError(
                f"{repo.path}: git log printed {commit[:60]!r}, expected a commit; git fsck shows more"
            )
        logged.append(([commit, *parts[start + 1 : start + size]], parts[start + size]))
    # Verify the commit objects: git does not notice if one was replaced by a copy of another.
    deque(repo.objects([fields[0] for fields, _ in logged], b"commit"), maxlen=0)
    return logged


def _revision(fields: list[str], path: str | None, oid: str | None, beside: tuple[str, ...] = ()) -> Revision:
    commit, parents, author, author_mail, authored, committer, committer_mail, committed, message = fields
    return Revision(
        commit=commit,
        parents=tuple(parents.split()),
        path=path or "",
        oid=oid,
        author=Person(name=author, email=author_mail),
        authored=_moment(authored),
        committer=Person(name=committer, email=committer_mail),
        committed=_moment(committed),
        message=message,
        beside=beside,
    )


def _content(repo: Repository, commit: str, files: str, path: str) -> str | None:
    """Return the id that a commit gave to a file; for a merge it is looked up, since git's log does not state it."""
    for name, oid in _contents(files):
        if name == path:
            return oid
    blob = repo.read(commit, path)
    return blob.oid if blob is not None else None


def _contents(files: str) -> Iterator[tuple[str, str | None]]:
    """Yield each file of git's list, with the name as printed and the id of its content; None if it was removed."""
    for line in files.splitlines():
        if line.startswith(":"):
            what, _, path = line.partition("\t")
            _, mode, _, oid, _ = what.removeprefix(":").encode().split()
            yield path, _there(mode, oid)


def _moment(raw: str) -> datetime:
    """Parse git's raw date, seconds and zone; an invalid zone or year gives the start of 1970 in UTC."""
    seconds, _, zone = raw.partition(" ")
    try:
        minutes = int(zone[1:3]) * 60 + int(zone[3:5])
        offset = timezone(timedelta(minutes=-minutes if zone.startswith("-") else minutes))
        return datetime.fromtimestamp(int(seconds), offset)
    except (ValueError, OverflowError, OSError):
        return datetime.fromtimestamp(0, UTC)


def changed(repo: Repository, before: str | None, after: str, prefix: str = "") -> tuple[ChangedFile, ...]:
    """Return the files that differ between two commits, sorted by path; links are ignored.

    Without ``before`` all files are new; ``prefix`` is the folder to search, by default the whole tree.
    """
    return tuple(
        ChangedFile(path=path, before=_regular(was), after=_regular(becomes))
        for path, was, becomes in repo.difference(before, after, prefix)
    )


def not_files(repo: Repository, before: str, after: str, prefix: str) -> tuple[str, ...]:
    """Return the links and submodules below a folder that are new or others after the second commit, sorted."""
    found = repo.difference(before, after, prefix)
    return tuple(path for path, _, becomes in found if becomes is not None and becomes[0] not in REGULAR)


def _regular(member: Member | None) -> str | None:
    return member[1] if member is not None and member[0] in REGULAR else None


def _there(mode: bytes, oid: bytes) -> str | None:
    return oid.decode("ascii") if mode in REGULAR else None


def newest_where(
    repo: Repository, path: str, at: str, holds: Callable[[bytes], bool]
) -> tuple[Revision, Blob] | None:
    """Return the newest revision of a file, up to a commit, for whose content ``holds`` is true."""
    for revision in history(repo, path, at):
        if revision.oid is not None:
            data = repo.blob(revision.oid)
            if holds(data):
                return revision, Blob(revision.oid, data)
    return None


def at_date(repo: Repository, moment: datetime, at: str) -> str:
    """Return the commit of a branch at a time, by the dates along its first parents.

    Side branches do not count: what was merged in May was not in the registry in April, whenever it was made.

    Raises:
        RegistryError: the branch started later.
    """
    # git interprets a small number as something other than seconds since 1970, unless written this way.
    seconds = max(int(moment.timestamp()), 0)
    found = repo.run("rev-list", "--max-count=1", "--first-parent", f"--before=@{seconds} +0000", at)
    commit = found.out.decode().strip()
    if not commit:
        first = repo.run("rev-list", "--max-parents=0", "--first-parent", "--format=%cs", at).out.split()[-1:]
        raise RegistryError(
            f"no commit as old as {moment:%Y-%m-%d %H:%M %Z}; the history begins later, on "
            f"{b''.join(first).decode() or 'no day'}; name that day or a later one{repo.unshallow_hint}"
        )
    return commit


DATE = re.compile(r"\d{4}-\d{2}-\d{2}(?P<time>[T ]\d{2}:\d{2}(:\d{2})?(Z|[+-]\d{2}:?\d{2})?)?\Z")
NAME = re.compile(r"[\w./~^@{}+-]+\Z")


class Named(Struct, frozen=True):
    """A commit, tag or branch."""

    name: str


class OnDate(Struct, frozen=True):
    """The state at a time, in UTC."""

    moment: datetime


class Firmware(Struct, frozen=True):
    """The newest revision of an entry made with a firmware."""

    version: str


Rev = Named | OnDate | Firmware


def parse_rev(text: str) -> Rev:
    """Parse a revision.

    A tag that looks like a date is written ``refs/tags/2026-05-01``.

    Raises:
        RegistryError: the text is not a revision.
    """
    if text.startswith("firmware:"):
        version = text.removeprefix("firmware:").strip()
        if version and version.isprintable():
            return Firmware(version)
    elif DATE.match(text):
        return OnDate(_moment_of(text))
    elif NAME.match(text) and not text.startswith("-") and len(text) <= 250:
        return Named(text)
    raise RegistryError(
        f"{text!r} is not a revision: expected a commit, tag or branch, a date such as 2026-05-01, or firmware:01.09"
    )


def _moment_of(text: str) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        is_day = len(text) == len("2026-05-01")
        return moment + timedelta(days=1, seconds=-1) if is_day else moment.astimezone(UTC)
    except (ValueError, OverflowError):
        raise RegistryError(
            f"{text!r} is not a date: expected one such as 2026-05-01 or 2026-05-01T12:30Z"
        ) from None


def commit_at(repo: Repository, rev: Rev) -> str:
    """Return the commit of a revision; for a firmware the newest, which is where the search starts.

    Raises:
        RegistryError: there is no such commit, or none yet.
    """
    if isinstance(rev, Named):
        return repo.commit_of(rev.name)
    newest = repo.newest()
    return at_date(repo, rev.moment, newest) if isinstance(rev, OnDate) else newest


def common_ancestor(repo: Repository, ours: str | None, theirs: str) -> str | None:
    """Return the newest common commit of two histories; ``None`` if there is no local commit.

    Raises:
        RegistryError: they have no common commit.
    """
    if ours is None:
        return None
    found = repo.run("merge-base", ours, theirs, good=(0, 1))
    if found.code:
        raise RegistryError(
            f"{repo.path}: the two histories share no commit, so they are different registries{repo.unshallow_hint}"
        )
    return found.out.split()[0].decode()
