"""Reading of a registry's files in a folder, without git."""

from __future__ import annotations

import os
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.registry.entry_yaml import LARGEST_ENTRY
from calibrary.registry.paths import PROPOSED, ROOT, is_entry

__all__ = ["entry_paths", "proposal_paths", "read_entry_file"]


def entry_paths(root: Path) -> list[str]:
    """Return the sorted paths of all entries below a registry's root; links to folders are not followed.

    Raises:
        RegistryError: there is no registry here, or a folder cannot be read.
    """
    if not (root / ROOT).is_dir():
        raise RegistryError(
            f"{root}: no registry here: expected a folder 'cameras' with one YAML file a camera"
        )
    return _entries_below(root, ROOT)


def proposal_paths(root: Path) -> list[str]:
    """Return the same for proposals."""
    return _entries_below(root, PROPOSED)


def _entries_below(root: Path, top: str) -> list[str]:
    def refuse(error: OSError) -> None:
        raise RegistryError(f"{error.filename}: cannot be read: {error.strerror}") from None

    start = len(str(root)) + 1 if str(root) != "." else 0
    found = []
    for folder, _, names in os.walk(root / top, onerror=refuse) if (root / top).is_dir() else ():
        below = folder[start:].replace(os.sep, "/")
        found += [f"{below}/{name}" for name in names if is_entry(name)]
    return sorted(found)


def read_entry_file(root: Path, path: str) -> bytes:
    """Return the content of one entry file.

    Raises:
        RegistryError: it is not a regular file, too large, or cannot be read.
    """
    file = root / path
    try:
        if file.is_symlink() or not file.is_file():
            raise RegistryError(f"{path}: expected a regular file")
        with file.open("rb") as opened:
            data = opened.read(LARGEST_ENTRY + 1)
    except OSError as error:
        raise RegistryError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > LARGEST_ENTRY:
        raise RegistryError(f"{path}: is larger than {LARGEST_ENTRY >> 10} KiB, expected one camera's entry")
    return data
