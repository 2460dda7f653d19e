"""Worker processes for a job."""

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

from calibrary.errors import InputError
from calibrary.interrupts import interrupts_held

AHEAD = 4
"""Items submitted ahead per process, so that no process waits for work."""

log = logging.getLogger("calibrary")

Item = TypeVar("Item")
Result = TypeVar("Result")


def end_with_parent() -> None:
    """End this worker when its parent process has ended; otherwise it would wait forever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def get_ready(preload: Sequence[str]) -> None:
    """Start the process that workers are forked from, so that it loads modules while this process continues.

    Args:
        preload: as for :func:`mapped`, which starts that process if this function was not called.
    """
    if "forkserver" in multiprocessing.get_all_start_methods():
        from multiprocessing.forkserver import ensure_running  # noqa: PLC0415  not on every system

        multiprocessing.get_context("forkserver").set_forkserver_preload([*preload])
        with interrupts_held(), deaf_to_ctrl_c():
            ensure_running()


def mapped(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    *,
    preload: Sequence[str],
    does: str,
    begin: Callable[[], None] = end_with_parent,
) -> Iterator[Result]:
    """Yield ``work(item)`` for each item, in order, computed by several processes; of one item or worker, by this one.

    If the iteration ends early, by an exception, a signal or the caller, the processes are killed at once: they only
    read, or write temporary data.

    Args:
        work: a function that other processes can import.
        items: its arguments.
        workers: number of processes.
        preload: modules that are loaded once, before the processes are forked.
        does: what a process does, for the message of the error.
        begin: called first in each process.

    Raises:
        InputError: a process was killed from outside.
    """
    if workers <= 1 or len(items) <= 1:
        yield from map(work, items)
        return
    try:
        with _pool(min(workers, len(items)), preload, begin) as pool:
            # Interrupted during its start, a process would still start later, without the resources shared with this.
            with interrupts_held(), deaf_to_ctrl_c():
                under_way = deque(pool.submit(work, item) for item in items)
            # Not pool.map, which cancels what is left: for that Python 3.11 prints a traceback when its pool is killed.
            while under_way:
                yield under_way.popleft().result()
    except BrokenProcessPool:
        raise InputError(
            f"a process that {does} was ended from outside, as when memory runs out; use --workers 1"
        ) from None


def mapped_on(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    *,
    preload: Sequence[str],
) -> Iterator[tuple[Item, Result | None]]:
    """Yield (item, ``work(item)``) for any number of items; survives the death of a process.

    Only a few items are taken ahead. If a process is killed, each item that was being processed is tried again in a
    process of its own, so that an item that kills its process does not affect others.

    Yields:
        Each item with its result, in order; with None if its process was killed twice.
    """
    left = iter(items)
    waiting: deque[Item] = deque()
    while waiting or (waiting := deque(islice(left, AHEAD * workers))):
        try:
            with _pool(workers, preload) as pool:
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
                yield waiting[0], _alone(work, waiting[0], preload)
                waiting.popleft()


def _alone(work: Callable[[Item], Result], item: Item, preload: Sequence[str]) -> Result | None:
    """Process one item in a process of its own; return None if that process is killed."""
    try:
        with _pool(1, preload) as pool:
            return _submitted(pool, work, item).result()
    except BrokenProcessPool:
        return None


def _submitted(pool: ProcessPoolExecutor, work: Callable[[Item], Result], item: Item) -> Future[Result]:
    with interrupts_held(), deaf_to_ctrl_c():
        return pool.submit(work, item)


@contextmanager
def _pool(
    workers: int, preload: Sequence[str], begin: Callable[[], None] = end_with_parent
) -> Iterator[ProcessPoolExecutor]:
    """Provide a process pool; its processes are killed at once if the block ends early."""
    # "fork" would copy the threads of the progress bar into the worker.
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
        # One that was killed as it sent its result leaves half of it, for whose end the pool's thread waits while
        # anyone could still write it.
        if pool._result_queue is not None:
            pool._result_queue._writer.close()  # type: ignore[attr-defined]
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Block SIGINT in processes started here: the terminal's Ctrl-C is for the command that started them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # The resource tracker starts with the first process and would unblock the signals; so start it first.
    multiprocessing.resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
