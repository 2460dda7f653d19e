"""Optional check of K against the pixels, as one more source: it confirms K, contradicts it, or neither."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.fallback import Fallback, by_pixels
from calibrary.jobs.extract.judging import judge_image
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.places import is_url
from calibrary.jobs.survey.words import CONTRADICTED
from calibrary.jobs.verify.look import Look, look
from calibrary.known_camera import Projection
from calibrary.parsers.imagery import read_metadata
from calibrary.policy import FLEET, Policy
from calibrary.progress import Progress
from calibrary.records import replace
from calibrary.sfm.alterations import Claim, Kind, focal_altered
from calibrary.sfm.pixel_check import CentreCheck, DistortionCheck, PixelCheck, PixelVerdict
from calibrary.validation import Finding, Report, Severity, Verdict, lacks_confirmation

Verified = tuple[Camera, Fallback | None, PixelCheck | None, Look | None]


def verified(
    camera: Camera,
    fall_back: Callable[[Camera], Fallback | None],
    *,
    listing: Listing,
    policy: Policy,
    progress: Progress | None,
) -> Verified:
    """Check a camera, and its fallback, against the pixels.

    Args:
        camera: result from its images' metadata.
        fall_back: runs the fallback steps for it.
        listing: of the images.
        policy: the limits.
        progress: called with (done, total, what).

    Returns:
        The camera, its fallback, the check of the K in use, and the observations; without the last two if
        there is no K to check.
    """
    before = fall_back(camera)
    K = _in_use(camera, before)
    if K is None:
        return camera, before, None, None
    found, claim = _look(camera, K, listing, progress), claim_of(camera)
    if camera.calibration is not None:
        camera = _judged(camera, _explained(found, camera.calibration, claim, policy), policy)
    fallback = fall_back(camera)
    K = _in_use(camera, fallback) or K
    check = _explained(found, K, claim, policy)
    if fallback is not None and fallback.calibration is K and fallback.report is not None:
        fallback = replace(fallback, report=with_pixels(fallback.report, check, policy))
    valid = fallback.report if fallback is not None and fallback.report is not None else camera.report
    is_valid = valid is not None and valid.verdict is Verdict.VALID
    if not is_valid and found.measured is not None and policy.independent_sources_settle:
        fallback = by_pixels(camera, fallback, found.measured, policy)
    return camera, fallback, check, found


def _explained(found: Look, K: Calibration, claim: Claim | None, policy: Policy) -> PixelCheck:
    """Check K against the pixels; if they contradict it, add the tag that explains this."""
    check = found.check(K, policy.source_agreement)
    if check.verdict is not PixelVerdict.CONTRADICTS or claim is None or found.found is None:
        return check
    claim = replace(claim, K=K, by="K" if K is not claim.K else claim.by)
    return replace(check, explained=focal_altered(claim, found.found.focal_px, found.found.std))


def _in_use(camera: Camera, fallback: Fallback | None) -> Calibration | None:
    taken = fallback.calibration if fallback is not None else None
    return taken if taken is not None else camera.calibration


def _judged(camera: Camera, check: PixelCheck, policy: Policy) -> Camera:
    """Add the check to all states: they belong to one camera, so a dozen images represent them all."""
    judged = tuple(
        replace(one, report=with_pixels(one.report, check, policy)) if one.report is not None else one
        for one in camera.judged
    )
    report = with_pixels(camera.report, check, policy) if camera.report is not None else None
    return replace(camera, judged=judged, report=report)


def _look(camera: Camera, K: Calibration, listing: Listing, progress: Progress | None) -> Look:
    paths = [listing.root / name for name in camera.names if not is_url(name)]
    files = sorted({path for path in paths if path.is_file()})
    if len(files) < len(camera.names):
        return Look(
            chosen=0, reason="the images are not in a folder of this machine, where pixels can be read"
        )
    return look(files, K, progress=progress)


def claim_of(camera: Camera) -> Claim | None:
    """The claim about a camera; None without a K, or with a K from an assumed sensor size."""
    state = camera.states[0]
    known = state.known.camera
    if camera.calibration is None or camera.evidence.chosen is None or not camera.calibration.grade.is_metric:
        return None
    return Claim(
        K=camera.calibration,
        zoom=state.metadata.zoom,
        native_size=known.native_size if known is not None else None,
        fisheye=known is not None and known.projection is Projection.FISHEYE,
    )


def claim_of_image(path: Path) -> Claim | None:
    """The claim about the camera that took an image; None if the image cannot be read."""
    try:
        camera = judge_image(read_metadata(path), path.name, FLEET)
    except InputError:
        return None
    return claim_of(camera) if camera is not None else None


REMEDIES: Final = {
    Kind.DISTORTION_REMOVED: "use K without its distortion for these images, or provide images that are not dewarped",
    Kind.DISTORTION_PRESENT: "use the distortion of the lens: register a measured calibration of this capture mode",
    Kind.ZOOMED: "fly without digital zoom, or register a K for this zoom alone: --capture-mode 'zoom 2x'",
    Kind.CROPPED: "register a K for images of this size alone",
}
"""Remedies if the pixels show a different camera than stated."""
RIGHT = "find out which of the two is right: calibrate the camera with a board, or register a measured K"
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
        findings = tuple(_decided(one, check, policy) for one in findings)
    alone = any(lacks_confirmation(one) for one in findings)
    return replace(report, findings=(*findings, *_findings(check, policy, alone=alone)))


def _decided(finding: Finding, check: PixelCheck, policy: Policy) -> Finding:
    """A finding that pixels which agree with K settle: that it stands alone, or what is too far to agree with them."""
    if lacks_confirmation(finding):
        return _confirmed(finding, check)
    is_far = finding.measured is not None and abs(finding.measured) > policy.source_agreement
    if finding.rule == CONTRADICTED and is_far and finding.severity in {Severity.UNPROVEN, Severity.ERROR}:
        message = f"{finding.message}; the pixels of {check.images} images agree with K, and not with it"
        return replace(finding, severity=Severity.NOTE, message=message, remedy=None)
    return finding


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
            remedy=RIGHT,
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
    if check.centre is not None:
        yield _of_centre(check.centre, check.images, policy)
    if check.distortion is not None:
        yield from _of_distortion(check.distortion, policy)


def _of_centre(found: CentreCheck, images: int, policy: Policy) -> Finding:
    if not found.judged:
        severity, what = Severity.NOTE, "do not determine the principal point well enough to judge it"
    elif not found.off:
        severity, what = Severity.PASS, "agree with the principal point"
    elif found.assumed:
        severity, what = (
            Severity.NOTE,
            "show that it is not in the middle, where K assumes the principal point",
        )
    elif policy.independent_sources_settle:
        severity, what = Severity.UNPROVEN, "contradict the principal point"
    else:
        severity, what = Severity.WARNING, "contradict the principal point"
    return Finding(
        rule="pixels-centre",
        severity=severity,
        message=f"the pixels of {images} images {what}: {found.figures}",
        remedy=RIGHT if severity in {Severity.UNPROVEN, Severity.WARNING} else None,
    )


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
