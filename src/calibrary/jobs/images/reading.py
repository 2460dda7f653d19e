"""Reading the heads of images, piece by piece and by several processes, into one accumulator."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.jobs.images.accumulator import Accumulator, Flight
from calibrary.jobs.images.observation import Image, Observation, observe
from calibrary.jobs.images.places import is_remote, open_place
from calibrary.jobs.images.ranged import StoreError
from calibrary.jobs.images.units import Partials, Unit, batches, shards
from calibrary.workers import mapped_on

__all__ = ["BATCH", "Done", "Engine", "Question", "Reading", "gather", "here", "read_images", "read_unit"]

BATCH = 64
AT_ONCE = 32
"""Requests of one process that are under way together: at 20 ms each, as many answers as it has time to read."""
WORTH_A_POOL = 400
"""Below this many images starting workers costs more than it saves."""
KILLED = "not read: the process that read it was killed, and again on the second try"


class Question(Struct, frozen=True, kw_only=True):
    """What every image is asked.

    Attributes:
        days: also on which day it was taken.
        list_all: keep its name, however many there are.
    """

    days: bool = False
    list_all: bool = True


class Done(Struct, frozen=True):
    """What became of one piece of the work, or of several that were merged where they were read.

    Attributes:
        count: how many images they are.
        part: what they say; None where the process that read them was killed, and again on the second try.
        unit: the piece, if it is one.
    """

    count: int
    part: Accumulator | None
    unit: Unit | None


Read: TypeAlias = Callable[[Unit], Accumulator]
Engine: TypeAlias = Callable[[Read, Iterator[Unit]], Iterator[Done]]
"""Whatever spreads pieces of work over processes or machines: any order will do, and any merging on the way."""


class Reading(Struct, frozen=True, kw_only=True):
    """What came of reading images.

    Attributes:
        images: what they say.
        lost: how many of them were not read because the process that did was killed, also on
            the second try; they are among those that cannot be read.
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
        directory: names are relative to it.
        workers: processes; 0 takes as many as there are cores once it is worth it.
        progress: called with the number of images read since the last call.
    """
    images = (Image(name=path.relative_to(directory).as_posix(), place=str(path)) for path in paths)
    found = read_images(images, engine=here(workers, known=len(paths)), progress=progress)
    return found.images.settled()


NOTHING_ASKED: Final = Question()


def read_images(
    images: Iterable[Image],
    question: Question = NOTHING_ASKED,
    *,
    engine: Engine,
    shard: int | None = None,
    partials: Path | None = None,
    progress: Callable[[int], None] | None = None,
    stop_at_first: bool = False,
) -> Reading:
    """Read the heads of images.

    Args:
        images: what to read; no more of them are asked for than are being read.
        question: what they are asked.
        engine: what spreads the work.
        shard: how many images are a piece; None for small ones.
        partials: where to keep what each shard says, and look it up in a later run.
        progress: called with the number of images read since the last call.
        stop_at_first: leave off after the first piece with an image that cannot be read.

    Raises:
        InputError: a partial result cannot be written.
    """
    asked = f"days{question.days:d}-all{question.list_all:d}"
    kept = Partials(partials, asked) if partials is not None else None
    units = shards(images) if kept is not None else batches(images, shard or BATCH)
    total, lost = Accumulator(list_all=question.list_all), 0

    def taken(part: Accumulator, count: int) -> None:
        total.merge(part)
        if progress is not None:
            progress(count)

    def left() -> Iterator[Unit]:
        for unit in units:
            known = kept.get(unit) if kept is not None else None
            if known is None:
                yield unit
            else:
                taken(known, len(unit.images))

    for done in engine(partial(read_unit, question=question), left()):
        part = done.part
        if part is None:
            lost += done.count
            part = _unread(done.unit, question)
        elif kept is not None and done.unit is not None:
            kept.put(done.unit, part)
        taken(part, done.count)
        if stop_at_first and total.has_unread:
            break
    return Reading(images=total, lost=lost)


def here(workers: int, *, known: int | None) -> Engine:
    """Processes of this machine.

    Args:
        workers: how many; 0 takes as many as there are cores once it is worth it.
        known: how many images there are, None for very many.
    """
    if workers == 0:
        workers = (os.cpu_count() or 1) if known is None or known >= WORTH_A_POOL else 1
    if known is not None:
        workers = min(workers, -(-known // BATCH))

    def engine(read: Read, units: Iterator[Unit]) -> Iterator[Done]:
        return (Done(len(unit.images), part, unit) for unit, part in _mapped(read, units, workers))

    return engine


def _mapped(read: Read, units: Iterator[Unit], workers: int) -> Iterator[tuple[Unit, Accumulator | None]]:
    if workers <= 1:
        return ((unit, read(unit)) for unit in units)
    return mapped_on(read, units, workers, preload=[__name__])


def read_unit(unit: Unit, *, question: Question) -> Accumulator:
    """What some images say, read by this process."""
    part = Accumulator(list_all=question.list_all)
    read = partial(_read, days=question.days)
    near = [image for image in unit.images if not is_remote(image.place)]
    far = [image for image in unit.images if is_remote(image.place)]
    for image in near:
        part.add(read(image))
    if far:
        # Threads wait for answers side by side; their connections are kept for the next piece.
        with ThreadPoolExecutor(min(AT_ONCE, len(far))) as pool:
            for observation in pool.map(read, far):
                part.add(observation)
    return part


def _read(image: Image, *, days: bool) -> Observation:
    passing = False
    try:
        with open_place(image.place) as source:
            return observe(source, image, days=days)
    except InputError as error:
        reason = error.message
    except StoreError as error:
        reason, passing = error.message, error.passing
    except OSError as error:
        reason = f"cannot be read: {error.strerror or error}"
    return Observation(id=image.id, name=image.name, reason=reason, passing=passing)


def _unread(unit: Unit | None, question: Question) -> Accumulator:
    part = Accumulator(list_all=question.list_all)
    for image in unit.images if unit is not None else ():
        part.add(Observation(id=image.id, name=image.name, reason=KILLED, passing=True))
    return part
