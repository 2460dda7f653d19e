"""A whole site from a registry at a commit: the same bytes from the same commit, on however many processes."""

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
"""FrameMetadata how many of how many entries are done."""

CHUNK = 6
WORTH_A_POOL = 24
"""Below this many entries starting workers costs more than it saves."""

MOST_NEWS = 200
"""Commits since an earlier site; after more of them looking at each costs more than it saves."""


class Site(Struct, frozen=True, kw_only=True):
    """A site that was built.

    Attributes:
        root: its folder.
        commit: that it shows.
        policy: whose limits it was judged by.
        cards: a row of its list each.
    """

    root: Path
    commit: str
    policy: Policy
    cards: tuple[Card, ...]


def build(registry: Path, out: Path, *, workers: int | None = None, progress: Progress | None = None) -> Site:
    """Put the site of a registry, as it is now, into a folder; an earlier site there is replaced as a whole.

    Args:
        registry: its folder.
        out: where the site goes: a new or empty folder, or an earlier site.
        workers: processes; by default one for each processor.
        progress: told how far it is.

    Raises:
        InputError: ``out`` holds something else, or cannot be written; it is as it was.
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
        folder: the empty one.
        registry: its folder.
        former: an earlier site of this registry by this process, whose pages are taken over where they are
            still true.
        published: whether the files that programs read are beside it.
        workers: processes; by default one for each processor.
        progress: told how far it is.

    Raises:
        InputError: it cannot be written.
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
    # For a few files git's own look at each is quicker than one at every commit.
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
    """The cards of entries that no commit since the earlier site has touched, by path."""
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
