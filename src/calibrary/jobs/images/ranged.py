"""Reading of a file on a server with few range requests: the first covers most image headers, others follow on demand.

A request takes 10 … 100 ms and costs as much as some hundred kilobytes of transfer, so the windows are larger
than on a disk. If a reader proceeds from window to window, as over the 64 kB segments with the raw
temperatures of a thermal JPEG, each window is twice as long as the previous one. If it jumps to the end, as
in a TIFF with its directory at the end, the whole end is fetched at once.
"""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO, Final, Protocol, TypeVar, cast

from msgspec import Struct

from calibrary.errors import CalibraryError
from calibrary.parsers.imagery.source import Source
from calibrary.progress import log

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

FIRST: Final = 64 * 1024
"""Bytes of the first request; contains the whole header of most images."""
WINDOW: Final = 64 * 1024
MOST: Final = 2 * 1024 * 1024
TAIL: Final = 128 * 1024
"""If a reader looks this close to the end (bytes), the end is fetched, on both sides of that position."""
WAITS_S: Final = (0.2, 0.8, 3.2)
"""Waiting times in s before further attempts, if these may succeed."""

T = TypeVar("T")


class StoreError(CalibraryError):
    """A server did not deliver a requested file.

    Attributes:
        passing: whether another attempt may succeed.
    """

    def __init__(self, message: str, *, passing: bool = False) -> None:
        super().__init__(message)
        self.message = message
        self.passing = passing


class First(Struct, frozen=True):
    """The beginning of a file.

    Attributes:
        data: its first bytes.
        size: of the whole file.
        version: its ETag; None if the server states none.
    """

    data: bytes
    size: int
    version: str | None


class Store(Protocol):
    """A server's files by key. Every method raises StoreError."""

    def first(self, key: str, size: int) -> First:
        """The first ``size`` bytes of a file, with its total size and version."""

    def part(self, key: str, start: int, end: int, version: str | None) -> bytes:
        """The bytes from ``start`` up to, not including, ``end``; fails if the version differs."""

    def listed(self, prefix: str) -> Iterator[str]:
        """Yield the keys of all files below a prefix, in the order of their bytes."""


class Ranged:
    """File interface for :class:`~calibrary.parsers.imagery.source.Source` to a file on a server, using ranges."""

    def __init__(self, fetch: Callable[[int, int], bytes], first: bytes, size: int) -> None:
        self._fetch, self._size = fetch, size
        self._parts = [(0, first)]
        self._window, self._at = WINDOW, 0

    def seek(self, offset: int) -> None:
        """Set the position of the next read."""
        self._at = offset

    def as_file(self) -> BinaryIO:
        """A buffered file object, for readers that need more than Source does."""
        return io.BufferedReader(_Raw(self, self._size))

    def read(self, size: int) -> bytes:
        """Read up to ``size`` bytes, fewer at the end of the file."""
        start, end = self._at, min(self._at + size, self._size)
        self._at = end
        for begin, data in reversed(self._parts):
            if begin <= start and end <= begin + len(data):
                return data[start - begin : end - begin]
        begin, stop = self._range(start, end)
        data = self._fetch(begin, stop)
        self._parts.append((begin, data))
        return data[start - begin : end - begin]

    def _range(self, start: int, end: int) -> tuple[int, int]:
        """The range to fetch in order to read the bytes from ``start`` to ``end``."""
        length = max(end - start, self._window)
        self._window = min(2 * self._window, MOST)
        if start + length >= self._size - TAIL:
            known = max(begin + len(data) for begin, data in self._parts if begin <= start)
            return min(start, max(self._size - TAIL, known)), self._size
        return start, start + length


class _Raw(io.RawIOBase):
    """Raw file interface for :class:`io.BufferedReader`."""

    def __init__(self, ranged: Ranged, size: int) -> None:
        self._ranged, self._size, self._at = ranged, size, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: WriteableBuffer) -> int:
        into = memoryview(buffer)
        self._ranged.seek(self._at)
        data = self._ranged.read(len(into)) if self._at < self._size else b""
        into[: len(data)] = data
        self._at += len(data)
        return len(data)


class Remote:
    """One version of a file in a store; its parts are fetched on demand.

    Raises:
        StoreError: the file cannot be read; later reads raise it also if the file has changed.
    """

    def __init__(self, store: Store, key: str) -> None:
        self._store, self._key = store, key
        self._found = patiently(lambda: store.first(key, FIRST))
        self.size = self._found.size

    def ranged(self, *, head: bool) -> Ranged:
        """The file as a :class:`Ranged`; with ``head`` the part already fetched from its beginning is reused."""
        return Ranged(self._fetch, self._found.data if head else b"", self.size)

    def _fetch(self, start: int, end: int) -> bytes:
        version = self._found.version
        return patiently(lambda: _whole(self._store.part(self._key, start, end, version), end - start))


@contextmanager
def opened(store: Store, key: str, name: str) -> Iterator[Source]:
    """Context manager that opens one file of a store.

    Raises:
        StoreError: the file cannot be read, or has changed in the meantime.
    """
    file = Remote(store, key)
    # Source uses only seek and read.
    yield Source(cast("BinaryIO", file.ranged(head=True)), name=name, size=file.size)


def _whole(data: bytes, size: int) -> bytes:
    if len(data) != size:
        raise StoreError(f"the server sent {len(data)} of {size} bytes", passing=True)
    return data


def patiently(attempt: Callable[[], T]) -> T:
    """Return the result of ``attempt``, which is repeated after a pause if that may help.

    Raises:
        StoreError: the last attempt failed, or repeating is useless.
    """
    for wait in WAITS_S:
        try:
            return attempt()
        except StoreError as error:
            if not error.passing:
                raise
            log.info("%s; tried again in %.1f s", error.message, wait)
        time.sleep(wait)
    return attempt()
