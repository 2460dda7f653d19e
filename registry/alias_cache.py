"""The index over all entries that finding one needs, cached between runs and updated from git.

It holds the aliases of cameras, the labels of units, and the entries whose path does not follow from their camera.
Reading a hundred thousand entries for them takes seconds; of a registry that was read before only the differences are
read. The file is in the user's cache folder and may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from platformdirs import user_cache_path

from calibrary.atomic import write_files
from calibrary.errors import CalibraryError, InputError
from calibrary.registry.entry_yaml import LARGEST_ENTRY
from calibrary.registry.git.history import changed
from calibrary.registry.git.objects import HEX
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS
from calibrary.registry.resolution import AliasMap, is_keyed, scan_aliases
from calibrary.strictyaml import load_yaml

__all__ = ["Names", "label_in", "names_at", "names_kept"]

VERSION: Final = 2
LABEL: Final = re.compile(rb"^label:.*$", re.MULTILINE)

Alias = tuple[str, str, str]
"""Make and model as match keys, and the folder of the camera that is so called."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Names:
    """What the entries of one commit say that their paths do not.

    Attributes:
        commit: whose entries.
        aliases: by path.
        labels: of the units, by the entry's path.
        irregular: paths that no key gives.
    """

    commit: str
    aliases: Mapping[str, tuple[Alias, ...]]
    labels: Mapping[str, str]
    irregular: tuple[str, ...]

    @property
    def alias_map(self) -> AliasMap:
        """As the resolution asks for it."""
        found: dict[tuple[str, str], set[str]] = {}
        for entries in self.aliases.values():
            for make, model, folder in entries:
                found.setdefault((make, model), set()).add(folder)
        return {name: frozenset(folders) for name, folders in found.items()}


def names_at(repo: Repository, commit: str, *, folder: Path | None = None) -> Names:
    """The names at a commit, kept for the next time.

    Args:
        repo: the repository.
        commit: 40 hexadecimal digits.
        folder: where they are kept; the user's cache folder when left out.

    Raises:
        RegistryError: an entry's content is missing.
    """
    names = names_kept(repo, commit, folder=folder)
    if names is None:
        names = _read_whole(repo, commit)
        _keep(names, _file_of(repo, folder))
    return names


def names_kept(repo: Repository, commit: str, *, folder: Path | None = None) -> Names | None:
    """The same where an earlier run left them, brought up to this commit; None where that takes reading every entry.

    Args:
        repo: as of :func:`names_at`.
        commit: as of :func:`names_at`.
        folder: as of :func:`names_at`.

    Raises:
        RegistryError: the content of an entry that has changed since is missing.
    """
    file = _file_of(repo, folder)
    known = _kept(file)
    if known is None or known.commit == commit:
        return known
    # A history that was rewritten may have taken the commit with it.
    if not repo.holds(known.commit):
        return None
    names = _brought_up(repo, known, commit)
    _keep(names, file)
    return names


def _file_of(repo: Repository, folder: Path | None) -> Path:
    folder = folder or user_cache_path("calibrary", appauthor=False) / "registry-names"
    repository = hashlib.sha256(str(repo.common_dir).encode("utf-8", "surrogateescape")).hexdigest()[:32]
    return folder / f"{repository}.json"


def _keep(names: Names, file: Path) -> None:
    """Write the cache; if that fails, the next run only takes longer."""
    with suppress(CalibraryError, OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_files({file: _document(names)})


def _read_whole(repo: Repository, commit: str) -> Names:
    listing = repo.listing(commit, CAMERAS)
    paths = sorted(listing)
    aliases, labels = _said(zip(paths, repo.read_many([listing[path] for path in paths]), strict=True))
    return Names(
        commit=commit,
        aliases=aliases,
        labels=labels,
        irregular=tuple(path for path in paths if not is_keyed(path)),
    )


def _brought_up(repo: Repository, known: Names, commit: str) -> Names:
    """The earlier index, with the entries that differ replaced."""
    differing = changed(repo, known.commit, commit, CAMERAS)
    there = {file.path: file.after for file in differing if file.after is not None}
    new_aliases, new_labels = _said(zip(there, repo.read_many([*there.values()]), strict=True))
    touched = {file.path for file in differing}
    aliases = {path: names for path, names in known.aliases.items() if path not in touched}
    labels = {path: label for path, label in known.labels.items() if path not in touched}
    irregular = {path for path in known.irregular if path not in touched}
    return Names(
        commit=commit,
        aliases=aliases | new_aliases,
        labels=labels | new_labels,
        irregular=tuple(sorted(irregular | {path for path in there if not is_keyed(path)})),
    )


def label_in(data: bytes) -> str | None:
    """The label that an entry's file states; its one line is read, and not the entry."""
    if (line := LABEL.search(data)) is None:
        return None
    try:
        stated = load_yaml(line[0], source="label", max_bytes=LARGEST_ENTRY, max_depth=1)
    except InputError:
        return None
    label = stated.get("label") if isinstance(stated, dict) else None
    return label if isinstance(label, str) else None


def _said(files: Iterable[tuple[str, bytes]]) -> tuple[dict[str, tuple[Alias, ...]], dict[str, str]]:
    """The aliases and the labels, by path."""
    found, labels = {}, {}
    for path, data in files:
        if (label := label_in(data)) is not None:
            labels[path] = label
        named = scan_aliases([(path, data)])
        if named:
            found[path] = tuple(
                (make, model, folder) for (make, model), folders in named.items() for folder in folders
            )
    return found, labels


def _document(names: Names) -> bytes:
    document = {
        "version": VERSION,
        "commit": names.commit,
        "aliases": {path: [list(alias) for alias in aliases] for path, aliases in names.aliases.items()},
        "labels": dict(names.labels),
        "irregular": list(names.irregular),
    }
    return json.dumps(document, ensure_ascii=True, separators=(",", ":")).encode()


def _kept(file: Path) -> Names | None:
    """The index of an earlier run; None if the file is anything else."""
    try:
        document = json.loads(file.read_bytes())
        if document["version"] != VERSION or HEX.match(document["commit"]) is None:
            return None
        return Names(
            commit=document["commit"],
            aliases={_text(path): _of_entry(aliases) for path, aliases in document["aliases"].items()},
            labels={_text(path): _text(label) for path, label in document["labels"].items()},
            irregular=tuple(_text(path) for path in document["irregular"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _of_entry(aliases: Sequence[Sequence[str]]) -> tuple[Alias, ...]:
    return tuple((_text(make), _text(model), _text(folder)) for make, model, folder in aliases)


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(value)
    return value
