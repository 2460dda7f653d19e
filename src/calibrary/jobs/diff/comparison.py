"""Comparison of two calibrations of one camera: parameters, pixels, ground, significance; and a verdict.

The size of the difference is judged first. A difference matters if the projections over the whole image,
after the best rotation of the camera, differ by more than the policy's limits: RMS, maximum, or image scale.
A difference that does not matter raises no alarm, even if it is significant. One that matters raises an alarm
unless the measured uncertainties of both explain it. If that uncertainty exceeds the limits itself, a warning
states that the agreement proves little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Final

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import CalibrationError
from calibrary.jobs.diff.causes import causes, other_camera
from calibrary.jobs.diff.frames import check_units, common_frame
from calibrary.jobs.diff.numbers import Ground, Numbers, Parameter, numbers_of, what_moved
from calibrary.jobs.diff.uncertainty import PRIORS, Basis, Significance, std_of
from calibrary.jobs.diff.verdicts import ALARMING, ChangeVerdict, Kind, Structural, Use
from calibrary.jobs.diff.wording import chance, listed, percent, pixels
from calibrary.pages.notebook import in_notebook
from calibrary.policy import FLEET, Policy
from calibrary.records import Meta, Record, replace

__all__ = ["ChangeVerdict", "DiffReport", "Ground", "Numbers", "Parameter", "compare"]


BETTER: Final = 0.7
"""A focal length counts as better known if its standard deviation is at most this fraction of the other's."""

BY_KIND: Final = {
    Kind.TURNED: (
        Use.EACH,
        "Use the one whose frame is turned as your images are, and never one for the images of the other.",
    ),
    Kind.STRETCH: (
        Use.A,
        "Keep using A, and provide the original files of the images behind B: they were stretched or transcoded.",
    ),
    Kind.CROP: (
        Use.EACH,
        "Use each for images of its own crop, and set the camera back if the change of mode was not wanted.",
    ),
    Kind.OTHER_CAMERA: (
        Use.EACH,
        "Find out by the serial number which camera and lens took your images, and use the calibration of that one.",
    ),
    Kind.DEWARP_ON: (
        Use.EACH,
        "Use B for images that the camera corrected and A for all others; for surveys switch dewarping off.",
    ),
    Kind.DEWARP_OFF: (
        Use.EACH,
        "Use A for images that the camera corrected and B for all others; for surveys leave dewarping off.",
    ),
    Kind.RESIZE: (Use.EACH, "Use each for images of its own size; they are one camera."),
}
CONVENTIONS: Final = {
    Kind.MIRRORED: "a mirrored axis",
    Kind.FOCAL_SWAP: "fx and fy in each other's place",
    Kind.CENTRE_SWAP: "cx and cy in each other's place",
    Kind.OTHER_MODEL: "the lens model that the coefficients are read for",
    Kind.ORDER: "the order of the coefficients",
    Kind.HALF_PIXEL: "the pixel origin",
    Kind.ORIGIN: "the origin of the principal point",
    Kind.TANGENTIAL_SWAP: "p1 and p2 in each other's place",
    Kind.TANGENTIAL_SIGN: "the sign of p1 and p2",
    Kind.DIRECTION: "the direction or sign of the distortion",
}


class Side(Record):
    """One of the two calibrations.

    Attributes:
        label: file name, or KEY@REV.
        calibration: as given.
    """

    label: str
    calibration: Calibration


class Projection(Record):
    """Difference of the projections of points at infinity, after the best rotation of the camera.

    Attributes:
        rms_px, max_px: over the whole image.
        centre_rms_px: over the central part of the image.
        rotation_deg: angle of the rotation that was removed.
        unknown_share: fraction of the image without a result, because only one of the two has a projection or
            the uncertainty of the difference exceeds the limit.
    """

    rms_px: Annotated[float, Meta(ge=0)]
    max_px: Annotated[float, Meta(ge=0)]
    centre_rms_px: Annotated[float, Meta(ge=0)]
    rotation_deg: Annotated[float, Meta(ge=0)]
    unknown_share: Annotated[float, Meta(ge=0, le=1)]


class Difference(Record):
    """Numerical difference at a common image size.

    Attributes:
        image_size: common width and height in px.
        parameters: all parameters of both.
        matters: whether the difference exceeds the policy's limits, regardless of noise.
        focal_change: relative change of fx or fy, whichever is larger.
        scale_change: relative change of the image scale: the part of the focal length's change that the
            distortion does not compensate.
        projection: difference in pixels.
        ground: effect on a map.
        significance: comparison with noise.
        distortion_compared: false if one of the distortions is unknown and only K was compared.
    """

    image_size: ImageSize
    parameters: tuple[Parameter, ...]
    matters: bool
    focal_change: float
    scale_change: float
    projection: Projection
    ground: Ground
    significance: Significance
    distortion_compared: bool


class DiffReport(Record, tag_field="schema", tag="calibrary/diff-1", dict=True):
    """Output of ``calibrary diff A B --json``.

    Attributes:
        verdict: of the comparison.
        alarm: whether the difference needs attention; the exit code is then 1.
        reasons: for the verdict, in sentences.
        warnings: limits of the comparison, in sentences.
        use: which of the two to use.
        advice: what to do, in one sentence.
        structural: structural changes.
        steps: operations that converted both to a common image size; empty if the sizes were equal.
        a, b: the two calibrations; b is the later one.
        numbers: null if no conversion to a common image size exists.
    """

    verdict: ChangeVerdict
    alarm: bool
    reasons: Annotated[tuple[str, ...], Meta(min_length=1)]
    warnings: tuple[str, ...]
    use: Use
    advice: str
    structural: tuple[Structural, ...]
    steps: tuple[str, ...]
    a: Side
    b: Side
    numbers: Difference | None

    @property
    def detail(self) -> Numbers | None:
        """The arrays behind ``numbers``, for maps; no part of the document, so None for one that was read."""
        found: Numbers | None = self.__dict__.get("detail")
        return found

    def doubted(self, doubts: Sequence[str]) -> DiffReport:
        """The same with what makes one of the two an unlikely K, which needs attention in any case."""
        report = replace(self, alarm=True, warnings=(*doubts, *self.warnings))
        report.__dict__["detail"] = self.detail
        return report

    def _repr_html_(self) -> str:
        """Return the verdict, the reasons and the advice as HTML, for notebooks."""
        return in_notebook(self)


def compare(
    a: Calibration,
    b: Calibration,
    policy: Policy = FLEET,
    *,
    labels: tuple[str, str] = ("a", "b"),
    altitude_m: float = 100.0,
) -> DiffReport:
    """Compare the later calibration ``b`` with ``a``.

    Args:
        a: the earlier one.
        b: the later one.
        policy: with the limits.
        labels: names of the two.
        altitude_m: height above ground in m, for the effect on a map.

    Raises:
        InputError: the K of one is not in pixels.
        CalibrationError: the fields of view overlap too little, and no structural change explains it.
    """
    check_units(a, b)
    sides = Side(label=labels[0], calibration=a), Side(label=labels[1], calibration=b)
    frame = common_frame(a, b)
    structural = causes(a, b, frame)
    if not frame.is_common:
        return _judged(sides, None, structural, (), altitude_m)
    try:
        numbers = numbers_of(frame.a, frame.b, policy)
    except CalibrationError as error:
        if not structural:
            raise
        return _judged(sides, None, structural, (), altitude_m, str(error))
    structural = (*structural, *other_camera(a, b, numbers, structural))
    # A nominal focal length was never that of the lens: nothing moved.
    measured = all(one.grade.is_measured for one in (a, b))
    moved = what_moved(numbers) if measured and numbers.matters and not structural else None
    return _judged(sides, numbers, structural, frame.steps, altitude_m, moved=moved)


def _judged(
    sides: tuple[Side, Side],
    numbers: Numbers | None,
    structural: tuple[Structural, ...],
    steps: tuple[str, ...],
    altitude_m: float,
    message: str = "",
    moved: str | None = None,
) -> DiffReport:
    a, b = (side.calibration for side in sides)
    verdict = _verdict(numbers, structural)
    matters = numbers is None or _is_drift(numbers)
    kinds = {one.kind for one in structural}
    alarm = bool(kinds & ALARMING) or matters
    use, notes = _advice(a, b, numbers, verdict, structural, alarm=alarm)
    report = DiffReport(
        a=sides[0],
        b=sides[1],
        verdict=verdict,
        alarm=alarm,
        reasons=tuple(_reasons(numbers, verdict, structural, message, moved)),
        warnings=tuple(_warnings(a, b, numbers, verdict)),
        use=use,
        advice=notes,
        structural=structural,
        steps=steps,
        numbers=_difference(numbers, altitude_m) if numbers is not None else None,
    )
    # What msgspec keeps beside the fields is not written.
    report.__dict__["detail"] = numbers
    return report


def _difference(numbers: Numbers, altitude_m: float) -> Difference:
    seen = numbers.difference
    return Difference(
        image_size=numbers.a.intrinsics.image_size,
        parameters=numbers.parameters,
        matters=numbers.matters,
        focal_change=numbers.focal_change,
        scale_change=numbers.scale.change,
        projection=Projection(
            rms_px=seen.rms_px,
            max_px=seen.max_px,
            centre_rms_px=seen.centre_rms_px,
            rotation_deg=seen.rotation_deg,
            unknown_share=float(numbers.unknown.mean()),
        ),
        ground=numbers.ground(altitude_m),
        significance=numbers.significance,
        distortion_compared=numbers.lens_compared,
    )


def _verdict(numbers: Numbers | None, structural: tuple[Structural, ...]) -> ChangeVerdict:
    if structural or numbers is None:
        return ChangeVerdict.STRUCTURAL
    if _is_identical(numbers):
        return ChangeVerdict.IDENTICAL
    if not numbers.matters:
        within = numbers.is_measured and _p(numbers) >= numbers.policy.drift_significance
        return ChangeVerdict.NOISE if within else ChangeVerdict.NEGLIGIBLE
    if _is_drift(numbers):
        return ChangeVerdict.DRIFT
    if numbers.is_measured and not numbers.is_noise_large:
        return ChangeVerdict.NOISE
    return ChangeVerdict.UNRESOLVED


def _is_drift(numbers: Numbers) -> bool:
    return numbers.matters and not numbers.significance.explains


def _is_identical(numbers: Numbers) -> bool:
    common = numbers.common
    equal = not (common.changed or common.lost or common.gained)
    # Another model of the same map has other coefficients: then what they project decides, to the digits shown.
    same_model = type(numbers.a.distortion) is type(numbers.b.distortion)
    comparable = numbers.lens_compared or (numbers.a.distortion is None and numbers.b.distortion is None)
    return comparable and (equal if same_model else pixels(numbers.difference.max_px) == "0 px")


def _p(numbers: Numbers) -> float:
    return numbers.significance.p or 0.0


def _reasons(
    numbers: Numbers | None,
    verdict: ChangeVerdict,
    structural: tuple[Structural, ...],
    message: str,
    moved: str | None,
) -> list[str]:
    notes = [one.reason for one in structural]
    if numbers is None:
        return [*notes, message] if message else notes
    if verdict is ChangeVerdict.IDENTICAL:
        return [_identity(numbers)]
    seen, limits = numbers.difference, _limits(numbers.policy)
    differ = (
        f"projections differ by {pixels(seen.rms_px)} rms and {pixels(seen.max_px)} at most over the frame, "
        f"the image scale by {percent(numbers.scale.change)}"
    )
    if not math.isfinite(seen.rms_px):
        return [*notes, "too few directions are seen by both to compare their projections"]
    notes.append(differ)
    if not numbers.matters:
        if any(one.kind in ALARMING for one in structural):
            return [*notes, f"that is below the limits ({limits}): the alarm is for the change of kind"]
        return [*notes, f"that is below the limits ({limits}): it does not matter, significant or not"]
    notes += [f"that is beyond the limits ({limits})", *_known(numbers)]
    edit = _edit(numbers)
    if edit and not structural:
        notes.append(edit)
    if structural:
        return notes
    if numbers.significance.basis is Basis.COPY:
        return notes
    if moved is not None:
        notes.append(moved)
    return [*notes, _explained(numbers)]


def _identity(numbers: Numbers) -> str:
    a, b = numbers.a.distortion, numbers.b.distortion
    if a is None or b is None or type(a) is type(b):
        return "every number is the same"
    return f"the same lens in two models, {a.model} and {b.model}: every ray has the same pixel"


def _known(numbers: Numbers) -> tuple[str, ...]:
    """How well each side's focal length is known, if one is nominal: of that the grade is all that tells."""
    sides = {"A": numbers.a, "B": numbers.b}
    if numbers.significance.basis is Basis.COPY or all(one.grade.is_measured for one in sides.values()):
        return ()
    within = {
        name: 2.0 * (std_of(one, "fx") / one.intrinsics.fx or PRIORS[one.grade].focal)
        for name, one in sides.items()
    }
    told = ", ".join(
        f"{name} ({one.grade.value}) to ±{within[name] * 100:.2g}%" for name, one in sides.items()
    )
    verdict = "explains" if abs(numbers.scale.change) <= sum(within.values()) else "does not explain"
    return (f"the focal length is known of {told} (2 σ), which {verdict} the image scale",)


def _explained(numbers: Numbers) -> str:
    found = numbers.significance
    if found.explains is None:
        return "no measured uncertainty explains it: at least one of the two states none"
    if found.p is None and not found.explains:
        return f"it is more than two calibrations of these grades usually differ by ({found.basis.value})"
    p = chance(_p(numbers))
    if not found.explains:
        return f"noise would do so with a chance of {p} ({found.basis.value})"
    if not numbers.is_measured:
        return f"two independent calibrations of these grades usually differ by as much ({found.basis.value})"
    if numbers.is_noise_large:
        return "it is within noise, and the noise is large: calibrate better"
    return f"it is within noise, which does as much in {p} of all cases ({found.basis.value})"


def _edit(numbers: Numbers) -> str | None:
    """Description of the few numbers that differ if most are equal to the last digit."""
    common = numbers.common
    changed = (*common.changed, *common.lost, *common.gained)
    if not common.is_one_measurement or not changed:
        return None
    verb = "differs" if len(changed) == 1 else "differ"
    how = (
        "one measurement that was edited, not two"
        if common.is_copy
        else "one is a copy of the other in these, or they were held fixed"
    )
    return f"only {listed(changed)} {verb}; {listed(common.same)} are the same to the last digit: {how}"


def _warnings(a: Calibration, b: Calibration, numbers: Numbers | None, verdict: ChangeVerdict) -> list[str]:
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
    unknown = float((numbers.unknown & ~numbers.blind).mean())
    if unknown >= 0.005 and verdict is not ChangeVerdict.IDENTICAL:
        notes.append(
            f"in {unknown:.0%} of the frame the difference is known to no better than "
            f"{pixels(numbers.policy.drift_max_px)}: agreement there proves nothing"
        )
    if verdict is ChangeVerdict.UNRESOLVED and not numbers.is_measured:
        notes.append("not both state their uncertainty, so this does not prove agreement")
    return notes


def _limits(policy: Policy) -> str:
    return (
        f"{policy.drift_rms_px:g} px rms, {policy.drift_max_px:g} px at most, {policy.drift_focal:.2%} of f"
    )


def _advice(
    a: Calibration,
    b: Calibration,
    numbers: Numbers | None,
    verdict: ChangeVerdict,
    structural: tuple[Structural, ...],
    *,
    alarm: bool,
) -> tuple[Use, str]:
    """Choose which of the two to use, and explain it in a sentence."""
    drifted = alarm and numbers is not None and {one.kind for one in structural} == {Kind.RESIZE}
    if numbers is None or (structural and not drifted):
        cause = structural[-1]
        return _of_field(a, b) if cause.kind is Kind.FIELD else _of_structure(cause, alarm=alarm)
    better, why = _better(a, b, numbers)
    if verdict in {ChangeVerdict.IDENTICAL, ChangeVerdict.NOISE, ChangeVerdict.NEGLIGIBLE}:
        return _agreeing(a, b, numbers, verdict, (better, why))
    if verdict is ChangeVerdict.UNRESOLVED:
        if better is not Use.EITHER:
            return (
                better,
                f"Use {better.value}, {why}; calibrate again with more and steeper views to be sure.",
            )
        return Use.A, (
            "Keep using A: no change is proven, and none is ruled out; calibrate better, with more and steeper views."
        )
    return _drifted(numbers)


def _of_structure(cause: Structural, *, alarm: bool) -> tuple[Use, str]:
    if cause.kind in CONVENTIONS:
        return Use.A, (
            f"Keep using A: B differs by {CONVENTIONS[cause.kind]}, not by what the camera did; export or convert B "
            "again before it is used."
        )
    if cause.kind in BY_KIND:
        return BY_KIND[cause.kind]
    bad, good = cause.faulty, Use.A if cause.faulty == "B" else Use.B
    if not alarm:
        return good, f"Use {good.value}, which is complete, although no map will show what {bad} lost."
    what = "incomplete" if "lost" in cause.kind.value else "counted another way"
    return good, f"Use {good.value}: {bad} is {what}; export {bad} again from its source before it is used."


def _of_field(a: Calibration, b: Calibration) -> tuple[Use, str]:
    """Advice for two fields of view at the same image size, which the image size cannot distinguish."""
    if (a.grade.is_measured) is not (b.grade.is_measured):
        use, one, other = (Use.A, a, b) if a.grade.is_measured else (Use.B, b, a)
        unmeasured = "B" if use is Use.A else "A"
        return use, (
            f"Use {use.value}, which is {one.grade.value} where the other is {other.grade.value}, for images of its "
            f"own zoom and crop mode; check the sensor size behind {unmeasured} before {unmeasured} is used."
        )
    return Use.EACH, (
        "Use each only for images of the zoom and crop mode that it was made in; where that is not known, calibrate "
        "again in the mode that you fly."
    )


def _agreeing(
    a: Calibration,
    b: Calibration,
    numbers: Numbers,
    verdict: ChangeVerdict,
    better: tuple[Use, str],
) -> tuple[Use, str]:
    use, why = better
    if not numbers.lens_compared and a.distortion is not b.distortion:
        whole = Use.A if a.distortion is not None else Use.B
        return whole, f"Use {whole.value}, which states the distortion: as far as both go, they agree."
    if verdict is ChangeVerdict.IDENTICAL:
        return Use.EITHER, "Use either: they hold the same calibration."
    small = (
        "they differ by no more than their uncertainty"
        if numbers.matters
        else "no map will show the difference"
    )
    if use is not Use.EITHER:
        return use, f"Use {use.value}, {why}; {small}."
    return Use.EITHER, f"Use either: {small}."


def _drifted(numbers: Numbers) -> tuple[Use, str]:
    common = numbers.common
    if common.is_one_measurement and not numbers.is_measured:
        changed = listed((*common.changed, *common.lost, *common.gained))
        if common.is_copy:
            return Use.A, f"Keep using A, and find out who changed {changed} and why before B is used."
        return Use.A, (
            f"Keep using A until you know why only {changed} differ: changed by hand, or solved again with the rest "
            "held fixed."
        )
    if not numbers.is_measured:
        return Use.NEITHER, (
            "Do not exchange one for the other: calibrate the camera with a board, and use the one that agrees with it."
        )
    return Use.EACH, (
        "Use B for images taken since it was made and A for those before: K has changed; if nothing happened to the "
        "camera in between, calibrate once more."
    )


def _better(a: Calibration, b: Calibration, numbers: Numbers) -> tuple[Use, str]:
    """The calibration that is known better, with the reason; EITHER if there is no clear difference."""
    if a.grade is not b.grade:
        use, one, other = (Use.A, a, b) if a.grade.rank < b.grade.rank else (Use.B, b, a)
        return use, f"which is {one.grade.value} where the other is {other.grade.value}"
    known = numbers.spread_a.covariance, numbers.spread_b.covariance
    if (known[0] is None) is not (known[1] is None):
        return (Use.A if known[1] is None else Use.B), "which states how well it is known"
    std = [covariance.std["fx"] for covariance in known if covariance is not None]
    if std:
        for use, mine, others in ((Use.A, std[0], std[1]), (Use.B, std[1], std[0])):
            if mine < BETTER * others:
                return (
                    use,
                    f"which is known {others / mine:.1f} times better"
                    if mine > 0
                    else "which is known better",
                )
    return Use.EITHER, ""
