"""One image file's head: read where it is needed, counted, and never past a budget.

Metadata lies scattered over a file (a thermal JPEG keeps its frame header behind three megabytes of raw
temperatures), so nothing is read in bulk: a first chunk that contains most heads, then windows.
"""

from __future__ import annotations

import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

from calibrary.errors import InputError, ParseError

__all__ = ["FIRST_CHUNK", "READ_BUDGET", "Block", "Source", "open_source"]

FIRST_CHUNK = 16 * 1024
"""Holds the EXIF directories, and in half of all files everything, but rarely a whole thumbnail."""

WINDOW = 4 * 1024
"""What is read around a value that lies outside the first chunk."""

READ_BUDGET = 16 * 1024 * 1024
"""No honest head needs more; the parts a reader asks for are each bounded far below this."""


class Source:
    """Random access to one file's bytes through a first chunk and one window.

    Attributes:
        name: for messages; a file's name without its directory.
        size: bytes in the file.
        bytes_read: bytes asked of the operating system so far.
    """

    __slots__ = ("_file", "_first", "_window", "_window_start", "bytes_read", "name", "size")

    def __init__(self, file: BinaryIO, *, name: str, size: int) -> None:
        """Reads the first chunk of ``file``, which must be seekable and unbuffered."""
        self.name = name
        self.size = size
        self.bytes_read = 0
        self._file = file
        self._window = b""
        self._window_start = 0
        self._first = self._fetch(0, min(size, FIRST_CHUNK))

    @property
    def head(self) -> bytes:
        """The first chunk, for recognising what this is."""
        return self._first

    def read(self, offset: int, size: int, *, ahead: int = WINDOW) -> bytes:
        """``size`` bytes from ``offset``; fewer where the file ends first.

        Args:
            offset: from the start of the file.
            size: expected bytes.
            ahead: how much to fetch when the bytes are not at hand, if that is more than ``size``.

        Raises:
            ParseError: the budget for one head is spent.
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
        """A part of the file that is addressed from its own start."""
        room = max(self.size - start, 0)
        return Block(self, start, room if length is None else min(length, room))

    def broken(self, message: str, *, place: str | None = None) -> ParseError:
        """A ParseError that names this file."""
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
    """A part of a source, such as an EXIF block inside a JPEG, addressed from its own start."""

    __slots__ = ("length", "source", "start")

    def __init__(self, source: Source, start: int, length: int) -> None:
        self.source = source
        self.start = start
        self.length = length

    @classmethod
    def of(cls, data: bytes, name: str) -> Block:
        """Bytes that had to be assembled or inflated first."""
        return cls(Source(io.BytesIO(data), name=name, size=len(data)), 0, len(data))

    def read(self, offset: int, size: int) -> bytes:
        """``size`` bytes from ``offset``; fewer where the block ends first."""
        return self.source.read(self.start + offset, min(size, max(self.length - offset, 0)))


@contextmanager
def open_source(path: str | os.PathLike[str]) -> Iterator[Source]:
    """A regular file, open for the length of the block.

    Pipes, devices and directories are refused before they are opened: opening one can block or act.

    Raises:
        InputError: it is not there, not readable, or no regular file.
    """
    name = display_name(path)
    try:
        _refuse_special(os.stat(path), name)  # noqa: PTH116  for every image; a Path costs more than the call
        # A pipe may take the file's place between the two calls, and opening one waits for a writer.
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
    """The file's name as it may stand in a message: without its directory and without control characters."""
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
    """What the operating system says, without the path it repeats."""
    return (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
