"""An SQLite cache of a registry's content at a commit, discarded whenever it is in doubt.

It may be deleted at any time, be of another version, incomplete, locked by another process, or not writable: then it
returns nothing, and the caller reads git. Every table has a row count and a sum of checksums, since SQLite does not
notice a changed byte. Connections are opened for each query, so that threads, forks and other processes share only the
file.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, TypeAlias
from zlib import crc32

__all__ = ["ENTRIES", "ROWS", "IndexFile", "Mention"]

Mention: TypeAlias = tuple[str, str, str, str]
"""Path of the entry, kind of the name, the name itself, and additional data."""
Row: TypeAlias = tuple[str, ...]

WAIT_S: Final = 2.0
CHUNK: Final = 500
FAILURES: Final = (sqlite3.Error, OSError, UnicodeError)

TABLES: Final = """
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS files (path TEXT PRIMARY KEY, oid TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS mentions (path TEXT NOT NULL, kind TEXT NOT NULL, word TEXT NOT NULL, other TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS by_path ON mentions (path);
CREATE INDEX IF NOT EXISTS by_kind ON mentions (kind);
CREATE TABLE IF NOT EXISTS entries (oid TEXT PRIMARY KEY, packed BLOB NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS rows (oid TEXT PRIMARY KEY, packed BLOB NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID;
"""
ENTRIES: Final = "entries"
ROWS: Final = "rows"
"""Fields of entries, which are read in a fraction of the time of a whole entry."""
FILES: Final = "SELECT path, oid FROM files ORDER BY path"
FILES_AT: Final = "SELECT path, oid FROM files WHERE path"
MENTIONS: Final = "SELECT path, kind, word, other FROM mentions WHERE kind = ?"
MENTIONS_AT: Final = "SELECT path, kind, word, other FROM mentions WHERE path"


class IndexFile:
    """The cache file of one repository."""

    def __init__(self, file: Path, repository: str, version: str) -> None:
        """Set up without opening the file.

        Args:
            file: path of the file.
            repository: identifies the repository.
            version: version of the content; a file with another version is discarded.
        """
        self._file = file
        self._stamp: Final = {"repository": repository, "version": version}

    def files(self) -> tuple[str, dict[str, str]] | None:
        """Return the commit, and the id of every file by path; None if the data is not complete."""
        found = self._read("files", FILES, ())
        return (found[0], dict(found[1])) if found is not None else None  # type: ignore[arg-type]  # pairs

    def mentions(self, kind: str) -> tuple[str, list[Mention]] | None:
        """Return the commit, and all names of one kind; None if the data is not complete."""
        return self._read(f"mentions {kind}", MENTIONS, (kind,))  # type: ignore[return-value]  # four columns

    def commit(self) -> str | None:
        """Return the commit of the content; None if there is none."""
        with self._opened() as db:
            return self._meta(db).get("commit") if db is not None else None

    def replace(self, commit: str, files: Mapping[str, str], mentions: Sequence[Mention]) -> None:
        """Rewrite the file, if it is writable."""
        with self._opened(writes=True) as db:
            if db is None:
                return
            db.execute("BEGIN IMMEDIATE")
            for table in ("meta", "files", "mentions"):
                db.execute(f"DELETE FROM {table}")  # noqa: S608  three names of our own
            meta = {**self._stamp, "commit": commit}
            _insert(db, meta, [*files.items()], mentions)
            db.executemany("INSERT INTO meta VALUES (?, ?)", [*meta.items()])
            for table in (ENTRIES, ROWS):
                db.execute(f"DELETE FROM {table} WHERE oid NOT IN (SELECT oid FROM files)")  # noqa: S608  as above
            db.execute("COMMIT")

    def advance(
        self, base: str, commit: str, files: Mapping[str, str | None], mentions: Sequence[Mention]
    ) -> None:
        """Update the content from one commit to another, unless another process did so first.

        Args:
            base: current commit.
            commit: new commit.
            files: files that differ, with their new id; None if removed.
            mentions: names stated by the new files.
        """
        with self._opened(writes=True) as db:
            if db is None:
                return
            db.execute("BEGIN IMMEDIATE")
            meta = self._meta(db)
            if meta.get("commit") != base:
                db.execute("ROLLBACK")
                return
            for path in files:
                _count(meta, "files", db.execute(f"{FILES_AT} = ?", (path,)).fetchall(), -1)
                for row in db.execute(f"{MENTIONS_AT} = ?", (path,)).fetchall():
                    _count(meta, f"mentions {row[1]}", [row], -1)
                db.execute("DELETE FROM files WHERE path = ?", (path,))
                db.execute("DELETE FROM mentions WHERE path = ?", (path,))
            _insert(db, meta, [(path, oid) for path, oid in files.items() if oid is not None], mentions)
            meta["commit"] = commit
            db.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", [*meta.items()])
            db.execute("COMMIT")

    def kept(self, table: str, oids: Sequence[str]) -> dict[str, bytes]:
        """Return cached data from one of the tables of entries, by file id, as far as it exists and is intact."""
        found: dict[str, bytes] = {}
        with self._opened() as db:
            if db is None or not self._meta(db):
                return found
            for start in range(0, len(oids), CHUNK):
                chunk = oids[start : start + CHUNK]
                marks = ",".join("?" * len(chunk))
                rows = db.execute(
                    f"SELECT oid, packed, crc FROM {table} WHERE oid IN ({marks})",  # noqa: S608  question marks
                    chunk,
                )
                found.update({oid: packed for oid, packed, crc in rows if _crc(oid, packed) == crc})
        return found

    def keep(self, table: str, entries: Mapping[str, bytes]) -> None:
        """Cache data of entries by file id, if the file is writable."""
        with self._opened(writes=True) as db:
            if db is not None and self._meta(db):
                rows = [(oid, packed, _crc(oid, packed)) for oid, packed in entries.items()]
                db.execute("BEGIN IMMEDIATE")
                db.executemany(f"INSERT OR REPLACE INTO {table} VALUES (?, ?, ?)", rows)  # noqa: S608  a name of our own
                db.execute("COMMIT")

    def _read(self, table: str, query: str, words: Sequence[str]) -> tuple[str, list[Row]] | None:
        found: tuple[str, list[Row]] | None = None
        with self._opened() as db:
            if db is None:
                return None
            db.execute("BEGIN")
            meta = self._meta(db)
            if not meta:
                return None
            found = meta["commit"], db.execute(query, words).fetchall()
            if meta.get(table, "0 0") != _sum(found[1], 1, "0 0"):
                found = None
                raise sqlite3.DatabaseError
        return found

    def _meta(self, db: sqlite3.Connection) -> dict[str, str]:
        """Return the metadata; empty if the file is of another repository or version."""
        meta = dict(db.execute("SELECT key, value FROM meta"))
        is_ours = all(meta.get(key) == value for key, value in self._stamp.items())
        return meta if is_ours and "commit" in meta else {}

    @contextmanager
    def _opened(self, *, writes: bool = False) -> Iterator[sqlite3.Connection | None]:
        """Provide a connection; None if there is no readable file. Failures are treated as a missing file."""
        if not writes and not self._file.is_file():
            yield None
            return
        connection = None
        try:
            if writes:
                self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            connection = sqlite3.connect(self._file, timeout=WAIT_S, isolation_level=None)
            connection.execute("PRAGMA synchronous = NORMAL")
            if writes:
                connection.executescript(TABLES)
        except FAILURES as error:
            self._failed(error, connection)
            yield None
            return
        try:
            yield connection
        except FAILURES as error:
            self._failed(error, connection)
        finally:
            connection.close()

    def _failed(self, error: Exception, connection: sqlite3.Connection | None) -> None:
        """Delete the file after an error, unless it is only locked, read-only or missing, and so may be intact."""
        if connection is not None:
            connection.close()
        if not isinstance(error, sqlite3.OperationalError | OSError):
            self._drop()

    def _drop(self) -> None:
        with suppress(OSError):
            self._file.unlink()


def _insert(
    db: sqlite3.Connection, meta: dict[str, str], files: Sequence[Row], mentions: Sequence[Mention]
) -> None:
    db.executemany("INSERT INTO files VALUES (?, ?)", files)
    _count(meta, "files", files, 1)
    db.executemany("INSERT INTO mentions VALUES (?, ?, ?, ?)", mentions)
    for mention in mentions:
        _count(meta, f"mentions {mention[1]}", [mention], 1)


def _count(meta: dict[str, str], table: str, rows: Iterable[Row], sign: int) -> None:
    meta[table] = _sum(rows, sign, meta.get(table, "0 0"))


def _sum(rows: Iterable[Row], sign: int, start: str) -> str:
    """Return the number and the sum of checksums of rows, independent of their order."""
    count, total = map(int, start.split())
    for row in rows:
        count += sign
        total += sign * crc32("\0".join(row).encode())
    return f"{count} {total}"


def _crc(oid: str, packed: bytes) -> int:
    return crc32(packed, crc32(oid.encode()))
