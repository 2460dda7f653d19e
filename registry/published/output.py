"""The output folder of a publication: files are written atomically, and obsolete ones are removed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from calibrary.atomic import check_folder
from calibrary.errors import InputError
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.places import PUBLISHED_FILE, is_published
from calibrary.registry.published.layout import (
    CAMERA_FOLDER,
    ENTRY_FOLDER,
    METADATA_FOLDER,
    SCHEMA_FOLDER,
    UNIT_FOLDER,
    is_ours,
    sha256,
)

FOLDERS: Final = (ENTRY_FOLDER, CAMERA_FOLDER, UNIT_FOLDER, METADATA_FOLDER)
STAGING: Final = ".publishing"
STATE_FILE: Final = f"{STAGING}/state.json"
"""State for the next run; not part of the publication."""
OWN_NAMES: Final = frozenset({STAGING, SCHEMA_FOLDER, *FOLDERS})
"""Names that a publication uses at the top of its folder."""
SITE_MARKER: Final = ".calibrary-site"

OURS: Final = (b'{"schema":"calibrary/', b'{"signatures":[')
"""First bytes of published files."""
WAIT_S: Final = 60.0


class Output(Struct, kw_only=True):
    """The output folder, and the files that belong into it.

    Attributes:
        root: the folder.
        known: digests of the verified existing files, by path.
        kept: all files that belong into the folder.
        written: number of files that were absent or different.
        staged: temporary files, moved to their places when all are written.
    """

    root: Path
    known: dict[str, str] = field(default_factory=dict)
    kept: set[str] = field(default_factory=set)
    written: int = 0
    staged: dict[str, str] = field(default_factory=dict)

    def put(self, path: str, data: bytes, *, in_place: bool = True) -> str:
        """Write a file atomically unless it already exists; return its digest."""
        # Strings, as paths of pathlib take as long as the writing itself.
        digest, place = sha256(data), os.path.join(self.root, path)  # noqa: PTH118
        self.kept.add(path)
        if self.known.get(path) == digest or _content(place) == data:
            return digest
        self.written += 1
        temporary = os.path.join(self.root, STAGING, f"{os.getpid()}-{self.written}")  # noqa: PTH118
        with open(temporary, "wb", buffering=0) as file:  # noqa: PTH123
            file.write(data)
        if in_place:
            _move(temporary, place)
        else:
            self.staged[path] = temporary
        return digest

    def publish_staged(self) -> None:
        """Move the staged files to their places, after all of them are on the disk."""
        if hasattr(os, "sync"):
            os.sync()
        for path, temporary in self.staged.items():
            _move(temporary, os.path.join(self.root, path))  # noqa: PTH118
        self.staged.clear()

    def remove_stale(self) -> int:
        """Remove files of an earlier publication that are not in this one; other files are kept."""
        stale = [
            path
            for path in _files_below(self.root)
            if path not in self.kept and is_ours(path) and _begins_as_ours(self.root / path)
        ]
        for path in stale:
            place = self.root / path
            place.unlink()
            with suppress(OSError):
                # Also remove folders that are now empty.
                for folder in place.relative_to(self.root).parents[:-1]:
                    (self.root / folder).rmdir()
        return len(stale)


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
        is_known = is_published(str(out))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=str(out)) from None
    # An interrupted first run leaves everything except the root; a site may be in the same folder.
    if found and not (is_known or STAGING in found or SITE_MARKER in found):
        raise InputError(
            f"is not a published registry (it has no {PUBLISHED_FILE}) and is not empty; name another folder",
            source=str(out),
        )


@contextmanager
def opened(out: Path) -> Iterator[Output]:
    """Provide the folder, locked against other runs, and without the remains of an interrupted one.

    Raises:
        InputError: the folder is not writable.
        RegistryError: another run is using it.
    """
    try:
        staging = out / STAGING
        staging.mkdir(parents=True, exist_ok=True)
        with writer_lock(staging, wait_s=WAIT_S):
            for left in staging.glob("*-*"):
                left.unlink()
            yield Output(root=out)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(out)) from None


def _content(place: str) -> bytes | None:
    try:
        with open(place, "rb", buffering=0) as file:  # noqa: PTH123
            return file.read()
    except (FileNotFoundError, NotADirectoryError):
        return None


def _move(temporary: str, place: str) -> None:
    try:
        os.replace(temporary, place)  # noqa: PTH105
    except FileNotFoundError:
        os.makedirs(os.path.dirname(place), exist_ok=True)  # noqa: PTH103, PTH120
        os.replace(temporary, place)  # noqa: PTH105


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
        return opened.read(max(map(len, OURS))).startswith(OURS)
