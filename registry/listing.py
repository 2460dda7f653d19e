"""Selection of a snapshot's entries by words, status, grade and conditions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from calibrary.errors import RegistryError
from calibrary.registry.entry import Status
from calibrary.registry.fields import Row
from calibrary.registry.paths import id_of, in_use_path, is_entry, is_proposal
from calibrary.registry.query import Selection, parse_where, select
from calibrary.registry.snapshot import Snapshot

__all__ = ["listed"]


def listed(
    snapshot: Snapshot,
    words: Sequence[str] = (),
    *,
    statuses: Collection[str] = (),
    grades: Collection[str] = (),
    where: Sequence[str] = (),
    sort: str | None = None,
) -> tuple[Selection, tuple[RegistryError, ...]]:
    """Select entries; return them, and the errors of those that cannot be read.

    A proposal is included if its camera has no usable entry, or if drafts are asked for.

    Args:
        snapshot: state of the registry.
        words: parts of the id or label; all must occur.
        statuses: statuses to include; all if empty.
        grades: grades to include; all if empty.
        where: conditions; see :mod:`calibrary.registry.query`.
        sort: fields; see :func:`calibrary.registry.query.select`; by default entries are sorted by id.

    Raises:
        InputError: a condition or field does not exist.
    """
    conditions = [one for text in where for one in parse_where(text)]
    unreadable: list[RegistryError] = []
    paths = _named(snapshot, [word.lower() for word in words])
    found = [
        (path, _row(snapshot, path, row))
        for path, row in snapshot.rows(paths, unreadable=unreadable.append)
        if (not statuses or row["status"] in statuses)
        and (not grades or row["grade"] in grades)
        and (not is_proposal(path) or "draft" in statuses or in_use_path(path) not in snapshot.paths)
    ]
    found.sort(key=lambda one: str(one[1]["id"]))
    return select(found, conditions, sort), tuple(unreadable)


def _named(snapshot: Snapshot, words: Sequence[str]) -> Iterator[str]:
    """Yield the paths of the entries with every word in their id or label."""
    labels = snapshot.labels if words else {}
    for path in (*snapshot.paths, *filter(is_entry, snapshot.proposed)):
        label = labels.get(in_use_path(path), "") if labels else ""
        # The first word excludes nearly all entries of a large registry, before their ids are computed.
        if words and not label and words[0] not in path:
            continue
        named = f"{id_of(path)} {label}".lower()
        if all(word in named for word in words):
            yield path


def _row(snapshot: Snapshot, path: str, stated: Row) -> Row:
    """Return the fields of an entry with its id, and whether it is proposed or another proposal exists."""
    proposed = is_proposal(path) or stated["status"] == Status.DRAFT
    row = {**stated, "id": id_of(path), "proposed": proposed}
    proposal = snapshot.beside(path)
    return row if proposal is None else row | {"proposal": proposal}
