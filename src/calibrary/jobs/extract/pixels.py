"""Optional check of K against the pixels of the images, as an additional source."""

from __future__ import annotations

from collections.abc import Callable

from calibrary.calibration import Calibration
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.claims import claim_of
from calibrary.jobs.extract.fallback import Fallback
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.places import is_url
from calibrary.jobs.verify.look import Look, look
from calibrary.jobs.verify.verdict import with_pixels
from calibrary.policy import Policy
from calibrary.progress import Progress
from calibrary.records import replace
from calibrary.sfm.as_stated import Claim, focal_altered
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict

__all__ = ["Verified", "verified"]

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
