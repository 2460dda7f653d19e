"""A file on a server, read in few ranges: enough at first for most heads, then by what the reader turns out to want.

A request costs 10 to 100 ms and as much money as some hundred kilobytes of transfer, so a window is larger than on a
disk: where a reader walks on from window to window, as over the 64 kB segments that a thermal JPEG keeps its raw
temperatures in, each is twice as long as the one before; where it goes to the end, as in a TIFF whose directory was
written last, the whole end is taken at once.
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

__all__ = ["FIRST", "First", "Listed", "Ranged", "Remote", "Store", "StoreError", "opened", "patiently"]

FIRST: Final = 64 * 1024
"""The whole head of most images; fewer would cost the others a second request."""
WINDOW: Final = 64 * 1024
MOST: Final = 2 * 1024 * 1024
TAIL: Final = 128 * 1024
"""So near to the end a reader is taken to want what is there, on both sides of where it looked first."""
WAITS_S: Final = (0.2, 0.8, 3.2)
"""Before another attempt is made, where that may succeed."""

T = TypeVar("T")


class StoreError(CalibraryError):
    """A server did not give what it was asked for.

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
        version: its ETag; None where the server has none.
    """

    data: bytes
    size: int
    version: str | None


class Listed(Struct, frozen=True):
    """A file that a server lists: its key, and what changes when its content does."""

    key: str
    version: str | None


class Store(Protocol):
    """A server's files by key. Every method raises StoreError."""

    def first(self, key: str, size: int) -> First:
        """So many bytes from the beginning, and what file it is."""

    def part(self, key: str, start: int, end: int, version: str | None) -> bytes:
        """The bytes from ``start`` to before ``end`` of that very version."""

    def listed(self, prefix: str) -> Iterator[Listed]:
        """Every file below a prefix, in the order of the keys' bytes."""


class Ranged:
    """What :class:`~calibrary.parsers.imagery.source.Source` needs of a file, over ranges of one on a server."""

    def __init__(self, fetch: Callable[[int, int], bytes], first: bytes, size: int) -> None:
        self._fetch, self._size = fetch, size
        self._parts = [(0, first)]
        self._window, self._at = WINDOW, 0

    def seek(self, offset: int) -> None:
        """Where to read next."""
        self._at = offset

    def as_file(self) -> BinaryIO:
        """The same as a buffered file, for readers that ask for more of one than Source does."""
        return io.BufferedReader(_Raw(self, self._size))

    def read(self, size: int) -> bytes:
        """So many bytes, fewer where the file ends first."""
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
        """What to fetch for the sake of some bytes."""
        length = max(end - start, self._window)
        self._window = min(2 * self._window, MOST)
        if start + length >= self._size - TAIL:
            known = max(begin + len(data) for begin, data in self._parts if begin <= start)
            return min(start, max(self._size - TAIL, known)), self._size
        return start, start + length


class _Raw(io.RawIOBase):
    """What :class:`io.BufferedReader` needs of a file."""

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
    """One version of a file of a store, whose parts are fetched as they are asked for.

    Raises:
        StoreError: it cannot be read; also from what is read of it later, where it was changed meanwhile.
    """

    def __init__(self, store: Store, key: str) -> None:
        self._store, self._key = store, key
        self._found = patiently(lambda: store.first(key, FIRST))
        self.size = self._found.size

    def ranged(self, *, head: bool) -> Ranged:
        """It as a file; with ``head`` what was fetched of its beginning is not fetched again."""
        return Ranged(self._fetch, self._found.data if head else b"", self.size)

    def _fetch(self, start: int, end: int) -> bytes:
        version = self._found.version
        return patiently(lambda: _whole(self._store.part(self._key, start, end, version), end - start))


@contextmanager
def opened(store: Store, key: str, name: str) -> Iterator[Source]:
    """One file of a store, for the length of the block.

    Raises:
        StoreError: it cannot be read, or was changed meanwhile.
    """
    file = Remote(store, key)
    # Source only seeks and reads.
    yield Source(cast("BinaryIO", file.ranged(head=True)), name=name, size=file.size)


def _whole(data: bytes, size: int) -> bytes:
    if len(data) != size:
        raise StoreError(f"the server sent {len(data)} of {size} bytes", passing=True)
    return data


def patiently(attempt: Callable[[], T]) -> T:
    """What an attempt gives, made again after a while where that may help.

    Raises:
        StoreError: the last one failed as well, or another will not help.
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
