"""The changes of an entry's calibration over its revisions, for a camera's page."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError
from calibrary.jobs.diff.comparison import DiffReport, compare
from calibrary.policy import Policy
from calibrary.registry.history import EntryRevision

__all__ = ["MOST_COMPARED", "Step", "steps"]

MOST_COMPARED = 100
"""Most changes of one entry that get a page, newest first; few cameras are calibrated as often."""


BEYOND = "Their numbers are too far from any camera's to be computed with."


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
