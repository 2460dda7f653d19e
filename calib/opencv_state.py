"""What OpenCV keeps for the whole process, changed for a while: its threads and its log."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["one_thread", "quiet"]


@contextmanager
def one_thread() -> Iterator[None]:
    """Have OpenCV use one thread, for with several some of its results depend on how many there are."""
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep OpenCV from logging every odd tag of a TIFF to standard error; what matters comes back as an error."""
    from cv2.utils import logging

    before = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(before)
