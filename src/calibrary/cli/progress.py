"""Progress bar for work that takes longer than a second; on a terminal only.

A program that runs a command gets lines in its place, on standard error, if it sets CALIBRARY_PROGRESS=lines:
``progress DONE TOTAL WHAT``.
"""

from __future__ import annotations

import os
import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

SHOWN_AFTER_S = 1.0
LINE_EVERY_S = 0.2


class Bar:
    """Progress bar, called with the number done, the total and the unit; not drawn for short work."""

    def __init__(self, console: Console, words: str) -> None:
        self._console = console
        self._words = words
        self._start = time.monotonic()
        self._progress: Progress | None = None
        self._task: TaskID | None = None
        self._is_for_a_program = os.environ.get("CALIBRARY_PROGRESS") == "lines"
        self._line_at = self._start

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Remove the bar, so that a question or the result can be printed; work that goes on draws it again."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def __call__(self, done: int, total: int, what: str) -> None:
        """Update the bar."""
        if self._is_for_a_program:
            if time.monotonic() >= self._line_at:
                self._line_at = time.monotonic() + LINE_EVERY_S
                sys.stderr.write(f"progress {done} {total} {what}\n")
                sys.stderr.flush()
            return
        if self._progress is None:
            if (
                not self._console.is_terminal
                or self._console.quiet
                or time.monotonic() - self._start < SHOWN_AFTER_S
            ):
                return
            self._begin()
        if self._progress is not None and self._task is not None:
            self._progress.update(
                self._task, description=f"{self._words} {what}".strip(), completed=done, total=total or None
            )

    def _begin(self) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
        )
        self._task = self._progress.add_task(self._words)
        self._progress.start()
