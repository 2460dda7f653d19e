"""What OpenCV keeps for the whole process, changed for a while: its threads and its log."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["one_thread", "quiet"]

SILENT = 0


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
    import cv2

    # OpenCV 5 has moved these functions.
    logging = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    before = logging.getLogLevel()
    logging.setLogLevel(SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(before)
