"""Objects of a git repository as ``git cat-file --batch`` answers them: an id, a kind, and bytes that fit the id."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import weakref
from typing import IO, Annotated, Final, TypeAlias, cast

from msgspec import Meta, Struct

from calibrary.errors import RegistryError

__all__ = ["HEX", "LARGEST_FILE", "Blob", "ObjectId", "ObjectReader", "blob_id", "object_id"]

HEX: Final = re.compile(r"[0-9a-f]{40}\Z")
ObjectId: TypeAlias = Annotated[str, Meta(pattern="^[0-9a-f]{40}$")]
LARGEST_FILE: Final = 1 << 20
"""Bytes; an entry with a full covariance takes some four thousand."""


class Blob(Struct, frozen=True):
    """A file's content as it was stored.

    Attributes:
        oid: git's name for it, 40 hex digits.
    """

    oid: str
    data: bytes


def blob_id(data: bytes) -> str:
    """What git calls this content."""
    return object_id(b"blob", data)


def object_id(kind: bytes, data: bytes) -> str:
    """What git calls an object of a kind: the SHA-1 of its header and content."""
    digest = hashlib.sha1(b"%s %d\0" % (kind, len(data)), usedforsecurity=False)
    digest.update(data)
    return digest.hexdigest()


class ObjectReader:
    """A ``git cat-file --batch`` that belongs to one thread of one process."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        """Take over a process that has just been started."""
        self.pid = os.getpid()
        self._process = process
        # Held from outside, so that its pipes are closed by us in whatever order garbage is collected.
        weakref.finalize(self, _end, process, self.pid)
        self._questions = cast("IO[bytes]", process.stdin).fileno()
        self._answers = cast("IO[bytes]", process.stdout)

    def ask(self, name: str) -> tuple[str, bytes, bytes] | None:
        """The id, kind and content of what a name means; ``None`` if there is no such thing.

        Raises:
            EOFError: the process has died.
            RegistryError: it is larger than any file of a registry.
        """
        # Past the buffer: what waits in one at a fork would be sent twice.
        try:
            os.write(self._questions, os.fsencode(name) + b"\n")
        except BrokenPipeError:
            raise EOFError from None
        header = self._answers.readline()
        parts = header.split()
        if not header.endswith(b"\n"):
            raise EOFError
        if len(parts) != 3 or HEX.match(parts[0].decode("ascii", "replace")) is None:
            return None
        size = int(parts[2])
        if size > LARGEST_FILE and parts[1] == b"blob":
            self.close()
            raise RegistryError(f"{name}: {size} bytes, expected at most {LARGEST_FILE}")
        data = self._answers.read(size + 1)[:-1]
        if len(data) != size:
            raise EOFError
        return parts[0].decode(), parts[1], data

    def close(self) -> None:
        """End the process, unless it is the other side's of a fork."""
        _end(self._process, self.pid)


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    """End a reader; on the other side of a fork it belongs to the other process."""
    if os.getpid() == owner:
        process.kill()
        process.communicate()
