"""Processes that share a job's work, and what each of them owes the command that started it."""

from __future__ import annotations

import multiprocessing
import multiprocessing.resource_tracker
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from calibrary.interrupts import held

__all__ = ["end_with_parent", "mapped"]

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
    # A forked worker would inherit the threads of whoever draws the progress bar.
    method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([*preload])
    pool = ProcessPoolExecutor(min(workers, len(items)), mp_context=context, initializer=begin)
    try:
        # Interrupted on its way, a process would begin after all, when what it shares with us has gone.
        with held(), _deaf_to_ctrl_c():
            results = pool.map(work, items)
        yield from results
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
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
