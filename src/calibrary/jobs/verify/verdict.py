"""Effect of the pixel check on a report: it confirms K as another independent source, contradicts it, or neither."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.sfm.as_stated import Kind
from calibrary.sfm.pixel_check import DistortionCheck, PixelCheck, PixelVerdict
from calibrary.validation import Finding, Report, Severity, lacks_confirmation

__all__ = ["REMEDIES", "with_pixels"]

REMEDIES: Final = {
    Kind.DISTORTION_REMOVED: "use K without its distortion for these images, or provide images that are not dewarped",
    Kind.DISTORTION_PRESENT: "use the distortion of the lens: register a measured calibration of this capture mode",
    Kind.ZOOMED: "fly without digital zoom, or register a K for this zoom alone: --capture-mode 'zoom 2x'",
    Kind.CROPPED: "register a K for images of this size alone",
}
"""Remedies if the pixels show a different camera than stated."""
FLY = "fly cross strips, a second height, 30° obliques or with RTK, or calibrate the camera with a board"


def with_pixels(report: Report, check: PixelCheck, policy: Policy) -> Report:
    """Add the findings of the pixel check to a report.

    Agreement confirms a K that lacks only a second source. With a contradiction K is unverified at best, even if other
    sources agree with it; if none does and the contradiction is beyond doubt, K is rejected. Under a policy in which
    independent sources do not settle a verdict, a contradiction is a warning.

    Args:
        report: report on the K that was checked.
        check: pixel check of that K.
        policy: policy of the report.
    """
    findings = report.findings
    confirms = check.verdict is PixelVerdict.AGREES and policy.independent_sources_settle
    if confirms:
        findings = tuple(_confirmed(one, check) if lacks_confirmation(one) else one for one in findings)
    alone = any(lacks_confirmation(one) for one in findings)
    return replace(report, findings=(*findings, *_findings(check, policy, alone=alone)))


def _confirmed(finding: Finding, check: PixelCheck) -> Finding:
    message = f"fx = {finding.measured:.3f} W, confirmed independently by the pixels of {check.images} images"
    return replace(finding, severity=Severity.PASS, message=message, remedy=None)


def _findings(check: PixelCheck, policy: Policy, *, alone: bool) -> Iterator[Finding]:
    limit = policy.source_agreement
    if check.verdict is PixelVerdict.CANNOT_TELL:
        yield Finding(
            rule="pixels",
            severity=Severity.NOTE,
            measured=check.difference,
            limit=limit,
            message=f"the pixels cannot tell whether K is right: {check.reason}",
            remedy=FLY,
        )
    elif check.verdict is PixelVerdict.AGREES:
        yield Finding(
            rule="pixels",
            severity=Severity.PASS,
            measured=check.difference,
            limit=limit,
            message=f"the pixels of {check.images} images agree: {check.figures}",
        )
    else:
        severity = Severity.UNPROVEN
        assert check.difference is not None  # noqa: S101  it contradicts by so much
        assert check.std is not None  # noqa: S101
        if alone and abs(check.difference) - 2 * check.std > limit:
            severity = Severity.ERROR
        yield Finding(
            rule="pixels",
            severity=severity if policy.independent_sources_settle else Severity.WARNING,
            measured=check.difference,
            limit=limit,
            message=f"the pixels of {check.images} images contradict K: {check.figures}; {check.reason}",
            remedy="find out which of the two is right: calibrate the camera with a board, or register a measured K",
        )
    if check.explained is not None:
        yield Finding(
            rule=check.explained.kind.value,
            severity=Severity.UNPROVEN if policy.independent_sources_settle else Severity.WARNING,
            measured=check.explained.measured,
            limit=check.explained.stated,
            message=check.explained.message,
            remedy=REMEDIES[check.explained.kind],
        )
    if check.distortion is not None:
        yield from _of_distortion(check.distortion, policy)


def _of_distortion(found: DistortionCheck, policy: Policy) -> Iterator[Finding]:
    if not (found.removed or found.present):
        return
    pixels = f"{found.measured_px:+.1f} ± {found.std_px:.1f} px"
    if found.removed:
        message = (
            f"the images have {pixels} of distortion at the corners where K states {found.stated_px:+.1f} px: "
            "it was removed already, in the camera or by a program"
        )
        remedy = REMEDIES[Kind.DISTORTION_REMOVED]
    else:
        message = (
            f"K states that the images have no distortion, and their pixels show {pixels} at the corners"
        )
        remedy = REMEDIES[Kind.DISTORTION_PRESENT]
    yield Finding(
        rule="distortion-as-stated",
        severity=Severity.UNPROVEN if policy.independent_sources_settle else Severity.WARNING,
        measured=found.measured_px,
        limit=found.stated_px,
        message=message,
        remedy=remedy,
    )
