"""The published form of a commit's entries: a file for each, and a row in the file of its camera."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from datetime import date
from functools import cache, partial
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import is_serial_hash
from calibrary.records import replace, to_json
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.git.repository import Repository
from calibrary.registry.published.layout import (
    CameraName,
    EarlierRevision,
    PublishedEntry,
    camera_path,
    document_bytes,
    entry_path,
    sha256,
)
from calibrary.registry.published.output import Output
from calibrary.registry.resolution import is_keyed
from calibrary.registry.snapshot import used_before
from calibrary.registry.writing import parsed
from calibrary.workers import mapped

__all__ = ["Row", "names_of", "written_rows"]

CHUNK: Final = 500
WORTH_A_POOL: Final = 2000
"""Number of entries above which starting worker processes pays."""


class Row(Struct, frozen=True, kw_only=True):
    """The contribution of an entry to the camera files.

    Attributes:
        key: key of the file that contains it: make, model and, if it is of a unit, the unit.
        names: other names of the camera.
        row: the entry in that file.
        files: paths of its files, written or existing.
        written: number of files that were written.
    """

    key: CameraKey
    names: tuple[CameraName, ...]
    row: PublishedEntry
    files: tuple[str, ...] = ()
    written: int = 0

    @property
    def cameras(self) -> frozenset[str]:
        """Paths of the camera files that depend on it."""
        return frozenset({camera_path(self.key), *(name.path for name in self.names)})


def names_of(entry: Entry) -> tuple[CameraKey, tuple[CameraName, ...]]:
    """Return the key of the file that contains an entry, and the other names of its camera."""
    camera = entry.calibration.camera
    return (
        CameraKey(make=camera.make, model=camera.model, serial=camera.serial),
        tuple(CameraName(make=alias.make, model=alias.model) for alias in entry.aliases),
    )


_Listed = Sequence[tuple[str, str]]


def written_rows(
    repo: Repository,
    commit: str,
    listed: _Listed,
    output: Output,
    *,
    workers: int | None,
    progress: Callable[[int], None],
) -> list[Row]:
    """Write the files of entries, without drafts, and of earlier revisions that apply to other days; return the rows.

    Args:
        repo: repository of the registry.
        commit: commit to publish.
        listed: path and id of the entries.
        output: output folder.
        workers: number of processes; by default one per processor.
        progress: called with the number of entries done since the last call.

    Raises:
        InputError: a process was killed from outside.
        RegistryError: an entry cannot be read or must not be published.
    """
    chunks = [listed[start : start + CHUNK] for start in range(0, len(listed), CHUNK)]
    count = (os.cpu_count() or 1) if workers is None else workers
    work = partial(_write_chunk, place=repo.path, commit=commit, out=output.root)
    rows: list[Row] = []
    made = _mapped(work, chunks, 1 if len(listed) < WORTH_A_POOL else count)
    for chunk, some in zip(chunks, made, strict=True):
        rows += some
        progress(len(chunk))
    for one in rows:
        output.kept.update(one.files)
        output.written += one.written
    return rows


def _mapped(
    work: Callable[[_Listed], list[Row]], chunks: Sequence[_Listed], workers: int
) -> Iterator[list[Row]]:
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
    """Return the repository, opened once per process."""
    return Repository.open(place)


def _write_chunk(chunk: _Listed, *, place: Path, commit: str, out: Path) -> list[Row]:
    repo = _repository(place)
    contents = repo.read_many([oid for _, oid in chunk])
    entries = ((path, parsed(data, path)) for (path, _), data in zip(chunk, contents, strict=True))
    return [
        _write_entry(path, entry, repo, commit, out)
        for path, entry in entries
        if entry.status is not Status.DRAFT
    ]


def _write_entry(path: str, entry: Entry, repo: Repository, commit: str, out: Path) -> Row:
    _require_publishable(path, entry)
    output = Output(root=out)
    earlier = [
        EarlierRevision(commit=at, validity=one.validity, sha256=_put_entry(one, output))
        for at, one in _earlier(entry, used_before(repo, commit, path))
    ]
    key, names = names_of(entry)
    return Row(
        key=key,
        names=names,
        row=PublishedEntry.of(entry, path, _put_entry(entry, output), earlier),
        files=tuple(output.kept),
        written=output.written,
    )


def _put_entry(entry: Entry, output: Output) -> str:
    # The label and tags of a unit are internal to the team.
    data = document_bytes(to_json(replace(entry, label=None, tags=())))
    return output.put(entry_path(sha256(data)), data)


def _require_publishable(path: str, entry: Entry) -> None:
    """Check that readers can find an entry, and that its serial number is hashed.

    Raises:
        RegistryError: the entry is of another camera than its path, or its serial number is not hashed.
    """
    if entry.path != path and is_keyed(path):
        raise RegistryError(
            f"{path}: its camera belongs at {entry.path}; 'calibrary registry check' shows what is wrong with it"
        )
    serial = entry.calibration.camera.serial
    if serial is not None and not is_serial_hash(serial):
        raise RegistryError(
            f"{path}: its serial number is not hashed, so it is not published; 'calibrary registry add FILE' hashes it"
        )


def _earlier(entry: Entry, revisions: Iterable[tuple[str, Entry]]) -> Iterator[tuple[str, Entry]]:
    """Yield the revisions for days on which the entry is not valid: the newest of each period."""
    if not entry.is_usable or entry.validity is None:
        return
    seen: set[tuple[date | None, date | None]] = {_days(entry.validity)}
    for commit, one in revisions:
        if (days := _days(one.validity)) not in seen:
            seen.add(days)
            yield commit, one


def _days(validity: Validity | None) -> tuple[date | None, date | None]:
    return (validity.first, validity.last) if validity is not None else (None, None)
