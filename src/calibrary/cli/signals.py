"""Ctrl-C and SIGTERM: the work is unwound once, then the command exits with 128 + the signal number."""

from __future__ import annotations

import os
import signal
import threading
import time
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
PARENT = "CALIBRARY_PARENT"
"""Process without which a command has nobody to work for, as the desk states it to those that it starts."""


class Interrupted(KeyboardInterrupt):
    """Raised when the signal of this number asks the command to end."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def listen() -> None:
    """Raise :class:`Interrupted` at the first of these signals; later ones are ignored during the unwinding."""
    for number in SIGNALS:
        # A command started with a signal ignored, as by nohup, continues to ignore it.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    # Not for the hooks of git, which are children of another process.
    if parent := os.environ.pop(PARENT, None):
        threading.Thread(target=_end_after, args=(int(parent),), daemon=True).start()


def stop_listening() -> None:
    """Ignore the signals, because the result is complete and the process is about to end."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def exit_code(error: KeyboardInterrupt) -> int:
    """Exit code that a shell reports for a command ended by a signal."""
    return 128 + (error.number if isinstance(error, Interrupted) else signal.SIGINT)


def _interrupt(number: int, _frame: FrameType | None) -> None:
    stop_listening()
    raise Interrupted(number)


def _end_after(parent: int) -> None:
    """End this process as SIGTERM does once its parent is gone, whose terminal may have been closed."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os.kill(os.getpid(), signal.SIGTERM)
