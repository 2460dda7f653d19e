"""A registry as a plain folder of files: a checkout, an unpacked archive, or a folder written by hand."""

from __future__ import annotations

import os
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.registry.entry import ROOT, is_entry
from calibrary.registry.entry_yaml import LARGEST_ENTRY

__all__ = ["entry_paths", "read_entry_file"]


def entry_paths(root: Path) -> list[str]:
    """The paths of all entries below a registry's root, sorted; links to folders are not followed.

    Raises:
        RegistryError: there is no registry here, or a folder of it cannot be read.
    """
    cameras = root / ROOT
    if not cameras.is_dir():
        raise RegistryError(
            f"{root}: no registry here: wanted a folder 'cameras' with one YAML file a camera"
        )

    def refuse(error: OSError) -> None:
        raise RegistryError(f"{error.filename}: cannot be read: {error.strerror}") from None

    start = len(str(root)) + 1 if str(root) != "." else 0
    found = []
    for folder, _, names in os.walk(cameras, onerror=refuse):
        below = folder[start:].replace(os.sep, "/")
        found += [f"{below}/{name}" for name in names if is_entry(name)]
    return sorted(found)


def read_entry_file(root: Path, path: str) -> bytes:
    """The bytes of one entry.

    Raises:
        RegistryError: it is no regular file, too large, or cannot be read.
    """
    file = root / path
    try:
        if file.is_symlink() or not file.is_file():
            raise RegistryError(f"{path}: wanted a regular file")
        with file.open("rb") as opened:
            data = opened.read(LARGEST_ENTRY + 1)
    except OSError as error:
        raise RegistryError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > LARGEST_ENTRY:
        raise RegistryError(f"{path}: is larger than {LARGEST_ENTRY >> 10} KiB, wanted one camera's entry")
    return data
