"""What became of each number of an entry, and where it became another: the raw material of a camera's page."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError
from calibrary.jobs.diff.comparison import Comparison, compare
from calibrary.keep.keeper import Keeper
from calibrary.keep.story import Chapter
from calibrary.policy import Policy
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import Revision

__all__ = ["MOST_COMPARED", "Step", "past", "steps"]

MOST_COMPARED = 100
"""Changes of one entry that get a page, the newest; few cameras are calibrated as often in their life."""


BEYOND = "Their numbers are too far from any camera's to be computed with."


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One change of an entry's calibration.

    Attributes:
        before, after: the revisions on both sides.
        comparison: None where the two cannot be compared.
        why_not: why there is none.
    """

    before: Chapter
    after: Chapter
    comparison: Comparison | None = None
    why_not: str | None = None

    @property
    def name(self) -> str:
        """By its two commits, as people shorten them."""
        return f"{self.before.revision.commit[:10]}-{self.after.revision.commit[:10]}"


def past(keeper: Keeper, revisions: tuple[Revision, ...]) -> tuple[Chapter, ...]:
    """Every revision of an entry with what it said, newest first.

    Args:
        keeper: of the registry.
        revisions: as the registry's history tells them, newest first.
    """
    entries = [_entry(keeper, revision) for revision in revisions]
    befores = [*entries[1:], None]
    return tuple(
        Chapter(revision=revision, entry=entry, before=before)
        for revision, entry, before in zip(revisions, entries, befores, strict=True)
    )


def steps(chapters: tuple[Chapter, ...], policy: Policy) -> tuple[Step, ...]:
    """Each neighbouring pair of revisions between which the calibration changed, newest first, compared."""
    readable = [chapter for chapter in chapters if chapter.entry is not None]
    changed = [
        (before, after)
        for after, before in pairwise(readable)
        if _numbers(before.entry) != _numbers(after.entry)
    ]
    return tuple(_step(before, after, policy) for before, after in changed[:MOST_COMPARED])


def _step(before: Chapter, after: Chapter, policy: Policy) -> Step:
    one, other = before.entry, after.entry
    assert one is not None and other is not None  # noqa: S101, PT018  only readable ones are paired
    try:
        comparison = compare(one.calibration, other.calibration, policy)
    except CalibraryError as error:
        return Step(before=before, after=after, why_not=str(error))
    except np.linalg.LinAlgError:
        return Step(before=before, after=after, why_not=BEYOND)
    return Step(before=before, after=after, comparison=comparison)


def _numbers(entry: Entry | None) -> tuple[object, ...]:
    """All of a calibration that a comparison looks at."""
    assert entry is not None  # noqa: S101  only readable ones are paired
    calibration: Calibration = entry.calibration
    return calibration.intrinsics, calibration.distortion, calibration.quality, calibration.grade


def _entry(keeper: Keeper, revision: Revision) -> Entry | None:
    if revision.oid is None:
        return None
    try:
        return parse_entry(keeper.registry.repo.blob(revision.oid), revision.path)
    except InputError:
        return None
