"""Atomic writing of files: each file is written completely or not at all."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.errors import InputError
from calibrary.interrupts import interrupts_held

if TYPE_CHECKING:
    from concurrent.futures import Future

log = logging.getLogger(__name__)


def check_folder(path: Path, *, place: str | None = None) -> None:
    """Check, before any work is done, that a file can be written in a folder; the folder may not exist yet.

    Raises:
        InputError: the path is not a folder, or the folder is not writable.
    """
    folder = path.parent
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        raise InputError("is a file; expected a folder", source=str(folder), place=place)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError("the folder may not be written to", source=str(folder), place=place)


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write several files; each is complete or unchanged, and none is written unless all can be.

    Every file is first written to a temporary file in its folder, then renamed. Missing folders are created. If
    writing stops for any reason, also by a signal, no half-written file remains.

    Raises:
        InputError: a folder is not writable, or the disk is full; the message states which files were already written.
    """
    staged: list[tuple[Path, Path]] = []
    made: list[Path] = []
    done: list[str] = []
    try:
        for path, content in files.items():
            _make_folder(path.parent, made)
            if path.is_dir():
                raise IsADirectoryError(None, "is a directory")
            temporary = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
            staged.append((temporary, path))
            _stage(temporary, content)
        for path, synced in _syncs(staged):  # noqa: B007  the message names the path
            synced.result()
        with interrupts_held():
            while staged:
                temporary, path = staged[0]
                temporary.replace(path)
                del staged[0]
                made.clear()
                done.append(path.name)
                log.info("wrote %s (%d bytes)", path, len(files[path]))
    except OSError as error:
        written = f"only {', '.join(done)}" if done else "nothing"
        raise InputError(
            f"cannot be written: {error.strerror or error}; {written} was written", source=str(path)
        ) from None
    finally:
        for temporary, _ in staged:
            with suppress(OSError):
                temporary.unlink()
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()


def _make_folder(folder: Path, made: list[Path]) -> None:
    """Create a folder and its missing parents, and append each created one to ``made``."""
    if folder.is_dir():
        return
    _make_folder(folder.parent, made)
    with suppress(FileExistsError):
        folder.mkdir()
        made.append(folder)


def _stage(temporary: Path, content: bytes) -> None:
    # Mode 0o666 less the umask, as open() uses; O_EXCL never overwrites an existing file.
    with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb") as file:
        file.write(content)


def _syncs(staged: Sequence[tuple[Path, Path]]) -> list[tuple[Path, Future[None]]]:
    """Wait until every content is on the disk, and return what came of it for each path.

    A file that takes its name before that may be empty after a power cut. Requests that wait side by side share a
    commit of the file system's journal: 1500 files take 0.3 to 1.4 s, one after the other 1.7 to 6.
    """
    from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415  for what writes only

    with ThreadPoolExecutor(16) as pool:
        return [(path, pool.submit(_sync, temporary)) for temporary, path in staged]


def _sync(temporary: Path) -> None:
    # Windows flushes only what is open for writing.
    with temporary.open("r+b") as file:
        os.fsync(file.fileno())
