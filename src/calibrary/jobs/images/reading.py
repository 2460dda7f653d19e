"""Reading the heads of images by several processes, batch by batch, into one accumulator."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

from calibrary.errors import InputError
from calibrary.jobs.images.accumulator import Accumulator, Flight
from calibrary.jobs.images.observation import Image, Observation, observe
from calibrary.parsers.imagery.source import open_source
from calibrary.workers import mapped_on

__all__ = ["BATCH", "Reading", "gather", "read_batch", "read_images"]

BATCH = 64
WORTH_A_POOL = 400
"""Below this many images starting workers costs more than it saves."""
KILLED = "not read: the process that read it was killed, twice; memory may have run out"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What came of reading images.

    Attributes:
        images: what they say.
        lost: how many of them nobody could read because the process that did was killed, and again when it was
            tried anew; they are among those that cannot be read.
    """

    images: Accumulator
    lost: int = 0


def gather(
    paths: Sequence[Path],
    directory: Path,
    *,
    workers: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Flight:
    """What some images say, every one of them named.

    Args:
        paths: what to read.
        directory: names are told relative to it.
        workers: processes; 0 takes as many as there are cores once it is worth it.
        progress: called with the number of images read since the last call.
    """
    images = (Image(name=path.relative_to(directory).as_posix(), place=str(path)) for path in paths)
    found = read_images(images, known=len(paths), workers=workers, progress=progress)
    return found.images.settled()


def read_images(
    images: Iterable[Image],
    *,
    known: int | None,
    workers: int = 0,
    days: bool = False,
    list_all: bool = True,
    progress: Callable[[int], None] | None = None,
    stop_at_first: bool = False,
) -> Reading:
    """Read the heads of images.

    Args:
        images: what to read; no more of them are asked for than are being read.
        known: how many there are, None for very many.
        workers: processes; 0 takes as many as there are cores once it is worth it.
        days: ask on which day they were taken.
        list_all: keep the name of every image.
        progress: called with the number of images read since the last call.
        stop_at_first: leave off after the first batch with an image that cannot be read.
    """
    if workers == 0:
        workers = (os.cpu_count() or 1) if known is None or known >= WORTH_A_POOL else 1
    if known is not None:
        workers = min(workers, -(-known // BATCH))
    read = partial(read_batch, days=days, list_all=list_all)
    total, lost = Accumulator(list_all=list_all), 0
    for batch, part in _mapped(read, _batches(images), workers):
        if part is None:
            lost += len(batch)
            part = _unread(batch, list_all=list_all)  # noqa: PLW2901  what stands for it
        total.merge(part)
        if progress is not None:
            progress(len(batch))
        if stop_at_first and total.has_unread:
            break
    return Reading(images=total, lost=lost)


def read_batch(images: Sequence[Image], *, days: bool, list_all: bool) -> Accumulator:
    """What some images say, read by this process one after another."""
    part = Accumulator(list_all=list_all)
    for image in images:
        part.add(_read(image, days=days))
    return part


def _read(image: Image, *, days: bool) -> Observation:
    try:
        with open_source(image.place) as source:
            return observe(source, image, days=days)
    except InputError as error:
        reason = error.message
    except OSError as error:
        reason = f"cannot be read: {error.strerror or error}"
    return Observation(id=image.id, name=image.name, reason=reason)


def _unread(images: Sequence[Image], *, list_all: bool) -> Accumulator:
    part = Accumulator(list_all=list_all)
    for image in images:
        part.add(Observation(id=image.id, name=image.name, reason=KILLED))
    return part


def _batches(images: Iterable[Image]) -> Iterator[list[Image]]:
    left = iter(images)
    while batch := list(islice(left, BATCH)):
        yield batch


def _mapped(
    read: Callable[[Sequence[Image]], Accumulator], batches: Iterator[list[Image]], workers: int
) -> Iterator[tuple[list[Image], Accumulator | None]]:
    if workers <= 1:
        return ((batch, read(batch)) for batch in batches)
    return mapped_on(read, batches, workers, preload=[__name__])
