"""Deferring Ctrl-C and SIGTERM during steps that must not be interrupted."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupts_held() -> Iterator[Sequence[int]]:
    """Defer SIGINT and SIGTERM until the block has ended; gives the list of those that arrived meanwhile.

    Masking the signals for this thread is not enough: another thread, such as one of a BLAS library, would receive
    them, and Python would run the handler here. Only the main thread runs handlers, so other threads are unaffected.
    """
    if threading.current_thread() is not threading.main_thread():
        yield ()
        return
    arrived: list[int] = []

    def remember(number: int, _frame: FrameType | None) -> None:
        arrived.append(number)

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    heard = {n: handler for n, handler in before.items() if handler not in {signal.SIG_IGN, None}}
    for number in heard:
        signal.signal(number, remember)
    try:
        yield arrived
    finally:
        for number, handler in heard.items():
            signal.signal(number, handler)
        if arrived:
            signal.raise_signal(arrived[0])
