"""Building of a whole site from a registry at a commit; the bytes do not depend on the number of processes.

Its first page is the list of all cameras: a plain table, with a small script for searching, filtering and sorting.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from functools import cache, partial
from importlib import resources
from pathlib import Path

import numpy as np
from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.jobs.diff.told import badge_of
from calibrary.jobs.site.camera_page import (
    STATUSES,
    Step,
    camera_page,
    downloads,
    made_at,
    step_page,
    steps,
)
from calibrary.jobs.site.folder import INDEX, MARKER, Place, replaced, way
from calibrary.pages import render_page
from calibrary.pages.wording import count, stds_of
from calibrary.policy import Policy
from calibrary.probability import two_digits
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git.history import Revision, histories, history
from calibrary.registry.history import EntryRevision, of_path
from calibrary.registry.paths import id_of, proposed_name
from calibrary.registry.registry import Registry
from calibrary.registry.standing import Evidence
from calibrary.registry.statements import entry_path
from calibrary.view import Badge, Cell, Column, Link, Note, Section, Table, Tone, View
from calibrary.workers import mapped

Progress = Callable[[int, int], None]
"""Called with the number of entries done and the total."""

CHUNK = 6
WORTH_A_POOL = 24
"""For fewer entries, starting worker processes takes longer than it saves."""


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

    @property
    def is_whole(self) -> bool:
        """Whether every entry has a page."""
        return all(card.page is not None for card in self.cards)


def build(
    registry: Path,
    out: Path,
    *,
    workers: int = 0,
    progress: Progress | None = None,
) -> Site:
    """Build the site of a registry in a folder; an earlier site there is replaced as a whole.

    Args:
        registry: folder of the registry.
        out: a new or empty folder, or an earlier site.
        workers: processes; 0 for one per processor.
        progress: called with the number of entries done and the total.

    Raises:
        InputError: ``out`` contains something else or cannot be written; it stays unchanged.
        RegistryError: the registry cannot be read.
    """
    with replaced(out) as folder:
        site = build_into(folder, registry, workers=workers, progress=progress)
    return replace(site, root=out)


def build_into(
    folder: Path,
    registry: Path,
    *,
    workers: int = 0,
    progress: Progress | None = None,
) -> Site:
    """Write a site into an empty folder.

    Args:
        folder: an empty folder.
        registry: folder of the registry.
        workers: processes; 0 for one per processor.
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
        policy=snapshot.policy,
        root=folder,
    )
    # For a few files, git's log of each is faster than one over all commits.
    files = histories(repo, shown, entry_path) if len(snapshot.paths) >= WORTH_A_POOL else None
    tasks = [
        Task(
            path=path,
            is_proposed=proposed_name(path) in snapshot.proposed,
            revisions=files.get(path) if files is not None else None,
        )
        for path in sorted(snapshot.paths)
    ]
    chunks = [tasks[start : start + CHUNK] for start in range(0, len(tasks), CHUNK)]
    count = 1 if len(tasks) < WORTH_A_POOL else workers or os.cpu_count() or 1
    cards: list[Card] = []
    write = partial(write_entries, job=job)
    for some in mapped(write, chunks, count, preload=[__name__], does="makes pages"):
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


class Job(Struct, frozen=True, kw_only=True):
    """Settings common to all entries of a site.

    Attributes:
        registry: folder of the registry.
        commit: the commit to show.
        policy: with the limits for comparisons.
        root: output folder of the site.
    """

    registry: Path
    commit: str
    policy: Policy
    root: Path


class Task(Struct, frozen=True, kw_only=True):
    """One entry to write.

    Attributes:
        path: of its file.
        is_proposed: whether a proposal to replace it waits for approval.
        revisions: of its file, newest first; None if not known yet.
    """

    path: str
    is_proposed: bool = False
    revisions: tuple[Revision, ...] | None = None


def write_entries(tasks: Sequence[Task], *, job: Job) -> list[Card]:
    """Write the pages and files of entries.

    Raises:
        RegistryError: the registry's history cannot be read.
        InputError: the disk is full or not writable.
    """
    registry = _registry(job.registry)
    try:
        return [_write_entry(task, job, registry) for task in tasks]
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(job.root)) from None


@cache
def _registry(place: Path) -> Registry:
    """The registry, opened once per process."""
    return Registry.open(place)


def _write_entry(task: Task, job: Job, registry: Registry) -> Card:
    revisions = of_path(registry.repo, job.commit, task.path, revisions=task.revisions)
    id_ = id_of(task.path)
    try:
        snapshot = registry.snapshot(job.commit)
        data, entry = snapshot.read(task.path), snapshot.entry(task.path)
    except (InputError, RegistryError) as error:
        return Card(path=task.path, id=id_, problem=str(error), revisions=len(revisions))
    place = Place.of(task.path, proper=entry.path == task.path)
    # An entry may contain any finite number; values that overflow are shown as unknown.
    with np.errstate(all="ignore"):
        changes = steps(id_, revisions, job.policy)
        content = entry_files(
            entry,
            data=data,
            id_=id_,
            place=place,
            revisions=revisions,
            changes=changes,
            approvals=snapshot.standing(task.path).approvals,
            is_proposed=task.is_proposed,
        )
    for folder in {str(Path(address).parent) for address in content}:
        (job.root / folder).mkdir(parents=True, exist_ok=True)
    for address, written in content.items():
        (job.root / address).write_bytes(written)
    return _card(entry, task.path, place, revisions, changes, tuple(content))


def entry_files(
    entry: Entry,
    *,
    data: bytes,
    id_: str,
    place: Place,
    revisions: Sequence[EntryRevision],
    changes: Sequence[Step],
    approvals: Sequence[Evidence] = (),
    is_proposed: bool = False,
) -> dict[str, bytes]:
    """All files of an entry in a site, by address: its page, its downloads, a page for each change.

    Args:
        entry: the present entry.
        data: content of its file.
        id_: its longest KEY.
        place: location of its pages.
        revisions: newest first.
        changes: of its calibration, newest first.
        approvals: of the entry.
        is_proposed: whether a proposal to replace it waits for approval.
    """
    own = downloads(entry, data)
    page = camera_page(
        entry,
        id_=id_,
        place=place,
        revisions=revisions,
        changes=changes,
        files=own,
        approvals=approvals,
        is_proposed=is_proposed,
    )
    content = {place.page: render_page(page).encode()}
    content |= {place.file(file.name): file.data for file in own if file.name is not None}
    for step in changes:
        content[place.step(step.name)] = render_page(step_page(step, id_=id_, place=place)).encode()
    return content


def _card(
    entry: Entry,
    path: str,
    place: Place,
    revisions: Sequence[EntryRevision],
    changes: Sequence[Step],
    files: tuple[str, ...],
) -> Card:
    calibration = entry.calibration
    std, lens, quality = stds_of(calibration), calibration.distortion, calibration.quality
    newest = changes[0] if changes else None
    verdict: tuple[str, Tone] | None = None
    if newest is not None:
        found = badge_of(newest.comparison) if newest.comparison is not None else None
        verdict = (found.text, found.tone) if found is not None else ("not compared", Tone.CAUTION)
    return Card(
        path=path,
        id=id_of(path),
        page=place.page,
        make=calibration.camera.make or "",
        model=calibration.camera.model or "",
        status=entry.status,
        grade=calibration.grade.value,
        lens=lens.model if lens is not None else "unknown",
        firmware=(calibration.provenance.firmware or "") or (str(entry.firmware) if entry.firmware else ""),
        label=entry.label or "",
        tags=" ".join(entry.tags),
        made_on=(calibration.provenance.date or "")[:10],
        pixels=math.prod(calibration.intrinsics.image_size),
        fx=calibration.intrinsics.fx,
        std_fx=std.get("fx"),
        uncertainty="covariance"
        if quality is not None and quality.covariance is not None
        else ("σ" if std else "none"),
        revisions=len(revisions),
        verdict=verdict,
        files=files,
    )


# The style sheet shows the first nine columns, on a phone three; the others serve for searching and filtering.
COLUMNS = (
    Column("camera"),
    Column("status"),
    Column("fx (px)", numeric=True),
    Column("σ of fx (px)", numeric=True),
    Column("label"),
    Column("last change"),
    Column("grade"),
    Column("firmware"),
    Column("calibrated on"),
    Column("lens"),
    Column("uncertainty"),
    Column("revisions", numeric=True),
    Column("make"),
    Column("model"),
    Column("tags"),
)


class Card(Struct, frozen=True, kw_only=True):
    """Row of the list for an entry.

    Attributes:
        path: of its file in the registry.
        id: its longest KEY.
        page: address of its page; None if the entry cannot be read.
        problem: why it cannot be read.
        make, model, grade, lens, firmware, made_on, label, tags: from the entry.
        status: None if the entry cannot be read.
        pixels: number of those of an image.
        fx, std_fx: px.
        uncertainty: kind of uncertainty that it states.
        revisions: number of revisions.
        verdict: of the newest change of the calibration, with its tone.
        files: addresses of all written files.
    """

    path: str
    id: str
    page: str | None = None
    problem: str | None = None
    make: str = ""
    model: str = ""
    status: Status | None = None
    grade: str = ""
    lens: str = ""
    firmware: str = ""
    made_on: str = ""
    label: str = ""
    tags: str = ""
    pixels: int = 0
    fx: float | None = None
    std_fx: float | None = None
    uncertainty: str = ""
    revisions: int = 0
    verdict: tuple[str, Tone] | None = None
    files: tuple[str, ...] = ()


def listing(cards: Sequence[Card], policy: Policy, made_by: str) -> str:
    """Make the page as HTML.

    Args:
        cards: in the order of the list.
        policy: of the registry.
        made_by: for the footer.
    """
    readable = [card for card in cards if card.page is not None]
    broken = [card for card in cards if card.page is None]
    usable = sum(card.status is not None and card.status.is_usable for card in readable)
    drafts = sum(card.status is Status.DRAFT for card in readable)
    parts = [f"{count(len(readable), 'camera')}, {usable} of them in use"]
    parts += [f"{count(drafts, 'draft')} to approve"] if drafts else []
    parts += [f"{len(broken)} that cannot be read"] if broken else []
    sections = []
    if broken:
        sections.append(
            Section(
                title="What cannot be read",
                blocks=(
                    Note(
                        text="These files are not entries; nothing is shown of them.",
                        action="calibrary registry check names what to correct",
                        tone=Tone.BAD,
                    ),
                    Table(
                        caption="Entries that cannot be read",
                        columns=(Column("entry"), Column("reason")),
                        rows=tuple((card.id, card.problem or "") for card in broken),
                    ),
                ),
            )
        )
    if readable:
        table = Table(
            caption="Every camera of the registry; its name leads to its page",
            columns=COLUMNS,
            rows=tuple(
                _row(card, card.page, card.status)
                for card in cards
                if card.page is not None and card.status is not None
            ),
        )
        sections.insert(0, Section(title="Cameras", anchor="all-cameras", blocks=(table,)))
    else:
        empty = Note(
            text="The registry contains no camera yet.", action="calibrary registry add FILE puts one in"
        )
        sections.insert(0, Section(title="Cameras", anchor="all-cameras", blocks=(empty,)))
    page = View(
        title="Camera registry",
        lead=f"{'; '.join(parts)}. Checked against the {policy.name} policy.",
        sections=tuple(sections),
        contents=False,
        made_by=made_by,
    )
    return render_page(page, script=_script() if readable else None)


def _row(card: Card, page: str, status: Status) -> tuple[Cell, ...]:
    return (
        Link(card.id, way(INDEX, page)),
        Badge(status.value, STATUSES[status]),
        f"{card.fx:.2f}" if card.fx is not None else "–",
        two_digits(card.std_fx) if card.std_fx is not None else "–",
        card.label or "–",
        Badge(*card.verdict) if card.verdict is not None else "–",
        card.grade,
        card.firmware or "–",
        card.made_on or "–",
        card.lens,
        card.uncertainty,
        str(card.revisions),
        card.make,
        card.model,
        card.tags or "–",
    )


def _script() -> str:
    return resources.files("calibrary.jobs.site").joinpath("list.js").read_text(encoding="utf-8")
