"""Table of counted images and their metadata: 16 bytes per image, independent of the order of arrival."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from calibrary.arrays import IntArray
from calibrary.jobs.images.observation import ID_BYTES

__all__ = ["IdTable"]

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
