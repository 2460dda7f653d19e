"""A process of its own for COLMAP: its log stays off the terminal, and Ctrl-C ends it without a stack trace."""

from __future__ import annotations

import multiprocessing
import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from calibrary.errors import CalibraryError, CalibrationError
from calibrary.progress import Progress, log
from calibrary.workers import deaf_to_ctrl_c, end_with_parent

__all__ = ["run_apart"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

GLOG_PREFIX = re.compile(r"^[IWEF]\d{8} \S+\s+\d+ [\w.]+:\d+\] ")
"""Severity, time, thread and line of source: what glog writes before what it has to say."""

STACK = ("    @ ", "*** ", "PC: @")
"""How glog begins the lines of a stack trace, which names no cause."""


@dataclass(frozen=True, slots=True)
class _Step:
    """So far is the work."""

    done: int
    total: int
    what: str


@dataclass(frozen=True, slots=True)
class _Done:
    """What the work returned."""

    result: object


def run_apart(
    work: Callable[Concatenate[Progress, Arguments], Result],
    progress: Progress | None,
    *args: Arguments.args,
    **kwargs: Arguments.kwargs,
) -> Result:
    """What ``work(report, …)`` returns, computed by a process of its own.

    Whatever ends the wait early, Ctrl-C or an exception of ``progress``, ends that process at once: what it writes
    belongs into a temporary folder of the caller's.

    Args:
        work: a function that another process can import; its first argument is a callback like ``progress``.
        progress: called with (done, total, what).
        *args: for ``work``; they and its result have to be picklable.
        **kwargs: the same.

    Raises:
        CalibraryError: ``work`` raised it.
        CalibrationError: the process ended without an answer, or failed inside COLMAP.
    """
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="calibrary-") as folder:
        said = Path(folder) / "stderr"
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_answer, args=(theirs, said, work, args, kwargs), daemon=True)
        with deaf_to_ctrl_c():
            process.start()
        theirs.close()
        try:
            answer = _awaited(ours, progress)
        finally:
            process.kill()
            process.join()
            ours.close()
        log.debug("%s", said.read_text(errors="replace") if said.exists() else "")
        if isinstance(answer, _Done):
            return answer.result  # type: ignore[return-value]  # what ``work`` returned, through a pipe
        raise answer if isinstance(answer, CalibraryError) else CalibrationError(_crash(answer, said))


def _awaited(connection: Connection, progress: Progress | None) -> _Done | BaseException | None:
    """What the process answers in the end; None where it ended without an answer."""
    while True:
        try:
            message = connection.recv()
        except EOFError:
            return None
        if not isinstance(message, _Step):
            return message  # type: ignore[no-any-return]  # _answer sends nothing else
        if progress is not None:
            progress(message.done, message.total, message.what)


def _crash(error: BaseException | None, said: Path) -> str:
    lines = said.read_text(errors="replace").splitlines() if said.exists() else []
    told = [line for line in lines if line.strip() and not line.startswith(STACK)]
    fatal = next((line for line in told if line.startswith("F") and GLOG_PREFIX.match(line)), None)
    last = GLOG_PREFIX.sub("", fatal or next(reversed(told), "it said nothing"))
    reason = (
        str(error) if error is not None else f"its process ended without an answer; last it wrote: {last}"
    )
    return f"COLMAP failed on these images: {reason}"


def _answer(
    connection: Connection,
    said: Path,
    work: Callable[..., object],
    args: tuple[object, ...],
    kwargs: dict[str, object],
) -> None:
    """The process: standard output and error go into a file, whatever writes to them."""
    end_with_parent()
    output = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    os.dup2(output, 1)
    os.dup2(output, 2)

    def report(done: int, total: int, what: str) -> None:
        connection.send(_Step(done, total, what))

    try:
        connection.send(_Done(work(report, *args, **kwargs)))
    except Exception as error:  # noqa: BLE001  the parent decides what it means
        connection.send(error if isinstance(error, CalibraryError) else CalibrationError(str(error)))
