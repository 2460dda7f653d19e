"""History of a camera's calibration: its changes, the section of its page, and a page for each change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import date
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, first_of
from calibrary.jobs.diff.comparison import DiffReport, compare
from calibrary.jobs.diff.page import badge_of, comparison_sections
from calibrary.jobs.site.folder import Place, way
from calibrary.pages import (
    Badge,
    Block,
    Cell,
    Code,
    Column,
    Details,
    Figure,
    KeyValues,
    Link,
    Note,
    Page,
    Section,
    Table,
    Tone,
)
from calibrary.pages.plots import Axis, Series
from calibrary.pages.plots.history import history
from calibrary.pages.wording import made_by, minus, stds_of
from calibrary.policy import Policy
from calibrary.registry.entry import Entry, Status, digest
from calibrary.registry.fields import differences
from calibrary.registry.git.history import Revision
from calibrary.registry.history import EntryRevision

__all__ = ["STATUSES", "Step", "made_at", "step_page", "steps", "story"]

MOST_COMPARED: Final = 100
"""Most changes of one entry that get a page, newest first; few cameras are calibrated as often."""
MOST_REVISIONS: Final = 200
"""Most rows of the history; the log shows all."""

ALTITUDE_M: Final = 100.0
BEYOND: Final = "Their numbers are too far from any camera's to be computed with."
STATUSES: Final = {
    Status.APPROVED: Tone.GOOD,
    Status.HELD: Tone.GOOD,
    Status.DRAFT: Tone.CAUTION,
    Status.RETIRED: Tone.NEUTRAL,
}


class Step(Struct, frozen=True, kw_only=True):
    """One change of an entry's calibration.

    Attributes:
        before, after: the two revisions.
        comparison: None if the two cannot be compared.
        reason: why there is no comparison.
    """

    before: EntryRevision
    after: EntryRevision
    comparison: DiffReport | None = None
    reason: str | None = None

    @property
    def name(self) -> str:
        """Name made of its two abbreviated commits."""
        return f"{self.before.revision.commit[:10]}-{self.after.revision.commit[:10]}"


def steps(id_: str, revisions: tuple[EntryRevision, ...], policy: Policy) -> tuple[Step, ...]:
    """Compare each pair of consecutive revisions between which the calibration changed, newest first."""
    readable = [(one, one.entry.calibration) for one in revisions if one.entry is not None]
    changed = [
        (before, after) for after, before in pairwise(readable) if _numbers(before[1]) != _numbers(after[1])
    ]
    return tuple(_step(id_, before, after, policy) for before, after in changed[:MOST_COMPARED])


def _step(
    id_: str,
    older: tuple[EntryRevision, Calibration],
    newer: tuple[EntryRevision, Calibration],
    policy: Policy,
) -> Step:
    (before, one), (after, other) = older, newer
    try:
        labels = _label(id_, before), _label(id_, after)
        comparison = compare(one, other, policy, labels=labels)
    except CalibraryError as error:
        return Step(before=before, after=after, reason=str(error))
    except np.linalg.LinAlgError:
        return Step(before=before, after=after, reason=BEYOND)
    return Step(before=before, after=after, comparison=comparison)


def _numbers(calibration: Calibration) -> tuple[object, ...]:
    """The parts of a calibration that affect a comparison."""
    return calibration.intrinsics, calibration.distortion, calibration.quality, calibration.grade


def _label(id_: str, revision: EntryRevision) -> str:
    return f"{id_}@{revision.revision.commit[:10]}"


def made_at(commit: Revision | None) -> str:
    """Footer with the commit that last changed the page's content, so that the page stays the same until the next."""
    return made_by(
        f"from commit {commit.commit[:12]} of {commit.committed:%Y-%m-%d}" if commit is not None else None
    )


def step_page(step: Step, *, id_: str, place: Place) -> Page:
    """Make the page that compares one change of an entry's calibration.

    Args:
        step: the change.
        id_: the entry's longest KEY.
        place: location of the entry's page.
    """
    before, after = step.before, step.after
    back = Link(f"All of {id_}", way(place.step(step.name), place.page))
    reason = after.reason or after.revision.subject
    done = Section(
        title="What was done",
        blocks=(
            KeyValues(
                (
                    ("on", f"{after.revision.authored:%Y-%m-%d}"),
                    ("by", after.revision.author.name),
                    ("reason", reason),
                    ("firmware", f"{before.firmware or 'not stated'} → {after.firmware or 'not stated'}"),
                )
            ),
            Details(summary="Every field that changed", blocks=(_fields(after, before),)),
            back,
        ),
    )
    if step.comparison is None:
        found: tuple[Section, ...] = (
            Section(title="Verdict", blocks=(Note(text=step.reason or "", tone=Tone.CAUTION),)),
        )
        badge = Badge("not compared", Tone.CAUTION)
    else:
        found = comparison_sections(step.comparison, ALTITUDE_M)
        badge = badge_of(step.comparison)
    camera = after.entry.calibration.camera if after.entry is not None else id_
    return Page(
        title=f"Change of {camera}",
        badge=badge,
        lead=f"A is the entry of {before.revision.authored:%Y-%m-%d}, B on "
        f"{after.revision.authored:%Y-%m-%d}.",
        sections=(*found, done),
        made_by=made_at(after.revision),
    )


def story(
    id_: str, place: Place, revisions: Sequence[EntryRevision], changes: Sequence[Step]
) -> Iterator[Block]:
    """History of a camera: chart of its numbers and table of its revisions.

    Args:
        id_: the entry's longest KEY.
        place: location of the entry's page.
        revisions: of the entry, newest first.
        changes: of its calibration, newest first.
    """
    told = [revision for revision in reversed(revisions) if revision.entry is not None]
    if not told:
        yield "No history."
        return
    if len(told) > 1:
        yield _chart(_measured(told))
    by_commit = {step.after.revision.commit: step for step in changes}
    titles = (
        "date",
        "by",
        "status",
        "grade",
        "firmware",
        "fx (px)",
        "Δ fx (px)",
        "Δ cx (px)",
        "Δ cy (px)",
        "what changed",
        "reason",
    )
    numeric = {"fx (px)", "Δ fx (px)", "Δ cx (px)", "Δ cy (px)"}
    table = Table(
        caption="Every revision, newest first",
        columns=tuple(Column(title, numeric=title in numeric) for title in titles),
        rows=tuple(_row(revision, by_commit, place) for revision in revisions[:MOST_REVISIONS]),
    )
    yield Section(title="Revisions", blocks=(table,), printed=False)
    if len(revisions) > MOST_REVISIONS:
        yield Code(
            text=f"calibrary registry log {id_}",
            label=f"The command that lists all {len(revisions)} revisions",
        )
    if len(changes) == MOST_COMPARED:
        yield f"The newest {MOST_COMPARED} changes are compared here; calibrary diff compares any two."


def _measured(told: Sequence[EntryRevision]) -> list[EntryRevision]:
    """The revisions that changed the numbers, each in its last form, sorted by the date of the calibration."""
    newest: dict[str, EntryRevision] = {}
    for one in told:
        if one.entry is not None:
            newest[digest(one.entry.calibration, one.entry.sensor)] = one
    return sorted(newest.values(), key=_day)


def _day(one: EntryRevision) -> date:
    """Date of the calibration as stated by its source, else of the commit."""
    stated = one.entry.calibration.provenance.date if one.entry is not None else None
    with suppress(ValueError):
        return date.fromisoformat((stated or "")[:10])
    return one.revision.authored.date()


def _chart(told: Sequence[EntryRevision]) -> Figure:
    """Chart of fx, cx and cy over time; values at another image size than today's are gaps."""
    entries = [revision.entry for revision in told if revision.entry is not None]
    size = entries[-1].calibration.intrinsics.image_size
    same = [entry.calibration.intrinsics.image_size == size for entry in entries]

    def value(entry: Entry, name: str) -> float:
        return float(getattr(entry.calibration.intrinsics, name))

    series = [
        Series(
            axis=Axis(name, "px"),
            values=[value(entry, name) if ok else math.nan for entry, ok in zip(entries, same, strict=True)],
            std=[stds_of(entry.calibration).get(name, math.nan) for entry in entries],
        )
        for name in ("fx", "cx", "cy")
    ]
    marks = [
        (at, f"firmware {revision.firmware}")
        for at, revision in enumerate(told)
        if at > 0 and revision.firmware is not None and revision.firmware != told[at - 1].firmware
    ]
    gap = "" if all(same) else " Revisions of another image size are not drawn."
    return history(
        series,
        labels=[_day(revision).isoformat() for revision in told],
        marks=marks,
        days=[_day(revision) for revision in told],
        spans=[_valid(entry) for entry in entries],
        caption="fx, cx and cy by the day of the calibration, with ± 1 σ where it is stated; shaded: the days that it "
        f"is valid on, where the entry limits them; dashed: a new firmware.{gap}",
    )


def _valid(entry: Entry) -> tuple[date | None, date | None] | None:
    validity = entry.validity
    return (validity.first, validity.last) if validity is not None else None


def _row(one: EntryRevision, by_commit: dict[str, Step], place: Place) -> tuple[Cell, ...]:
    entry, delta, revision = one.entry, one.delta, one.revision
    gone = "removed" if revision.oid is None else "unreadable"
    change = partial(_delta, delta)
    step = by_commit.get(revision.commit)
    return (
        f"{revision.authored:%Y-%m-%d}",
        revision.author.name,
        Badge(entry.status.value, STATUSES[entry.status]) if entry is not None else Badge(gone, Tone.NEUTRAL),
        entry.calibration.grade.value if entry is not None else "–",
        one.firmware or "–",
        f"{entry.calibration.intrinsics.fx:.2f}" if entry is not None else "–",
        change("fx"),
        change("cx"),
        change("cy"),
        _what(one, step, place),
        one.reason or revision.subject,
    )


def _what(revision: EntryRevision, step: Step | None, place: Place) -> Cell:
    """Link to the comparison, or description of what else changed."""
    if step is not None:
        found: DiffReport | None = step.comparison
        verdict = found.verdict.value if found is not None else "not compared"
        return Link(f"{verdict} at {revision.revision.commit[:10]}", way(place.page, place.step(step.name)))
    if revision.entry is None:
        return "–"
    if revision.before is None:
        return "first entry"
    names = [change.name for change in differences(revision.before, revision.entry)]
    return first_of(names, 4) or "nothing"


def _fields(after: EntryRevision, before: EntryRevision) -> Table:
    changes = differences(before.entry, after.entry) if after.entry is not None else ()
    return Table(
        caption="Every field of the entry that differs",
        columns=(Column("field"), Column("before"), Column("after")),
        rows=tuple((change.name, _text(change.before), _text(change.after)) for change in changes),
    )


def _delta(delta: dict[str, float] | None, name: str) -> str:
    return minus(f"{delta[name]:+.2f}") if delta is not None and delta[name] else "–"


def _text(value: object) -> str:
    return "–" if value is None else str(value)
