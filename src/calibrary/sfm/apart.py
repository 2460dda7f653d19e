"""A process of its own for COLMAP: its log stays off the terminal, and Ctrl-C ends it without a stack trace."""

from __future__ import annotations

import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Concatenate, Final, ParamSpec, TypeVar

from msgspec import Struct

from calibrary.errors import CalibraryError, CalibrationError
from calibrary.progress import Progress, log
from calibrary.workers import deaf_to_ctrl_c

__all__ = ["run_apart"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

GLOG_PREFIX = re.compile(r"^[IWEF]\d{8} \S+\s+\d+ [\w.]+:\d+\] ")
"""Severity, time, thread and line of source: what glog writes before what it has to say."""

BEGIN: Final = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from calibrary.sfm.apart import answer; answer()"
)
"""The process's program. Unlike multiprocessing it does not run the caller's main module again, which a script without
``if __name__ == "__main__"`` does not survive."""

ATTEMPTS: Final = 2

STACK = ("    @ ", "*** ", "PC: @")
"""How glog begins the lines of a stack trace, which names no cause."""


class _Step(Struct, frozen=True):
    """So far is the work."""

    done: int
    total: int
    what: str


class _Done(Struct, frozen=True):
    """What the work returned."""

    result: object


class _Died(Struct, frozen=True):
    """The process ended without an answer.

    Attributes:
        how: by which signal, or with which status.
        last: what it wrote last.
    """

    how: str
    last: str


def run_apart(
    work: Callable[Concatenate[Progress, Arguments], Result],
    progress: Progress | None,
    *args: Arguments.args,
    **kwargs: Arguments.kwargs,
) -> Result:
    """What ``work(report, …)`` returns, computed by a process of its own.

    Whatever ends the wait early, Ctrl-C or an exception of ``progress``, ends that process at once: what it writes
    belongs into a temporary folder of the caller's. A process that dies is started once more, with a warning.

    Args:
        work: a function that another process can import, and that can begin again where it was cut off; its first
            argument is a callback like ``progress``.
        progress: called with (done, total, what).
        *args: for ``work``; they and its result have to be picklable.
        **kwargs: the same.

    Raises:
        CalibraryError: ``work`` raised it.
        CalibrationError: the process died twice, or failed inside COLMAP.
    """
    asked = pickle.dumps([*sys.path]) + pickle.dumps((work, args, kwargs))
    for attempt in range(1, ATTEMPTS + 1):
        answer = _once(asked, progress)
        if not isinstance(answer, _Died):
            break
        if attempt < ATTEMPTS:
            log.warning("COLMAP's process %s; it is started once more", answer.how)
    if isinstance(answer, _Done):
        return answer.result  # type: ignore[return-value]  # what ``work`` returned, through a pipe
    if isinstance(answer, _Died):
        reason = f"its process {answer.how} {ATTEMPTS} times; last it wrote: {answer.last}"
        raise CalibrationError(f"COLMAP failed on these images: {reason}")
    raise answer


def _once(asked: bytes, progress: Progress | None) -> _Done | _Died | CalibraryError:
    with tempfile.TemporaryDirectory(prefix="calibrary-") as folder:
        said = Path(folder) / "stderr"
        with deaf_to_ctrl_c(), said.open("wb") as log_file:
            process = subprocess.Popen(  # noqa: S603  Python itself
                [sys.executable, "-c", BEGIN],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log_file,
                env={**os.environ, "GLOG_log_dir": folder},
            )
        assert process.stdin is not None  # noqa: S101  both are pipes
        assert process.stdout is not None  # noqa: S101
        try:
            with suppress(BrokenPipeError):
                process.stdin.write(asked)
                process.stdin.flush()
            answer = _awaited(process.stdout, progress)
            status = process.wait() if answer is None else 0
        finally:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                with suppress(BrokenPipeError):
                    pipe.close()
        lines = said.read_text(errors="replace")
        log.debug("%s", lines)
        return answer or _Died(how=_how(status), last=_last_words(lines))


def _awaited(pipe: IO[bytes], progress: Progress | None) -> _Done | CalibraryError | None:
    """What the process answers in the end; None where it ended without an answer."""
    while True:
        try:
            message = pickle.load(pipe)  # noqa: S301  our own process wrote it
        except (EOFError, pickle.UnpicklingError):
            return None
        if not isinstance(message, _Step):
            return message  # type: ignore[no-any-return]  # answer() sends nothing else
        if progress is not None:
            progress(message.done, message.total, message.what)


def _how(status: int) -> str:
    if status < 0:
        return f"was ended by {signal.Signals(-status).name}"
    return f"ended without an answer (status {status})"


def _last_words(said: str) -> str:
    lines = [line for line in said.splitlines() if line.strip() and not line.startswith(STACK)]
    fatal = next((line for line in lines if line.startswith("F") and GLOG_PREFIX.match(line)), None)
    return GLOG_PREFIX.sub("", fatal or next(reversed(lines), "nothing"))


def answer() -> None:
    """The process: what it is asked comes by standard input; standard output and error go into a file from here on."""
    work, args, kwargs = pickle.load(sys.stdin.buffer)  # noqa: S301  our own process wrote it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)

    def send(message: object) -> None:
        data = pickle.dumps(message)
        replies.write(data)
        replies.flush()

    try:
        send(_Done(work(lambda *step: send(_Step(*step)), *args, **kwargs)))
    except CalibraryError as error:
        send(error)
    except Exception as error:  # noqa: BLE001  the parent decides what it means
        send(CalibrationError(f"COLMAP failed on these images: {error}"))


def _end_with_parent() -> None:
    """Standard input ends when the process that wants the answer is gone."""
    while os.read(0, 1):
        pass
    os._exit(1)
