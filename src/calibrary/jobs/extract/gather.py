"""Reading a directory of images, several at a time, into one record per camera state.

Two images of one camera state give equal metadata, so what is kept grows with the number of states and not
with the number of images; only the names add up.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import msgspec

from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.parsers.image_names import is_image
from calibrary.parsers.imagery import read_metadata
from calibrary.records import Record
from calibrary.workers import mapped

__all__ = ["Gathered", "ImageSet", "SkippedFile", "collect_images", "find_files", "find_images", "gather"]

CHUNK = 64
WORTH_A_POOL = 400
"""Below this many images starting workers costs more than it saves."""


class SkippedFile(Record):
    """An image that no camera can be told from.

    Attributes:
        name: path below the image directory.
        reason: what was found and what was expected.
    """

    name: str = msgspec.field(name="file")
    reason: str


@dataclass(slots=True)
class Gathered:
    """What a directory of images says: names by camera state, and the images that say nothing."""

    states: dict[ImageMetadata, list[str]] = field(default_factory=dict)
    rejected: list[SkippedFile] = field(default_factory=list)

    def add(self, other: Gathered) -> None:
        """Take in what another part of the directory says."""
        for metadata, names in other.states.items():
            self.states.setdefault(metadata, []).extend(names)
        self.rejected.extend(other.rejected)


def find_files(
    directory: Path, *, recursive: bool, unreadable: list[SkippedFile] | None = None
) -> Iterator[Path]:
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
            yield Path(entry.path)
        elif recursive:
            try:
                waiting += _entries(Path(entry.path))
            except InputError as error:
                if unreadable is None:
                    raise
                name = Path(entry.path).relative_to(directory).as_posix()
                unreadable.append(SkippedFile(name=f"{name}/", reason=f"the folder {error.message}"))


def _entries(directory: Path) -> list[os.DirEntry[str]]:
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
        raise InputError(f"{reason}; {remedy}", source=str(directory)) from None
    return sorted(seen, key=lambda entry: entry.name, reverse=True)


def find_images(
    directory: Path, *, recursive: bool, unreadable: list[SkippedFile] | None = None
) -> list[Path]:
    """The files of a directory that are images by their suffix; arguments as of :func:`find_files`."""
    files = find_files(directory, recursive=recursive, unreadable=unreadable)
    return [path for path in files if is_image(path)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSet:
    """The images of a run.

    Attributes:
        paths: to read.
        root: the folder that their names are told relative to.
        folders: where a calibration file may lie beside them.
        unreadable: sub-folders that were passed over.
    """

    paths: tuple[Path, ...]
    root: Path
    folders: tuple[Path, ...]
    unreadable: tuple[SkippedFile, ...] = ()


def collect_images(given: Sequence[Path], *, recursive: bool) -> ImageSet:
    """The images that are meant by a folder, or by images and folders.

    Raises:
        InputError: none is given, or one is not there or cannot be read; a sub-folder is passed over then.
    """
    if not given:
        raise InputError("no image was given; expected a folder, or a list of images")
    unreadable: list[SkippedFile] = []
    if len(given) == 1 and not given[0].is_file():
        [folder] = given
        images = find_images(folder, recursive=recursive, unreadable=unreadable)
        return ImageSet(paths=tuple(images), root=folder, folders=(folder,), unreadable=tuple(unreadable))
    paths: dict[Path, None] = {}
    folders: dict[Path, None] = {}
    # Made absolute without following links: a name in the report is the one that was given.
    for path in (Path(os.path.abspath(one)) for one in given):  # noqa: PTH100
        if path.is_file():
            paths[path] = folders[path.parent] = None
        else:
            found = find_images(path, recursive=recursive, unreadable=unreadable)
            paths.update(dict.fromkeys(found))
            folders[path] = None
    return ImageSet(
        paths=tuple(paths),
        root=Path(os.path.commonpath(folders)),
        folders=tuple(folders),
        unreadable=tuple(unreadable),
    )


def gather(
    images: Sequence[Path],
    directory: Path,
    *,
    workers: int = 0,
    progress: Callable[[int], None] | None = None,
    stop_at_first: bool = False,
) -> Gathered:
    """Read the heads of images.

    Args:
        images: what to read.
        directory: names are told relative to it.
        workers: processes; 0 takes as many as there are cores once it is worth it.
        progress: called with the number of images read since the last call.
        stop_at_first: leave off after the first image that is rejected.
    """
    if workers == 0:
        workers = (os.cpu_count() or 1) if len(images) >= WORTH_A_POOL else 1
    chunks = [images[i : i + CHUNK] for i in range(0, len(images), CHUNK)]
    read = partial(_read_chunk, directory=directory)
    result = Gathered()
    for part, chunk in zip(_mapped(read, chunks, workers), chunks, strict=True):
        result.add(part)
        if progress is not None:
            progress(len(chunk))
        if stop_at_first and result.rejected:
            break
    return result


def _mapped(
    read: Callable[[Sequence[Path]], Gathered], chunks: Sequence[Sequence[Path]], workers: int
) -> Iterator[Gathered]:
    if workers <= 1 or len(chunks) <= 1:
        yield from map(read, chunks)
        return
    try:
        yield from mapped(read, chunks, workers, preload=[__name__])
    except BrokenProcessPool:
        raise InputError(
            "a process that reads images was ended from outside, as when memory runs out; use --workers 1"
        ) from None


def _read_chunk(images: Sequence[Path], *, directory: Path) -> Gathered:
    part = Gathered()
    for path in images:
        name = path.relative_to(directory).as_posix()
        try:
            metadata = read_metadata(path)
        except InputError as error:
            part.rejected.append(SkippedFile(name=name, reason=error.message))
        except OSError as error:
            part.rejected.append(SkippedFile(name=name, reason=f"cannot be read: {error.strerror or error}"))
        else:
            part.states.setdefault(metadata, []).append(name)
    return part
