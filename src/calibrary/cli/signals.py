"""Ctrl-C and SIGTERM: the work is unwound once, then the command ends with 128 and the signal's number."""

from __future__ import annotations

import signal
from types import FrameType

__all__ = ["Interrupted", "exit_code", "listen", "stop_listening"]

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """A signal asked the command to end.

    Attributes:
        number: the signal's.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def listen() -> None:
    """Raise :class:`Interrupted` at the first of these signals; further ones do not disturb the unwinding."""
    for number in SIGNALS:
        # A command that was started to ignore a signal, as by nohup, goes on ignoring it.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def stop_listening() -> None:
    """Ignore the signals: the result is there, and the process is about to end."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def exit_code(error: KeyboardInterrupt) -> int:
    """What the shell gives a command that a signal ended."""
    return 128 + (error.number if isinstance(error, Interrupted) else signal.SIGINT)


def _interrupt(number: int, _frame: FrameType | None) -> None:
    stop_listening()
    raise Interrupted(number)
