"""What any number of images say, merged in any order, grouping and number of times to the same.

A set of (image, what it says) is all that is kept, and united: union is associative, commutative and idempotent, and
nothing depends on which part came first. What two parts disagree about is settled once, when all is there: an
image that was read somewhere is read; one that said two things, because it was changed between two attempts,
counts for the one with the smaller digest, and one with two names has the smaller.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from datetime import date

import msgspec
from msgspec import Struct

from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.images.id_table import IdTable
from calibrary.jobs.images.observation import Observation, Seen, path_order

__all__ = ["EXAMPLES", "Accumulator", "Flight", "Names", "undated"]

EXAMPLES = 8
"""Names that are kept of images that say the same, where not all are."""
UNREAD_SHOWN = 1000
"""Rows that are kept of images that cannot be read, where not all are."""
_FORM = b"calibrary images 1\n"


class Names(Struct, frozen=True):
    """Images by name, in the order of their folders.

    Attributes:
        listed: all of them, or the first of very many.
        count: how many there are.
    """

    listed: tuple[str, ...]
    count: int

    @classmethod
    def of(cls, names: Iterable[str]) -> Names:
        """All of some images."""
        listed = tuple(sorted(names, key=path_order))
        return cls(listed, len(listed))

    @classmethod
    def joined(cls, parts: list[Names]) -> Names:
        """Several groups of images as one; where one of them is not listed in full, only as much of the whole."""
        if len(parts) == 1:
            return parts[0]
        names = sorted((name for part in parts for name in part.listed), key=path_order)
        whole = all(part.is_whole for part in parts)
        return cls(tuple(names if whole else names[:EXAMPLES]), sum(part.count for part in parts))

    @property
    def is_whole(self) -> bool:
        """Whether every image is listed."""
        return len(self.listed) == self.count


def undated(states: Mapping[ImageMetadata, Sequence[str]]) -> dict[ImageMetadata, ByDay]:
    """All of some images by what they say, no day among it."""
    return {metadata: {None: Names.of(names)} for metadata, names in states.items()}


ByDay = Mapping[date | None, Names]


class Flight(Struct, frozen=True, kw_only=True):
    """What all images of a run say, settled; nothing in it depends on the order in which they were read.

    Attributes:
        seen: names by what they say.
        unread: images that nothing can be read from: all of them, or the first of very many.
        unread_count: how many of them there are.
    """

    seen: Mapping[Seen, Names]
    unread: tuple[SkippedFile, ...]
    unread_count: int

    @property
    def states(self) -> dict[ImageMetadata, tuple[str, ...]]:
        """The names by metadata alone, the state of the first image first."""
        found: dict[ImageMetadata, list[Names]] = {}
        for seen, names in self.seen.items():
            found.setdefault(seen.metadata, []).append(names)
        return {metadata: Names.joined(parts).listed for metadata, parts in found.items()}

    @property
    def by_day(self) -> dict[ImageMetadata, ByDay]:
        """The names by metadata and by day, the state of the first image first."""
        found: dict[ImageMetadata, dict[date | None, list[Names]]] = {}
        for seen, names in self.seen.items():
            found.setdefault(seen.metadata, {}).setdefault(seen.day, []).append(names)
        return {
            metadata: {day: Names.joined(parts) for day, parts in days.items()}
            for metadata, days in found.items()
        }


class _Kept:
    """Some images that say the same: all of them, or those with the first names."""

    __slots__ = ("_most", "rows")

    def __init__(self, most: int | None) -> None:
        self._most = most
        self.rows: dict[bytes, tuple[str, str]] = {}

    def add(self, image: bytes, name: str, reason: str) -> None:
        old, new = self.rows.get(image), (name, reason)
        if old is None or _order(new) < _order(old):
            self.rows[image] = new
            # What is beyond the first so many in a part is beyond them in the whole as well.
            if self._most is not None and len(self.rows) > 4 * self._most:
                self.rows = dict(self.first())

    def first(self) -> list[tuple[bytes, tuple[str, str]]]:
        rows = sorted(self.rows.items(), key=lambda row: (*_order(row[1]), row[0]))
        return rows if self._most is None else rows[: self._most]


class Accumulator:
    """What the images of a part of a run say.

    Its size grows with the number of different things said, and by sixteen bytes an image.

    Args:
        list_all: keep the name of every image, not only the first few of those that say the same.
    """

    __slots__ = ("_ids", "_kept", "_numbers", "is_passing", "list_all")

    def __init__(self, *, list_all: bool = True) -> None:
        self.list_all = list_all
        # Whether another attempt may read an image that this one could not; no part of what is written.
        self.is_passing = False
        self._ids = IdTable()
        # Images that cannot be read are those that say None.
        self._numbers: dict[Seen | None, int] = {}
        self._kept: list[_Kept] = []

    @property
    def has_unread(self) -> bool:
        """Whether nothing could be read from some image that was taken in."""
        return None in self._numbers

    def add(self, observation: Observation) -> None:
        """Take in one image."""
        self.is_passing |= observation.passing
        number = self._number(observation.seen)
        self._ids.add(observation.id, number)
        self._kept[number].add(observation.id, observation.name, observation.reason)

    def merge(self, other: Accumulator) -> None:
        """Take in all that another part has; that one stays as it is.

        Raises:
            ValueError: one of them keeps every name and the other does not.
        """
        if other.list_all != self.list_all:
            raise ValueError("one part keeps the name of every image and the other does not")
        self.is_passing |= other.is_passing
        numbers = [self._number(seen) for seen in other._numbers]
        self._ids.merge(other._ids, numbers)
        for number, kept in zip(numbers, other._kept, strict=True):
            for image, (name, reason) in kept.rows.items():
                self._kept[number].add(image, name, reason)

    def settled(self) -> Flight:
        """All that was taken in, each image once."""
        seen = [*self._numbers]
        by_digest = sorted(range(len(seen)), key=lambda number: _digest(seen[number]))
        ranks = [0] * len(seen)
        for rank, number in enumerate(by_digest):
            ranks[number] = rank
        counts, settled = self._ids.counts(ranks)
        groups: dict[Seen, Names] = {}
        unread: list[SkippedFile] = []
        unread_count = 0
        for what, number in self._numbers.items():
            rows = self._kept[number].first()
            own = [row for image, row in rows if settled.get(image, number) == number]
            if what is None:
                unread_count = int(counts[number])
                unread = [SkippedFile(name=name, reason=reason) for name, reason in own]
            elif counts[number]:
                # Of very many images all those that are kept by name may count for something else.
                listed = own or [row for _, row in rows]
                groups[what] = Names(tuple(name for name, _ in listed), int(counts[number]))
        order = sorted(groups, key=lambda what: (path_order(groups[what].listed[0]), _digest(what)))
        return Flight(
            seen={what: groups[what] for what in order}, unread=tuple(unread), unread_count=unread_count
        )

    def to_bytes(self) -> bytes:
        """As a file or another process holds it; equal for equal parts, whatever order they were taken in."""
        order = sorted(self._numbers.items(), key=lambda item: _digest(item[0]))
        ids = IdTable()
        at = {number: place for place, (_, number) in enumerate(order)}
        ids.merge(self._ids, [at[number] for number in range(len(at))])
        part = _Part(
            list_all=self.list_all,
            seen=[what for what, _ in order],
            kept=[
                [(image, _to_utf8(name), _to_utf8(reason)) for image, (name, reason) in self._kept[n].first()]
                for _, n in order
            ],
            ids=ids.to_bytes(),
        )
        return _FORM + msgspec.msgpack.encode(part)

    @classmethod
    def from_bytes(cls, data: bytes) -> Accumulator:
        """What :meth:`to_bytes` gave.

        Raises:
            InputError: it is damaged, or of another version.
        """
        if not data.startswith(_FORM):
            raise InputError("is not a partial result of this version; remove it")
        try:
            part = msgspec.msgpack.decode(data[len(_FORM) :], type=_Part)
        except msgspec.DecodeError as error:
            raise InputError(f"is a damaged partial result: {error}; remove it") from None
        found = cls(list_all=part.list_all)
        for what, rows in zip(part.seen, part.kept, strict=True):
            number = found._number(what)
            for image, name, reason in rows:
                found._kept[number].add(image, _from_utf8(name), _from_utf8(reason))
        found._ids = IdTable.from_bytes(part.ids)
        return found

    def _number(self, seen: Seen | None) -> int:
        number = self._numbers.setdefault(seen, len(self._numbers))
        if number == len(self._kept):
            most = UNREAD_SHOWN if seen is None else EXAMPLES
            self._kept.append(_Kept(None if self.list_all else most))
        return number


class _Part(msgspec.Struct, frozen=True):
    """The written form of an accumulator; names in it may hold what is not UTF-8."""

    list_all: bool
    seen: list[Seen | None]
    kept: list[list[tuple[bytes, bytes, bytes]]]
    ids: bytes


def _digest(seen: Seen | None) -> bytes:
    """What images that say two things are settled by; the lowest of all but "nothing could be read"."""
    if seen is None:
        return b"\xff" * 17
    return hashlib.blake2b(msgspec.msgpack.encode(seen), digest_size=16).digest()


def _order(row: tuple[str, str]) -> tuple[str, str]:
    return path_order(row[0]), row[1]


def _to_utf8(text: str) -> bytes:
    return text.encode(errors="surrogateescape")


def _from_utf8(data: bytes) -> str:
    return data.decode(errors="surrogateescape")
