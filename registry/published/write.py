"""Writing a commit of a registry as static files: only changed files, and the timestamp last."""

from __future__ import annotations

import os
import re
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from datetime import UTC, date, datetime
from functools import cache, partial
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct, field
from tuf.api.metadata import TargetFile

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import is_serial_hash, match_key
from calibrary.records import Record, from_json, replace, to_json
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import changed, history
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS, STATEMENTS, SUFFIX
from calibrary.registry.published.layout import (
    SCHEMA_FOLDER,
    SCHEMAS,
    CameraName,
    EarlierRevision,
    PublishedCamera,
    PublishedEntry,
    PublishedState,
    Sha256,
    camera_path,
    document_bytes,
    entry_path,
    sha256,
    units_folder,
)
from calibrary.registry.published.metadata import (
    TIMESTAMP_FILE,
    Former,
    Listed,
    Signing,
    former,
    signers,
    write_metadata,
)
from calibrary.registry.published.output import STATE_FILE, Output, check_out, opened
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.statements import RULES
from calibrary.schemas import served
from calibrary.version import __version__
from calibrary.workers import mapped

UNSIGNED: Final = Signing()
URL: Final = re.compile(r"https?://[^\s\"?#\\]+")


class Publication(Record, tag_field="schema", tag="calibrary/registry-publish-1"):
    """Output of ``calibrary registry publish --json``.

    Attributes:
        registry: folder of the registry.
        commit: published commit.
        out: output folder.
        entries: number of entries.
        cameras: number of camera files.
        written, unchanged, removed: numbers of files.
        signed: whether it is signed with a key of one's own.
        valid_until: when readers refuse it, unless it was published again.
        root: version of the root, which says whose keys sign.
        root_until: when it expires, unless its keys renewed it.
        root_keys, root_threshold: how many keys it lists for itself, and how many of them have to sign a change.
        is_new_root: whether it was written now.
    """

    registry: str
    commit: ObjectId
    out: str
    entries: int
    cameras: int
    written: int
    unchanged: int
    removed: int
    signed: bool
    valid_until: datetime
    root: int
    root_until: datetime
    root_keys: int
    root_threshold: int
    is_new_root: bool


def publish(
    snapshot: Snapshot,
    out: Path,
    *,
    signing: Signing = UNSIGNED,
    base_url: str | None = None,
    workers: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Publication:
    """Write the approved, held and retired entries of a state; all but the metadata depends only on the commit.

    The timestamp is replaced last, so that a reader finds the complete old state, the complete new one, or in between a
    digest that does not match; the reader then tries again. If an earlier state exists in the folder, only the entries
    that differ from it are read.

    Args:
        snapshot: state of a registry in git.
        out: a folder that is new, empty, or an earlier publication; unchanged files are not written.
        signing: keys, and how long it is valid.
        base_url: URL at which the folder is served; if given, the schemas are also written, with URLs below it as
            their ids.
        workers: number of processes; 0 for one per processor.
        progress: called with (entries done, number of entries).

    Raises:
        InputError: the folder contains other files, or is not writable.
        RegistryError: an entry cannot be read or must not be published, or the keys are not those of the folder.
    """
    by = signers(signing)
    repo, commit = snapshot.require_git("has no commit that could be published")
    check_out(out)
    if base_url is not None and not URL.fullmatch(base_url):
        raise InputError("expected where the files are served, as https://HOST/PATH/", source=base_url)
    when = history(repo, None, commit, most=1)[0].committed.astimezone(UTC)
    with opened(out) as output:
        before = former(out)
        content = _content(snapshot, repo, commit, output, before, workers=workers, progress=progress)
        state = PublishedState(
            commit=commit, date=when, entries=content.entries, cameras=len(content.cameras)
        )
        made = write_metadata(content.cameras, state, output, by, before, valid_days=signing.valid_days)
        if base_url is not None:
            for name, text in served(f"{base_url.rstrip('/')}/{SCHEMA_FOLDER}/", SCHEMAS).items():
                output.put(f"{SCHEMA_FOLDER}/{name}", text, in_place=False)
        output.publish_staged()
        output.put(TIMESTAMP_FILE, made.stamp)
        removed = output.remove_stale()
        save_state(output, made.stamp, repo)
    return Publication(
        registry=str(snapshot.place),
        commit=commit,
        out=str(out),
        entries=content.entries,
        cameras=len(content.cameras),
        written=output.written,
        unchanged=len(output.kept) - output.written,
        removed=removed,
        signed=not by.is_public,
        valid_until=made.until,
        root=made.root.version,
        root_until=made.root.expires,
        root_keys=len(made.root.roles["root"].keyids),
        root_threshold=made.root.roles["root"].threshold,
        is_new_root=made.is_new_root,
    )


class _Content(Struct, frozen=True, kw_only=True):
    """Published content: the number of entries, and every camera file."""

    entries: int
    cameras: Listed


def _content(
    snapshot: Snapshot,
    repo: Repository,
    commit: str,
    output: Output,
    before: Former,
    *,
    workers: int,
    progress: Callable[[int, int], None] | None,
) -> _Content:
    """Write the files of entries and cameras, unless they exist."""
    listed = sorted(snapshot.paths)
    existing, changed_entries = _difference(repo, commit, output, before)
    read = [path for path in listed if existing is None or path in changed_entries]
    done = len(listed) - len(read)

    def count(more: int) -> None:
        nonlocal done
        done += more
        if progress is not None:
            progress(done, len(listed))

    rows = written_rows(repo, commit, read, output, workers=workers, progress=count)
    if existing is None:
        return _Content(entries=len(rows), cameras=_write_cameras(_cameras(rows), output))
    return _updated(existing, changed_entries, rows, output)


def _difference(
    repo: Repository, commit: str, output: Output, before: Former
) -> tuple[ExistingPublication | None, frozenset[str]]:
    """Return the existing publication, if it can be updated, and the entries that differ in a commit."""
    existing = existing_publication(output.root, repo, before)
    try:
        return existing, frozenset(
            existing.changed_entries(repo, commit)
        ) if existing is not None else frozenset()
    except RegistryError:
        # A part of the earlier commit is missing here.
        return None, frozenset()


def _updated(
    existing: ExistingPublication, changed_entries: Set[str], rows: Sequence[Row], output: Output
) -> _Content:
    """Update an existing publication; ``rows`` are the new ones of the entries that were changed or added."""
    output.known.update(existing.digests)
    kept = existing.entries.keys() - changed_entries
    output.kept.update(file for path in kept for file in existing.entries[path].files)
    differing = {camera for row in (*existing.rows(changed_entries), *rows) for camera in row.cameras}
    unchanged_rows = existing.rows(existing.entries_behind(differing) & kept)
    found = _cameras(sorted([*rows, *unchanged_rows], key=lambda one: one.row.path))
    same = {path: digest for path, digest in existing.cameras.items() if path not in differing}
    output.kept.update(same)
    written = _write_cameras({path: found[path] for path in differing & found.keys()}, output)
    return _Content(entries=len(kept) + len(rows), cameras=same | written)


def _cameras(rows: Sequence[Row]) -> dict[str, PublishedCamera]:
    """Return the camera files by path: each with its entries, and the cameras for which it is an alias."""
    keys: dict[str, CameraKey] = {}
    entries: dict[str, list[PublishedEntry]] = defaultdict(list)
    aliases: dict[str, dict[tuple[str, str], CameraName]] = defaultdict(dict)
    for one in rows:
        path = camera_path(one.key)
        keys.setdefault(path, one.key)
        entries[path].append(one.row)
        own = CameraName(make=one.key.make or "", model=one.key.model or "")
        for name in one.names:
            keys.setdefault(name.path, CameraKey(make=name.make, model=name.model))
            aliases[name.path].setdefault((match_key(own.make), match_key(own.model)), own)
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


def _write_cameras(cameras: Mapping[str, PublishedCamera], output: Output) -> dict[str, TargetFile]:
    """Write camera files; return the length and digest of each by path."""
    found = {}
    for path, camera in cameras.items():
        data = document_bytes(camera)
        found[path] = TargetFile(len(data), {"sha256": output.put(path, data, in_place=False)}, path)
    return found


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


_Listed = Sequence[str]


def written_rows(
    repo: Repository,
    commit: str,
    listed: _Listed,
    output: Output,
    *,
    workers: int,
    progress: Callable[[int], None],
) -> list[Row]:
    """Write the files of entries, without drafts, and of earlier revisions that apply to other days; return the rows.

    Args:
        repo: repository of the registry.
        commit: commit to publish.
        listed: paths of the entries.
        output: output folder.
        workers: number of processes; 0 for one per processor.
        progress: called with the number of entries done since the last call.

    Raises:
        InputError: a process was killed from outside.
        RegistryError: an entry cannot be read or must not be published.
    """
    chunks = [listed[start : start + CHUNK] for start in range(0, len(listed), CHUNK)]
    work = partial(_write_chunk, place=repo.path, commit=commit, out=output.root)
    rows: list[Row] = []
    count = 1 if len(listed) < WORTH_A_POOL else workers or os.cpu_count() or 1
    made = mapped(work, chunks, count, preload=[__name__], does="writes entries")
    for chunk, some in zip(chunks, made, strict=True):
        rows += some
        progress(len(chunk))
    for one in rows:
        output.kept.update(one.files)
        output.written += one.written
    return rows


@cache
def _snapshot(place: Path, commit: str) -> Snapshot:
    """Return the state to publish, opened once per process."""
    return Registry.open(place).snapshot(commit)


def _write_chunk(chunk: _Listed, *, place: Path, commit: str, out: Path) -> list[Row]:
    snapshot = _snapshot(place, commit)
    return [
        _write_entry(one.path, one.entry, snapshot, out)
        for one in snapshot.stored(chunk)
        if one.entry.status is not Status.DRAFT
    ]


def _write_entry(path: str, entry: Entry, snapshot: Snapshot, out: Path) -> Row:
    _require_publishable(path, entry)
    output = Output(root=out)
    earlier = [
        EarlierRevision(commit=at, validity=one.validity, sha256=_put_entry(one, output))
        for at, one in _earlier(entry, snapshot.earlier(path))
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
    is_told = entry.label is None and not entry.tags
    data = document_bytes(to_json(entry if is_told else replace(entry, label=None, tags=())))
    return output.put(entry_path(sha256(data)), data)


def _require_publishable(path: str, entry: Entry) -> None:
    """Check that readers can find an entry, and that its serial number is hashed.

    Raises:
        RegistryError: the entry is of another camera than its path, or its serial number is not hashed.
    """
    if entry.path != path:
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


MOST_COMMITS: Final = 1000
"""Longest range of commits that is examined; for a longer one, all entries with a validity are read again."""
PARENT: Final = b"parent "


class _State(Record, tag_field="schema", tag="calibrary/publishing-1"):
    """State stored for the next run.

    Attributes:
        writer: versions of calibrary and of the Unicode tables, which determine the content of every file.
        timestamp: SHA-256 of the timestamp's file.
    """

    writer: str
    timestamp: Sha256


class _PublishedEntry(Struct, frozen=True, kw_only=True):
    """A published entry.

    Attributes:
        camera: path of the camera file that contains it.
        files: paths of the entry, then of its earlier revisions.
        is_dated: whether it has a validity, so that its history matters.
    """

    camera: str
    files: tuple[str, ...]
    is_dated: bool


class ExistingPublication(Struct, frozen=True, kw_only=True):
    """An existing publication with all files verified.

    Attributes:
        out: folder of the publication.
        commit: commit of the registry.
        digests: digests of its camera and entry files by path.
        cameras: the camera files.
        entries: entries by their path in the registry.
    """

    out: Path
    commit: str
    digests: Mapping[str, str]
    cameras: Listed
    entries: Mapping[str, _PublishedEntry]

    def changed_entries(self, repo: Repository, commit: str) -> set[str]:
        """Return the paths of entries whose published form may differ at a commit.

        The published form of an entry depends on its content and, if it has a validity, on its history.

        Raises:
            RegistryError: the repository lacks a part of either commit.
        """
        differing = {file.path for file in changed(repo, self.commit, commit, CAMERAS)}
        for file in changed(repo, self.commit, commit, STATEMENTS):
            subject = file.path.removeprefix(STATEMENTS).rpartition("/")[0]
            if subject == RULES:
                raise RegistryError("the rules have changed, and with them any entry may have")
            differing.add(f"{subject}{SUFFIX}")
        dated = {path for path, one in self.entries.items() if one.is_dated}
        if not dated <= differing:
            touched = _paths_changed_in(repo, self.commit, commit)
            differing |= dated if touched is None else dated & touched
        return differing

    def rows(self, paths: Set[str]) -> Iterator[Row]:
        """Yield the rows of some entries in the camera files."""
        for path in sorted(paths & self.entries.keys()):
            listed = self.entries[path]
            key, names = names_of(parse_entry((self.out / listed.files[0]).read_bytes(), path))
            [row] = (row for row in self._camera(listed.camera).entries if row.path == path)
            yield Row(key=key, names=names, row=row, files=listed.files)

    def entries_behind(self, cameras: Set[str]) -> set[str]:
        """Return the paths of all entries that camera files depend on, and possibly some others."""
        wanted = set(cameras)
        for path in cameras & self.cameras.keys():
            wanted |= {name.path for name in self._camera(path).aliases}
        units = tuple(folder for path in wanted if (folder := units_folder(path)) is not None)
        return {
            path
            for path, one in self.entries.items()
            if one.camera in wanted or (units and one.camera.startswith(units))
        }

    def _camera(self, path: str) -> PublishedCamera:
        data = (self.out / path).read_bytes()
        return from_json(PublishedCamera, msgspec.json.decode(data), source=path)


def existing_publication(out: Path, repo: Repository, before: Former) -> ExistingPublication | None:
    """Return the publication in a folder; None if it is damaged, or this version might write it differently."""
    try:
        stored, state = _state(out), before.state
        if (
            state is None
            or stored is None
            or (stored.writer, stored.timestamp) != (_writer(), sha256(before.stamp))
            or repo.is_shallow
            or not repo.holds(state.commit)
        ):
            return None
        files, reading = before.files, _Verification(out)
        for path, file in files.items():
            reading.camera(path, file.hashes["sha256"])
    except (OSError, InputError, RegistryError, msgspec.MsgspecError):
        return None
    return ExistingPublication(
        out=out, commit=state.commit, digests=reading.digests, cameras=files, entries=reading.entries
    )


def save_state(output: Output, stamp: bytes, repo: Repository) -> None:
    """Store the state for the next run; not for a shallow clone, whose history is incomplete."""
    place = output.root / STATE_FILE
    if repo.is_shallow:
        place.unlink(missing_ok=True)
        return
    temporary = place.with_name("state-new")
    temporary.write_bytes(document_bytes(_State(writer=_writer(), timestamp=sha256(stamp))))
    temporary.replace(place)


def _state(out: Path) -> _State | None:
    try:
        return from_json(_State, msgspec.json.decode((out / STATE_FILE).read_bytes()), source=STATE_FILE)
    except FileNotFoundError:
        return None


def _writer() -> str:
    return f"calibrary {__version__}, Unicode {unicodedata.unidata_version}"


class _Digest(msgspec.Struct):
    sha256: str


class _Row(msgspec.Struct):
    path: str
    sha256: str
    validity: dict[str, str | None] | None
    earlier: list[_Digest]


class _Camera(msgspec.Struct):
    """The members of a camera file needed here; decoding them takes a tenth of the time of the whole record."""

    entries: list[_Row]


_CAMERA: Final = msgspec.json.Decoder(_Camera)


class _Verification(Struct, frozen=True):
    """Verifies camera files, and the entries that they list.

    Attributes:
        out: the folder.
        digests, entries: as in :class:`ExistingPublication`.
    """

    out: Path
    digests: dict[str, str] = field(default_factory=dict)
    entries: dict[str, _PublishedEntry] = field(default_factory=dict)

    def camera(self, path: str, digest: str) -> None:
        """Verify a camera file and its entries.

        Raises:
            InputError: a file has another digest.
            OSError: a file does not exist.
        """
        for row in _CAMERA.decode(self._verified(path, digest)).entries:
            of = [row.sha256, *(one.sha256 for one in row.earlier)]
            files = tuple(entry_path(one) for one in of)
            for file, one in zip(files, of, strict=True):
                if file not in self.digests:
                    self._verified(file, one)
            self.entries[row.path] = _PublishedEntry(
                camera=path, files=files, is_dated=row.validity is not None
            )

    def _verified(self, path: str, digest: str) -> bytes:
        with open(os.path.join(self.out, path), "rb", buffering=0) as file:  # noqa: PTH118, PTH123  a third of the time
            data = file.read()
        if sha256(data) != digest:
            raise InputError("has another digest than expected", source=path)
        self.digests[path] = digest
        return data


def _paths_changed_in(repo: Repository, start: str, end: str) -> set[str] | None:
    """Return the paths changed by any commit of a range; None if it is not linear, or too long."""
    touched, commit = set[str](), end
    for _ in range(MOST_COMMITS):
        if commit == start:
            return touched
        [data] = repo.objects([commit], b"commit")
        lines = data.partition(b"\n\n")[0].splitlines()
        parents = [line.removeprefix(PARENT).decode() for line in lines if line.startswith(PARENT)]
        if len(parents) != 1:
            return None
        touched |= {file.path for file in changed(repo, parents[0], commit, CAMERAS)}
        [commit] = parents
    return None
