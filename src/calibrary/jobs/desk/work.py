"""What writes or takes its time: calibrary's own commands, each in a process of its own, as a terminal runs them.

A process of its own has no terminal: a key with a passphrase that no agent has fails at once, and does not ask where
nobody looks. It unwinds by itself when it is interrupted, and its messages are what the page shows.
"""

from __future__ import annotations

import os
import re
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Final

from calibrary.errors import InputError

PATIENCE_S: Final = 3.0
"""Time for an interrupted command to unwind."""
MOST_JOBS: Final = 200
OUT: Final = ".out"
MOST_SAID: Final = 100_000
"""Characters of a command's output that are shown."""
PROGRESS: Final = re.compile(r"progress (\d+) (\d+) (.*)")


class Job:
    """One command, running or done.

    Attributes:
        words: the command, without calibrary.
        folder: for what it writes; removed with the desk.
        title: what it is, for its page.
        progress: (done, total, what) so far.
        code: its exit code; None while it runs.
        is_cancelled: whether it was asked to end.
        said: what it printed: results, then complaints.
    """

    def __init__(
        self, words: Sequence[str], folder: Path, title: str, slots: AbstractContextManager[object]
    ) -> None:
        self.words, self.folder, self.title = tuple(words), folder, title
        self.progress = (0, 0, "waiting")
        self.code: int | None = None
        self.is_cancelled = False
        self.said = ("", "")
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()
        self._over = threading.Event()
        threading.Thread(target=self._run, args=(slots,), daemon=True).start()

    @property
    def command(self) -> str:
        """The command as typed in a terminal."""
        return self._shown(shlex.join(["calibrary", *self.words]))

    @property
    def text(self) -> str:
        """What it printed, without a document."""
        return self._shown("\n".join(filter(None, self.said[1:] if "--json" in self.words else self.said)))

    @property
    def documents(self) -> list[bytes]:
        """The JSON documents that it printed so far, one of many lines or one a line; none where it failed."""
        try:
            found = (self.folder / OUT).read_bytes()
        except OSError:
            return []
        if found.startswith(b"{\n"):
            return [found]
        # Of the last line a part may be written yet.
        return [
            line for line in found.splitlines(keepends=True) if line.startswith(b"{") and line.endswith(b"\n")
        ]

    def _shown(self, text: str) -> str:
        """A text without the folders of the desk."""
        return re.sub(
            rf"{re.escape(str(self.folder.parent))}{re.escape(os.sep)}[\w-]+{re.escape(os.sep)}", "", text
        )

    def wait(self, seconds: float) -> bool:
        """Whether it is over after at most so long."""
        return self._over.wait(seconds)

    def cancel(self) -> None:
        """Ask it to end; it is killed if it does not."""
        with self._lock:
            self.is_cancelled = True
            process = self._process
        if process is not None and process.poll() is None:
            self._signal(process, signal.SIGINT)
            threading.Timer(PATIENCE_S, self._kill, (process,)).start()

    def _kill(self, process: subprocess.Popen[str]) -> None:
        if process.poll() is None:
            self._signal(process, getattr(signal, "SIGKILL", signal.SIGTERM))

    @staticmethod
    def _signal(process: subprocess.Popen[str], number: int) -> None:
        if os.name == "nt":
            process.terminate()
            return
        # The group: worker processes too.
        with suppress(ProcessLookupError):
            os.killpg(process.pid, number)

    def _run(self, slots: AbstractContextManager[object]) -> None:
        out, complaints = self.folder / OUT, list[str]()
        try:
            with slots, out.open("w", encoding="utf-8") as file:
                if not self.is_cancelled:
                    self._listen(file.fileno(), complaints)
            with out.open(encoding="utf-8", errors="replace") as file:
                found = file.read(MOST_SAID).rstrip()
        except OSError as error:
            found, complaints = "", [f"calibrary: {error}"]
        self.said = (found, "\n".join(complaints[-200:]))
        self.code = self._process.returncode if self._process is not None else -1
        self._over.set()

    def _listen(self, out: int, complaints: list[str]) -> None:
        environment = {"CALIBRARY_PROGRESS": "lines", "GIT_TERMINAL_PROMPT": "0", "PYTHONUTF8": "1"}
        # What is printed is shown while it runs.
        environment["PYTHONUNBUFFERED"] = "1"
        if os.name != "nt":
            environment["CALIBRARY_PARENT"] = str(os.getpid())
        with self._lock:
            self.progress = (0, 0, "watching" if "watch" in self.words[:2] else "starting")
            # -P: no module is taken from the folder that it works in.
            self._process = subprocess.Popen(  # noqa: S603  our own command; no shell
                [sys.executable, "-P", "-m", "calibrary", *self.words],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
                cwd=self.folder,
                env={**os.environ, **environment},
                start_new_session=os.name != "nt",
            )
        if self.is_cancelled:
            self.cancel()
        assert self._process.stderr is not None  # noqa: S101  a pipe was asked for
        with self._process.stderr as told:
            for line in told:
                if found := PROGRESS.match(line):
                    self.progress = (int(found[1]), int(found[2]), found[3].strip())
                elif line.strip():
                    complaints.append(line.rstrip())
        self._process.wait()


class Jobs:
    """The commands of a desk, by an id that nobody can guess; as many at once as there are processors."""

    def __init__(self, scratch: Path) -> None:
        self._scratch, self._jobs = scratch, dict[str, Job]()
        self._slots = threading.Semaphore(os.cpu_count() or 1)
        self._writing = threading.Lock()

    def folder(self) -> tuple[str, Path]:
        """A new id, and the folder for it."""
        id_ = secrets.token_urlsafe(9)
        folder = self._scratch / id_
        folder.mkdir()
        return id_, folder

    def folder_of(self, id_: str) -> Path:
        """The folder of an id that has one already."""
        return self._scratch / id_

    def start(
        self,
        words: Sequence[str],
        title: str,
        place: tuple[str, Path] | None = None,
        *,
        at_once: bool = False,
    ) -> str:
        """Start a command, and return its id; the oldest that are over are forgotten.

        Args:
            words: the command.
            title: what it is.
            place: the id and folder that it has already.
            at_once: do not wait for a processor: it takes little time, or waits itself.
        """
        id_, folder = place or self.folder()
        over = [one for one, job in self._jobs.items() if job.code is not None]
        for one in over[: max(0, len(self._jobs) - MOST_JOBS)]:
            shutil.rmtree(self._jobs.pop(one).folder, ignore_errors=True)
        self._jobs[id_] = Job(words, folder, title, nullcontext() if at_once else self._slots)
        return id_

    def write(self, words: Sequence[str], title: str, seconds: float) -> str:
        """Run a command that changes the registry, one at a time, to its end; return its id."""
        with self._writing:
            id_ = self.start(words, title, at_once=True)
            if not self.get(id_).wait(seconds):
                self.get(id_).cancel()
                self.get(id_).wait(2 * PATIENCE_S)
        return id_

    def __contains__(self, id_: object) -> bool:
        """Whether a command of this id was begun."""
        return id_ in self._jobs

    def get(self, id_: str) -> Job:
        """The command of an id.

        Raises:
            InputError: there is none.
        """
        if id_ not in self._jobs:
            raise InputError("this ended with the desk that began it; begin it again")
        return self._jobs[id_]

    def close(self) -> None:
        """End all that runs."""
        left = [job for job in self._jobs.values() if job.code is None]
        for job in left:
            job.cancel()
        until = time.monotonic() + 2 * PATIENCE_S
        for job in left:
            job.wait(max(0.0, until - time.monotonic()))
