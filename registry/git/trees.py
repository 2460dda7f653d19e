"""The files of a commit, read from its trees.

The function that loads the trees verifies their hashes. git's own ``ls-tree`` and ``diff-tree`` do not: if one loose
tree is replaced by a copy of another, they list the files of another commit.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, TypeAlias

__all__ = ["REGULAR", "TREE", "Load", "Member", "difference", "members", "walk"]

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


def walk(load: Load, root: str, folder: str = "") -> Iterator[tuple[str, Member]]:
    """Yield the path of everything below a tree except trees, level by level.

    Args:
        load: loads trees.
        root: id of the tree.
        folder: its path, with a trailing slash.
    """
    level = [(folder, root)]
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
