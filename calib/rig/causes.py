"""Causes of contradictions between the cameras of a rig, from the relative poses of the individual shots.

Every shot of two cameras gives their relative pose. The matrix of residuals of each shot's relative pose in every
other shot shows the cause: two blocks if a camera moved between two shots, single columns if something moved during
one shot, an inverse pose if two images were exchanged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.rig.start import Eye, Link, Mispairing, Pairing
from calibrary.errors import first_of
from calibrary.validation import Finding, Severity

FEWEST_ASIDE: Final = 3
"""Smallest number of shots before and after the movement of a camera."""
CLEARLY: Final = 0.4
"""Two poses, before and after, must reduce the residuals to this share of those with one pose."""
BY_ITSELF_PX: Final = 1.0
"""A movement is searched for only if the residuals with one pose exceed this; single shots are not more accurate."""
EXCHANGED: Final = 0.2


CAMERA_MOVED: Final = "camera-moved"
"""Rule of a camera that has one place up to some shot, and another one after it."""


def moved_camera(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> Finding | None:
    """Test whether a camera has one pose up to some shot and another one after it."""
    misses = _misses(seen, eyes, link)
    count = len(misses)
    if count < 2 * FEWEST_ASIDE:
        return None
    single = float(misses.mean(axis=1).min())
    if single < max(BY_ITSELF_PX, 5 * eyes[link.other].noise_px):
        return None
    total = np.cumsum(misses, axis=1)
    cuts = range(FEWEST_ASIDE, count - FEWEST_ASIDE + 1)
    both = [
        (float(total[:, at - 1].min() + (total[:, -1] - total[:, at - 1]).min()) / count, at) for at in cuts
    ]
    least, at = min(both)
    if least > CLEARLY * single:
        return None
    return Finding(
        rule=CAMERA_MOVED,
        severity=Severity.ERROR,
        measured=single,
        message=f"{seen.names[link.camera]} moved in the rig before the shot {seen.shots[link.shots[at]]}: one pose "
        f"misses by {single:.1f} px, one before and one after by {least:.1f} px",
        remedy="fasten it; calibrate the shots before and after by themselves",
    )


def swapped_images(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> Finding | None:
    """Find the shots in which the images of the two cameras are exchanged."""
    if link.place is None or seen.cameras[seen.names[link.camera]].image_size != (
        seen.cameras[seen.names[link.other]].image_size
    ):
        return None
    pairing = Pairing(seen, eyes, link.camera, link.other, link.shots, link.shots)
    exchanged = pairing.miss(link.place, pairing.poses)
    limit = max(BY_ITSELF_PX, 5 * eyes[link.other].noise_px, 3 * float(np.median(link.miss_px)))
    wrong = (exchanged < EXCHANGED * link.miss_px) & (link.miss_px > limit)
    if not wrong.any():
        return None
    before, after = float(link.miss_px[wrong].mean()), float(exchanged[wrong].mean())
    return Finding(
        rule="swapped-frames",
        severity=Severity.UNPROVEN,
        measured=before,
        message=f"in {first_of([seen.shots[shot] for shot in link.shots[wrong]], 4)} the frame of "
        f"{seen.names[link.camera]} and the other camera's are exchanged: they miss by {before:.0f} px as paired, by "
        f"{after:.1f} px exchanged",
        remedy="exchange the two files of these shots",
    )


def _misses(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> FloatArray:
    """Return the residuals, (n, n) px, of each shot's relative pose in each other shot."""
    pairing = Pairing(seen, eyes, link.camera, link.other, link.shots, link.shots)
    rows = [pairing.miss(place, pairing.poses) for place in pairing.places]
    # A pose with the board behind the camera counts as a residual of the image's width, instead of infinity.
    return np.minimum(np.array(rows).reshape(len(rows), -1), float(link.width))


_PAIRED: Final[Mapping[Mispairing, tuple[str, str]]] = {
    Mispairing.SHIFTED: (
        "they agree if {camera}'s frames are paired {by:+d} shots later",
        "a frame is missing or extra at the beginning: give the pairing by --pattern, or remove the frame",
    ),
    Mispairing.REVERSED: (
        "they agree if {camera}'s frames are taken in reverse order",
        "pair them in reverse",
    ),
    Mispairing.MIRRORED: (
        "they agree if {camera}'s images are mirrored",
        "switch off the mirroring (flip) of this camera, or flip its images back",
    ),
}


def mispaired(seen: RigObservations, link: Link) -> Finding:
    """Return what is wrong with the pairing of two cameras' images whose shots agree on no relative pose."""
    kind, by = link.mispairing or (None, 0)
    camera, miss_px = seen.names[link.camera], float(min(np.median(link.miss_px), link.width))
    found, remedy = _PAIRED[kind] if kind is not None else (
        "no other pairing makes them agree",
        "check which frames belong together, and that the cameras are fixed to one another",
    )  # fmt: skip
    return Finding(
        rule=kind.value if kind is not None else "no-common-pose",
        severity=Severity.ERROR,
        measured=miss_px,
        message=f"the shots of {camera} and {seen.names[link.other]} agree on no relative pose: they miss by "
        f"{miss_px:.0f} px; {found.format(camera=camera, by=by)}",
        remedy=remedy,
    )
