"""Reading a directory of images, several at a time, into one record per camera state.

Two images of one camera state give equal metadata, so what is kept grows with the number of states and not
with the number of images; only the names add up.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.parsers.imagery import IMAGE_SUFFIXES, read_metadata

__all__ = ["Gathered", "Rejected", "find_files", "find_images", "gather"]

CHUNK = 64
WORTH_A_POOL = 400
"""Below this many images starting workers costs more than it saves."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """An image that no camera can be told from.

    Attributes:
        name: path below the image directory.
        reason: what was found and what was wanted.
    """

    name: str
    reason: str


@dataclass(slots=True)
class Gathered:
    """What a directory of images says: names by camera state, and the images that say nothing."""

    states: dict[ImageMetadata, list[str]] = field(default_factory=dict)
    rejected: list[Rejected] = field(default_factory=list)

    def add(self, other: Gathered) -> None:
        """Take in what another part of the directory says."""
        for metadata, names in other.states.items():
            self.states.setdefault(metadata, []).extend(names)
        self.rejected.extend(other.rejected)


def find_files(directory: Path, *, recursive: bool) -> Iterator[Path]:
    """The files of a directory in a fixed order; hidden ones and links to directories are left alone.

    Raises:
        InputError: the directory is not there or cannot be read.
    """
    try:
        entries = sorted(os.scandir(directory), key=lambda entry: entry.name)
    except OSError as error:
        reason = "is not a directory" if directory.exists() else "does not exist"
        if isinstance(error, PermissionError):
            reason = "may not be read"
        raise InputError(f"{reason}; give the folder that holds the images", source=str(directory)) from None
    for entry in entries:
        if entry.name.startswith("."):
            continue
        if entry.is_dir(follow_symlinks=False):
            if recursive:
                yield from find_files(Path(entry.path), recursive=True)
        else:
            yield Path(entry.path)


def find_images(directory: Path, *, recursive: bool) -> list[Path]:
    """The files of a directory that are images by their suffix."""
    files = find_files(directory, recursive=recursive)
    return [path for path in files if path.suffix.lower() in IMAGE_SUFFIXES]


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
    # A forked worker would inherit the threads of whoever draws the progress bar.
    method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([__name__])
    with ProcessPoolExecutor(min(workers, len(chunks)), mp_context=context) as pool:
        yield from pool.map(read, chunks)


def _read_chunk(images: Sequence[Path], *, directory: Path) -> Gathered:
    part = Gathered()
    for path in images:
        name = path.relative_to(directory).as_posix()
        try:
            metadata = read_metadata(path)
        except InputError as error:
            part.rejected.append(Rejected(name, error.message))
        except OSError as error:
            part.rejected.append(Rejected(name, f"cannot be read: {error.strerror or error}"))
        else:
            part.states.setdefault(metadata, []).append(name)
    return part
