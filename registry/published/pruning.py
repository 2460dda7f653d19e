"""Limits the size of the cache: removes files that no kept root refers to, oldest first.

The files of a registry's last root are always kept, whatever their size, for use without a network.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct

from calibrary.errors import CalibraryError
from calibrary.records import from_json
from calibrary.registry.published.cache import FILES, ROOTS, cached_root
from calibrary.registry.published.layout import PublishedCamera, PublishedRegistry, PublishedTree, sha256

__all__ = ["CACHE_MIB", "prune", "prune_if_due"]

CACHE_MIB: Final = "CALIBRARY_CACHE_MIB"
"""Environment variable with the largest size of the cache of published registries, in MiB."""
USUAL_MIB: Final = 256
LONGEST_S: Final = 30 * 86_400
"""Seconds that a file is kept after no root refers to it any more."""
LONGEST_UNREAD_S: Final = 365 * 86_400
"""Seconds that an unread root is kept; the newest of all is kept forever."""
EVERY_S: Final = 86_400
STAMP: Final = "pruned"
OFTEN: Final = 16
"""A process prunes again after writing this fraction of the limit."""


class _File(Struct, frozen=True):
    path: Path
    size: int
    time_s: float


def prune_if_due(folder: Path, written: int | None, more: int) -> int:
    """Prune if this was not done for a day, or much was written since; return the bytes written since pruning.

    Args:
        folder: folder of the cache.
        written: bytes written by this process since; None if it has not written yet.
        more: bytes that it has just written.
    """
    total = (written or 0) + more
    if total <= _limit() // OFTEN and (written is not None or time.time() - _time(folder / STAMP) <= EVERY_S):
        return total
    prune(folder)
    return 0


def prune(folder: Path, *, limit: int | None = None) -> int:
    """Remove old files, and files above the limit; return their number.

    Args:
        folder: folder of the cache.
        limit: bytes; by default from $CALIBRARY_CACHE_MIB.
    """
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / STAMP).touch()
    now = time.time()
    files = {one.path.name: one for one in _below(folder / FILES)}
    needed = _needed(folder / ROOTS, files, now)
    loose = sorted((one for name, one in files.items() if name not in needed), key=lambda one: one.time_s)
    total, removed = sum(one.size for one in files.values()), 0
    for one in loose:
        if now - one.time_s <= LONGEST_S and total <= (_limit() if limit is None else limit):
            break
        with suppress(OSError):
            one.path.unlink()
            total -= one.size
            removed += 1
    return removed


def _needed(roots: Path, files: Mapping[str, _File], now: float) -> set[str]:
    """Return the digests of files that kept roots refer to; remove roots that were not read for a long time."""
    found = [(cached_root(one.path), one) for one in _below(roots)]
    newest = max((root.read for root, _ in found if root is not None), default=None)
    needed: set[str] = set()
    for root, file in found:
        is_kept = root is not None and root.read == newest
        if not is_kept and now - file.time_s > LONGEST_UNREAD_S:
            with suppress(OSError):
                file.path.unlink()
        elif root is not None:
            with suppress(msgspec.MsgspecError, CalibraryError):
                state = from_json(PublishedRegistry, msgspec.json.decode(root.text))
                needed.update(_led_to(state.tree, state.depth, files))
    return needed


def _led_to(tree: Mapping[str, str], depth: int, files: Mapping[str, _File]) -> Iterator[str]:
    """Yield the existing files that a part of the tree refers to."""
    for digest in tree.values():
        data = _content(files.get(digest))
        if data is None:
            continue
        yield digest
        with suppress(msgspec.MsgspecError, CalibraryError):
            if depth:
                yield from _led_to(msgspec.json.decode(data, type=PublishedTree).tree, depth - 1, files)
                continue
            for row in msgspec.json.decode(data, type=PublishedCamera).entries:
                yield from (row.sha256, *(one.sha256 for one in row.earlier))


def _content(file: _File | None) -> bytes | None:
    if file is None:
        return None
    try:
        data = file.path.read_bytes()
    except OSError:
        return None
    return data if sha256(data) == file.path.name else None


def _below(folder: Path) -> Iterator[_File]:
    for at, _, names in os.walk(folder):
        for name in names:
            path = Path(at, name)
            with suppress(OSError):
                found = path.stat()
                yield _File(path, found.st_size, found.st_mtime)


def _time(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0


def _limit() -> int:
    stated = os.environ.get(CACHE_MIB, "")
    return (int(stated) if stated.isdecimal() else USUAL_MIB) << 20
