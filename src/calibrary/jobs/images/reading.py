"""Reading of image headers in pieces, by several processes, into one accumulator.

Each piece of work is read by one process.

On a cluster Dask's scheduler distributes the pieces of work and merges their results, independently of the image
metadata. Any engine that maps a function over pieces and reduces the results with an associative, commutative and
idempotent merge can be used instead (docs/performance.md shows Ray and Spark).
"""

from __future__ import annotations

import os
import pickle
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, Final, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.extras import require
from calibrary.jobs.images.accumulator import Accumulator, Flight
from calibrary.jobs.images.observation import Image, Observation, Seen, observe
from calibrary.jobs.images.places import is_remote, open_place
from calibrary.jobs.images.ranged import StoreError
from calibrary.parsers.imagery.reader import may_be_cropped
from calibrary.records import replace


class Unit(Struct, frozen=True):
    """A piece of work: images that one process reads.

    Attributes:
        images: at least one.
    """

    images: tuple[Image, ...]

    def pickled(self) -> bytes:
        """Serialise for another process, as plain tuples: faster than objects, and names may contain any bytes."""
        return pickle.dumps([(one.name, one.place, one.same_as) for one in self.images], protocol=5)

    @classmethod
    def unpickled(cls, data: bytes) -> Unit:
        """Restore from :meth:`pickled`; must not be used with data from elsewhere."""
        return cls(tuple(Image(*row) for row in pickle.loads(data)))  # noqa: S301  our own


def batches(images: Iterable[Image], size: int) -> Iterator[Unit]:
    """Yield pieces of ``size`` images."""
    left = iter(images)
    while batch := tuple(islice(left, size)):
        yield Unit(batch)


BATCH = 64
AT_ONCE = 32
"""Simultaneous requests of one process: at 20 ms each, as many as it can evaluate."""
WORTH_A_POOL = 400
"""For fewer images, starting worker processes takes longer than it saves."""
KILLED = "not read: the process that read it was killed, and again on the second try"


class Question(Struct, frozen=True, kw_only=True):
    """What to read from every image.

    Attributes:
        days: whether to read the date.
        list_all: whether to keep all names, however many there are.
    """

    days: bool = False
    list_all: bool = True


class Done(Struct, frozen=True):
    """Result of one piece of work, or of several that were merged by the engine.

    Attributes:
        count: number of images.
        part: metadata; None if the reading process was killed in both attempts.
        unit: the piece, if it is a single one.
    """

    count: int
    part: Accumulator | None
    unit: Unit | None


Read: TypeAlias = Callable[[Unit], Accumulator]
Engine: TypeAlias = Callable[[Read, Iterator[Unit]], Iterator[Done]]
"""Function that distributes pieces of work to processes or machines; it may reorder and merge them."""


class Reading(Struct, frozen=True, kw_only=True):
    """Result of reading images.

    Attributes:
        images: their metadata.
        lost: number of images that were not read because the reading process was killed in both attempts;
            they are included in those that cannot be read.
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
    """Read the metadata of images and keep all names.

    Args:
        paths: of the images.
        directory: folder that names are relative to.
        workers: processes; 0 for automatic, up to the number of cores.
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
    batch: int = BATCH,
    progress: Callable[[int], None] | None = None,
    stop_at_first: bool = False,
) -> Reading:
    """Read the headers of images.

    Args:
        images: the images; consumed lazily.
        question: what to read.
        engine: distributes the work.
        batch: number of images per piece.
        progress: called with the number of images read since the last call.
        stop_at_first: whether to stop after the first piece with an image that cannot be read.
    """
    total, lost = Accumulator(list_all=question.list_all), 0
    for done in engine(partial(read_unit, question=question), batches(images, batch)):
        part = done.part
        if part is None:
            lost += done.count
            part = _unread(done.unit, question)
        total.merge(part)
        if progress is not None:
            progress(done.count)
        if stop_at_first and total.has_unread:
            break
    return Reading(images=total, lost=lost)


def here(workers: int, *, known: int | None) -> Engine:
    """Make an engine of processes on this machine.

    Args:
        workers: number of processes; 0 for automatic, up to the number of cores.
        known: number of images, None for very many.
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
    from calibrary.workers import mapped_on  # noqa: PLC0415  multiprocessing, which few images do not need

    return mapped_on(read, units, workers, preload=[__name__])


def read_unit(unit: Unit, *, question: Question) -> Accumulator:
    """Read the images of a piece in this process."""
    part = Accumulator(list_all=question.list_all)
    read = partial(_read, days=question.days)
    near = [image for image in unit.images if not is_remote(image.place)]
    far = [image for image in unit.images if is_remote(image.place)]
    header = partial(read, pixels=False)
    for observation in _with_pixels(near, [*map(header, near)], read, map):
        part.add(observation)
    if far:
        from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415  for servers only

        # Threads wait for responses in parallel; their connections are kept for the next piece.
        with ThreadPoolExecutor(min(AT_ONCE, len(far))) as pool:
            for observation in _with_pixels(far, [*pool.map(header, far)], read, pool.map):
                part.add(observation)
    return part


def _with_pixels(
    images: Sequence[Image],
    found: list[Observation],
    read: Callable[..., Observation],
    mapped: Callable[..., Iterable[Observation]],
) -> list[Observation]:
    """Of images with equal headers that may be cropped, let the pixels of the first and the last decide.

    Decoding an image costs a hundred times as much as its header. Where the two differ, or show a crop, each is asked.
    """
    alike: dict[Seen, list[int]] = {}
    for number, one in enumerate(found):
        if one.seen is not None and may_be_cropped(one.seen.metadata):
            alike.setdefault(one.seen, []).append(number)
    for numbers in alike.values():
        ends = {read(images[number]).seen for number in (numbers[0], numbers[-1])}
        seen = ends.pop()
        if ends or seen is None or seen.metadata.whole_frame is False:
            asked = mapped(read, [images[number] for number in numbers])
        else:
            asked = (replace(found[number], seen=seen) for number in numbers)
        for number, one in zip(numbers, asked, strict=True):
            found[number] = one
    return found


def _read(image: Image, *, days: bool, pixels: bool = True) -> Observation:
    try:
        with open_place(image.place) as source:
            return observe(source, image, days=days, pixels=pixels)
    except (InputError, StoreError) as error:
        reason = error.message
    except OSError as error:
        reason = f"cannot be read: {error.strerror or error}"
    return Observation(id=image.id, name=image.name, reason=reason)


def _unread(unit: Unit | None, question: Question) -> Accumulator:
    part = Accumulator(list_all=question.list_all)
    for image in unit.images if unit is not None else ():
        part.add(Observation(id=image.id, name=image.name, reason=KILLED))
    return part


Future: TypeAlias = Any
"""Dask's Future; Dask declares no types."""

PIECE: Final = 10_000
"""Images per task: some seconds of work, compared with some milliseconds of overhead in the scheduler."""
MERGED: Final = 8
"""Number of results that one task merges."""
AHEAD: Final = 2
"""Tasks submitted in advance for each thread of the cluster."""
STALLED_S: Final = 3600.0
"""After this many seconds without a result the workers hang or are gone; a piece takes minutes at most."""


def _distributed() -> Any:
    """Import Dask, which is heavy, an extra, and untyped."""
    return import_module("distributed")


@contextmanager
def connected(cluster: str) -> Iterator[Engine]:
    """Context manager that gives an engine on a cluster.

    Args:
        cluster: address of its Dask scheduler, such as tcp://host:8786.

    Raises:
        MissingExtraError: Dask is not installed.
        InputError: no scheduler answers, or it has no workers.
    """
    require(["distributed"], "reading images on a cluster")
    with ExitStack() as stack:
        try:
            client = stack.enter_context(_distributed().Client(cluster, timeout="20s", set_as_default=False))
            client.wait_for_workers(1, timeout=60)
        except (OSError, ValueError) as error:
            raise InputError(f"no scheduler with workers answers: {error}", source=cluster) from None
        yield on_cluster(client)


def on_cluster(client: Any, *, merged: int = MERGED) -> Engine:
    """Make an engine on a connected cluster; ``merged`` results are merged before they are returned.

    If a worker dies, its task is repeated by another worker, up to the scheduler's ``allowed-failures`` (3).
    The scheduler counts the failure for every task that waited on that worker, so tasks that it gives up are
    tried once more, one at a time, to isolate the piece that kills the workers. If there are no more results,
    running tasks are cancelled and tried once more in the same way; if one hangs again, all remaining tasks
    are given up.
    """

    def engine(read: Read, units: Iterator[Unit]) -> Iterator[Done]:
        window = AHEAD * max(1, sum(client.nthreads().values()))
        under_way: dict[Future, bytes] = {}
        merges: dict[Future, list[tuple[Future, bytes]]] = {}
        waiting: list[tuple[Future, bytes]] = []
        given_up: list[bytes] = []
        stalled = threading.Event()
        ready = _distributed().as_completed(loop=client.loop)

        def submit(count: int) -> None:
            for unit in islice(units, 0 if stalled.is_set() else count):
                payload = unit.pickled()
                future = client.submit(_read_unit, read, payload, pure=False)
                under_way[future] = payload
                ready.add(future)

        submit(window)
        for future in _watched(ready, partial(_cancel, stalled, under_way, merges)):
            if future in merges:
                payloads = [payload for _, payload in merges.pop(future)]
                done = _answer(future, payloads)
                if done is not None:
                    yield done
                else:
                    given_up += payloads
            else:
                payload = under_way.pop(future)
                if future.status == "finished":
                    waiting.append((future, payload))
                else:
                    given_up.append(payload)
                submit(1)
            if len(waiting) >= merged or (waiting and not under_way):
                merge = client.submit(_merge, [one for one, _ in waiting], pure=False)
                merges[merge], waiting = waiting, []
                ready.add(merge)
        # If results stop, some tasks have not even started.
        given_up += (unit.pickled() for unit in units)
        yield from _alone(client, read, given_up, stalled)

    return engine


def _cancel(stalled: threading.Event, *tasks: Iterable[Future]) -> None:
    stalled.set()
    for future in [one for some in tasks for one in some]:
        future.cancel()


def _alone(client: Any, read: Read, given_up: Iterable[bytes], stalled: threading.Event) -> Iterator[Done]:
    """Yield the results of pieces read one at a time; if tasks stalled before, stop as soon as one hangs."""
    dead = False
    for payload in given_up:
        done = None
        if not dead:
            future = client.submit(_read_unit, read, payload, pure=False)
            try:
                future.exception(timeout=STALLED_S)
                done = _answer(future, [payload])
            except TimeoutError:
                dead = stalled.is_set()
                future.cancel()
        unit = Unit.unpickled(payload)
        yield done or Done(len(unit.images), None, unit)


def _watched(ready: Iterable[Future], cancel: Callable[[], None]) -> Iterator[Future]:
    """Yield tasks as they finish; calls ``cancel``, which ends them, if none finishes for :data:`STALLED_S`."""
    left = iter(ready)
    while True:
        timer = threading.Timer(STALLED_S, cancel)
        timer.daemon = True
        timer.start()
        try:
            future = next(left, None)
        finally:
            timer.cancel()
        if future is None:
            return
        yield future


def _answer(future: Future, payloads: Sequence[bytes]) -> Done | None:
    """The result of a task; None if its workers died."""
    if future.status != "finished":
        return None
    try:
        part = Accumulator.from_bytes(future.result(timeout=STALLED_S))
    except OSError:
        # The worker with the result has just died, and the result is not recomputed in time.
        return None
    units = [Unit.unpickled(payload) for payload in payloads]
    return Done(sum(len(unit.images) for unit in units), part, units[0] if len(units) == 1 else None)


def _read_unit(read: Read, payload: bytes) -> bytes:
    return read(Unit.unpickled(payload)).to_bytes()


def _merge(parts: Sequence[bytes]) -> bytes:
    if len(parts) == 1:
        return parts[0]
    total = Accumulator.from_bytes(parts[0])
    for part in parts[1:]:
        total.merge(Accumulator.from_bytes(part))
    return total.to_bytes()
