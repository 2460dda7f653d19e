"""Progress reports and timing of long work."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

log = logging.getLogger("calibrary")
"""Logs what is skipped, retried or slow; the command line shows it with --verbose."""

Progress: TypeAlias = Callable[[int, int, str], None]
"""Called with (done, total, what): the count so far, the total, and the kind of item, such as "images"."""


def counted(progress: Progress | None, total: int, what: str) -> Callable[[int], None] | None:
    """Return a function that adds to a count and reports the total progress.

    Args:
        progress: callback, first called with a count of 0; None if no progress is wanted.
        total: number of items.
        what: kind of item.
    """
    if progress is None:
        return None
    done = 0
    progress(done, total, what)

    def advance(more: int) -> None:
        nonlocal done
        done += more
        progress(done, total, what)

    return advance


def labelled(progress: Progress | None, what: str) -> Callable[[int, int], None] | None:
    """Return a (done, total) callback that adds the kind of item to each report."""
    return (lambda done, total: progress(done, total, what)) if progress is not None else None


@contextmanager
def stage(what: str) -> Iterator[None]:
    """Log the duration of a block, even if it fails."""
    start = time.perf_counter()
    try:
        yield
    finally:
        log.info("%s: %.2f s", what, time.perf_counter() - start)
