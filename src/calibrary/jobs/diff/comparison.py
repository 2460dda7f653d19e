"""Comparison of two calibrations of one camera: parameters, pixels, ground, significance; and a verdict.

The size of the difference is judged first. A difference matters if the projections over the whole image,
after the best rotation of the camera, differ by more than the policy's limits: RMS, maximum, or image scale.
A difference that does not matter raises no alarm, even if it is significant. One that matters raises an alarm
unless the measured uncertainties of both explain it. If that uncertainty exceeds the limits itself, a warning
states that the agreement proves little.
"""

from __future__ import annotations

import math

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.errors import CalibrationError, FrameError
from calibrary.jobs.diff.advice import Use, advice
from calibrary.jobs.diff.frames import common_frame
from calibrary.jobs.diff.kinds import ALARMING, Structural
from calibrary.jobs.diff.noise import Basis
from calibrary.jobs.diff.numbers import Ground, Numbers, Parameter, numbers_of
from calibrary.jobs.diff.structure import other_camera, signatures
from calibrary.jobs.diff.units import check_units
from calibrary.jobs.diff.verdicts import ChangeVerdict
from calibrary.jobs.diff.wording import chance, listed, percent, pixels
from calibrary.policy import FLEET, Policy

__all__ = ["ChangeVerdict", "Comparison", "Ground", "Numbers", "Parameter", "compare"]


class Comparison(Struct, frozen=True, kw_only=True, eq=False):
    """Two calibrations and the difference between them.

    Attributes:
        a, b: as given.
        verdict: of the comparison.
        alarm: whether the difference needs attention.
        reasons: for the verdict, in sentences.
        warnings: limits of the comparison, in sentences.
        use: which of the two to use.
        advice: what to do, in one sentence.
        structural: structural changes.
        steps: operations that converted both to a common image size.
        numbers: the difference in numbers; None if no conversion exists, which is a structural change.
        policy: policy with the limits.
    """

    a: Calibration
    b: Calibration
    verdict: ChangeVerdict
    alarm: bool
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    use: Use
    advice: str
    structural: tuple[Structural, ...]
    steps: tuple[str, ...]
    numbers: Numbers | None
    policy: Policy


def compare(a: Calibration, b: Calibration, policy: Policy = FLEET) -> Comparison:
    """Compare the later calibration ``b`` with ``a``.

    Raises:
        InputError: the K of one is not in pixels.
        FrameError: neither a scale nor a crop gives a common image size, and no structural change explains it.
        CalibrationError: the fields of view overlap too little, and no structural change explains it.
    """
    check_units(a, b)
    structural = signatures(a, b)
    try:
        frame = common_frame(a, b)
        numbers = numbers_of(frame.a, frame.b, policy)
    except (FrameError, CalibrationError) as error:
        if not structural:
            raise
        message = error.message if isinstance(error, FrameError) else str(error)
        return _judged(a, b, None, structural, (), policy, message)
    structural = (*structural, *other_camera(a, b, numbers, structural, matters=numbers.matters(policy)))
    return _judged(a, b, numbers, structural, frame.steps, policy)


def _judged(
    a: Calibration,
    b: Calibration,
    numbers: Numbers | None,
    structural: tuple[Structural, ...],
    steps: tuple[str, ...],
    policy: Policy,
    message: str = "",
) -> Comparison:
    verdict = _verdict(numbers, structural, policy)
    matters = numbers is None or _is_drift(numbers, policy)
    kinds = {one.kind for one in structural}
    alarm = bool(kinds & ALARMING) or matters
    use, notes = advice(a, b, numbers, verdict, structural, policy, alarm=alarm)
    return Comparison(
        a=a,
        b=b,
        verdict=verdict,
        alarm=alarm,
        reasons=tuple(_reasons(numbers, verdict, structural, policy, message)),
        warnings=tuple(_warnings(a, b, numbers, verdict, policy)),
        use=use,
        advice=notes,
        structural=structural,
        steps=steps,
        numbers=numbers,
        policy=policy,
    )


def _verdict(numbers: Numbers | None, structural: tuple[Structural, ...], policy: Policy) -> ChangeVerdict:
    if structural or numbers is None:
        return ChangeVerdict.STRUCTURAL
    if _is_identical(numbers):
        return ChangeVerdict.IDENTICAL
    if not numbers.matters(policy):
        within = numbers.is_measured and _p(numbers) >= policy.drift_significance
        return ChangeVerdict.NOISE if within else ChangeVerdict.NEGLIGIBLE
    if _is_drift(numbers, policy):
        return ChangeVerdict.DRIFT
    if numbers.is_measured and not numbers.is_noise_large(policy):
        return ChangeVerdict.NOISE
    return ChangeVerdict.UNRESOLVED


def _is_drift(numbers: Numbers, policy: Policy) -> bool:
    explained = numbers.significance is not None and numbers.significance.explains
    return numbers.matters(policy) and not explained


def _is_identical(numbers: Numbers) -> bool:
    common = numbers.common
    equal = not (common.changed or common.lost or common.gained)
    same_model = type(numbers.a.distortion) is type(numbers.b.distortion)
    comparable = numbers.lens_compared or (numbers.a.distortion is None and numbers.b.distortion is None)
    return comparable and (equal if same_model else pixels(numbers.difference.max_px) == "0 px")


def _p(numbers: Numbers) -> float:
    return numbers.significance.p if numbers.significance is not None else 0.0


def _reasons(
    numbers: Numbers | None,
    verdict: ChangeVerdict,
    structural: tuple[Structural, ...],
    policy: Policy,
    message: str,
) -> list[str]:
    notes = [one.reason for one in structural]
    if numbers is None:
        return [*notes, message]
    if verdict is ChangeVerdict.IDENTICAL:
        return ["every number is the same"]
    seen, limits = numbers.difference, _limits(policy)
    differ = (
        f"projections differ by {pixels(seen.rms_px)} rms and {pixels(seen.max_px)} at most over the frame, "
        f"the image scale by {percent(numbers.scale.change)}"
    )
    if not math.isfinite(seen.rms_px):
        return [*notes, "too few directions are seen by both to compare their projections"]
    notes.append(differ)
    if not numbers.matters(policy):
        if any(one.kind in ALARMING for one in structural):
            return [*notes, f"that is below the limits ({limits}): the alarm is for the change of kind"]
        return [*notes, f"that is below the limits ({limits}): it does not matter, significant or not"]
    notes.append(f"that is beyond the limits ({limits})")
    edit = _edit(numbers)
    if edit and not structural:
        notes.append(edit)
    if numbers.basis is Basis.COPY or structural:
        return notes
    return [*notes, _explained(numbers, policy)]


def _explained(numbers: Numbers, policy: Policy) -> str:
    if numbers.significance is None:
        return "no measured uncertainty explains it: at least one of the two states none"
    p = chance(numbers.significance.p)
    if not numbers.significance.explains:
        return f"noise would do so with a chance of {p} ({numbers.basis.value})"
    if not numbers.is_measured:
        return (
            f"two independent calibrations of these grades usually differ by as much ({numbers.basis.value})"
        )
    if numbers.is_noise_large(policy):
        return "it is within noise, and the noise is large: calibrate better"
    return f"it is within noise, which does as much in {p} of all cases ({numbers.basis.value})"


def _edit(numbers: Numbers) -> str | None:
    """Description of the few numbers that differ if most are equal to the last digit."""
    common = numbers.common
    changed = (*common.changed, *common.lost, *common.gained)
    if not common.is_one_measurement or not changed:
        return None
    verb = "differs" if len(changed) == 1 else "differ"
    return (
        f"only {listed(changed)} {verb}; {listed(common.same)} are the same to the last digit: "
        "one measurement that was edited, not two"
    )


def _warnings(
    a: Calibration, b: Calibration, numbers: Numbers | None, verdict: ChangeVerdict, policy: Policy
) -> list[str]:
    if numbers is None:
        return []
    notes = []
    if not numbers.lens_compared:
        silent = [name for name, one in (("A", a), ("B", b)) if one.distortion is None]
        verb = "does" if len(silent) == 1 else "do"
        notes.append(f"{' and '.join(silent)} {verb} not state the distortion: only K was compared")
    blind = float(numbers.blind.mean())
    if blind >= 0.005:
        notes.append(f"in {blind:.0%} of the frame only one of the two projects at all: unknown there")
    unknown = float((numbers.unknown(policy) & ~numbers.blind).mean())
    if unknown >= 0.005 and verdict is not ChangeVerdict.IDENTICAL:
        notes.append(
            f"in {unknown:.0%} of the frame the difference is known to no better than "
            f"{pixels(policy.drift_max_px)}: agreement there proves nothing"
        )
    if verdict is ChangeVerdict.UNRESOLVED and not numbers.is_measured:
        notes.append("not both state their uncertainty, so this does not prove agreement")
    return notes


def _limits(policy: Policy) -> str:
    return (
        f"{policy.drift_rms_px:g} px rms, {policy.drift_max_px:g} px at most, {policy.drift_focal:.2%} of f"
    )
