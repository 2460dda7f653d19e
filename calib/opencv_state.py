"""Temporary changes of OpenCV's process-wide state: number of threads and log level."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["one_thread", "quiet"]

SILENT = 0


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
