"""Processes that share a job's work, and what each of them owes the command that started it."""

from __future__ import annotations

import logging
import multiprocessing
import multiprocessing.resource_tracker
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

from calibrary.interrupts import held

__all__ = ["deaf_to_ctrl_c", "end_with_parent", "get_ready", "mapped", "mapped_on"]

AHEAD = 4
"""Items that are handed out for each process, so that none waits for the next."""

log = logging.getLogger("calibrary")

Item = TypeVar("Item")
Result = TypeVar("Result")


def end_with_parent() -> None:
    """End this worker when the command that wants its answers is gone; else it would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def get_ready(preload: Sequence[str]) -> None:
    """Start the process that workers are forked from: it loads modules while this one does something else.

    Args:
        preload: as for :func:`mapped`, which starts it itself where this was not called.
    """
    if "forkserver" in multiprocessing.get_all_start_methods():
        from multiprocessing.forkserver import ensure_running  # noqa: PLC0415  not on every system

        multiprocessing.get_context("forkserver").set_forkserver_preload([*preload])
        with held(), deaf_to_ctrl_c():
            ensure_running()


def mapped(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    *,
    preload: Sequence[str],
    begin: Callable[[], None] = end_with_parent,
) -> Iterator[Result]:
    """What ``work`` makes of each item, in their order, by several processes.

    Whatever ends the iteration early, an exception, a signal or a caller that wants no more, ends the processes
    at once: they only read, or write what is thrown away.

    Args:
        work: a function that other processes can import.
        items: what it is called with.
        workers: how many processes.
        preload: modules that are loaded once, before the processes part.
        begin: called first in each process.

    Raises:
        BrokenProcessPool: a process was ended from outside.
    """
    with _pool(min(workers, len(items)), preload, begin) as pool:
        # Interrupted on its way, a process would begin after all, when what it shares with us has gone.
        with held(), deaf_to_ctrl_c():
            results = pool.map(work, items)
        yield from results


def mapped_on(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    *,
    preload: Sequence[str],
    begin: Callable[[], None] = end_with_parent,
) -> Iterator[tuple[Item, Result | None]]:
    """The same for any number of items, which outlives the death of a process.

    Few items are taken before their turn. Whatever was under way when a process was killed is tried again, each
    item by a process of its own, so that the one that kills it takes no other along.

    Yields:
        each item with its result, in their order; with None where its process was killed twice.
    """
    left = iter(items)
    waiting: deque[Item] = deque()
    while waiting or (waiting := deque(islice(left, AHEAD * workers))):
        try:
            with _pool(workers, preload, begin) as pool:
                under_way = deque(_submitted(pool, work, item) for item in waiting)
                while under_way:
                    result = under_way[0].result()
                    yield waiting[0], result
                    under_way.popleft()
                    waiting.popleft()
                    for item in islice(left, 1):
                        waiting.append(item)
                        under_way.append(_submitted(pool, work, item))
        except BrokenProcessPool:
            log.warning("a process was ended from outside, as when memory runs out; its work is tried again")
            while waiting:
                yield waiting[0], _alone(work, waiting[0], preload, begin)
                waiting.popleft()


def _alone(
    work: Callable[[Item], Result], item: Item, preload: Sequence[str], begin: Callable[[], None]
) -> Result | None:
    """What a process of its own makes of one item; None where that is killed."""
    try:
        with _pool(1, preload, begin) as pool:
            return _submitted(pool, work, item).result()
    except BrokenProcessPool:
        return None


def _submitted(pool: ProcessPoolExecutor, work: Callable[[Item], Result], item: Item) -> Future[Result]:
    with held(), deaf_to_ctrl_c():
        return pool.submit(work, item)


@contextmanager
def _pool(workers: int, preload: Sequence[str], begin: Callable[[], None]) -> Iterator[ProcessPoolExecutor]:
    """Processes that end at once when what they are for ends early."""
    # A forked worker would inherit the threads of whoever draws the progress bar.
    method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([*preload])
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=begin)
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Processes started here never hear a terminal's Ctrl-C, which is for the command that started them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # It is started with the first process and would, in doing so, let the signals through again.
    multiprocessing.resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
