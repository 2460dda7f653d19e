"""The files of a folder, in a fixed order."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from calibrary.errors import InputError
from calibrary.parsers.files import is_image
from calibrary.records import Record

__all__ = ["SkippedFile", "files_in", "find_files", "find_images", "walk"]


class SkippedFile(Record):
    """An image from which no camera can be identified.

    Attributes:
        name: path relative to the image directory.
        reason: what was found and what was expected.
    """

    name: str = msgspec.field(name="file")
    reason: str


def walk(
    directory: Path, *, recursive: bool, unreadable: list[SkippedFile] | None = None
) -> Iterator[os.DirEntry[str]]:
    """Yield the files of a directory in a fixed order; hidden files and links to directories are skipped.

    Args:
        directory: the directory.
        recursive: whether to read sub-folders.
        unreadable: receives an item for each unreadable sub-folder, which is then skipped.

    Raises:
        InputError: the directory does not exist or cannot be read; or a sub-folder, if ``unreadable`` is None.
    """
    # An explicit stack, because folders may nest deeper than Python's recursion limit.
    waiting = _entries(directory)
    while waiting:
        entry = waiting.pop()
        if not entry.is_dir(follow_symlinks=False):
            yield entry
        elif recursive:
            try:
                waiting += _entries(entry.path)
            except InputError as error:
                if unreadable is None:
                    raise
                name = Path(entry.path).relative_to(directory).as_posix()
                unreadable.append(SkippedFile(name=f"{name}/", reason=f"the folder {error.message}"))


def _entries(directory: Path | str) -> list[os.DirEntry[str]]:
    """Content of one directory, last name first."""
    try:
        with os.scandir(directory) as entries:
            seen = [entry for entry in entries if not entry.name.startswith(".")]
    except OSError as error:
        reason, remedy = "is not a directory", "give the folder that contains the images"
        if isinstance(error, FileNotFoundError):
            reason = "does not exist"
        elif not isinstance(error, NotADirectoryError):
            reason, remedy = (
                f"cannot be read: {error.strerror or error}",
                "make it readable, or move it away",
            )
        raise InputError(f"{reason}; {remedy}", source=str(Path(directory))) from None
    return sorted(seen, key=lambda entry: entry.name, reverse=True)


def find_files(
    directory: Path, *, recursive: bool, unreadable: list[SkippedFile] | None = None
) -> Iterator[Path]:
    """As :func:`walk`, with paths."""
    return (Path(entry.path) for entry in walk(directory, recursive=recursive, unreadable=unreadable))


def files_in(directory: Path) -> list[Path]:
    """All files in a folder and its sub-folders.

    Raises:
        InputError: there are none.
    """
    found = list(find_files(directory, recursive=True))
    if not found:
        raise InputError("the folder contains no files", source=str(directory))
    return found


def find_images(
    directory: Path, *, recursive: bool, unreadable: list[SkippedFile] | None = None
) -> list[Path]:
    """As :func:`walk`, with only the files that are images by suffix."""
    files = find_files(directory, recursive=recursive, unreadable=unreadable)
    return [path for path in files if is_image(path)]
