"""The existing publication in the output folder: files that can be kept, and entries to read again.

It is used only if every file matches the digest given by the root, the same version of calibrary wrote it, and the
repository contains its commit. Otherwise everything is written again.
"""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct, field

from calibrary import __version__
from calibrary.errors import InputError, RegistryError
from calibrary.records import Record, from_json
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import changed
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS
from calibrary.registry.published.layout import (
    ROOT_FILE,
    TREE_FOLDER,
    PublishedCamera,
    PublishedRegistry,
    Sha256,
    document_bytes,
    entry_path,
    sha256,
    units_folder,
)
from calibrary.registry.published.output import STATE_FILE, Output
from calibrary.registry.published.rows import Row, names_of

__all__ = ["FormerPublication", "former_publication", "remember"]

MOST_COMMITS: Final = 1000
"""Longest range of commits that is examined; for a longer one, all entries with a validity are read again."""
PARENT: Final = b"parent "


class _State(Record, tag_field="schema", tag="calibrary/publishing-1"):
    """State stored for the next run.

    Attributes:
        writer: versions of calibrary and of the Unicode tables, which determine the content of every file.
        root: SHA-256 of calibrary.json.
    """

    writer: str
    root: Sha256


class _Listed(Struct, frozen=True, kw_only=True):
    """A published entry.

    Attributes:
        camera: path of the camera file that contains it.
        files: paths of the entry, then of its earlier revisions.
        is_dated: whether it has a validity, so that its history matters.
    """

    camera: str
    files: tuple[str, ...]
    is_dated: bool


class FormerPublication(Struct, frozen=True, kw_only=True):
    """An existing publication with all files verified.

    Attributes:
        out: folder of the publication.
        commit: commit of the registry.
        digests: digests of its files by path, without the root.
        cameras: the camera files among them.
        entries: entries by their path in the registry.
    """

    out: Path
    commit: str
    digests: Mapping[str, str]
    cameras: Mapping[str, str]
    entries: Mapping[str, _Listed]

    def due(self, repo: Repository, commit: str) -> set[str]:
        """Return the paths of entries whose published form may differ at a commit.

        The published form of an entry depends on its content and, if it has a validity, on its history.

        Raises:
            RegistryError: the repository lacks a part of either commit.
        """
        differing = {file.path for file in changed(repo, self.commit, commit, CAMERAS)}
        dated = {path for path, one in self.entries.items() if one.is_dated}
        if not dated <= differing:
            touched = _touched(repo, self.commit, commit)
            differing |= dated if touched is None else dated & touched
        return differing

    def rows(self, paths: Set[str]) -> Iterator[Row]:
        """Yield the rows of some entries in the camera files."""
        for path in sorted(paths & self.entries.keys()):
            listed = self.entries[path]
            key, names = names_of(parse_entry((self.out / listed.files[0]).read_bytes(), path))
            [row] = (row for row in self._camera(listed.camera).entries if row.path == path)
            yield Row(key=key, names=names, row=row, files=listed.files)

    def deciding_on(self, cameras: Set[str]) -> set[str]:
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


def former_publication(out: Path, repo: Repository) -> FormerPublication | None:
    """Return the publication in a folder; None if it is damaged, or this version might write it differently."""
    try:
        data = (out / ROOT_FILE).read_bytes()
        state = _state(out)
        if state is None or state.writer != _writer() or state.root != sha256(data) or repo.is_shallow:
            return None
        root = from_json(PublishedRegistry, msgspec.json.decode(data), source=ROOT_FILE)
        if not repo.holds(root.commit):
            return None
        reading = _Reading(out)
        reading.part(root.tree, TREE_FOLDER, root.depth)
    except (OSError, InputError, RegistryError, msgspec.MsgspecError):
        return None
    return FormerPublication(
        out=out, commit=root.commit, digests=reading.digests, cameras=reading.cameras, entries=reading.entries
    )


def remember(output: Output, root: bytes, repo: Repository) -> None:
    """Store the state for the next run; not for a shallow clone, whose history is incomplete."""
    place = output.root / STATE_FILE
    if repo.is_shallow:
        place.unlink(missing_ok=True)
        return
    temporary = place.with_name("state-new")
    temporary.write_bytes(document_bytes(_State(writer=_writer(), root=sha256(root))))
    temporary.replace(place)


def _state(out: Path) -> _State | None:
    try:
        return from_json(_State, msgspec.json.decode((out / STATE_FILE).read_bytes()), source=STATE_FILE)
    except FileNotFoundError:
        return None


def _writer() -> str:
    return f"calibrary {__version__}, Unicode {unicodedata.unidata_version}"


class _Part(msgspec.Struct):
    tree: dict[str, str]


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


_PART: Final = msgspec.json.Decoder(_Part)
_CAMERA: Final = msgspec.json.Decoder(_Camera)


class _Reading(Struct, frozen=True):
    """Verifies all files below a root.

    Attributes:
        out: the folder.
        digests, cameras, entries: as in :class:`FormerPublication`.
    """

    out: Path
    digests: dict[str, str] = field(default_factory=dict)
    cameras: dict[str, str] = field(default_factory=dict)
    entries: dict[str, _Listed] = field(default_factory=dict)

    def part(self, tree: Mapping[str, str], folder: str, depth: int) -> None:
        """Verify everything below a part of the tree.

        Raises:
            InputError: a file has another digest.
            OSError: a file does not exist.
        """
        for name, digest in tree.items():
            if depth == 0:
                self._camera(name, digest)
            else:
                data = self._verified(f"{folder}/{name}.json", digest)
                self.part(_PART.decode(data).tree, f"{folder}/{name}", depth - 1)

    def _camera(self, path: str, digest: str) -> None:
        self.cameras[path] = digest
        for row in _CAMERA.decode(self._verified(path, digest)).entries:
            of = [row.sha256, *(one.sha256 for one in row.earlier)]
            files = tuple(entry_path(one) for one in of)
            for file, one in zip(files, of, strict=True):
                if file not in self.digests:
                    self._verified(file, one)
            self.entries[row.path] = _Listed(camera=path, files=files, is_dated=row.validity is not None)

    def _verified(self, path: str, digest: str) -> bytes:
        with open(os.path.join(self.out, path), "rb", buffering=0) as file:  # noqa: PTH118, PTH123  a third of the time
            data = file.read()
        if sha256(data) != digest:
            raise InputError("has another digest than expected", source=path)
        self.digests[path] = digest
        return data


def _touched(repo: Repository, start: str, end: str) -> set[str] | None:
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
