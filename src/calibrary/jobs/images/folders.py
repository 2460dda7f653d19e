"""The files of a folder, in a fixed order."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from calibrary.errors import InputError
from calibrary.parsers.image_names import is_image
from calibrary.records import Record

__all__ = ["SkippedFile", "find_files", "find_images", "walk"]


class SkippedFile(Record):
    """An image that no camera can be identified from.

    Attributes:
        name: path below the image directory.
        reason: what was found and what was expected.
    """

    name: str = msgspec.field(name="file")
    reason: str


def walk(
    directory: Path, *, recursive: bool, unreadable: list[SkippedFile] | None = None
) -> Iterator[os.DirEntry[str]]:
    """The files of a directory in a fixed order; hidden ones and links to directories are left alone.

    Args:
        directory: where to look.
        recursive: go into sub-folders.
        unreadable: gets a line for each sub-folder that cannot be read, which is then passed over.

    Raises:
        InputError: the directory is not there or cannot be read; or one below it, without ``unreadable``.
    """
    # A stack of its own: folders nest deeper than Python calls.
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
    """What is in one directory, the last name first."""
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
    """The same as paths; arguments and errors as of :func:`walk`."""
    return (Path(entry.path) for entry in walk(directory, recursive=recursive, unreadable=unreadable))


def find_images(
    directory: Path, *, recursive: bool, unreadable: list[SkippedFile] | None = None
) -> list[Path]:
    """The files of a directory that are images by their suffix; arguments as of :func:`walk`."""
    files = find_files(directory, recursive=recursive, unreadable=unreadable)
    return [path for path in files if is_image(path)]
