"""Writing a commit of a registry as static files: only those of cameras that changed, and the manifest last."""

from __future__ import annotations

import os
import re
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct, field

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import is_serial_hash
from calibrary.records import Record, encoded, replace
from calibrary.registry.entry import Alias, Entry
from calibrary.registry.git.history import history
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import (
    CAMERAS,
    EVENTS,
    ROOT,
    UNIT,
    is_entry,
)
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published.manifest import (
    DATA,
    LARGEST_CAMERA,
    NAMESPACE,
    Manifest,
    Opened,
    PublishedCamera,
    PublishedEntry,
    PublishedList,
    camera_of,
    document_bytes,
    file_of,
    model_of,
    opened,
    sha256,
    signed_bytes,
)
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.sshsig import Signer, fingerprint, signed_by
from calibrary.registry.statements import RULES, entry_path
from calibrary.schemas import served
from calibrary.version import __version__

USUAL_DAYS: Final = 90
"""Days until readers refuse a publication that was not renewed."""
SCHEMA_FOLDER: Final = "schemas"
SCHEMAS: Final = ("published-3", "published-list-1", "published-camera-3", "entry-1")
"""Schemas of the published files."""
STAGING: Final = ".publishing"
"""Folder with the lock; not part of the publication."""
OWN_NAMES: Final = frozenset({STAGING, SCHEMA_FOLDER, DATA, PUBLISHED_FILE})
"""Names that a publication uses at the top of its folder."""
SITE_MARKER: Final = ".calibrary-site"
FORMER_FORM: Final = "metadata/1.root.json"
"""File of publications by The Update Framework, which are not read any more."""
WAIT_S: Final = 60.0
CHUNK: Final = 200
"""Number of cameras that are read at a time."""
URL: Final = re.compile(r"https?://[^\s\"?#\\]+")
OURS: Final = re.compile(r"[0-9a-f]{64}\.json")


class Publication(Record, tag_field="schema", tag="calibrary/registry-publish-1"):
    """Output of ``calibrary registry publish --json``.

    Attributes:
        registry: folder of the registry.
        commit: published commit.
        out: output folder.
        entries: number of entries.
        cameras: number of camera files.
        written, unchanged, removed: numbers of files.
        signed_by: fingerprint of the key that signs; null if none does.
        valid_until: when readers refuse it, unless it was published again.
        refused: entries that are not published, each with the reason.
    """

    registry: str
    commit: ObjectId
    out: str
    entries: int
    cameras: int
    written: int
    unchanged: int
    removed: int
    signed_by: str | None
    valid_until: datetime
    refused: tuple[str, ...] = ()

    @property
    def is_whole(self) -> bool:
        """Whether no entry was refused."""
        return not self.refused


class _Output(Struct, kw_only=True):
    """The output folder: digests of its files, how many of them were written, and why entries are not in it."""

    folder: Path
    kept: set[str] = field(default_factory=set)
    written: int = 0
    refused: list[str] = field(default_factory=list)

    def put(self, data: bytes) -> str:
        """Write a file under its digest, unless it is there; return the digest.

        It is written in place: nobody asks for it before a manifest leads to it.
        """
        digest = sha256(data)
        if self.verified(digest) is None:
            (self.folder / file_of(digest)).write_bytes(data)
            self.written += 1
        self.kept.add(digest)
        return digest

    def verified(self, digest: str) -> bytes | None:
        """Return the file with a digest; None if there is none, or it is damaged."""
        try:
            data = (self.folder / file_of(digest)).read_bytes()
        except FileNotFoundError:
            return None
        return data if sha256(data) == digest else None

    def described(self, digest: str) -> _File | None:
        """Return what the list says of a camera's file; None if there is none, or it is damaged."""
        data = self.verified(digest)
        return _described(digest, data) if data is not None else None

    def remove_stale(self) -> int:
        """Remove files that no manifest needs any more, and those of an interrupted run; return their number."""
        files = [file for file in (self.folder / DATA).iterdir() if OURS.fullmatch(file.name)]
        stale = [file for file in files if file.stem not in self.kept]
        for file in stale:
            file.unlink()
        return len(stale)


class _File(Struct, frozen=True, kw_only=True):
    """A camera's file, and what the list says of it."""

    digest: str
    entries: int
    aliases: frozenset[str]
    is_whole: bool


def publish(
    snapshot: Snapshot,
    out: Path,
    *,
    sign: Path | None = None,
    valid_days: int = USUAL_DAYS,
    base_url: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Publication:
    """Write the approved and retired entries of a state; all but the manifest depends only on the commit.

    The manifest is replaced last, and only then the files go that it does not need. So a reader finds the old state,
    the new one, or a file that is gone; then he reads the manifest again.

    Args:
        snapshot: state of a registry in git.
        out: a folder that is new, empty, or an earlier publication; files of unchanged cameras stay.
        sign: an ssh key, as ``ssh-keygen -Y sign`` takes it; None to sign with none.
        valid_days: days until readers refuse it, unless it is published again.
        base_url: URL at which the folder is served; if given, the schemas are also written, with URLs below it as
            their ids.
        progress: called with (entries done, number of entries).

    Raises:
        InputError: the folder contains other files, or is not writable.
        RegistryError: the registry cannot be read, or the key is not that of the folder.
    """
    repo, commit = snapshot.require_git("has no commit that could be published")
    check_out(out)
    if base_url is not None and not URL.fullmatch(base_url):
        raise InputError("expected where the files are served, as https://HOST/PATH/", source=base_url)
    signer = Signer(str(sign)) if sign is not None else None
    key = fingerprint(signed_by(b"", signer.sign(b"", NAMESPACE), NAMESPACE)) if signer is not None else None
    with _locked(out):
        output, before = _Output(folder=out), _former(out, key)
        cameras = _cameras(snapshot, output, before if before and before.key == key else None, progress)
        manifest = _manifest(repo, commit, output.put(document_bytes(_list_of(cameras))), before, valid_days)
        is_kept = before is not None and before.key == key and _lasts(before.manifest, manifest, valid_days)
        if before is not None and is_kept:
            manifest = before.manifest
        schemas = served(f"{base_url.rstrip('/')}/{SCHEMA_FOLDER}/", SCHEMAS) if base_url is not None else {}
        write_files({out / SCHEMA_FOLDER / name: text for name, text in schemas.items()})
        if not is_kept:
            if hasattr(os, "sync"):
                os.sync()
            sign_it = (lambda data: signer.sign(data, NAMESPACE)) if signer is not None else None
            write_files({out / PUBLISHED_FILE: signed_bytes(manifest, sign_it)})
            output.written += 1
        removed = output.remove_stale()
    return Publication(
        registry=str(snapshot.place),
        commit=commit,
        out=str(out),
        entries=sum(one.entries for one in cameras.values()),
        cameras=len(cameras),
        written=output.written,
        unchanged=len(output.kept) + 1 - output.written,
        removed=removed,
        signed_by=key,
        valid_until=manifest.until,
        refused=tuple(output.refused),
    )


def _former(out: Path, key: str | None) -> Opened | None:
    """Return the manifest in a folder; None if there is none, or it is damaged.

    Raises:
        RegistryError: another key signed it.
    """
    try:
        found = opened((out / PUBLISHED_FILE).read_bytes(), str(out))
    except (FileNotFoundError, RegistryError):
        return None
    if found.key not in {None, key}:
        raise RegistryError(
            f"{out}: was signed by {found.key}, and its readers accept nothing else: name that key, or remove "
            f"{out / PUBLISHED_FILE}, and every reader has to confirm the change"
        )
    return found


def _manifest(
    repo: Repository, commit: str, cameras: str, before: Opened | None, valid_days: int
) -> Manifest:
    now = datetime.now(UTC).replace(microsecond=0)
    return Manifest(
        version=max(int(now.timestamp()), before.manifest.version + 1 if before is not None else 0),
        until=now + timedelta(days=valid_days),
        commit=commit,
        date=history(repo, None, commit, most=1)[0].committed.astimezone(UTC),
        writer=_writer(repo),
        cameras=cameras,
    )


def _writer(repo: Repository) -> str:
    cut = ", from a shallow clone" if repo.is_shallow else ""
    return f"calibrary {__version__}, Unicode {unicodedata.unidata_version}{cut}"


def _lasts(before: Manifest, made: Manifest, valid_days: int) -> bool:
    """Whether a former manifest says the same as a new one, and is valid neither too shortly nor too long."""
    is_same = replace(before, version=made.version, until=made.until) == made
    return is_same and timedelta() <= made.until - before.until <= timedelta(days=valid_days / 2)


def _list_of(cameras: Mapping[str, _File]) -> PublishedList:
    aliases: dict[str, set[str]] = defaultdict(set)
    for name, file in cameras.items():
        for alias in file.aliases:
            aliases[alias].add(name.partition(f"/{UNIT}")[0])
    return PublishedList(
        cameras={name: file.digest for name, file in sorted(cameras.items())},
        aliases={alias: tuple(sorted(those)) for alias, those in sorted(aliases.items())},
    )


def _cameras(
    snapshot: Snapshot,
    output: _Output,
    before: Opened | None,
    progress: Callable[[int, int], None] | None,
) -> dict[str, _File]:
    """Return the file of every camera that has published entries, by name; those that changed are written."""
    listed = sorted(snapshot.paths)
    names = {path: camera_of(path) for path in listed}
    former, changed = _changed(snapshot, output, before)
    if changed is None:
        found, changed = {}, {*names.values()}
    else:
        found = {name: output.described(digest) for name, digest in former.items()}
        changed |= {name for name, file in found.items() if file is None or not file.is_whole}
        changed |= {name for name in names.values() if not _is_hashed(name)}
    paths: dict[str, list[str]] = {name: [] for name in changed}
    for path, name in names.items():
        if name in paths:
            paths[name].append(path)
    kept = {name: file for name, file in found.items() if file is not None and name not in paths}
    output.kept |= {file.digest for file in kept.values()}
    return kept | dict(_written(snapshot, paths, output, progress, total=len(listed)))


def _written(
    snapshot: Snapshot,
    paths: Mapping[str, Sequence[str]],
    output: _Output,
    progress: Callable[[int, int], None] | None,
    *,
    total: int,
) -> Iterator[tuple[str, _File]]:
    """Write the files of cameras, given the paths of their entries; yield those that have any."""
    done, due = total - sum(map(len, paths.values())), [*paths]
    for start in range(0, len(due), CHUNK):
        some = due[start : start + CHUNK]
        entries = dict(snapshot.parsed([path for name in some for path in paths[name]]))
        for name in some:
            found = {path: _why_not(path, entries[path]) for path in paths[name]}
            output.refused += [why for why in found.values() if why is not None]
            # A serial number that is not hashed stands in the path, too.
            refused = [path for path, why in found.items() if why is not None and _is_hashed(name)]
            rows = [
                _published(path, entry, snapshot)
                for path, why in found.items()
                if why is None and isinstance(entry := entries[path], Entry)
            ]
            data = document_bytes(PublishedCamera(entries=tuple(rows), refused=tuple(refused)))
            if len(data) > LARGEST_CAMERA:
                raise RegistryError(f"{name}: is {len(data)} bytes, and readers accept {LARGEST_CAMERA}")
            if rows or refused:
                yield name, _described(output.put(data), data)
        done += len(entries)
        if progress is not None:
            progress(done, total)


def _changed(
    snapshot: Snapshot, output: _Output, before: Opened | None
) -> tuple[Mapping[str, str], set[str] | None]:
    """Return the list of a former publication, and the names of the cameras that changed since; None for all."""
    repo, commit = snapshot.require_git("is needed")
    if before is None or before.manifest.writer != _writer(repo) or repo.is_shallow:
        return {}, None
    data = output.verified(before.manifest.cameras)
    if data is None or not repo.holds(before.manifest.commit):
        return {}, None
    changed = _changed_paths(repo, before.manifest.commit, commit)
    names = None if changed is None else {camera_of(path) for path in changed}
    return msgspec.json.decode(data, type=PublishedList).cameras, names


def _changed_paths(repo: Repository, before: str, commit: str) -> set[str] | None:
    """Return the paths of entries that commits since a former one touched; None if that does not tell what changed.

    What is published of an entry depends on its file, the statements on it and their history, and on the rules.
    """
    if repo.run("rev-list", "--max-count=1", before, f"^{commit}").out.strip():
        return None
    log = ("log", "-m", "-z", "--format=", "--name-only", "--no-renames", commit, f"^{before}", "--")
    found = set[str]()
    printed = repo.run(*log, CAMERAS, EVENTS).out.decode("utf-8", "replace")
    for path in filter(None, printed.split("\0")):
        if path.startswith(f"{EVENTS}{RULES}/"):
            return None
        found.add(entry_path(path))
    return {path for path in found if path.startswith(ROOT) and is_entry(path)}


class _Names(Struct):
    aliases: tuple[Alias, ...] = ()


def _described(digest: str, data: bytes) -> _File:
    file = msgspec.json.decode(data, type=PublishedCamera)
    names = [one for row in file.entries for one in msgspec.json.decode(row.entry, type=_Names).aliases]
    aliases = frozenset(model_of(one.make, one.model) for one in names)
    return _File(digest=digest, entries=len(file.entries), aliases=aliases, is_whole=not file.refused)


def _is_hashed(name: str) -> bool:
    """Whether the name of a camera states no serial number but as its hash."""
    _, unit, digits = name.partition(f"/{UNIT}")
    return not unit or is_serial_hash(digits)


def _why_not(path: str, entry: Entry | InputError) -> str | None:
    """Return why an entry is not published: readers then refuse its camera, and no other; None if it can be."""
    if isinstance(entry, InputError):
        return str(entry)
    check = "'calibrary registry check' shows what is wrong with it"
    if entry.path != path:
        return f"{path}: its camera belongs at {entry.path}; {check}"
    serial = entry.calibration.camera.serial
    if serial is not None and not is_serial_hash(serial):
        return f"{path}: its serial number is not hashed; 'calibrary registry add FILE' hashes it"
    return None


def _published(path: str, entry: Entry, snapshot: Snapshot) -> PublishedEntry:
    return PublishedEntry(
        path=path,
        status="approved" if entry.is_usable else "retired",
        reason=entry.reason,
        entry=_public(entry),
        others=tuple(map(_public, snapshot.standing(path).entries[1:])),
    )


def _public(entry: Entry) -> msgspec.Raw:
    """Return an entry without what is internal to the team."""
    return msgspec.Raw(encoded(replace(entry, label=None, tags=()), indent=0))


def check_out(out: Path) -> None:
    """Check that a folder can be used for a publication.

    Raises:
        InputError: it contains other files, or is not writable.
    """
    check_folder(out)
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError("is a file, expected a folder for the published files", source=str(out))
    try:
        found = {item.name for item in out.iterdir()}
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=str(out)) from None
    if (out / FORMER_FORM).exists():
        raise InputError(
            "was published in an earlier form (metadata/, models/, units/, entries/), which nothing reads any more; "
            "empty it, or name another folder",
            source=str(out),
        )
    # An interrupted first run leaves everything except the manifest; a site may be in the same folder.
    if found and not found & {PUBLISHED_FILE, STAGING, SITE_MARKER}:
        raise InputError(
            f"is not a published registry (it has no {PUBLISHED_FILE}) and is not empty; name another folder",
            source=str(out),
        )


@contextmanager
def _locked(out: Path) -> Iterator[None]:
    """Hold the folder against other runs.

    Raises:
        InputError: the folder is not writable.
        RegistryError: another run is using it.
    """
    try:
        for name in (STAGING, DATA):
            (out / name).mkdir(parents=True, exist_ok=True)
        with writer_lock(out / STAGING, wait_s=WAIT_S):
            yield
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(out)) from None
