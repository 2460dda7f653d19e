"""Opening of calibration files, the only module that does so; and which files are images, by name."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from calibrary.errors import InputError, ParseError

MAX_BYTES = 64 * 1024 * 1024
IMAGE_SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".jpe", ".mpo", ".tif", ".tiff", ".dng", ".heic", ".heif", ".png"}
)
"""Suffixes of images in a directory scan, in lower case. The first bytes of a file decide how it is read."""

_LFS = b"version https://git-lfs.github.com/spec/v1"
_KINDS = (
    (stat.S_ISDIR, "a directory"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_regular_file(path: Path, *, max_bytes: int = MAX_BYTES) -> bytes:
    """Read a regular file; anything else is not opened, because reading could block or never end.

    Raises:
        InputError: the file does not exist, is not a regular file, or is not readable.
        ParseError: the file is empty, too long, or a git-LFS pointer.
    """
    name = display_name(path)
    data = read_head(path, max_bytes + 1)
    if not data:
        raise ParseError("the file is empty; export or copy it again", source=name)
    if len(data) > max_bytes:
        raise too_long(name, max_bytes)
    if data.startswith(_LFS):
        raise ParseError(
            "this is a git-LFS pointer, not the file it stands for; fetch it with `git lfs pull`",
            source=name,
        )
    return data


def read_head(path: Path, count: int) -> bytes:
    """Read up to ``count`` first bytes of a regular file.

    Raises:
        InputError: the file does not exist, is not a regular file, or is not readable.
    """
    name = display_name(path)
    try:
        _refuse_irregular(path.stat().st_mode, name)
        # The file may be replaced between stat and open: O_NONBLOCK prevents a pipe from blocking; fstat decides.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with open(descriptor, "rb") as file:  # noqa: PTH123  pathlib cannot open a descriptor
            _refuse_irregular(os.fstat(descriptor).st_mode, name)
            return file.read(count)
    except InputError:
        raise
    except OSError as error:  # also a loop of symbolic links
        raise InputError(f"cannot be read: {error.strerror or error}", source=name) from None
    except ValueError as error:  # an invalid name, with a NUL
        raise InputError(f"cannot be read: {error}", source=name) from None


def length_of(path: Path) -> int:
    """Size of a file in bytes; 0 if it does not exist, because reading it will report that."""
    try:
        return path.stat().st_size
    except (OSError, ValueError):
        return 0


def too_long(name: str, max_bytes: int) -> ParseError:
    """The error for a file of more than ``max_bytes``."""
    return ParseError(
        f"the file is longer than {max_bytes} bytes, more than any calibration has; if it is one, raise --max-size-mib",
        source=name,
    )


def companions(path: Path, *, max_bytes: int = MAX_BYTES) -> Callable[[str], bytes | None]:
    """Function that reads other files in the folder of ``path`` by relative name; it never leaves that folder.

    An empty file gives b"".
    """

    def companion(name: str) -> bytes | None:
        relative = PurePosixPath(name)
        if (
            relative.is_absolute()
            or ".." in relative.parts
            or not relative.parts
            or "\\" in name
            or "\0" in name
        ):
            raise ParseError(
                f"it refers to {name!a}, which is not a file beside it", source=display_name(path)
            )
        beside = path.parent / relative
        try:
            if not beside.exists():
                return None
        except OSError as error:  # such as a name longer than a file system's
            why = f"it refers to {name[:40]!a}…, which cannot be looked up: {error.strerror}"
            raise ParseError(why, source=display_name(path)) from None
        return read_regular_file(beside, max_bytes=max_bytes) if length_of(beside) else b""

    return companion


def display_name(path: Path) -> str:
    """File name for messages: without folder, unprintable characters escaped."""
    name = path.name or str(path)
    return name if name.isprintable() else ascii(name)[1:-1]


def _refuse_irregular(mode: int, source: str) -> None:
    if not stat.S_ISREG(mode):
        kind = next((name for test, name in _KINDS if test(mode)), "no regular file")
        raise InputError(f"this is {kind}, expected a file", source=source)


def is_image(path: str | Path) -> bool:
    """Whether a file name has the suffix of an image."""
    return os.path.splitext(path)[1].lower() in IMAGE_SUFFIXES  # noqa: PTH122  asked of every file
