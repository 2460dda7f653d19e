"""Objects of a git repository from ``git cat-file --batch``: an id, a kind, and content verified by the id."""

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
"""Bytes; an entry with a full covariance has about 4000."""


class Blob(Struct, frozen=True):
    """Stored content of a file.

    Attributes:
        oid: git's id of it, 40 hex digits.
    """

    oid: str
    data: bytes


def blob_id(data: bytes) -> str:
    """Return git's id of a file content."""
    return object_id(b"blob", data)


def object_id(kind: bytes, data: bytes) -> str:
    """Return git's id of an object: the SHA-1 of its header and content."""
    digest = hashlib.sha1(b"%s %d\0" % (kind, len(data)), usedforsecurity=False)
    digest.update(data)
    return digest.hexdigest()


class ObjectReader:
    """A ``git cat-file --batch`` process, used by one thread of one process."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        """Take over a process that was just started."""
        self.pid = os.getpid()
        self._process = process
        # The finalizer references the process, so that its pipes are closed here, whatever is collected first.
        weakref.finalize(self, _end, process, self.pid)
        self._questions = cast("IO[bytes]", process.stdin).fileno()
        self._answers = cast("IO[bytes]", process.stdout)

    def ask(self, name: str) -> tuple[str, bytes, bytes] | None:
        """Return the id, kind and content of a named object; ``None`` if it does not exist.

        Raises:
            EOFError: the process has ended.
            RegistryError: the object is larger than any file of a registry.
        """
        # Unbuffered: buffered data would be sent twice after a fork.
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
        """End the process, unless it belongs to the parent of a fork."""
        _end(self._process, self.pid)


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    """End a reader process; after a fork it belongs to the parent."""
    if os.getpid() == owner:
        process.kill()
        process.communicate()
