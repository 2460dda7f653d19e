"""The stream that one atomic commit is written by: ``git fast-import``'s language, as bytes.

Two lines of it carry the promise. ``feature done`` makes a stream that breaks off an error instead of a
commit of what had arrived. ``from <commit>`` pins the parent that was read: git refuses to move the branch when
somebody else moved it meanwhile (git-fast-import(1)).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

from calibrary.errors import RegistryError

__all__ = ["File", "Person", "Step", "stream"]

DROPPED = str.maketrans("", "", "<>\n\r\0")


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """Who answers for a commit."""

    name: str
    email: str

    def at(self, moment: datetime) -> bytes:
        """As git writes it, with the moment in seconds and the zone it was told in."""
        name, email = (text.translate(DROPPED).strip() for text in (self.name, self.email))
        return f"{name or email} <{email}> {int(moment.timestamp())} {moment:%z}".encode()


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """One file of a commit.

    Attributes:
        data: its whole new content; ``None`` removes it.
    """

    path: str
    data: bytes | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One commit of a stream.

    Attributes:
        authored: when it was first made; ``committed`` is when it came to stand where it stands.
    """

    files: Sequence[File]
    message: str
    author: Person
    authored: datetime
    committer: Person
    committed: datetime


def stream(ref: str, parent: str | None, steps: Sequence[Step]) -> bytes:
    """Commits one after the other on a ref; git prints the id of each.

    Args:
        ref: full name of the branch, ``refs/heads/…``.
        parent: 40 hex digits of the commit that was read; ``None`` begins a history.
        steps: at least one.

    Raises:
        RegistryError: a moment states no time zone.
    """
    parts = [b"feature done\n"]
    origin = parent
    for number, step in enumerate(steps, start=1):
        parts += _commit(ref, origin, step, number)
        origin = f":{number}"
    parts.append(b"done\n")
    return b"".join(parts)


def _commit(ref: str, origin: str | None, step: Step, number: int) -> Iterable[bytes]:
    if step.authored.tzinfo is None or step.committed.tzinfo is None:
        raise RegistryError("the time of a commit states no zone: wanted one with an offset from UTC")
    yield f"commit {ref}\nmark :{number}\n".encode()
    yield b"author " + step.author.at(step.authored) + b"\n"
    yield b"committer " + step.committer.at(step.committed) + b"\n"
    yield from _data(step.message.replace("\0", "").encode())
    if origin is not None:
        yield f"from {origin}\n".encode()
    # What goes first: a file may take the place of a folder that this very commit empties.
    for file in sorted(step.files, key=lambda file: file.data is not None):
        if file.data is None:
            yield f"D {file.path}\n".encode()
        else:
            yield f"M 100644 inline {file.path}\n".encode()
            yield from _data(file.data)
    yield f"get-mark :{number}\n".encode()


def _data(content: bytes) -> Iterable[bytes]:
    yield b"data %d\n" % len(content)
    yield content
    yield b"\n"
