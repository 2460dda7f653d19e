"""Writing files whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from calibrary.errors import InputError

__all__ = ["write_files"]


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write several files; each is complete or as it was before, and none is written unless all can be.

    Everything is written beside its place first, then moved there.

    Raises:
        InputError: a folder is missing or may not be written to, or the disk is full; the message says what
            was changed all the same.
    """
    staged: list[tuple[str, Path]] = []
    done: list[str] = []
    try:
        for path, content in files.items():
            staged.append((_stage(path, content), path))
        while staged:
            temporary, path = staged[0]
            Path(temporary).replace(path)
            del staged[0]
            done.append(path.name)
    except OSError as error:
        written = f"only {', '.join(done)}" if done else "nothing"
        raise InputError(
            f"cannot be written: {error.strerror or error}; {written} was written", source=str(path)
        ) from None
    finally:
        for temporary, _ in staged:
            with suppress(OSError):
                Path(temporary).unlink()


def _stage(path: Path, content: bytes) -> str:
    if path.is_dir():
        raise IsADirectoryError(None, "is a directory")
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o666 & ~_umask())
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return temporary


def _umask() -> int:
    """The process's umask; reading it means setting it for a moment."""
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
