"""Run COLMAP in a separate process: its log does not reach the terminal, and Ctrl-C ends it without a stack trace."""

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

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

GLOG_PREFIX = re.compile(r"^[IWEF]\d{8} \S+\s+\d+ [\w.]+:\d+\] ")
"""Prefix of glog's lines: severity, time, thread and source line."""

BEGIN: Final = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from calibrary.sfm.colmap_process import answer; answer()"
)
"""Program of the process. Unlike multiprocessing it does not run the caller's main module again, which would fail for a
script without ``if __name__ == "__main__"``."""

ATTEMPTS: Final = 2

STACK = ("    @ ", "*** ", "PC: @")
"""Beginnings of the lines of glog's stack traces, which do not name a cause."""


class _Step(Struct, frozen=True):
    """Progress of the work."""

    done: int
    total: int
    what: str


class _Done(Struct, frozen=True):
    """Result of the work."""

    result: object


class _Died(Struct, frozen=True):
    """The process ended without an answer.

    Attributes:
        how: the signal or exit status, in words.
        last: its last message.
    """

    how: str
    last: str


def run_apart(
    work: Callable[Concatenate[Progress, Arguments], Result],
    progress: Progress | None,
    *args: Arguments.args,
    **kwargs: Arguments.kwargs,
) -> Result:
    """Run ``work(report, …)`` in a separate process and return its result.

    Ctrl-C or an exception of ``progress`` ends the process at once, so it should write only to a temporary folder of
    the caller. A process that dies is started once more, with a warning.

    Args:
        work: a function that another process can import and that can be started again after an interruption; its
            first argument is a callback like ``progress``.
        progress: called with (done, total, what).
        *args: for ``work``; they and the result must be picklable.
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
    """Wait for the final answer of the process, reporting progress; None if it ended without an answer."""
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
    """Run the work in the process: reads the task from standard input and sends the answer to the original stdout.

    Standard output is redirected to standard error, which goes to a file.
    """
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
    """End this process when standard input closes, that is, when the parent process has ended."""
    while os.read(0, 1):
        pass
    os._exit(1)
