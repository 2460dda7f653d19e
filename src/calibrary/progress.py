"""How long work reports how far it is, and how long its parts took: one way everywhere."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

__all__ = ["Progress", "counted", "labelled", "log", "stage"]

log = logging.getLogger("calibrary")
"""What is skipped, tried again or took long; the command line shows it with --verbose."""

Progress: TypeAlias = Callable[[int, int, str], None]
"""Called with (done, total, what): how many of how many, and of what, as "images"."""


def counted(progress: Progress | None, total: int, what: str) -> Callable[[int], None] | None:
    """From work that says "so many more" to a caller who wants "so many of so many".

    Args:
        progress: whom to tell, first of all that nothing is done yet; None if the caller does not ask.
        total: how many there are.
        what: of what.
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
    """From work that counts one kind of thing, and does not say which, to a caller who wants to know of what."""
    return (lambda done, total: progress(done, total, what)) if progress is not None else None


@contextmanager
def stage(what: str) -> Iterator[None]:
    """Log how long a part of the work took, even if it failed."""
    start = time.perf_counter()
    try:
        yield
    finally:
        log.info("%s: %.2f s", what, time.perf_counter() - start)
