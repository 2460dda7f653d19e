"""Objects of a git repository from ``git cat-file --batch``: an id, a kind, and content verified by the id."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import IO, Annotated, Final, TypeAlias, cast

from msgspec import Meta, Struct

from calibrary.registry.git.errors import TooLargeError

HEX: Final = re.compile(r"[0-9a-f]{40}\Z")
ObjectId: TypeAlias = Annotated[str, Meta(pattern="^[0-9a-f]{40}$")]
LARGEST_FILE: Final = 1 << 20
"""Bytes; an entry with a full covariance has about 4000."""


Answer: TypeAlias = tuple[str, bytes, bytes]
"""Id, kind and content."""


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

    def ask(self, names: Sequence[str]) -> list[Answer | None]:
        """Return the id, kind and content of named objects; ``None`` for those that do not exist.

        Args:
            names: names of objects, so few that a pipe holds all of them while git waits to be read.

        Raises:
            EOFError: the process has ended.
            RegistryError: an object is larger than any file of a registry.
        """
        # Unbuffered: buffered data would be sent twice after a fork.
        try:
            os.write(self._questions, b"".join(os.fsencode(name) + b"\n" for name in names))
        except BrokenPipeError:
            raise EOFError from None
        found = list[Answer | None]()
        for _ in names:
            header = self._answers.readline()
            parts = header.split()
            if not header.endswith(b"\n"):
                raise EOFError
            if len(parts) != 3 or HEX.match(parts[0].decode("ascii", "replace")) is None:
                found.append(None)
                continue
            size = int(parts[2])
            if size > LARGEST_FILE and parts[1] == b"blob":
                self.close()
                raise TooLargeError(f"{size} bytes, expected at most {LARGEST_FILE}")
            data = self._answers.read(size + 1)[:-1]
            if len(data) != size:
                raise EOFError
            found.append((parts[0].decode(), parts[1], data))
        return found

    def close(self) -> None:
        """End the process, unless it belongs to the parent of a fork."""
        _end(self._process, self.pid)


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    """End a reader process; after a fork it belongs to the parent."""
    if os.getpid() == owner:
        process.kill()
        process.communicate()


Member: TypeAlias = tuple[bytes, str]
"""Mode and id."""
Load: TypeAlias = Callable[[Sequence[str]], Iterable[bytes]]
"""Returns the content of trees, in the order of their ids."""

TREE: Final = b"40000"
REGULAR: Final = frozenset({b"100644", b"100755"})
"""Modes of files; the others are links and submodules."""


def members(data: bytes) -> dict[str, Member]:
    """Return the members of a tree by name."""
    found, at = {}, 0
    while at < len(data):
        blank = data.index(b" ", at)
        end = data.index(b"\0", blank)
        found[os.fsdecode(data[blank + 1 : end])] = (data[at:blank], data[end + 1 : end + 21].hex())
        at = end + 21
    return found


def walk(load: Load, folders: Iterable[tuple[str, str]]) -> Iterator[tuple[str, Member]]:
    """Yield the path of everything below trees except trees, level by level.

    Args:
        load: loads trees.
        folders: their paths, with a trailing slash, and ids.
    """
    level = [*folders]
    while level:
        below = []
        for (prefix, _), data in zip(level, load([oid for _, oid in level]), strict=True):
            for name, (mode, oid) in members(data).items():
                if mode == TREE:
                    below.append((f"{prefix}{name}/", oid))
                else:
                    yield f"{prefix}{name}", (mode, oid)
        level = below


def difference(
    load: Load, old: str | None, new: str | None, folder: str = ""
) -> Iterator[tuple[str, Member | None, Member | None]]:
    """Yield the paths that differ between two trees, with both members; only trees that differ are loaded.

    Args:
        load: loads trees.
        old: id of the first tree; None is an empty one.
        new: id of the second tree.
        folder: their path, with a trailing slash.
    """
    level = [(folder, old, new)] if old != new else []
    while level:
        wanted = [oid for _, *pair in level for oid in pair if oid is not None]
        loaded = iter(load(wanted))
        below = []
        for prefix, one, other in level:
            before = members(next(loaded)) if one is not None else {}
            after = members(next(loaded)) if other is not None else {}
            for name in before.keys() | after.keys():
                was, becomes = before.get(name), after.get(name)
                if was == becomes:
                    continue
                (file_was, tree_was), (file_becomes, tree_becomes) = _parted(was), _parted(becomes)
                if tree_was != tree_becomes:
                    below.append((f"{prefix}{name}/", tree_was, tree_becomes))
                if file_was != file_becomes:
                    yield f"{prefix}{name}", file_was, file_becomes
        level = below


def _parted(member: Member | None) -> tuple[Member | None, str | None]:
    """Return a member as (file, None), or as (None, id of a tree)."""
    if member is not None and member[0] == TREE:
        return None, member[1]
    return member, None
