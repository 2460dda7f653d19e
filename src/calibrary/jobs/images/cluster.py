"""The same reading on a cluster: Dask's scheduler spreads the pieces, and merges what they say on the way back.

Nothing in here knows what an image says: any engine that maps a function over pieces and folds the answers with an
associative, commutative and idempotent merge does the same (docs/scale.md has Ray and Spark).
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
from calibrary.jobs.images.reading import Done, Engine, Read
from calibrary.jobs.images.units import Unit

Future: TypeAlias = Any
"""Of Dask, which declares no types."""

__all__ = ["MERGED", "PIECE", "connected", "on_cluster"]

PIECE: Final = 10_000
"""Images of one task: some seconds of work, against some milliseconds that a task costs the scheduler."""
MERGED: Final = 8
"""Answers that one task merges."""
AHEAD: Final = 2
"""Tasks that are handed out for each thread of the cluster."""
STALLED_S: Final = 3600.0
"""Where nothing comes back for so long, the workers hang, or none comes up any more; a piece takes minutes at most."""
_LOCAL = re.compile(r"local:([1-9][0-9]{0,2})")


def _distributed() -> Any:
    """Dask: heavy, an extra, and without types."""
    return import_module("distributed")


@contextmanager
def connected(
    scheduler: str | None = None, cluster: str | None = None, *, merged: int = MERGED
) -> Iterator[Engine]:
    """An engine on a cluster for the length of the block.

    Args:
        scheduler: address of a running one, as tcp://host:8786.
        cluster: "local:4" starts so many processes on this machine instead.
        merged: answers that travel back as one; 1 where each is kept by itself.

    Raises:
        MissingExtraError: Dask is not installed.
        InputError: no scheduler answers, it has no workers, or ``cluster`` is not of this form.
    """
    require(["distributed"], "reading images on a cluster")
    distributed = _distributed()

    with ExitStack() as stack:
        target: Any = scheduler
        if cluster is not None:
            size = _LOCAL.fullmatch(cluster)
            if size is None:
                raise InputError(f"{cluster!r}: expected local:N, such as local:4", place="--cluster")
            # Where no worker comes back, what waits for one ends, instead of waiting for ever.
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
    """An engine on a cluster that is connected; ``merged`` answers travel back as one.

    A task whose worker dies is done again by another one, as often as the scheduler's ``allowed-failures`` says (3).
    The scheduler blames every task that waited on that worker: what it gives up is tried once more, one at a time, so
    that the piece which kills its workers takes no other along. Where nothing comes back any more, what is under way
    is cancelled, tried once more in the same way, and all that is left is given up when that hangs as well.
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
        # Where nothing comes back any more, some are not even begun.
        given_up += (unit.pickled() for unit in units)
        yield from _alone(client, read, given_up, stalled)

    return engine


def _cancel(stalled: threading.Event, *tasks: Iterable[Future]) -> None:
    stalled.set()
    for future in [one for some in tasks for one in some]:
        future.cancel()


def _alone(client: Any, read: Read, given_up: Iterable[bytes], stalled: threading.Event) -> Iterator[Done]:
    """What comes of pieces one at a time; where things stalled before, nothing more is tried once one hangs."""
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
    """Tasks as they end; ``cancel``, by which they end too, is called where none does for :data:`STALLED_S`."""
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
    """What came back from some pieces; None where their workers died."""
    if future.status != "finished":
        return None
    try:
        part = Accumulator.from_bytes(future.result(timeout=STALLED_S))
    except OSError:
        # The worker that held the answer died just now, and it is not computed again in time.
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
