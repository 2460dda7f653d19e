"""Building of a whole site from a registry at a commit; the bytes do not depend on the number of processes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.jobs.site.addresses import INDEX
from calibrary.jobs.site.listing import listing
from calibrary.jobs.site.place import MARKER, is_published, replaced
from calibrary.jobs.site.words import made_at
from calibrary.jobs.site.work import Card, Job, Task, write_entries
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.git.history import changed, histories, history
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS, PROPOSALS, in_use_path, proposal_path
from calibrary.registry.registry import Registry
from calibrary.workers import mapped

__all__ = ["Progress", "Site", "build", "build_into"]

Progress = Callable[[int, int], None]
"""Called with the number of entries done and the total."""

CHUNK = 6
WORTH_A_POOL = 24
"""For fewer entries, starting worker processes takes longer than it saves."""

MOST_NEWS = 200
"""Most commits since an earlier site that are examined; for more, a full build is faster."""


class Site(Struct, frozen=True, kw_only=True):
    """A built site.

    Attributes:
        root: its folder.
        commit: the commit that it shows.
        policy: with the limits for comparisons.
        cards: rows of its list.
    """

    root: Path
    commit: str
    policy: Policy
    cards: tuple[Card, ...]


def build(registry: Path, out: Path, *, workers: int | None = None, progress: Progress | None = None) -> Site:
    """Build the site of a registry in a folder; an earlier site there is replaced as a whole.

    Args:
        registry: folder of the registry.
        out: a new or empty folder, or an earlier site.
        workers: processes; by default one per processor.
        progress: called with the number of entries done and the total.

    Raises:
        InputError: ``out`` contains something else or cannot be written; it stays unchanged.
        RegistryError: the registry cannot be read.
    """
    with replaced(out) as folder:
        site = build_into(folder, registry, published=is_published(out), workers=workers, progress=progress)
    return replace(site, root=out)


def build_into(
    folder: Path,
    registry: Path,
    *,
    former: Site | None = None,
    published: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Site:
    """Write a site into an empty folder.

    Args:
        folder: an empty folder.
        registry: folder of the registry.
        former: an earlier site of this registry built by this process; its pages are reused if still valid.
        published: whether the published files for programs are next to it.
        workers: processes; by default one per processor.
        progress: called with the number of entries done and the total.

    Raises:
        InputError: the folder cannot be written.
        RegistryError: the registry cannot be read.
    """
    opened = Registry.open(registry)
    snapshot = opened.snapshot()
    repo, shown = snapshot.require_git("has no history to show")
    job = Job(
        registry=registry.resolve(),
        commit=shown,
        policy=opened.configuration.policy,
        root=folder,
        former=former.root if former is not None else None,
        published=published,
    )
    known = _still_true(repo, former, job) if former is not None else {}
    # For a few files, git's log of each is faster than one over all commits.
    files = histories(repo, shown) if len(snapshot.paths) - len(known) >= WORTH_A_POOL else None
    tasks = [
        Task(
            path=path,
            oid=oid or "",
            is_proposed=proposal_path(path) in snapshot.proposed,
            revisions=files.get(path) if files is not None else None,
            former=known.get(path),
        )
        for path, oid in sorted(snapshot.paths.items())
    ]
    chunks = [tasks[start : start + CHUNK] for start in range(0, len(tasks), CHUNK)]
    count = (os.cpu_count() or 1) if workers is None else workers
    if len(tasks) - len(known) < WORTH_A_POOL:
        count = 1
    cards: list[Card] = []
    for some in _mapped(partial(write_entries, job=job), chunks, count):
        cards += some
        if progress is not None:
            progress(len(cards), len(tasks))
    newest = history(repo, None, shown, most=1)
    made = made_at(newest[0] if newest else None)
    try:
        (folder / INDEX).write_bytes(listing(cards, job.policy, made).encode())
        (folder / MARKER).write_text(f"{shown}\n", encoding="ascii")
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(folder)) from None
    return Site(root=folder, commit=shown, policy=job.policy, cards=tuple(cards))


def _still_true(repo: Repository, former: Site, job: Job) -> dict[str, Card]:
    """Cards by path of the entries that no commit since the earlier site has changed."""
    if former.policy != job.policy:
        return {}
    is_ancestor = repo.run("merge-base", "--is-ancestor", former.commit, job.commit, good=(0, 1)).code == 0
    news = history(repo, None, f"{former.commit}..{job.commit}", most=MOST_NEWS) if is_ancestor else ()
    if not is_ancestor or len(news) == MOST_NEWS:
        return {}
    touched = {
        in_use_path(file.path)
        for commit in news
        for parent in (commit.parents or (None,))
        for folder in (CAMERAS, PROPOSALS)
        for file in changed(repo, parent, commit.commit, folder)
    }
    return {card.path: card for card in former.cards if card.path not in touched}


def _mapped(
    write: Callable[[Sequence[Task]], list[Card]], chunks: Sequence[Sequence[Task]], workers: int
) -> Iterator[list[Card]]:
    if workers <= 1 or len(chunks) <= 1:
        yield from map(write, chunks)
        return
    try:
        yield from mapped(write, chunks, workers, preload=[__name__])
    except BrokenProcessPool:
        raise InputError(
            "a process that makes pages was ended from outside, as when memory runs out; use --workers 1"
        ) from None
