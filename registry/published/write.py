"""Writing a commit of a registry as static files: only what changed, and the root file last."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, date
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Final

from calibrary.atomic import check_folder
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import SERIAL_HASH_DIGITS
from calibrary.records import Record, replace, to_json
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.git.history import history
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import is_entry, match_key
from calibrary.registry.published.layout import (
    CAMERA_FOLDER,
    ENTRY_FOLDER,
    ROOT_FILE,
    SIGNATURE_FILE,
    TREE_FOLDER,
    UNIT_FOLDER,
    WIDTH,
    CameraName,
    EarlierRevision,
    PublishedCamera,
    PublishedEntry,
    PublishedRegistry,
    PublishedTree,
    camera_path,
    depth_for,
    document_bytes,
    entry_path,
    is_ours,
    sha256,
)
from calibrary.registry.published.signature import sign
from calibrary.registry.resolution import is_keyed
from calibrary.registry.snapshot import Snapshot, used_before
from calibrary.registry.writing import parsed
from calibrary.workers import mapped

__all__ = ["FOLDERS", "OWN_NAMES", "Publication", "publish"]

FOLDERS: Final = (ENTRY_FOLDER, CAMERA_FOLDER, UNIT_FOLDER, TREE_FOLDER)
STAGING: Final = ".publishing"
OWN_NAMES: Final = frozenset({ROOT_FILE, SIGNATURE_FILE, STAGING, *FOLDERS})
"""What a publication has at the top of its folder."""

OURS: Final = b'{"schema":"calibrary/'
"""How every published file begins."""
HEX: Final = frozenset("0123456789abcdef")
WAIT_S: Final = 60.0
CHUNK: Final = 500
WORTH_A_POOL: Final = 2000
"""Entries from which starting workers costs less than it saves."""


class Publication(Record, tag_field="schema", tag="calibrary/registry-publish-1"):
    """What calibrary registry publish --json prints.

    Attributes:
        registry: its folder.
        commit: that was published.
        out: the folder that it was written into.
        entries: how many entries there are.
        cameras: how many camera files there are.
        written, unchanged, removed: files.
        root: SHA-256 of calibrary.json.
        signed: whether it is signed.
    """

    registry: str
    commit: ObjectId
    out: str
    entries: int
    cameras: int
    written: int
    unchanged: int
    removed: int
    root: str
    signed: bool


def publish(
    snapshot: Snapshot,
    out: Path,
    *,
    key: Path | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Publication:
    """Write the entries of a state that are approved, held or retired; the same bytes for the same commit.

    The root is replaced last, so that a reader finds the whole former state, the whole new one, or in between a digest
    that does not fit; the reader then asks again.

    Args:
        snapshot: of a registry in git.
        out: a folder that is new, empty, or an earlier publication; what has not changed there is left alone.
        key: an ssh key to sign the root with, as of ``ssh-keygen -Y sign -f``.
        workers: processes; by default one for each processor.
        progress: told how many of how many entries are done.

    Raises:
        InputError: the folder contains something else, or cannot be written.
        RegistryError: an entry cannot be read or may not be published, or it cannot be signed.
    """
    repo, commit = snapshot.require_git("has no commit that could be published")
    _check_out(out)
    when = history(repo, None, commit, most=1)[0].committed.astimezone(UTC)
    with _output(out) as output:
        rows = _written_entries(snapshot, repo, commit, output, workers=workers, progress=progress)
        cameras = _cameras(rows)
        depth = depth_for(len(cameras))
        tree = _write_tree(cameras, depth, output)
        root = PublishedRegistry(
            commit=commit, date=when, entries=len(rows), cameras=len(cameras), depth=depth, tree=tree
        )
        data = document_bytes(root)
        signature = sign(data, key) if key is not None else None
        output.settle()
        if signature is not None:
            output.put(SIGNATURE_FILE, signature)
        output.put(ROOT_FILE, data)
        removed = _remove_stale(output, is_signed=signature is not None)
    return Publication(
        registry=str(snapshot.place),
        commit=commit,
        out=str(out),
        entries=len(rows),
        cameras=len(cameras),
        written=output.written,
        unchanged=len(output.kept) - output.written,
        removed=removed,
        root=sha256(data),
        signed=signature is not None,
    )


@dataclass(slots=True, kw_only=True)
class _Output:
    """The folder that is written into, and what belongs there.

    Attributes:
        root: the folder.
        kept: every file that belongs there.
        written: how many of them were absent or different.
        staged: files that are written beside their place, which is taken when all are.
    """

    root: Path
    kept: set[str] = field(default_factory=set)
    written: int = 0
    staged: dict[str, Path] = field(default_factory=dict)

    def put(self, path: str, data: bytes, *, at_once: bool = True) -> None:
        """A file whose content is complete or as it was, and not touched where it is the same."""
        self.kept.add(path)
        place = self.root / path
        if _content(place) == data:
            return
        self.written += 1
        temporary = self.root / STAGING / f"{os.getpid()}-{self.written}"
        temporary.write_bytes(data)
        if at_once:
            _move(temporary, place)
        else:
            self.staged[path] = temporary

    def settle(self) -> None:
        """Move what is staged to its place, once all of it is on the disk."""
        if hasattr(os, "sync"):
            os.sync()
        for path, temporary in self.staged.items():
            _move(temporary, self.root / path)
        self.staged.clear()


def _content(place: Path) -> bytes | None:
    try:
        return place.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None


def _move(temporary: Path, place: Path) -> None:
    try:
        temporary.replace(place)
    except FileNotFoundError:
        place.parent.mkdir(parents=True, exist_ok=True)
        temporary.replace(place)


def _check_out(out: Path) -> None:
    """Refuse a folder of something else.

    Raises:
        InputError: it contains something that was not published, or nothing may be written there.
    """
    check_folder(out)
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError("is a file, expected a folder for the published files", source=str(out))
    try:
        found = {item.name for item in out.iterdir()}
        is_known = ROOT_FILE in found and (out / ROOT_FILE).read_bytes().startswith(OURS)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=str(out)) from None
    # A first run that was interrupted leaves everything but the root; a site may lie beside the published files.
    if found and not (is_known or STAGING in found or SITE_MARKER in found):
        raise InputError(
            f"is not a published registry (it has no {ROOT_FILE} of ours) and is not empty; name a folder of its own",
            source=str(out),
        )


SITE_MARKER: Final = ".calibrary-site"


@contextmanager
def _output(out: Path) -> Iterator[_Output]:
    """The folder, locked against another run, and without what an interrupted one left.

    Raises:
        InputError: it cannot be written.
        RegistryError: another run is busy in it.
    """
    try:
        staging = out / STAGING
        staging.mkdir(parents=True, exist_ok=True)
        with writer_lock(staging, wait_s=WAIT_S):
            for left in staging.glob("*-*"):
                left.unlink()
            yield _Output(root=out)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(out)) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """What an entry adds to the camera files.

    Attributes:
        key: of the file that lists it: make, model and the unit, if it is of one.
        names: what else the camera is called.
        row: the entry in that file.
        files: the paths that were written or found for it.
        written: how many of them were written.
    """

    key: CameraKey
    names: tuple[CameraName, ...]
    row: PublishedEntry
    files: tuple[str, ...]
    written: int


def _written_entries(
    snapshot: Snapshot,
    repo: Repository,
    commit: str,
    output: _Output,
    *,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> list[_Row]:
    """Write every entry's file, and those of its earlier revisions that answer for other days."""
    listed = [
        (path, oid) for path, oid in sorted(snapshot.paths.items()) if is_entry(path) and oid is not None
    ]
    chunks = [listed[start : start + CHUNK] for start in range(0, len(listed), CHUNK)]
    count = (os.cpu_count() or 1) if workers is None else workers
    work = partial(_write_chunk, place=repo.path, commit=commit, out=output.root)
    rows: list[_Row] = []
    done = 0
    for chunk, made in zip(
        chunks, _mapped(work, chunks, 1 if len(listed) < WORTH_A_POOL else count), strict=True
    ):
        rows += made
        done += len(chunk)
        if progress is not None:
            progress(done, len(listed))
    for one in rows:
        output.kept.update(one.files)
        output.written += one.written
    return rows


_Chunk = Sequence[tuple[str, str]]


def _mapped(
    work: Callable[[_Chunk], list[_Row]], chunks: Sequence[_Chunk], workers: int
) -> Iterator[list[_Row]]:
    if workers <= 1 or len(chunks) <= 1:
        yield from map(work, chunks)
        return
    try:
        yield from mapped(work, chunks, workers, preload=[__name__])
    except BrokenProcessPool:
        raise InputError(
            "a process that writes entries was ended from outside, as when memory runs out; use --workers 1"
        ) from None


@cache
def _repository(place: Path) -> Repository:
    """Opened once in each process."""
    return Repository.open(place)


def _write_chunk(chunk: _Chunk, *, place: Path, commit: str, out: Path) -> list[_Row]:
    repo = _repository(place)
    contents = repo.read_many([oid for _, oid in chunk])
    entries = ((path, parsed(data, path)) for (path, _), data in zip(chunk, contents, strict=True))
    return [
        _write_entry(path, entry, repo, commit, out)
        for path, entry in entries
        if entry.status is not Status.DRAFT
    ]


def _write_entry(path: str, entry: Entry, repo: Repository, commit: str, out: Path) -> _Row:
    _require_publishable(path, entry)
    camera = entry.calibration.camera
    output = _Output(root=out)
    earlier = [
        EarlierRevision(commit=at, validity=one.validity, sha256=_put_entry(one, output))
        for at, one in _earlier(entry, used_before(repo, commit, path))
    ]
    return _Row(
        key=CameraKey(make=camera.make, model=camera.model, serial=camera.serial),
        names=tuple(CameraName(make=alias.make, model=alias.model) for alias in entry.aliases),
        row=PublishedEntry.of(entry, path, _put_entry(entry, output), earlier),
        files=tuple(output.kept),
        written=output.written,
    )


def _put_entry(entry: Entry, output: _Output) -> str:
    # A unit's label and the folder it is kept in are internal to the team.
    data = document_bytes(to_json(replace(entry, label=None, tags=())))
    digest = sha256(data)
    output.put(entry_path(digest), data)
    return digest


def _require_publishable(path: str, entry: Entry) -> None:
    """Refuse what no reader would find, and a serial number in clear.

    Raises:
        RegistryError: the entry is of another camera than its path says, or its serial number is not hashed.
    """
    if entry.path != path and is_keyed(path):
        raise RegistryError(
            f"{path}: its camera belongs at {entry.path}; 'calibrary registry check' shows what is wrong with it"
        )
    serial = entry.calibration.camera.serial
    if serial is not None and (len(serial) != SERIAL_HASH_DIGITS or not set(serial) <= HEX):
        raise RegistryError(
            f"{path}: its serial number is not hashed, so it is not published; 'calibrary registry add FILE' hashes it"
        )


def _earlier(entry: Entry, revisions: Iterable[tuple[str, Entry]]) -> Iterator[tuple[str, Entry]]:
    """The revisions that may answer for a day on which the entry is not valid: the newest of each period."""
    if not entry.is_usable or entry.validity is None:
        return
    seen: set[tuple[date | None, date | None]] = {_days(entry.validity)}
    for commit, one in revisions:
        if (days := _days(one.validity)) not in seen:
            seen.add(days)
            yield commit, one


def _days(validity: Validity | None) -> tuple[date | None, date | None]:
    return (validity.first, validity.last) if validity is not None else (None, None)


def _cameras(rows: Sequence[_Row]) -> dict[str, PublishedCamera]:
    """The camera files by path: each with its entries, and the cameras that it is another name of."""
    keys: dict[str, CameraKey] = {}
    entries: dict[str, list[PublishedEntry]] = defaultdict(list)
    aliases: dict[str, dict[tuple[str, str], CameraName]] = defaultdict(dict)
    for one in rows:
        path = camera_path(one.key)
        keys.setdefault(path, one.key)
        entries[path].append(one.row)
        own = CameraName(make=one.key.make or "", model=one.key.model or "")
        for name in one.names:
            called = CameraKey(make=name.make, model=name.model)
            keys.setdefault(camera_path(called), called)
            aliases[camera_path(called)].setdefault((match_key(own.make), match_key(own.model)), own)
    return {
        path: PublishedCamera(
            make=keys[path].make or "",
            model=keys[path].model or "",
            serial=keys[path].serial,
            entries=tuple(sorted(entries[path], key=lambda row: row.path)),
            aliases=tuple(name for _, name in sorted(aliases[path].items())),
        )
        for path in sorted(keys)
    }


def _write_tree(cameras: Mapping[str, PublishedCamera], depth: int, output: _Output) -> dict[str, str]:
    """Write the camera files and the tree of their digests; what the root has of it."""
    leaves = []
    for path, camera in cameras.items():
        data = document_bytes(camera)
        output.put(path, data, at_once=False)
        leaves.append((sha256(path.encode()), path, sha256(data)))
    return _write_part(sorted(leaves), TREE_FOLDER, depth, output)


def _write_part(
    leaves: Sequence[tuple[str, str, str]], folder: str, depth: int, output: _Output
) -> dict[str, str]:
    """Write what is below a part of the tree; the part itself.

    Args:
        leaves: hash of the path, path and digest of each camera file below it, sorted.
        folder: of the part's files.
        depth: levels of files below it.
        output: to write to.
    """
    if depth == 0:
        return {path: digest for _, path, digest in leaves}
    at = folder.count("/") * WIDTH
    part = {}
    for name, below in groupby(leaves, key=lambda leaf: leaf[0][at : at + WIDTH]):
        data = document_bytes(
            PublishedTree(tree=_write_part([*below], f"{folder}/{name}", depth - 1, output))
        )
        output.put(f"{folder}/{name}.json", data, at_once=False)
        part[name] = sha256(data)
    return part


def _remove_stale(output: _Output, *, is_signed: bool) -> int:
    """Remove files of an earlier publication that are not in this one; anything else stays."""
    removed = 0
    stale = [
        path
        for path in _files_below(output.root)
        if path not in output.kept and is_ours(path) and _begins_as_ours(output.root / path)
    ]
    if not is_signed and (output.root / SIGNATURE_FILE).is_file():
        stale.append(SIGNATURE_FILE)
    for path in stale:
        place = output.root / path
        place.unlink()
        removed += 1
        with suppress(OSError):
            # Up to the first folder that has something else in it.
            for folder in place.relative_to(output.root).parents[:-1]:
                (output.root / folder).rmdir()
    return removed


def _files_below(root: Path) -> Iterator[str]:
    start = len(str(root)) + 1
    for top in FOLDERS:
        for folder, _, names in os.walk(root / top):
            below = folder[start:].replace(os.sep, "/")
            yield from (f"{below}/{name}" for name in names)


def _begins_as_ours(file: Path) -> bool:
    if file.is_symlink():
        return False
    with file.open("rb") as opened:
        return opened.read(len(OURS)) == OURS
