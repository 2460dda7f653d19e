"""The lock that allows one writer at a time, and removal of locks left by killed processes.

The writer's lock is a kernel lock (``flock``), which vanishes with its holder, also after ``kill -9``. git's own locks
are files, which do not. A lock file of git may be removed if our own lock is held, so that no other calibrary writes;
if the file is old by the disk's own clock; and if it locks a ref. ``index.lock`` is never removed: ``git commit``
holds it for as long as an editor is open.
"""

from __future__ import annotations

import errno
import os
import random
import re
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from calibrary.errors import RegistryError

LOCK_NAME = "calibrary.lock"
LONGEST_PAUSE_S = 0.2
WITHOUT_LOCKS = frozenset({errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP})
"""Answers of network disks that are mounted without locks."""
REPORTED = re.compile(r"Unable to create '(?P<path>[^\n]+\.lock)': File exists")
REMOVABLE = re.compile(r"(HEAD|packed-refs|refs/.+)\.lock\Z")


class WriterLock:
    """The writer's lock, held; see :func:`writer_lock`."""

    def __init__(self, handle: int, folder: Path) -> None:
        self._handle = handle
        self._folder = folder

    def remove_stale(self, path: Path, *, older_than_s: float) -> bool:
        """Remove a lock file of git that a killed writer left.

        The age is its absolute value, so that a clock that was set back does not keep a lock forever.

        Returns:
            Whether the lock file is gone.
        """
        try:
            inside = path.resolve().relative_to(self._folder.resolve()).as_posix()
        except ValueError:
            return False
        if REMOVABLE.match(inside) is None:
            return False
        try:
            age_s = self._now() - path.lstat().st_mtime
            if abs(age_s) < older_than_s:
                return False
            aside = path.with_name(f"{path.name}.{os.getpid()}.stale")
            path.rename(aside)
            aside.unlink()
        except FileNotFoundError:
            return True
        return True

    def _now(self) -> float:
        """Return the time by the clock of the disk with the locks, which may be another machine's."""
        os.lseek(self._handle, 0, os.SEEK_SET)
        os.write(self._handle, b"calibrary\n")
        return os.fstat(self._handle).st_mtime


@contextmanager
def writer_lock(folder: Path, *, wait_s: float) -> Iterator[WriterLock]:
    """Hold a registry's writer lock.

    Args:
        folder: common git folder of the repository.
        wait_s: longest time to wait for other processes, in s.

    Raises:
        RegistryError: another process held it longer, or the folder is not writable.
    """
    path = folder / LOCK_NAME
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        raise RegistryError(
            f"{folder}: cannot be written: {error.strerror}; expected write access to the repository"
        ) from None
    try:
        _grant_as_folder(handle, folder)
        _acquire(handle, path, wait_s)
        try:
            yield WriterLock(handle, folder)
        finally:
            _unlock(handle)
    finally:
        os.close(handle)


def _acquire(handle: int, path: Path, wait_s: float) -> None:
    deadline = time.monotonic() + wait_s
    for pause_s in backoff(first_s=0.001, longest_s=0.02):
        try:
            _try_lock(handle)
        except (BlockingIOError, PermissionError):
            pass
        except OSError as error:
            if error.errno not in WITHOUT_LOCKS:
                raise
            raise RegistryError(
                f"{path}: nothing was written: this disk grants no locks ({error.strerror}), and without them two "
                "writers would lose changes; keep the registry on a local disk, or mount this one with locks"
            ) from None
        else:
            return
        if time.monotonic() > deadline:
            raise RegistryError(
                f"{path}: another process has been writing for {wait_s:g} s; wait for it, or end it, "
                "which releases its lock"
            )
        time.sleep(pause_s)


def backoff(*, first_s: float = 0.005, longest_s: float = LONGEST_PAUSE_S) -> Iterator[float]:
    """Yield increasing pauses in s without end, each random up to the current limit, to avoid synchronised retries."""
    longest = first_s
    while True:
        yield random.uniform(0.0, longest)  # noqa: S311  jitter, not a secret
        longest = min(2.0 * longest, longest_s)


def blocking_lock(output: str) -> Path | None:
    """Return the lock file that git reports as existing; None if it reports none."""
    found = REPORTED.search(output)
    return Path(found["path"]) if found else None


if sys.platform == "win32":
    import msvcrt

    def _try_lock(handle: int) -> None:
        os.lseek(handle, 1 << 30, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)

    def _unlock(handle: int) -> None:
        os.lseek(handle, 1 << 30, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_UNLCK, 1)

    def _grant_as_folder(handle: int, folder: Path) -> None:
        """Do nothing: here, files have the permissions of their folder."""
else:
    import fcntl

    def _try_lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def _unlock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_UN)

    def _grant_as_folder(handle: int, folder: Path) -> None:
        """Give the lock file the write permissions of its folder, whatever the umask of its first holder was."""
        with suppress(OSError):
            have = stat.S_IMODE(os.fstat(handle).st_mode)
            wanted = have | (folder.stat().st_mode & 0o066)
            if wanted != have:
                os.fchmod(handle, wanted)
