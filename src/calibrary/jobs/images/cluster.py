"""The same reading on a cluster: Dask's scheduler spreads the pieces, and merges what they say on the way back.

Nothing in here knows what an image says: any engine that maps a function over pieces and folds the answers with an
associative, commutative and idempotent merge does the same (docs/scale.md has Ray and Spark).
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
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
    that the piece which kills its workers takes no other along.
    """

    def engine(read: Read, units: Iterator[Unit]) -> Iterator[Done]:
        window = AHEAD * max(1, sum(client.nthreads().values()))
        under_way: dict[Future, bytes] = {}
        merges: dict[Future, list[tuple[Future, bytes]]] = {}
        waiting: list[tuple[Future, bytes]] = []
        given_up: list[bytes] = []
        ready = _distributed().as_completed(loop=client.loop)

        def submit(count: int) -> None:
            for unit in islice(units, count):
                payload = unit.pickled()
                future = client.submit(_read, read, payload, pure=False)
                under_way[future] = payload
                ready.add(future)

        submit(window)
        for future in ready:
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
        for payload in given_up:
            alone = client.submit(_read, read, payload, pure=False)
            alone.exception()
            unit = Unit.unpickled(payload)
            yield _answer(alone, [payload]) or Done(len(unit.images), None, unit)

    return engine


def _answer(future: Future, payloads: Sequence[bytes]) -> Done | None:
    """What came back from some pieces; None where their workers died."""
    if future.status != "finished":
        return None
    try:
        part = Accumulator.from_bytes(future.result())
    except OSError:
        # The worker that held the answer died just now.
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
