"""Two calibrations of one camera compared: in numbers, in pixels, on the ground, against their noise; and a verdict.

Size comes first. A difference matters where the projections over the whole frame, the camera free to turn, differ by
more than the policy's limits: root mean square, largest value, or image scale. One that does not matter raises no
alarm, however significant. One that does raises it, unless the measured uncertainty of both explains it; and where
that uncertainty is itself larger than the limits, this is said, because such an agreement proves little.
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
    """Two calibrations and what lies between them.

    Attributes:
        a, b: as they were given.
        verdict: what it comes to.
        alarm: whether it needs attention.
        reasons: why, in sentences.
        warnings: what the comparison cannot say, in sentences.
        use: which of the two to use.
        advice: what to do, in one sentence.
        structural: changes of kind.
        steps: what brought both to one frame.
        numbers: None where nothing does, which is then a change of kind.
        policy: policy with the limitsd.
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
        FrameError: no scale and no crop brings the two to one frame, and no signature says why.
        CalibrationError: they see too little in common, and no signature says why.
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
    """What differs where most numbers are equal to the last digit."""
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
