"""Index of a registry's entries at a commit, cached between runs and updated by the differences.

Reading 100 000 entries takes a minute, listing their trees a second. An :class:`Index` uses a file in the user's cache
folder (:mod:`calibrary.registry.index`) with the files of a commit, the names stated in their content (aliases,
superseded entries), and parsed entries by git's id of their file. Its results equal those of git at that commit; a
test compares the two over random histories.
"""

from __future__ import annotations

import hashlib
import re
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeAlias, TypeVar
from zlib import crc32

import msgspec
from msgspec import Struct
from platformdirs import user_cache_path

from calibrary.errors import InputError
from calibrary.known_camera import match_key
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.fields import Value
from calibrary.registry.git.history import changed
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import (
    CAMERAS,
    PROPOSALS,
    PROPOSED,
    ROOT,
    STATEMENTS,
    SUFFIX,
    folder_of,
    in_use_path,
    is_entry,
    is_proposal,
)
from calibrary.registry.resolution import AliasMap
from calibrary.registry.standing import Standing
from calibrary.registry.statements import RULES, Signed, parse_statement
from calibrary.strictyaml import load_yaml

Mention: TypeAlias = tuple[str, str, str, str]
"""Path of the entry, kind of the name, the name itself, and additional data."""
SqlRow: TypeAlias = tuple[str, ...]

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
CREATE TABLE IF NOT EXISTS checked (oid TEXT PRIMARY KEY, packed BLOB NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS standings (oid TEXT PRIMARY KEY, packed BLOB NOT NULL, crc INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS seen (ref TEXT, subject TEXT, id TEXT, PRIMARY KEY (ref, subject, id)) WITHOUT ROWID;
"""
ENTRIES: Final = "entries"
ROWS: Final = "rows"
"""Fields of entries, by git's id of their file."""
STANDINGS: Final = "standings"
"""What is in force of entries at the commit of the file, by their paths."""
CHECKED: Final = "checked"
"""What checking the entries of a model found, by a name of all that it follows from."""
FILES: Final = "SELECT path, oid FROM files ORDER BY path"
FILES_AT: Final = "SELECT path, oid FROM files WHERE path"
MENTIONS: Final = "SELECT path, kind, word, other FROM mentions WHERE kind = ?"
MENTIONS_AT: Final = "SELECT path, kind, word, other FROM mentions WHERE path"


class Overlay(Struct, frozen=True):
    """Difference between the commit of the file and the requested one.

    Attributes:
        files: entries and proposals that differ, with their new id; None if removed.
        mentions: names stated by the new files.
        touched: beginnings of the paths of entries whose standing may differ; None for all.
    """

    files: Mapping[str, str | None]
    mentions: tuple[Mention, ...]
    touched: frozenset[str] | None


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

    def replace(
        self, commit: str, files: Mapping[str, str], mentions: Sequence[Mention], *, is_other: bool = False
    ) -> None:
        """Rewrite the file, if it is writable.

        Args:
            commit: the commit.
            files: id of every file, by path.
            mentions: names stated by the files.
            is_other: whether the repository is another one than before, so that what was seen there means nothing.
        """
        with self._opened(writes=True) as db:
            if db is None:
                return
            db.execute("BEGIN IMMEDIATE")
            former = ("seen",) if is_other else ()
            for table in ("meta", "files", "mentions", CHECKED, STANDINGS, *former):
                db.execute(f"DELETE FROM {table}")  # noqa: S608  three names of our own
            meta = {**self._stamp, "commit": commit}
            _insert(db, meta, [*files.items()], mentions)
            db.executemany("INSERT INTO meta VALUES (?, ?)", [*meta.items()])
            for table in (ENTRIES, ROWS):
                db.execute(f"DELETE FROM {table} WHERE oid NOT IN (SELECT oid FROM files)")  # noqa: S608  the same
            db.execute("COMMIT")

    def advance(self, base: str, commit: str, overlay: Overlay) -> None:
        """Update the content from one commit to another, unless another process did so first.

        Args:
            base: current commit.
            commit: new commit.
            overlay: what differs.
        """
        files, mentions = overlay.files, overlay.mentions
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
            if overlay.touched is None:
                db.execute(f"DELETE FROM {STANDINGS}")  # noqa: S608  a name of our own
            for start in overlay.touched or ():
                span = (start, f"{start}\U0010ffff")
                db.execute(f"DELETE FROM {STANDINGS} WHERE oid >= ? AND oid <= ?", span)  # noqa: S608  the same
            meta["commit"] = commit
            db.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", [*meta.items()])
            db.execute("COMMIT")

    def at(self, table: str, oids: Sequence[str]) -> tuple[str, dict[str, bytes]] | None:
        """Return the commit, and what is kept for it; None if the data is not complete."""
        commit, found = self.commit(), self.kept(table, oids)
        return (commit, found) if commit is not None and commit == self.commit() else None

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

    def keep(
        self, table: str, entries: Mapping[str, object], *, at: str | None = None, most: int | None = None
    ) -> None:
        """Cache data of entries by file id, if the file is writable; only if it is of a commit, where one is given.

        Of a table with more rows than ``most``, what was kept before is dropped.
        """
        if not entries:
            return
        with self._opened(writes=True) as db:
            if db is not None and self._meta(db):
                packs = {oid: msgspec.msgpack.encode(one) for oid, one in entries.items()}
                rows = [(oid, packed, _crc(oid, packed)) for oid, packed in packs.items()]
                db.execute("BEGIN IMMEDIATE")
                if at is not None and self._meta(db).get("commit") != at:
                    db.execute("ROLLBACK")
                    return
                if most is not None and db.execute(f"SELECT count(*) FROM {table}").fetchone()[0] > most:  # noqa: S608
                    db.execute(f"DELETE FROM {table}")  # noqa: S608  a name of our own
                db.executemany(f"INSERT OR REPLACE INTO {table} VALUES (?, ?, ?)", rows)  # noqa: S608  a name of our own
                db.execute("COMMIT")

    def seen(self, ref: str, subjects: Iterable[str]) -> dict[str, list[str]]:
        """Return the ids of the statements that were read before, by the branch and their subject."""
        found: dict[str, list[str]] = {}
        with self._opened() as db:
            if db is None or not self._meta(db):
                return found
            for subject in subjects:
                rows = db.execute("SELECT id FROM seen WHERE ref = ? AND subject = ?", (ref, subject))
                found[subject] = [name for (name,) in rows]
        return found

    def remember(self, ref: str, statements: Mapping[str, Iterable[str]]) -> None:
        """Keep the ids of statements that were read, by the branch and their subject."""
        with self._opened(writes=True) as db:
            if db is not None and self._meta(db):
                rows = [(ref, subject, name) for subject, names in statements.items() for name in names]
                db.execute("BEGIN IMMEDIATE")
                db.executemany("INSERT OR IGNORE INTO seen VALUES (?, ?, ?)", rows)
                db.execute("COMMIT")

    def forget(self, ref: str, names: Iterable[str]) -> None:
        """Forget statements that were read, by the branch and their ids."""
        with self._opened(writes=True) as db:
            if db is not None and self._meta(db):
                db.execute("BEGIN IMMEDIATE")
                db.executemany("DELETE FROM seen WHERE ref = ? AND id = ?", [(ref, name) for name in names])
                db.execute("COMMIT")

    @property
    def path(self) -> Path:
        """The file."""
        return self._file

    def _read(self, table: str, query: str, words: Sequence[str]) -> tuple[str, list[SqlRow]] | None:
        found: tuple[str, list[SqlRow]] | None = None
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
    db: sqlite3.Connection, meta: dict[str, str], files: Sequence[SqlRow], mentions: Sequence[Mention]
) -> None:
    db.executemany("INSERT INTO files VALUES (?, ?)", files)
    _count(meta, "files", files, 1)
    db.executemany("INSERT INTO mentions VALUES (?, ?, ?, ?)", mentions)
    for mention in mentions:
        _count(meta, f"mentions {mention[1]}", [mention], 1)


def _count(meta: dict[str, str], table: str, rows: Iterable[SqlRow], sign: int) -> None:
    meta[table] = _sum(rows, sign, meta.get(table, "0 0"))


def _sum(rows: Iterable[SqlRow], sign: int, start: str) -> str:
    """Return the number and the sum of checksums of rows, independent of their order."""
    count, total = map(int, start.split())
    for row in rows:
        count += sign
        total += sign * crc32("\0".join(row).encode())
    return f"{count} {total}"


def _crc(oid: str, packed: bytes) -> int:
    return crc32(packed, crc32(oid.encode()))


VERSION: Final = f"6 {' '.join(Entry.__struct_fields__)}"
"""Version of the stored form; an index with another version is rebuilt."""
BLOCK: Final = 500

LINE_OF_LABEL: Final = re.compile(rb"^label:.*$", re.MULTILINE)
T = TypeVar("T")
ALIAS, LABEL, SUPERSEDES, NAMED = "alias", "label", "supersedes", "named"
NAMING_KEYS: Final = (b"aliases", b"supersedes")
"""Keys of a file that may state names; files without them are not parsed for this."""
_PACKED: Final = msgspec.msgpack.Decoder(Entry)
_ROW: Final = msgspec.msgpack.Decoder(dict[str, Value])
_STANDING: Final = msgspec.msgpack.Decoder(Standing)


def stated_names(path: str, entry: Entry) -> Iterator[Mention]:
    """Yield the names that an entry states and others look up, by kind; see :meth:`Index.mentions`."""
    camera = entry.calibration.camera
    if entry.label is not None:
        yield path, LABEL, match_key(entry.label), entry.label
    for alias in entry.aliases:
        name = f"{match_key(alias.make)}\n{match_key(alias.model)}"
        yield path, ALIAS, name, folder_of(camera.make or "", camera.model or "")
    if entry.supersedes is not None:
        yield path, SUPERSEDES, entry.supersedes, ""


def alias_folder(name: str) -> str:
    """Return the folder for entries of the camera named by an alias."""
    make, _, model = name.partition("\n")
    return folder_of(make, model)


class Index:
    """The files of a registry at one commit, and the names that they state.

    Attributes:
        file: the cache file of the repository.
    """

    def __init__(self, repo: Repository, commit: str, file: IndexFile) -> None:
        """Set up without reading anything; see :func:`index_at`."""
        self._repo = repo
        self._commit = commit
        self.file = file
        self._overlays: dict[str, Overlay] = {}
        self._all: tuple[dict[str, str], tuple[Mention, ...]] | None = None

    @cached_property
    def files(self) -> Mapping[str, str]:
        """Ids of all files in ``cameras/`` and ``proposals/``, by path, sorted."""
        found = self._from_file(self.file.files)
        if found is None:
            return MappingProxyType(self._from_git()[0])
        base, files = found
        if base != self._commit:
            for path, oid in self._overlay(base).files.items():
                if oid is None:
                    files.pop(path, None)
                else:
                    files[path] = oid
            files = dict(sorted(files.items()))
        return MappingProxyType(files)

    def mentions(self, kind: str) -> list[Mention]:
        """Return the names of one kind stated by all entries, sorted by path."""
        found = self._from_file(lambda: self.file.mentions(kind))
        if found is None:
            return sorted(one for one in self._from_git()[1] if one[1] == kind)
        base, mentions = found
        if base != self._commit:
            overlay = self._overlay(base)
            mentions = [one for one in mentions if one[0] not in overlay.files]
            mentions += [one for one in overlay.mentions if one[1] == kind]
        return sorted(mentions)

    @cached_property
    def aliases(self) -> AliasMap:
        """Folders with entries in ``cameras/`` that have an alias (make, model), by the alias as match keys."""
        found: dict[tuple[str, str], set[str]] = {}
        for path, _, name, folder in self.mentions(ALIAS):
            if not is_proposal(path):
                make, _, model = name.partition("\n")
                found.setdefault((make, model), set()).add(folder)
        return {name: frozenset(folders) for name, folders in found.items()}

    def parsed(
        self, files: Iterable[tuple[str, str, bytes | InputError]]
    ) -> Iterator[tuple[str, Entry | InputError]]:
        """Yield the entries of files with their paths; the error if one cannot be read.

        Args:
            files: id, path and content of each; the content has been verified against the id.
        """
        source = iter(files)
        while block := [*islice(source, BLOCK)]:
            kept = _unpacked(_PACKED, self.file.kept(ENTRIES, [oid for oid, _, _ in block]))
            new: dict[str, Entry] = {}
            for oid, path, data in block:
                if isinstance(data, InputError):
                    yield path, data
                    continue
                entry = kept.get(oid) or parsed_or_error(path, data)
                if oid not in kept and isinstance(entry, Entry):
                    new[oid] = entry
                yield path, entry
            self.file.keep(ENTRIES, new)

    def rows(self, oids: Sequence[str]) -> dict[str, dict[str, Value]]:
        """Return the fields that are kept of entries, by git's id of their file."""
        return _unpacked(_ROW, self.file.kept(ROWS, oids))

    def checked(self, decoder: msgspec.msgpack.Decoder[T], keys: Sequence[str]) -> dict[str, T]:
        """Return what is kept of checks, by the name of all that each follows from."""
        return _unpacked(decoder, self.file.kept(CHECKED, keys))

    def standings(
        self, paths: Sequence[str], compute: Callable[[Sequence[str]], Mapping[str, Standing]]
    ) -> dict[str, Standing]:
        """Return what is in force of entries; kept for the commit of the file.

        Args:
            paths: paths in ``cameras/``.
            compute: returns it of those that are not kept.
        """
        kept = self._from_file(lambda: self.file.at(STANDINGS, paths))
        found = _unpacked(_STANDING, kept[1] if kept is not None and kept[0] == self._commit else {})
        if missing := [path for path in paths if path not in found]:
            new = compute(missing)
            found.update(new)
            self.file.keep(STANDINGS, new, at=self._commit)
        return found

    def seen(self, ref: str, subjects: Iterable[str]) -> dict[str, list[str]]:
        """Return the ids of the statements that were read before on a branch, by their subject."""
        base = self.file.commit()
        # Another registry in the place of a former one is not measured by that.
        return self.file.seen(ref, subjects) if base is not None and self._repo.holds(base) else {}

    def _from_file(self, ask: Callable[[], tuple[str, T] | None]) -> tuple[str, T] | None:
        """Query the file, after updating it to a commit from which this one can be reached."""
        if self._all is not None:
            return None
        base = self.file.commit()
        if base is None or not self._repo.holds(base):
            files, mentions = self._from_git()
            self.file.replace(self._commit, files, mentions, is_other=base is not None)
            return None
        if base != self._commit and self._repo.tip() == self._commit:
            overlay = self._overlay(base)
            self.file.advance(base, self._commit, overlay)
        found = ask()
        if found is None or not self._repo.holds(found[0]):
            self._from_git()
            return None
        return found

    def _overlay(self, base: str) -> Overlay:
        if base not in self._overlays:
            differing = [
                file for folder in FOLDERS for file in changed(self._repo, base, self._commit, folder)
            ]
            files = {file.path: file.after for file in differing}
            there = {path: oid for path, oid in files.items() if oid is not None}
            said = {one.path: one.after for one in changed(self._repo, base, self._commit, STATEMENTS)}
            labels = {path: oid for path, oid in said.items() if oid is not None and path.startswith(LABELS)}
            mentions = (*_all_stated_names(self._repo, there), *_all_labels(self._repo, labels))
            self._overlays[base] = Overlay(files, mentions, _touched([*files, *said]))
        return self._overlays[base]

    def _from_git(self) -> tuple[dict[str, str], tuple[Mention, ...]]:
        if self._all is None:
            files = self._repo.listing(self._commit, *FOLDERS)
            labels = self._repo.listing(self._commit, LABELS)
            names = (*_all_stated_names(self._repo, files), *_all_labels(self._repo, labels))
            self._all = files, names
        return self._all


FOLDERS: Final = (CAMERAS, PROPOSALS)
LABELS: Final = f"{STATEMENTS}labels/"


def _touched(paths: Iterable[str]) -> frozenset[str] | None:
    """Return the beginnings of the paths of entries whose standing a change of files may affect; None for all."""
    found = set()
    for path in paths:
        if path.startswith(f"{STATEMENTS}{RULES}/"):
            return None
        if path.startswith(LABELS):
            found.add(f"{ROOT}{path.removeprefix(LABELS).rpartition('/')[0]}")
        elif path.startswith(STATEMENTS):
            found.add(f"{path.removeprefix(STATEMENTS).rpartition('/')[0]}{SUFFIX}")
        elif path.startswith((ROOT, PROPOSED)):
            found.add(in_use_path(path))
    return frozenset(found)


def _all_labels(repo: Repository, files: Mapping[str, str]) -> Iterator[Mention]:
    """Yield the labels that statements give to units; whether they are in force is seen when they are looked up."""
    for path, data in zip(files, repo.readable([*files.values()]), strict=True):
        one = parse_statement(path, data)
        label = one.body.label if isinstance(one, Signed) else None
        if label:
            yield path, NAMED, match_key(label), path.removeprefix(STATEMENTS).rpartition("/")[0]


def index_at(repo: Repository, commit: str, *, folder: Path | None = None) -> Index:
    """Return the index of a commit.

    Args:
        repo: the repository.
        commit: 40 hexadecimal digits.
        folder: folder of the cache file; by default the user's cache folder.
    """
    folder = folder or user_cache_path("calibrary", appauthor=False) / "registry-index"
    name = str(repo.common_dir)
    digest = hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:32]
    shown = name.encode("utf-8", "backslashreplace").decode()
    return Index(repo, commit, IndexFile(folder / f"{digest}.sqlite", shown, VERSION))


def _all_stated_names(repo: Repository, files: Mapping[str, str]) -> Iterator[Mention]:
    paths: Sequence[str] = [path for path in files if is_entry(path)]
    for path, data in zip(paths, repo.readable([files[path] for path in paths]), strict=True):
        if any(word in data for word in NAMING_KEYS):
            entry = parsed_or_error(path, data, require_digest=False)
            if isinstance(entry, Entry):
                yield from stated_names(path, entry)
                continue
        if (label := label_in(data)) is not None:
            yield path, LABEL, match_key(label), label


def label_in(data: bytes) -> str | None:
    """Return the label in an entry's file, from its line alone."""
    if (line := LINE_OF_LABEL.search(data)) is None:
        return None
    try:
        stated = load_yaml(line[0], source="label", max_bytes=LARGEST_ENTRY, max_depth=1)
    except InputError:
        return None
    label = stated.get("label") if isinstance(stated, dict) else None
    return label if isinstance(label, str) else None


def parsed_or_error(path: str, data: bytes, *, require_digest: bool = True) -> Entry | InputError:
    """Return the entry of a file, or the error."""
    try:
        return parse_entry(data, path, require_digest=require_digest)
    except InputError as error:
        return error


def _unpacked(decoder: msgspec.msgpack.Decoder[T], packed: Mapping[str, bytes]) -> dict[str, T]:
    """Return what was kept and can be read; of equal ones, as the standings of most entries, one object."""
    read, found = dict[bytes, T](), dict[str, T]()
    for name, data in packed.items():
        if (one := read.get(data)) is None:
            try:
                one = read[data] = decoder.decode(data)
            except (msgspec.DecodeError, InputError):
                continue
        found[name] = one
    return found
