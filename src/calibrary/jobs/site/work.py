"""Writing of one entry's pages and files of a site, and its row of the list."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
from msgspec import Struct

from calibrary.errors import InputError
from calibrary.jobs.diff.page import badge_of
from calibrary.jobs.site.addresses import Place
from calibrary.jobs.site.camera_page import camera_page
from calibrary.jobs.site.changes import step_page
from calibrary.jobs.site.downloads import Download, downloads
from calibrary.jobs.site.past import Step, steps
from calibrary.pages import Page, Tone, render_page
from calibrary.pages.parameters import stds_of
from calibrary.policy import Policy
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import Revision
from calibrary.registry.history import EntryRevision, of_path
from calibrary.registry.paths import id_of
from calibrary.registry.published.layout import camera_path
from calibrary.registry.registry import Registry

__all__ = ["Card", "Job", "Task", "entry_files", "write_entries"]

ENTRY_FORMAT = "calibrary entry"


class Card(Struct, frozen=True, kw_only=True):
    """Row of the list for an entry.

    Attributes:
        path: of its file in the registry.
        id: its longest KEY.
        page: address of its page; None if the entry cannot be read.
        problem: why it cannot be read.
        make, model, grade, lens, firmware, made_on, label, tags: from the entry.
        status: None if the entry cannot be read.
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
    fx: float | None = None
    std_fx: float | None = None
    uncertainty: str = ""
    revisions: int = 0
    verdict: tuple[str, Tone] | None = None
    files: tuple[str, ...] = ()


class Job(Struct, frozen=True, kw_only=True):
    """Settings common to all entries of a site.

    Attributes:
        registry: folder of the registry.
        commit: the commit to show.
        policy: with the limits for comparisons.
        root: output folder of the site.
        former: folder of an earlier site by the same program version; still valid pages are reused.
        published: whether the published files for programs are next to it, so that pages link to them.
    """

    registry: Path
    commit: str
    policy: Policy
    root: Path
    former: Path | None = None
    published: bool = False


class Task(Struct, frozen=True, kw_only=True):
    """One entry to write.

    Attributes:
        path: of its file.
        oid: git object id of its content.
        is_proposed: whether a proposal to replace it waits for approval.
        revisions: of its file, newest first; None if not known yet.
        former: its card in the earlier site, if still valid.
    """

    path: str
    oid: str
    is_proposed: bool = False
    revisions: tuple[Revision, ...] | None = None
    former: Card | None = None


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
    former = task.former
    if former is not None and job.former is not None:
        for address in former.files:
            _take_over(job.former / address, job.root / address)
        return former
    revisions = of_path(registry.repo, job.commit, task.path, revisions=task.revisions)
    data = registry.repo.blob(task.oid)
    id_ = id_of(task.path)
    newest = revisions[0] if revisions else None
    try:
        if newest is not None and newest.entry is not None and newest.revision.oid == task.oid:
            entry = newest.entry
        else:
            entry = parse_entry(data, task.path)
    except InputError as error:
        return Card(path=task.path, id=id_, problem=str(error), revisions=len(revisions))
    place = Place.of(task.path, proper=entry.path == task.path, published=job.published)
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
        is_proposed: whether a proposal to replace it waits for approval.
    """
    own = [*downloads(entry), _own_file(entry, data)]
    is_there = place.is_published and entry.status is not Status.DRAFT
    files = [*own, *([_published_file(entry)] if is_there else [])]
    page = camera_page(
        entry,
        id_=id_,
        place=place,
        revisions=revisions,
        changes=changes,
        files=files,
        is_proposed=is_proposed,
    )
    content = {place.page: _html(page)}
    content |= {place.file(file.name): file.data for file in own if file.name is not None}
    for step in changes:
        content[place.step(step.name)] = _html(step_page(step, id_=id_, place=place))
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
        fx=calibration.intrinsics.fx,
        std_fx=std.get("fx"),
        uncertainty="covariance"
        if quality is not None and quality.covariance is not None
        else ("σ" if std else "none"),
        revisions=len(revisions),
        verdict=verdict,
        files=files,
    )


def _own_file(entry: Entry, data: bytes) -> Download:
    name = f"{Path(entry.path).stem}-entry.yaml"
    remark = "exact"
    return Download(
        format="entry", title=ENTRY_FORMAT, name=name, data=data, remark=remark, left_out="nothing"
    )


def _published_file(entry: Entry) -> Download:
    """The published file for programs that contains the entry."""
    address = camera_path(entry.calibration.camera)
    return Download(
        format="published",
        title="for programs, over HTTP",
        name=address.rpartition("/")[2],
        remark="every entry of this camera, with the digest of its file",
        left_out="drafts, labels, tags",
        address=address,
    )


def _html(page: Page) -> bytes:
    return render_page(page).encode()


def _take_over(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with suppress(OSError):
        os.link(source, target)
        return
    shutil.copyfile(source, target)
