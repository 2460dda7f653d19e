"""Accumulation of image metadata: partial results merge in any order and grouping, repeatedly, to the same result.

An accumulator is a set of (image, metadata), and merging is set union, which is associative, commutative and
idempotent. Contradictions between parts are resolved at the end: an image that was read in any part counts as
read; an image with two different metadata, because it changed between two attempts, gets the one with the
smaller digest; an image with two names gets the smaller name.
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
"""Number of names kept for images with equal metadata, if not all are kept."""
UNREAD_SHOWN = 1000
"""Number of rows kept for images that cannot be read, if not all are kept."""
_FORM = b"calibrary images 1\n"


class Names(Struct, frozen=True):
    """Names of images, in the order of their folders.

    Attributes:
        listed: all names, or only the first if there are very many.
        count: number of images.
    """

    listed: tuple[str, ...]
    count: int

    @classmethod
    def of(cls, names: Iterable[str]) -> Names:
        """Names of images that are all listed."""
        listed = tuple(sorted(names, key=path_order))
        return cls(listed, len(listed))

    @classmethod
    def joined(cls, parts: list[Names]) -> Names:
        """Join several groups; if one is not listed in full, the result lists only as many names."""
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
    """The images by metadata, without dates."""
    return {metadata: {None: Names.of(names)} for metadata, names in states.items()}


ByDay = Mapping[date | None, Names]


class Flight(Struct, frozen=True, kw_only=True):
    """Metadata of all images of a run; independent of the order in which they were read.

    Attributes:
        seen: names by metadata.
        unread: images that cannot be read: all, or only the first if there are very many.
        unread_count: number of images that cannot be read.
    """

    seen: Mapping[Seen, Names]
    unread: tuple[SkippedFile, ...]
    unread_count: int

    @property
    def states(self) -> dict[ImageMetadata, tuple[str, ...]]:
        """Names by metadata without the date; the state of the first image first."""
        found: dict[ImageMetadata, list[Names]] = {}
        for seen, names in self.seen.items():
            found.setdefault(seen.metadata, []).append(names)
        return {metadata: Names.joined(parts).listed for metadata, parts in found.items()}

    @property
    def by_day(self) -> dict[ImageMetadata, ByDay]:
        """Names by metadata and date; the state of the first image first."""
        found: dict[ImageMetadata, dict[date | None, list[Names]]] = {}
        for seen, names in self.seen.items():
            found.setdefault(seen.metadata, {}).setdefault(seen.day, []).append(names)
        return {
            metadata: {day: Names.joined(parts) for day, parts in days.items()}
            for metadata, days in found.items()
        }


class _Kept:
    """Images with equal metadata: all of them, or those with the first names."""

    __slots__ = ("_most", "rows")

    def __init__(self, most: int | None) -> None:
        self._most = most
        self.rows: dict[bytes, tuple[str, str]] = {}

    def add(self, image: bytes, name: str, reason: str) -> None:
        old, new = self.rows.get(image), (name, reason)
        if old is None or _order(new) < _order(old):
            self.rows[image] = new
            # A name that is not among the first in a part is not among the first in the whole either.
            if self._most is not None and len(self.rows) > 4 * self._most:
                self.rows = dict(self.first())

    def first(self) -> list[tuple[bytes, tuple[str, str]]]:
        rows = sorted(self.rows.items(), key=lambda row: (*_order(row[1]), row[0]))
        return rows if self._most is None else rows[: self._most]


class Accumulator:
    """Metadata of the images of a part of a run.

    Its size grows with the number of different metadata, and by 16 bytes per image.

    Args:
        list_all: whether to keep the name of every image, not only the first few with equal metadata.
    """

    __slots__ = ("_ids", "_kept", "_numbers", "is_passing", "list_all")

    def __init__(self, *, list_all: bool = True) -> None:
        self.list_all = list_all
        # Whether another attempt may be able to read an image that failed; not written.
        self.is_passing = False
        self._ids = IdTable()
        # Images that cannot be read have None as metadata.
        self._numbers: dict[Seen | None, int] = {}
        self._kept: list[_Kept] = []

    @property
    def has_unread(self) -> bool:
        """Whether any added image could not be read."""
        return None in self._numbers

    def add(self, observation: Observation) -> None:
        """Add one image."""
        self.is_passing |= observation.passing
        number = self._number(observation.seen)
        self._ids.add(observation.id, number)
        self._kept[number].add(observation.id, observation.name, observation.reason)

    def merge(self, other: Accumulator) -> None:
        """Add all images of another part, which stays unchanged.

        Raises:
            ValueError: only one of the two keeps all names.
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
        """The result, with each image once."""
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
                # With very many images, all kept names may belong to images that count for other metadata.
                listed = own or [row for _, row in rows]
                groups[what] = Names(tuple(name for name, _ in listed), int(counts[number]))
        order = sorted(groups, key=lambda what: (path_order(groups[what].listed[0]), _digest(what)))
        return Flight(
            seen={what: groups[what] for what in order}, unread=tuple(unread), unread_count=unread_count
        )

    def to_bytes(self) -> bytes:
        """Serialise; equal parts give equal bytes, in whatever order their images were added."""
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
        """Restore from :meth:`to_bytes`.

        Raises:
            InputError: the data is damaged or from another version.
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
    """Serialised form of an accumulator; names may contain bytes that are not UTF-8."""

    list_all: bool
    seen: list[Seen | None]
    kept: list[list[tuple[bytes, bytes, bytes]]]
    ids: bytes


def _digest(seen: Seen | None) -> bytes:
    """Sort key for images with two different metadata: the lowest counts; "could not be read" is highest."""
    if seen is None:
        return b"\xff" * 17
    return hashlib.blake2b(msgspec.msgpack.encode(seen), digest_size=16).digest()


def _order(row: tuple[str, str]) -> tuple[str, str]:
    return path_order(row[0]), row[1]


def _to_utf8(text: str) -> bytes:
    return text.encode(errors="surrogateescape")


def _from_utf8(data: bytes) -> str:
    return data.decode(errors="surrogateescape")
