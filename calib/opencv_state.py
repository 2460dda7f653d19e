"""Temporary changes of process-wide state: OpenCV's number of threads and log level, and BLAS's number of threads."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

SILENT = 0

_lock = threading.Lock()
_running = 0
_limit: Any = None


@contextmanager
def one_thread() -> Iterator[None]:
    """Make OpenCV use one thread; some results depend on the number of threads."""
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress OpenCV's log messages about unusual TIFF tags; real problems are returned as errors."""
    import cv2

    # OpenCV 5 moved these functions.
    logging = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    before = logging.getLogLevel()
    logging.setLogLevel(SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(before)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit NumPy's BLAS to one thread while a solve runs; where threadpoolctl is not installed nothing is.

    The matrices of a solve are small, and more threads only wait for one another.

    Solves in several threads share one limit, which the last of them lifts: each by itself would restore what another
    one had set.
    """
    global _running, _limit  # noqa: PLW0603  the limit is one of the process
    with _lock:
        if _running == 0 and find_spec("threadpoolctl") is not None:
            from threadpoolctl import threadpool_limits

            _limit = threadpool_limits(limits=1, user_api="blas")
        _running += 1
    try:
        yield
    finally:
        with _lock:
            _running -= 1
            if _running == 0 and _limit is not None:
                _limit.restore_original_limits()
                _limit = None
