"""Access to the header of an image file: reads only where needed, counts bytes, and limits their total.

Metadata is scattered over a file (a thermal JPEG has its frame header after three megabytes of raw
temperatures), so a first chunk is read, which contains most headers, and then windows as needed.
"""

from __future__ import annotations

import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

from calibrary.errors import InputError, ParseError

FIRST_CHUNK = 16 * 1024
"""Bytes of the first read: contains the EXIF directories, and in half of all files everything needed."""

WINDOW = 4 * 1024
"""Bytes read around a value outside the first chunk."""

READ_BUDGET = 16 * 1024 * 1024
"""Most bytes read in total; no valid header needs more."""


class Source:
    """Random access to one file's bytes through a first chunk and one window.

    Attributes:
        name: for messages; a file's name without its directory.
        size: length of the file in bytes.
        bytes_read: bytes requested from the operating system so far.
    """

    __slots__ = ("_file", "_first", "_window", "_window_start", "bytes_read", "name", "size")

    def __init__(self, file: BinaryIO, *, name: str, size: int) -> None:
        """Read the first chunk of ``file``, which must be seekable and unbuffered."""
        self.name = name
        self.size = size
        self.bytes_read = 0
        self._file = file
        self._window = b""
        self._window_start = 0
        self._first = self._fetch(0, min(size, FIRST_CHUNK))

    @property
    def head(self) -> bytes:
        """The first chunk, to recognise the file."""
        return self._first

    def read(self, offset: int, size: int, *, ahead: int = WINDOW) -> bytes:
        """Read ``size`` bytes from ``offset``; fewer at the end of the file.

        Args:
            offset: from the start of the file.
            size: number of bytes.
            ahead: number of bytes to fetch if they are not in the buffer, if more than ``size``.

        Raises:
            ParseError: the limit of bytes for one header is exceeded.
            InputError: the file system fails.
        """
        end = offset + size
        if end <= len(self._first):
            return self._first[offset:end]
        begin = offset - self._window_start
        if begin < 0 or begin + size > len(self._window):
            if offset >= self.size:
                return b""
            wanted = min(max(size, ahead), self.size - offset)
            self._window = self._fetch(offset, wanted)
            self._window_start = offset
            begin = 0
        return self._window[begin : begin + size]

    def block(self, start: int = 0, length: int | None = None) -> Block:
        """A part of the file with offsets relative to its own start."""
        room = max(self.size - start, 0)
        return Block(self, start, room if length is None else min(length, room))

    def broken(self, message: str, *, place: str | None = None) -> ParseError:
        """Make a ParseError that names this file."""
        return ParseError(message, source=self.name, place=place)

    def _fetch(self, offset: int, size: int) -> bytes:
        if self.bytes_read + size > READ_BUDGET:
            limit = f"{READ_BUDGET // 2**20} MiB"
            raise self.broken(
                f"its head takes more than {limit} to read; save it again with an image program"
            )
        try:
            self._file.seek(offset)
            data = self._file.read(size)
        except (OSError, OverflowError) as error:
            raise InputError(f"cannot be read: {_reason(error)}", source=self.name) from None
        self.bytes_read += len(data)
        return data


class Block:
    """A part of a source, such as an EXIF block inside a JPEG, with offsets relative to its own start."""

    __slots__ = ("length", "source", "start")

    def __init__(self, source: Source, start: int, length: int) -> None:
        self.source = source
        self.start = start
        self.length = length

    @classmethod
    def of(cls, data: bytes, name: str) -> Block:
        """Make a block from bytes that were assembled or decompressed."""
        return cls(Source(io.BytesIO(data), name=name, size=len(data)), 0, len(data))

    def read(self, offset: int, size: int) -> bytes:
        """Read ``size`` bytes from ``offset``; fewer at the end of the block."""
        return self.source.read(self.start + offset, min(size, max(self.length - offset, 0)))


@contextmanager
def open_source(path: str | os.PathLike[str]) -> Iterator[Source]:
    """Context manager that opens a regular file.

    Pipes, devices and directories are refused before opening, because that can block or have side effects.

    Raises:
        InputError: the file does not exist, is not readable, or is not a regular file.
    """
    name = display_name(path)
    try:
        _refuse_special(os.stat(path), name)  # noqa: PTH116  for every image; a Path takes longer
        # A pipe may replace the file between the two calls, and opening a pipe waits for a writer.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"cannot be opened: {_reason(error)}", source=name) from None
    with io.FileIO(descriptor) as file:
        status = os.fstat(descriptor)
        _refuse_special(status, name)
        yield Source(file, name=name, size=status.st_size)


def display_name(path: str | os.PathLike[str]) -> str:
    """File name for messages: without directory and control characters."""
    name = os.path.basename(path) or str(path)  # noqa: PTH119  as above
    if name.isprintable():
        return name
    return "".join(character if character.isprintable() else "�" for character in name)


def _refuse_special(status: os.stat_result, name: str) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = {stat.S_IFDIR: "a directory", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
        found = kind.get(stat.S_IFMT(status.st_mode), "a device")
        raise InputError(f"this is {found}; an image file was expected", source=name)


def _reason(error: Exception) -> str:
    """The operating system's message without the path."""
    return (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
