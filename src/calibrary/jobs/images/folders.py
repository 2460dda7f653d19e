"""The files of a folder, in a fixed order; paths for modified copies of images, which overwrite none of them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from calibrary.errors import InputError
from calibrary.parsers.files import is_image
from calibrary.records import Record


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


def find_files(directory: Path, *, recursive: bool) -> Iterator[Path]:
    """As :func:`walk`, with paths; every sub-folder must be readable."""
    return (Path(entry.path) for entry in walk(directory, recursive=recursive))


def files_in(directory: Path) -> list[Path]:
    """All files in a folder and its sub-folders.

    Raises:
        InputError: there are none.
    """
    found = list(find_files(directory, recursive=True))
    if not found:
        raise InputError("the folder contains no files", source=str(directory))
    return found


def find_images(directory: Path, *, recursive: bool) -> list[Path]:
    """As :func:`find_files`, with only the files that are images by suffix."""
    return [path for path in find_files(directory, recursive=recursive) if is_image(path)]


def places_of_copies(images: Sequence[Path], out: Path) -> Iterator[tuple[Path, Path]]:
    """Yield each image with the path of its copy, at the same relative path in ``out`` as in the given folder.

    Raises:
        InputError: a folder contains no image or cannot be read.
    """
    target = out.resolve()
    for path in images:
        if not path.is_dir():
            yield path, out / path.name
            continue
        found = [one for one in find_images(path, recursive=True) if target not in one.resolve().parents]
        if not found:
            raise InputError("holds no image", source=str(path))
        for image in found:
            yield image, out / image.relative_to(path)


def refuse_overwriting(
    copies: Sequence[tuple[Path, Path]], *, done: str, force: bool, also: Sequence[Path] = ()
) -> None:
    """Check before writing that nothing would be overwritten.

    Args:
        copies: each image with the path of its copy.
        done: name of the operation, such as "undistort".
        force: whether existing files may be replaced.
        also: other files that will be written.

    Raises:
        InputError: an original image, another copy, or, without ``force``, an existing file would be
            overwritten.
    """
    inputs = {image.resolve() for image, _ in copies}
    outputs: dict[Path, Path] = {}
    for image, copy in copies:
        output = copy.resolve()
        if output in inputs:
            raise InputError(
                "it would overwrite an image it is made from; give another --out", source=str(copy)
            )
        other = outputs.setdefault(output, image)
        if other != image:
            raise InputError(
                f"both {other} and {image} would be written there; {done} them one by one", source=str(copy)
            )
    there = [] if force else [path for path in (*also, *(copy for _, copy in copies)) if path.exists()]
    if there:
        more = f" (and {len(there) - 1} more)" if len(there) > 1 else ""
        raise InputError(
            f"is there already{more}; --force replaces it, --out writes elsewhere", source=str(there[0])
        )
