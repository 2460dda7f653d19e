"""Reading of images on a cluster: Dask's scheduler distributes the pieces of work and merges their results.

This module is independent of the image metadata. Any engine that maps a function over pieces and reduces the
results with an associative, commutative and idempotent merge can be used instead (docs/scale.md shows Ray and
Spark).
"""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from itertools import islice
from typing import Any, Final, TypeAlias

from calibrary.errors import InputError
from calibrary.extras import require
from calibrary.jobs.images.accumulator import Accumulator
from calibrary.jobs.images.reading import Done, Engine, Read, Unit

Future: TypeAlias = Any
"""Dask's Future; Dask declares no types."""

__all__ = ["MERGED", "PIECE", "connected", "on_cluster"]

PIECE: Final = 10_000
"""Images per task: some seconds of work, compared with some milliseconds of overhead in the scheduler."""
MERGED: Final = 8
"""Number of results that one task merges."""
AHEAD: Final = 2
"""Tasks submitted in advance for each thread of the cluster."""
STALLED_S: Final = 3600.0
"""After this many seconds without a result the workers hang or are gone; a piece takes minutes at most."""
_LOCAL = re.compile(r"local:([1-9][0-9]{0,2})")


def _distributed() -> Any:
    """Import Dask, which is heavy, an extra, and untyped."""
    return import_module("distributed")


@contextmanager
def connected(
    scheduler: str | None = None, cluster: str | None = None, *, merged: int = MERGED
) -> Iterator[Engine]:
    """Context manager that gives an engine on a cluster.

    Args:
        scheduler: address of a running scheduler, such as tcp://host:8786.
        cluster: "local:4" to start 4 processes on this machine instead.
        merged: number of results merged before they are returned; 1 if each is kept separately.

    Raises:
        MissingExtraError: Dask is not installed.
        InputError: no scheduler answers, it has no workers, or ``cluster`` has another form.
    """
    require(["distributed"], "reading images on a cluster")
    distributed = _distributed()

    with ExitStack() as stack:
        target: Any = scheduler
        if cluster is not None:
            size = _LOCAL.fullmatch(cluster)
            if size is None:
                raise InputError(f"{cluster!r}: expected local:N, such as local:4", place="--cluster")
            # If no worker comes back, waiting tasks end instead of waiting for ever.
            stack.enter_context(
                import_module("dask").config.set({"distributed.scheduler.no-workers-timeout": "5 minutes"})
            )
            target = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=int(size[1]),
                    threads_per_worker=1,
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                )
            )
        try:
            client = stack.enter_context(distributed.Client(target, timeout="20s", set_as_default=False))
            client.wait_for_workers(1, timeout=60)
        except (OSError, ValueError) as error:
            raise InputError(f"no scheduler with workers answers: {error}", source=scheduler) from None
        yield on_cluster(client, merged=merged)


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
                future = client.submit(_read, read, payload, pure=False)
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
            future = client.submit(_read, read, payload, pure=False)
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


def _read(read: Read, payload: bytes) -> bytes:
    return read(Unit.unpickled(payload)).to_bytes()


def _merge(parts: Sequence[bytes]) -> bytes:
    if len(parts) == 1:
        return parts[0]
    total = Accumulator.from_bytes(parts[0])
    for part in parts[1:]:
        total.merge(Accumulator.from_bytes(part))
    return total.to_bytes()
