"""Accumulation of image metadata: partial results merge in any order and grouping, repeatedly, to the same result.

An accumulator is a set of (image, metadata), and merging is set union, which is associative, commutative and
idempotent. Contradictions between parts are resolved at the end: an image that was read in any part counts as
read; an image with two different metadata, because it changed between two attempts, gets the one with the
smaller digest; an image with two names gets the smaller name.

The table of counted images takes 16 bytes an image, independent of the order of arrival.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from itertools import pairwise
from typing import TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from calibrary.arrays import IntArray
from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.images.observation import ID_BYTES, Observation, Seen, path_order

Rows: TypeAlias = tuple[npt.NDArray[np.uint64], npt.NDArray[np.uint32], npt.NDArray[np.uint32]]
"""The first eight bytes of each id, the last four, and the number of the image's metadata."""

BUCKETS = 64
"""Rows are distributed by the first bits of the id, so that sorting needs little additional memory."""
LEAST_PENDING = 1 << 14
SHARE_PENDING = 10
"""New rows are sorted in when they are a tenth of the old: each row is then sorted about ten times in total."""

_WIRE = np.dtype([("high", ">u8"), ("low", ">u4"), ("what", "<u4")])


class IdTable:
    """A set of pairs of an image and a number."""

    __slots__ = ("_fresh", "_pending", "_pending_rows", "_rows", "_sorted")

    def __init__(self) -> None:
        self._fresh: dict[tuple[bytes, int], None] = {}
        self._pending: list[Rows] = []
        self._pending_rows = 0
        self._sorted: list[Rows | None] = [None] * BUCKETS
        self._rows = 0

    def add(self, image: bytes, what: int) -> None:
        """Add one pair."""
        self._fresh[image, what] = None
        if len(self._fresh) >= LEAST_PENDING:
            self._freeze()

    def merge(self, other: IdTable, numbers: Sequence[int]) -> None:
        """Add all pairs of another table; its number n corresponds to ``numbers[n]`` here."""
        to = np.array(numbers, dtype=np.uint32)
        other._freeze()
        # Unsorted, because pending rows of the other table need not be sorted twice.
        for high, low, what in [*other._pending, *filter(None, other._sorted)]:
            self._append((high, low, to[what]))

    def rows(self) -> Iterator[Rows]:
        """Yield every pair once, bucket by bucket, in the order of the ids."""
        self._freeze()
        self._put_in_order()
        return (rows for rows in self._sorted if rows is not None)

    def counts(self, ranks: Sequence[int]) -> tuple[IntArray, dict[bytes, int]]:
        """Count the images of each number; an image with several numbers counts for the one with the lowest rank.

        Returns:
            The counts, and the counted number of each image that has several.
        """
        total = np.zeros(len(ranks), dtype=np.int64)
        rank = np.array(ranks, dtype=np.int64)
        settled: dict[bytes, int] = {}
        for high, low, what in self.rows():
            order = np.lexsort((rank[what], low, high))
            high, low, what = high[order], low[order], what[order]  # noqa: PLW2901  in the order of ranks
            first = _is_new(high, low)
            total += np.bincount(what[first], minlength=len(ranks))
            begins = np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))
            for at in np.flatnonzero(~first):
                settled[_id(high[at], low[at])] = int(what[begins[at]])
        return total, settled

    def to_bytes(self) -> bytes:
        """Serialise for a partial result."""
        return b"".join(_packed(rows) for rows in self.rows())

    @classmethod
    def from_bytes(cls, data: bytes) -> IdTable:
        """Restore from :meth:`to_bytes`."""
        table = cls()
        table._append(_unpacked(data))
        return table

    def _freeze(self) -> None:
        if self._fresh:
            packed = b"".join(image + what.to_bytes(4, "little") for image, what in self._fresh)
            self._fresh = {}
            self._append(_unpacked(packed))

    def _append(self, rows: Rows) -> None:
        self._pending.append(rows)
        self._pending_rows += len(rows[0])
        if self._pending_rows >= max(LEAST_PENDING, self._rows // SHARE_PENDING):
            self._put_in_order()

    def _put_in_order(self) -> None:
        """Sort pending rows into the buckets; duplicates are removed."""
        if not self._pending:
            return
        high, low, what = (np.concatenate([rows[part] for rows in self._pending]) for part in range(3))
        self._pending, self._pending_rows = [], 0
        order = np.argsort(high, kind="stable")
        high, low, what = high[order], low[order], what[order]
        edges = np.searchsorted(high >> np.uint64(64 - BUCKETS.bit_length() + 1), np.arange(BUCKETS + 1))
        self._rows = 0
        for bucket, (begin, end) in enumerate(pairwise(edges)):
            if begin < end:
                new = (high[begin:end], low[begin:end], what[begin:end])
                self._sorted[bucket] = _united(self._sorted[bucket], new)
            kept = self._sorted[bucket]
            self._rows += len(kept[0]) if kept is not None else 0


def _united(old: Rows | None, new: Rows) -> Rows:
    parts = [new] if old is None else [old, new]
    high, low, what = (np.concatenate([rows[part] for rows in parts]) for part in range(3))
    order = np.lexsort((what, low, high))
    high, low, what = high[order], low[order], what[order]
    new_pair = _is_new(high, low) | np.concatenate([[True], what[1:] != what[:-1]])
    return high[new_pair], low[new_pair], what[new_pair]


def _is_new(high: npt.NDArray[np.uint64], low: npt.NDArray[np.uint32]) -> npt.NDArray[np.bool_]:
    """Mask of the rows where another image begins."""
    return np.concatenate([[True], (high[1:] != high[:-1]) | (low[1:] != low[:-1])])


def _packed(rows: Rows) -> bytes:
    packed = np.empty(len(rows[0]), dtype=_WIRE)
    packed["high"], packed["low"], packed["what"] = rows
    return packed.tobytes()


def _unpacked(data: bytes) -> Rows:
    found = np.frombuffer(data, dtype=_WIRE)
    return found["high"].astype("=u8"), found["low"].astype("=u4"), found["what"].astype("=u4")


def _id(high: np.uint64, low: np.uint32) -> bytes:
    return int(high).to_bytes(8, "big") + int(low).to_bytes(ID_BYTES - 8, "big")


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

    __slots__ = ("_ids", "_kept", "_numbers", "list_all")

    def __init__(self, *, list_all: bool = True) -> None:
        self.list_all = list_all
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
            raise InputError("a worker's result is of another version of calibrary")
        try:
            part = msgspec.msgpack.decode(data[len(_FORM) :], type=_Part)
        except msgspec.DecodeError as error:
            raise InputError(f"a worker's result is damaged: {error}") from None
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
