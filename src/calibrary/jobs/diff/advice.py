"""Advice on which of two calibrations to use, in one sentence."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

from calibrary.calibration import Calibration, Grade
from calibrary.jobs.diff.noise import Basis
from calibrary.jobs.diff.numbers import Numbers
from calibrary.jobs.diff.verdicts import ChangeVerdict, Kind, Structural
from calibrary.jobs.diff.wording import listed
from calibrary.policy import Policy

__all__ = ["Use", "advice"]

BETTER: Final = 0.7
"""A focal length counts as better known if its standard deviation is at most this fraction of the other's."""


class Use(StrEnum):
    """Which of the two to use."""

    A = "A"
    B = "B"
    EITHER = "either"
    EACH = "each for its own images"
    NEITHER = "neither yet"


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
    Kind.HALF_PIXEL: "the pixel origin",
    Kind.ORIGIN: "the origin of the principal point",
    Kind.TANGENTIAL_SWAP: "p1 and p2 in each other's place",
    Kind.TANGENTIAL_SIGN: "the sign of p1 and p2",
    Kind.DIRECTION: "the direction or sign of the distortion",
}
LOST: Final = frozenset(
    {
        Kind.COEFFICIENT_LOST,
        Kind.DISTORTION_LOST,
        Kind.FROM_CENTRE,
        Kind.EQUIVALENT_LEAK,
        Kind.OTHER_SIZE,
        Kind.OTHER_UNIT,
    }
)
MEASURED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})


def advice(
    a: Calibration,
    b: Calibration,
    numbers: Numbers | None,
    verdict: ChangeVerdict,
    structural: tuple[Structural, ...],
    policy: Policy,
    *,
    alarm: bool,
) -> tuple[Use, str]:
    """Choose which of the two to use, and explain it in a sentence."""
    drifted = alarm and numbers is not None and {one.kind for one in structural} == {Kind.RESIZE}
    if numbers is None or (structural and not drifted):
        if {one.kind for one in structural} == {
            Kind.CROP
        } and a.intrinsics.image_size == b.intrinsics.image_size:
            return _of_field(a, b)
        return _of_structure(structural, alarm=alarm)
    better, why = _better(a, b, numbers)
    if verdict in {ChangeVerdict.IDENTICAL, ChangeVerdict.NOISE, ChangeVerdict.NEGLIGIBLE}:
        return _agreeing(a, b, numbers, verdict, (better, why), policy)
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


def _of_structure(structural: tuple[Structural, ...], *, alarm: bool) -> tuple[Use, str]:
    for one in structural:
        if one.kind in LOST and one.faulty is not None:
            bad = one.faulty
            good = Use.A if bad == "B" else Use.B
            what = "incomplete" if "lost" in one.kind.value else "counted another way"
            if not alarm:
                return (
                    good,
                    f"Use {good.value}, which is complete, although no map will show what {bad} lost.",
                )
            return (
                good,
                f"Use {good.value}: {bad} is {what}; export {bad} again from its source before it is used.",
            )
    for kind, answer in BY_KIND.items():
        if any(one.kind is kind for one in structural) and kind is not Kind.RESIZE:
            return answer
    conventions = [CONVENTIONS[one.kind] for one in structural if one.kind in CONVENTIONS]
    if conventions:
        what = listed(conventions)
        return Use.A, (
            f"Keep using A: B differs by {what}, not by what the camera did; export or convert B again before it is "
            "used."
        )
    return BY_KIND[Kind.RESIZE]


def _of_field(a: Calibration, b: Calibration) -> tuple[Use, str]:
    """Advice for two fields of view at the same image size, which the image size cannot distinguish."""
    if (a.grade in MEASURED) is not (b.grade in MEASURED):
        use, one, other = (Use.A, a, b) if a.grade in MEASURED else (Use.B, b, a)
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
    policy: Policy,
) -> tuple[Use, str]:
    use, why = better
    if not numbers.lens_compared and a.distortion is not b.distortion:
        whole = Use.A if a.distortion is not None else Use.B
        return whole, f"Use {whole.value}, which states the distortion: as far as both go, they agree."
    if verdict is ChangeVerdict.IDENTICAL:
        return Use.EITHER, "Use either: they hold the same calibration."
    small = (
        "they differ by no more than their uncertainty"
        if numbers.matters(policy)
        else "no map will show the difference"
    )
    if use is not Use.EITHER:
        return use, f"Use {use.value}, {why}; {small}."
    return Use.EITHER, f"Use either: {small}."


def _drifted(numbers: Numbers) -> tuple[Use, str]:
    common = numbers.common
    if numbers.basis is Basis.COPY:
        changed = listed((*common.changed, *common.lost, *common.gained))
        return Use.A, f"Keep using A, and find out who changed {changed} and why before B is used."
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
    spreads = numbers.spread_a, numbers.spread_b
    if spreads[0].is_measured is not spreads[1].is_measured:
        return (Use.A if spreads[0].is_measured else Use.B), "which states how well it is known"
    if all(spread.is_measured for spread in spreads):
        std = [spread.covariance.std["fx"] for spread in spreads]
        for use, mine, others in ((Use.A, std[0], std[1]), (Use.B, std[1], std[0])):
            if mine < BETTER * others:
                return (
                    use,
                    f"which is known {others / mine:.1f} times better"
                    if mine > 0
                    else "which is known better",
                )
    return Use.EITHER, ""
