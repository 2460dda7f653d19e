"""The files of a registry at a commit, the names that they state, and their entries, as far as possible from the cache.

Files and names are kept by git's id of a model's folder, so that after a commit only the models that it changed are
read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from hashlib import sha256
from itertools import groupby, islice
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeAlias

import msgspec
from msgspec import Struct

from calibrary.errors import InputError
from calibrary.known_camera import match_key
from calibrary.registry.cache import Cache, Memory, file_of
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import (
    CAMERAS,
    EVENTS,
    folder_of,
    is_entry,
    model_folder,
)
from calibrary.registry.resolution import AliasMap
from calibrary.registry.standing import LABELS, Standing
from calibrary.registry.statements import RULES, Signed, parse_statement, subject_in
from calibrary.strictyaml import load_yaml
from calibrary.version import __version__

Mention: TypeAlias = tuple[str, str, str, str]
"""Path of the file, kind of the name, the name itself, and additional data."""

VERSION: Final = f"2 {__version__} {' '.join((*Entry.__struct_fields__, *Standing.__struct_fields__))}"
"""Version of what is kept."""
BLOCK: Final = 500
LABELLED: Final = f"{EVENTS}{LABELS}"
LINE_OF_LABEL: Final = re.compile(rb"^label:.*$", re.MULTILINE)
ALIAS, LABEL, NAMED = "alias", "label", "named"


class _Model(Struct, frozen=True, array_like=True):
    """What lies in a model's folder: git's id of every file by path, and the names that they state."""

    files: dict[str, str]
    names: tuple[Mention, ...]


_MODEL: Final = msgspec.msgpack.Decoder(_Model)
_ENTRY: Final = msgspec.msgpack.Decoder(Entry)
_STANDING: Final = msgspec.msgpack.Decoder(Standing)


class Contents:
    """The files of a registry at one commit.

    Attributes:
        cache: what was read before.
        memory: the statements that were seen before.
    """

    def __init__(self, repo: Repository, commit: str, *, folder: Path | None = None) -> None:
        """Set up without reading anything.

        Args:
            repo: the repository.
            commit: 40 hexadecimal digits.
            folder: folder of the files that are kept; by default in the user's cache folder.
        """
        self._repo, self._commit = repo, commit
        self.cache: Final = Cache(file_of(repo, ".cache", folder), VERSION)
        self.memory: Final = Memory(repo, folder)
        self._models: dict[str, list[_Model]] = {}

    @cached_property
    def files(self) -> Mapping[str, str]:
        """Ids of all files in ``cameras/``, by path, sorted."""
        found = {**self._folders(CAMERAS)[1]}
        for model in self._in(CAMERAS):
            found |= model.files
        return MappingProxyType(dict(sorted(found.items())))

    def mentions(self, kind: str) -> list[Mention]:
        """Return the names of one kind stated by all files, sorted by path."""
        every = (name for top in (CAMERAS, LABELLED) for one in self._in(top) for name in one.names)
        return sorted(name for name in every if name[1] == kind)

    @cached_property
    def aliases(self) -> AliasMap:
        """Folders with entries in ``cameras/`` that have an alias (make, model), by the alias as match keys."""
        found: dict[tuple[str, str], set[str]] = {}
        for _, _, name, folder in self.mentions(ALIAS):
            make, _, model = name.partition("\n")
            found.setdefault((make, model), set()).add(folder)
        return {name: frozenset(folders) for name, folders in found.items()}

    def _folders(self, top: str) -> tuple[dict[str, str], dict[str, str]]:
        """Return the ids of the models' folders, by path, and of the files beside them."""
        return self._repo.folders(self._commit, top, 2)

    def _in(self, top: str) -> list[_Model]:
        """Return what lies in each model's folder."""
        if top not in self._models:
            names = {f"folder {folder} {oid}": (folder, oid) for folder, oid in self._folders(top)[0].items()}
            kept = self.cache.get(_MODEL, names)
            missing = {name: at for name, at in names.items() if name not in kept}
            new = dict(zip(missing, self._read([*missing.values()]), strict=True))
            self.cache.keep(new)
            self._models[top] = [*kept.values(), *new.values()]
        return self._models[top]

    def _read(self, folders: Sequence[tuple[str, str]]) -> Iterator[_Model]:
        files: dict[str, dict[str, str]] = {folder: {} for folder, _ in folders}
        for path, oid in self._repo.files_in(folders).items():
            files["/".join(path.split("/")[: folders[0][0].count("/")]) + "/"][path] = oid
        every = {path: oid for some in files.values() for path, oid in some.items()}
        names = {path: [*some] for path, some in groupby(self._names(every), key=lambda one: one[0])}
        for some in files.values():
            yield _Model(some, tuple(name for path in some for name in names.get(path, ())))

    def _names(self, files: Mapping[str, str]) -> Iterator[Mention]:
        """Yield the names that files state; whether a label by statement is in force is seen when it is looked up."""
        for path, data in zip(files, self._repo.readable([*files.values()]), strict=True):
            if is_entry(path):
                yield from _names_in(path, data)
            elif path.startswith(EVENTS):
                one = parse_statement(path, data)
                if isinstance(one, Signed) and one.body.label:
                    yield path, NAMED, match_key(one.body.label), subject_in(path)

    def parsed(
        self, files: Iterable[tuple[str, str, bytes | InputError]]
    ) -> Iterator[tuple[str, Entry | InputError]]:
        """Yield the entries of files with their paths; the error if one cannot be read.

        Args:
            files: id, path and content of each; the content has been verified against the id.
        """
        source = iter(files)
        while block := [*islice(source, BLOCK)]:
            kept = self.cache.get(_ENTRY, [f"entry {oid}" for oid, _, _ in block])
            new: dict[str, Entry] = {}
            for oid, path, data in block:
                name = f"entry {oid}"
                if isinstance(data, InputError):
                    yield path, data
                    continue
                entry = kept.get(name) or parsed_or_error(path, data)
                if name not in kept and isinstance(entry, Entry):
                    new[name] = entry
                yield path, entry
            self.cache.keep(new)

    def standings(
        self,
        paths: Sequence[str],
        compute: Callable[[Sequence[str]], Mapping[str, Standing]],
        seen: Callable[[], Mapping[str, Iterable[str]]],
    ) -> dict[str, Standing]:
        """Return what is in force of entries.

        Args:
            paths: paths in ``cameras/``.
            compute: returns it of those that are not kept.
            seen: returns the ids of the statements that were seen before, by their subject.
        """
        before = self._standing_names(paths, seen())
        kept = self.cache.get(_STANDING, before.values())
        found = {path: kept[name] for path, name in before.items() if name in kept}
        if missing := [path for path in paths if path not in found]:
            new = compute(missing)
            found.update(new)
            names = self._standing_names(missing, seen())
            self.cache.keep({names[path]: one for path, one in new.items()})
        return found

    def _standing_names(self, paths: Sequence[str], seen: Mapping[str, Iterable[str]]) -> dict[str, str]:
        """Return for each entry a name of all that its standing follows from: of a model, all files and statements."""
        by_model: dict[str, list[str]] = {}
        for subject in sorted(seen):
            by_model.setdefault(model_folder(subject), []).extend((subject, *sorted(seen[subject])))
        rules = sorted(name for subject, names in seen.items() if "/" not in subject for name in names)
        rules.append(str(self._repo.listing(self._commit, f"{EVENTS}{RULES}")))
        found = dict[str, str]()
        for folder, group in groupby(paths, key=model_folder):
            said = (*rules, *map(str, self._oids(folder)), *by_model.get(folder, ()))
            digest = sha256("\n".join(said).encode()).hexdigest()
            found |= {path: f"standing {digest} {path}" for path in group}
        return found

    def _oids(self, folder: str) -> Iterator[str | None]:
        """Yield the ids of all folders in which something is said of a model."""
        own = folder.removeprefix(f"{CAMERAS}/")
        for top in (CAMERAS, f"{EVENTS}{CAMERAS}", LABELLED.rstrip("/")):
            yield self._repo.folder_id(self._commit, f"{top}/{own}")


def _names_in(path: str, data: bytes) -> Iterator[Mention]:
    if b"aliases" in data:
        entry = parsed_or_error(path, data, require_digest=False)
        if isinstance(entry, Entry):
            yield from stated_names(path, entry)
            return
    if (label := label_in(data)) is not None:
        yield path, LABEL, match_key(label), label


def stated_names(path: str, entry: Entry) -> Iterator[Mention]:
    """Yield the names that an entry states and others look up, by kind; see :meth:`Contents.mentions`."""
    camera = entry.calibration.camera
    if entry.label is not None:
        yield path, LABEL, match_key(entry.label), entry.label
    for alias in entry.aliases:
        name = f"{match_key(alias.make)}\n{match_key(alias.model)}"
        yield path, ALIAS, name, folder_of(camera.make or "", camera.model or "")


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
