"""Writing a commit of a registry as static files: only changed files, and the root last."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence, Set
from datetime import UTC
from itertools import groupby
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.records import Record
from calibrary.registry.git.history import history
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import is_entry, match_key
from calibrary.registry.published.former import FormerPublication, former_publication, remember
from calibrary.registry.published.layout import (
    ROOT_FILE,
    SCHEMA_FOLDER,
    SCHEMAS,
    SIGNATURE_FILE,
    TREE_FOLDER,
    WIDTH,
    CameraName,
    PublishedCamera,
    PublishedEntry,
    PublishedRegistry,
    PublishedTree,
    camera_path,
    depth_for,
    document_bytes,
    sha256,
)
from calibrary.registry.published.output import Output, check_out, opened
from calibrary.registry.published.rows import Row, written_rows
from calibrary.registry.published.signature import sign
from calibrary.registry.snapshot import Snapshot
from calibrary.schemas import served

__all__ = ["Publication", "publish"]

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
    base_url: str | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Publication:
    """Write the approved, held and retired entries of a state; the output depends only on the commit.

    The root is replaced last, so that a reader finds the complete old state, the complete new one, or in between a
    digest that does not match; the reader then tries again. If an earlier state exists in the folder, only the entries
    that differ from it are read.

    Args:
        snapshot: state of a registry in git.
        out: a folder that is new, empty, or an earlier publication; unchanged files are not written.
        key: an ssh key to sign the root with, as for ``ssh-keygen -Y sign -f``.
        base_url: URL at which the folder is served; if given, the schemas are also written, with URLs below it as
            their ids.
        workers: number of processes; by default one per processor.
        progress: called with (entries done, number of entries).

    Raises:
        InputError: the folder contains other files, or is not writable.
        RegistryError: an entry cannot be read or must not be published, or signing failed.
    """
    repo, commit = snapshot.require_git("has no commit that could be published")
    check_out(out)
    if base_url is not None and not URL.fullmatch(base_url):
        raise InputError("expected where the files are served, as https://HOST/PATH/", source=base_url)
    when = history(repo, None, commit, most=1)[0].committed.astimezone(UTC)
    with opened(out) as output:
        content = _content(snapshot, repo, commit, output, workers=workers, progress=progress)
        depth = depth_for(len(content.cameras))
        tree = _write_tree(content.cameras, depth, output)
        root = PublishedRegistry(
            commit=commit,
            date=when,
            entries=content.entries,
            cameras=len(content.cameras),
            depth=depth,
            tree=tree,
        )
        data = document_bytes(root)
        signature = sign(data, key) if key is not None else None
        if base_url is not None:
            for name, text in served(f"{base_url.rstrip('/')}/{SCHEMA_FOLDER}/", SCHEMAS).items():
                output.put(f"{SCHEMA_FOLDER}/{name}", text, at_once=False)
        output.settle()
        if signature is not None:
            output.put(SIGNATURE_FILE, signature)
        output.put(ROOT_FILE, data)
        removed = output.remove_stale(is_signed=signature is not None)
        remember(output, data, repo)
    return Publication(
        registry=str(snapshot.place),
        commit=commit,
        out=str(out),
        entries=content.entries,
        cameras=len(content.cameras),
        written=output.written,
        unchanged=len(output.kept) - output.written,
        removed=removed,
        root=sha256(data),
        signed=signature is not None,
    )


class _Content(Struct, frozen=True, kw_only=True):
    """Published content.

    Attributes:
        entries: number of entries.
        cameras: digest of every camera file, by path.
    """

    entries: int
    cameras: Mapping[str, str]


def _content(
    snapshot: Snapshot,
    repo: Repository,
    commit: str,
    output: Output,
    *,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> _Content:
    """Write the files of entries and cameras, unless they exist."""
    listed = {path: oid for path, oid in sorted(snapshot.paths.items()) if is_entry(path) and oid is not None}
    former, due = _difference(repo, commit, output)
    read = [(path, oid) for path, oid in listed.items() if former is None or path in due]
    done = len(listed) - len(read)

    def count(more: int) -> None:
        nonlocal done
        done += more
        if progress is not None:
            progress(done, len(listed))

    rows = written_rows(repo, commit, read, output, workers=workers, progress=count)
    if former is None:
        return _Content(entries=len(rows), cameras=_write_cameras(_cameras(rows), output))
    return _brought_forward(former, due, rows, output)


def _difference(
    repo: Repository, commit: str, output: Output
) -> tuple[FormerPublication | None, frozenset[str]]:
    """Return the existing publication, if it can be updated, and the entries that differ in a commit."""
    former = former_publication(output.root, repo)
    try:
        return former, frozenset(former.due(repo, commit)) if former is not None else frozenset()
    except RegistryError:
        # A part of the earlier commit is missing here.
        return None, frozenset()


def _brought_forward(
    former: FormerPublication, due: Set[str], rows: Sequence[Row], output: Output
) -> _Content:
    """Update an existing publication in which some entries differ.

    Args:
        former: the existing publication.
        due: paths of entries that were changed, added or removed.
        rows: their new rows.
        output: output folder.
    """
    output.known.update(former.digests)
    kept = former.entries.keys() - due
    output.kept.update(file for path in kept for file in former.entries[path].files)
    differing = {camera for row in (*former.rows(due), *rows) for camera in row.cameras}
    beside = former.rows(former.deciding_on(differing) & kept)
    found = _cameras(sorted([*rows, *beside], key=lambda one: one.row.path))
    same = {path: digest for path, digest in former.cameras.items() if path not in differing}
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


def _write_cameras(cameras: Mapping[str, PublishedCamera], output: Output) -> dict[str, str]:
    """Write camera files; return the digest of each by path."""
    return {path: output.put(path, document_bytes(camera), at_once=False) for path, camera in cameras.items()}


def _write_tree(cameras: Mapping[str, str], depth: int, output: Output) -> dict[str, str]:
    """Write the tree with the digests of the camera files; return the part in the root."""
    leaves = sorted((sha256(path.encode()), path, digest) for path, digest in cameras.items())
    return _write_part(leaves, TREE_FOLDER, depth, output)


def _write_part(
    leaves: Sequence[tuple[str, str, str]], folder: str, depth: int, output: Output
) -> dict[str, str]:
    """Write everything below a part of the tree; return the part.

    Args:
        leaves: (hash of the path, path, digest) of each camera file below it, sorted.
        folder: folder of the part's files.
        depth: number of levels below it.
        output: output folder.
    """
    if depth == 0:
        return {path: digest for _, path, digest in leaves}
    at = folder.count("/") * WIDTH
    part = {}
    for name, below in groupby(leaves, key=lambda leaf: leaf[0][at : at + WIDTH]):
        data = document_bytes(
            PublishedTree(tree=_write_part([*below], f"{folder}/{name}", depth - 1, output))
        )
        part[name] = output.put(f"{folder}/{name}.json", data, at_once=False)
    return part
