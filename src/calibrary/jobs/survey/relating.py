"""How two claims stand to each other.

Two thresholds are kept apart: a claim contradicts another beyond the tolerances of both, and confirms it only if it is
near: a wide tolerance must not make a witness. Measured calibrations are compared as ``diff`` compares them, in px over
the frame with the camera free to turn.
"""

from __future__ import annotations

import math
from enum import StrEnum

from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError
from calibrary.jobs.diff.common_numbers import K_NAMES, SAME, common_numbers
from calibrary.jobs.survey.claims import Claim
from calibrary.jobs.survey.limits import CONFIRMS, CONFIRMS_AT_MOST
from calibrary.jobs.survey.placing import Placed, Settled
from calibrary.policy import Policy
from calibrary.records import replace


class Relation(StrEnum):
    """How a claim stands to another; undecided if one of its readings does, and another does not."""

    COPY = "copy"
    DEPENDENT = "dependent"
    CONFIRMS = "confirms"
    COMPATIBLE = "compatible"
    CONTRADICTS = "contradicts"
    UNDECIDED = "undecided"


def relate(one: Placed, K: Placed, policy: Policy) -> Relation:
    """Of a claim that may have other readings only what all of them say; the usual one of two may confirm."""
    taken = relate_as_read(one, K, policy)
    if not (one.rivals or K.rivals):
        return taken
    if taken is Relation.CONFIRMS and Settled.AMBIGUOUS not in {one.settled, K.settled}:
        return taken
    said = {taken, *(relate_as_read(a, b, policy) for a in one.ways for b in K.ways)}
    if len(said) == 1:
        return taken
    return Relation.COPY if Relation.COPY in said else Relation.UNDECIDED


def relate_as_read(one: Placed, K: Placed, policy: Policy) -> Relation:
    """By the readings that are taken."""
    if _differ(one, K, policy):
        return Relation.CONTRADICTS
    if _is_copy(one, K):
        return Relation.COPY
    if one.claim.rests_on & K.claim.rests_on:
        return Relation.DEPENDENT
    if one.claim.is_measured and K.claim.is_measured:
        return Relation.CONFIRMS
    near = min(CONFIRMS + max(one.claim.rounding, K.claim.rounding), CONFIRMS_AT_MOST)
    return Relation.CONFIRMS if _apart(one, K) <= near else Relation.COMPATIBLE


def is_independent(one: Placed, K: Placed) -> bool:
    """Whether two claims share no input and are no copies; only then is their agreement evidence."""
    return not one.claim.rests_on & K.claim.rests_on and not _is_copy(one, K)


def limit_between(one: Claim, other: Claim) -> float:
    """Relative difference of two focal lengths beyond which one claim contradicts the other, if one is nominal."""
    granted = next((claim.granted for claim in (one, other) if claim.granted is not None), None)
    if granted is not None:
        return max(granted, one.rounding, other.rounding)
    if one.is_measured or other.is_measured:
        limit = one.tolerance + other.tolerance + one.rounding + other.rounding
        return max(limit, one.engraved, other.engraved)
    return max(math.hypot(one.tolerance, other.tolerance), one.rounding, other.rounding)


def gap(one: Placed, K: Placed) -> float:
    """Largest relative difference of the focal lengths, and where both measured it of the centre over the width.

    What is of the whole frame is compared with K as if the image showed all of it.
    """
    a, b = one.calibration.intrinsics, K.calibration.intrinsics
    ratio = _seen_by(one, K) / _seen_by(K, one)
    apart = [ratio - 1.0, ratio * (a.fy / a.fx) / (b.fy / b.fx) - 1.0]
    if one.claim.is_measured and K.claim.is_measured:
        apart += [(a.cx - b.cx) / b.image_size[0], (a.cy - b.cy) / b.image_size[0]]
    return max(apart, key=abs)


def _differ(one: Placed, K: Placed, policy: Policy) -> bool:
    if not (one.claim.is_measured and K.claim.is_measured):
        return _apart(one, K) > limit_between(one.claim, K.claim)
    mine, other = one.calibration, K.calibration
    # Where the principal point is assumed, it is no statement.
    if one.reading.centre_is_assumed:
        mine = _with_centre_of(mine, other)
    elif K.reading.centre_is_assumed:
        other = _with_centre_of(other, mine)
    if (mine.intrinsics, mine.distortion) == (other.intrinsics, other.distortion):
        return False
    from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  loads linear algebra, for the few that need it

    try:
        return compare(other, mine, policy).alarm
    except CalibraryError:
        return True


def _apart(one: Placed, K: Placed) -> float:
    """Difference of the focal lengths, as a share of the one that was measured, as tolerances are."""
    by = one if one.claim.is_measured and not K.claim.is_measured else K
    a, b = _seen_by(one, K), _seen_by(K, one)
    return abs(a - b) / (a if by is one else b)


def is_by_whole(one: Placed, K: Placed) -> bool:
    """Whether two claims are compared as if the image showed the whole frame: one is of that, the other of a part."""
    return any(
        a.claim.is_whole and not b.claim.is_whole and b.reading.is_cut for a, b in ((one, K), (K, one))
    )


def _seen_by(one: Placed, other: Placed) -> float:
    """Its focal length; where the other is of the whole frame, as if the image showed all of it."""
    if is_by_whole(one, other) and not one.claim.is_whole:
        stated = one.claim.calibration.intrinsics
        return stated.fx * one.calibration.intrinsics.image_size[0] / stated.image_size[0]
    return one.fx


def _with_centre_of(calibration: Calibration, other: Calibration) -> Calibration:
    K = replace(calibration.intrinsics, cx=other.intrinsics.cx, cy=other.intrinsics.cy)
    return replace(calibration, intrinsics=K)


def _is_copy(one: Placed, other: Placed) -> bool:
    """Whether both have the numbers of one source: one measurement twice, or a file that a program wrote from a tag."""
    if one.claim.is_measured and other.claim.is_measured:
        return common_numbers(one.calibration, other.calibration).is_one_measurement
    K, L = one.calibration.intrinsics, other.calibration.intrinsics
    return one.claim.is_measured != other.claim.is_measured and all(
        math.isclose(getattr(K, name), getattr(L, name), rel_tol=SAME) for name in K_NAMES
    )
