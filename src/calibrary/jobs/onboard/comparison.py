"""Compare the estimates of a camera's K, validate the proposed one, and compare it with entries of its model."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from enum import StrEnum
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, Grade
from calibrary.errors import CalibraryError, InputError
from calibrary.evidence.edits import edits
from calibrary.jobs.diff.comparison import ChangeVerdict, DiffReport, compare
from calibrary.jobs.extract.judging import circumstances
from calibrary.jobs.onboard.cameras import PayloadCamera
from calibrary.jobs.onboard.estimates import Estimate, Kind, expected_of, gap
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import folder_of, id_of
from calibrary.registry.registry import Registry
from calibrary.validation import NamedFocal, Report, ValidationContext, Verdict, validate

__all__ = [
    "Agreement",
    "ComparedEstimate",
    "EstimateComparison",
    "Relative",
    "compare_estimates",
    "held_against",
    "relatives",
]

MOST_RELATIVES: Final = 12
MOST_READ: Final = 400


JUDGED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED, Grade.DESIGN})
"""Grades of K that are precise enough for a difference between two of them to be relevant."""
ALIKE: Final = frozenset({ChangeVerdict.IDENTICAL, ChangeVerdict.NOISE, ChangeVerdict.NEGLIGIBLE})


class Agreement(StrEnum):
    """How an estimate compares with the chosen one."""

    AGREES = "agrees"
    DIFFERS = "differs"
    DISAGREES = "disagrees"


class ComparedEstimate(Struct, frozen=True, kw_only=True, eq=False):
    """One estimate compared with the chosen one.

    Attributes:
        estimate: the other estimate.
        difference: relative to the chosen one: of fx or fy, or of the principal point over the image width.
        agreement: whether it agrees; differs by more than noise and a map allow, but within the limit for two
            cameras of one model; or disagrees, beyond that limit.
    """

    estimate: Estimate
    difference: float
    agreement: Agreement

    @property
    def agrees(self) -> bool:
        """Whether the two are interchangeable for practical purposes."""
        return self.agreement is Agreement.AGREES

    @property
    def disagrees(self) -> bool:
        """Whether it cannot belong to this camera."""
        return self.agreement is Agreement.DISAGREES


class EstimateComparison(Struct, frozen=True, kw_only=True, eq=False):
    """The chosen estimate and how the others agree with it.

    Attributes:
        chosen: the estimate whose K is proposed.
        calibration: that K.
        others: all other estimates, each compared with it.
        overruled: estimates that disagree and are overruled, by the other sources or by the user.
        dispute: why no estimate can be chosen; None if one can.
    """

    chosen: Estimate
    calibration: Calibration
    others: tuple[ComparedEstimate, ...]
    overruled: tuple[ComparedEstimate, ...] = ()
    dispute: str | None = None


class Relative(Struct, frozen=True, kw_only=True, eq=False):
    """An entry of the same model and how the proposed K differs from it.

    Attributes:
        id: of the entry.
        entry: the entry.
        comparison: of its K with the proposed one; None if they cannot be compared.
        reason: why they cannot be compared.
        own: whether it is the entry of the camera being onboarded.
    """

    id: str
    entry: Entry
    comparison: DiffReport | None
    reason: str | None
    own: bool


def compare_estimates(
    estimates: Sequence[Estimate], policy: Policy, trusted: Kind | None = None
) -> EstimateComparison | None:
    """Compare the first estimate with the others.

    A disagreeing estimate is overruled if at least two independent origins agree with the first estimate and
    they outnumber the origins that disagree: a measurement and the catalogue overrule a firmware that writes
    the focal length of another lens. One origin against one is a dispute, which another source or ``trusted``
    resolves.

    Args:
        estimates: the one to propose first.
        policy: limits above which a difference between two measurements matters.
        trusted: kind of source that the user trusts.

    Returns:
        The comparison; None if no estimate gives a K.
    """
    if trusted is not None:
        able = [one for one in estimates if one.kind is trusted and one.rank is not None]
        estimates = [*able[:1], *(one for one in estimates if one not in able[:1])]
    if not estimates or estimates[0].rank is None or estimates[0].calibration is None:
        return None
    chosen, calibration = estimates[0], estimates[0].calibration
    others = tuple(_compared(chosen, one, policy) for one in estimates[1:])
    against = tuple(one for one in others if one.disagrees)
    for_it = {chosen.origin, *(one.estimate.origin for one in others if not one.disagrees)}
    against_it = {one.estimate.origin for one in against} - for_it
    is_trusted = trusted is not None and chosen.kind is trusted
    if not against or is_trusted or (len(for_it) >= 2 and len(for_it) > len(against_it)):
        return EstimateComparison(chosen=chosen, calibration=calibration, others=others, overruled=against)
    dispute = _dispute(chosen, against, for_it)
    return EstimateComparison(chosen=chosen, calibration=calibration, others=others, dispute=dispute)


def _compared(chosen: Estimate, other: Estimate, policy: Policy) -> ComparedEstimate:
    difference, agreement = gap(chosen, other), Agreement.AGREES
    if abs(difference) > max(chosen.limit, other.limit):
        agreement = Agreement.DISAGREES
    elif _matters(chosen, other, policy):
        agreement = Agreement.DIFFERS
    return ComparedEstimate(estimate=other, difference=difference, agreement=agreement)


def _matters(chosen: Estimate, other: Estimate, policy: Policy) -> bool:
    """Whether two measured K differ by more than noise and a map allow, by the rules of ``calibrary diff``."""
    one, two = chosen.calibration, other.calibration
    if one is None or two is None or not {one.grade, two.grade} <= JUDGED:
        return False
    try:
        found = compare(two, one, policy)
    except CalibraryError:
        return True
    return found.alarm or found.verdict not in {*ALIKE, ChangeVerdict.STRUCTURAL}


def _dispute(chosen: Estimate, against: Sequence[ComparedEstimate], for_it: set[str]) -> str:
    disagreeing = "; ".join(f"{_stated(one.estimate)}, {one.difference:+.1%}" for one in against[:4])
    alone = "nothing confirms it" if len(for_it) < 2 else "no majority of independent sources agrees with it"
    return f"{_stated(chosen)}; {disagreeing}; {alone}"


def _stated(estimate: Estimate) -> str:
    return f"{estimate.name} ({estimate.kind.value}) states fx = {estimate.intrinsics.fx:.1f} px"


def held_against(
    calibration: Calibration, camera: PayloadCamera, comparison: EstimateComparison, policy: Policy
) -> Report:
    """Validate the proposed K against the policy and the other estimates, without the overruled ones."""
    judged, outvoted = camera.judged, {compared.estimate.name for compared in comparison.overruled}
    if comparison.chosen.kind is Kind.TAGS and judged is not None:
        around = circumstances(judged.evidence, judged.states[0].known, spread=judged.spread)
        others = tuple(other for other in around.others if other.name not in outvoted)
        flights = _agreeing(comparison, {Kind.FLIGHT})
        return validate(calibration, policy, replace(around, others=(*others, *flights)))
    around = ValidationContext(
        expected=expected_of(camera),
        others=_agreeing(comparison, {Kind.TAGS, Kind.FILE, Kind.FLIGHT}),
        edits=tuple(f"the image was {edit}" for edit in edits(judged.states[0].metadata))
        if judged is not None and comparison.chosen.kind is Kind.BOARD
        else (),
    )
    return validate(calibration, policy, around)


def _agreeing(comparison: EstimateComparison, kinds: Collection[Kind]) -> tuple[NamedFocal, ...]:
    """The other estimates of these kinds that do not disagree."""
    return tuple(
        NamedFocal(
            name=compared.estimate.name, fx=compared.estimate.intrinsics.fx, tolerance=compared.estimate.limit
        )
        for compared in comparison.others
        if not compared.disagrees and compared.estimate.kind in kinds
    )


def refused_by(report: Report) -> str | None:
    """Reason why the policy rejects K or leaves it unproven; None if it is valid."""
    if report.verdict is Verdict.VALID:
        return None
    failure = report.failures[0]
    return f"{failure.message}{f'; {failure.remedy}' if failure.remedy else ''}"


def relatives(registry: Registry, entry: Entry, policy: Policy) -> tuple[Relative, ...]:
    """The entries of the same model: its own first, then those with the same image size."""
    snapshot, camera = registry.snapshot(), entry.calibration.camera
    folder = folder_of(camera.make or "", camera.model or "")
    paths = sorted(path for path in snapshot.paths if path.startswith(folder))
    found = []
    for path in paths[:MOST_READ]:
        try:
            other = parse_entry(snapshot.read(path), path)
        except InputError:
            # `registry check` reports entries that cannot be read.
            continue
        found.append(_relative(path, other, entry, policy))
    found.sort(key=lambda one: (not one.own, not _is_same_frame(one.entry, entry), one.id))
    return tuple(found[:MOST_RELATIVES])


def _relative(path: str, other: Entry, entry: Entry, policy: Policy) -> Relative:
    comparison, reason = None, None
    if other.calibration.camera.sub_camera != entry.calibration.camera.sub_camera:
        reason = "another camera of this model"
    else:
        try:
            comparison = compare(other.calibration, entry.calibration, policy)
        except CalibraryError as error:
            reason = error.message if isinstance(error, InputError) else str(error)
    return Relative(id=id_of(path), entry=other, comparison=comparison, reason=reason, own=path == entry.path)


def _is_same_frame(one: Entry, other: Entry) -> bool:
    return one.calibration.intrinsics.image_size == other.calibration.intrinsics.image_size
