"""Causes of contradictions between the cameras of a rig, from the relative poses of the individual shots.

Every shot of two cameras gives their relative pose. The matrix of residuals of each shot's relative pose in every
other shot shows the cause: two blocks if a camera moved between two shots, single columns if something moved during
one shot, an inverse pose if two images were exchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.rig.start import Eye, Link, Pairing
from calibrary.records import Record

FEWEST_ASIDE: Final = 3
"""Smallest number of shots before and after the movement of a camera."""
CLEARLY: Final = 0.4
"""Two poses, before and after, must reduce the residuals to this share of those with one pose."""
BY_ITSELF_PX: Final = 1.0
"""A movement is searched for only if the residuals with one pose exceed this; single shots are not more accurate."""
EXCHANGED: Final = 0.2


class RigCause(StrEnum):
    """Cause of a contradiction between shots."""

    CAMERA_MOVED = "camera-moved"
    SWAPPED_FRAMES = "swapped-frames"
    NOT_SIMULTANEOUS = "not-simultaneous"


class RigTrouble(Record):
    """A cause, with its camera and shots.

    Attributes:
        cause: the cause.
        camera: name of the camera.
        shots: the first shot after a movement, or the shots with exchanged images.
        before_px, after_px: mean residual in px without and with the cause.
    """

    cause: RigCause
    camera: str
    shots: tuple[str, ...]
    before_px: float
    after_px: float


def moved_camera(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> RigTrouble | None:
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
    return RigTrouble(
        cause=RigCause.CAMERA_MOVED,
        camera=seen.names[link.camera],
        shots=(seen.shots[link.shots[at]],),
        before_px=single,
        after_px=least,
    )


def swapped_images(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> RigTrouble | None:
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
    return RigTrouble(
        cause=RigCause.SWAPPED_FRAMES,
        camera=seen.names[link.camera],
        shots=tuple(seen.shots[shot] for shot in link.shots[wrong]),
        before_px=float(link.miss_px[wrong].mean()),
        after_px=float(exchanged[wrong].mean()),
    )


def _misses(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> FloatArray:
    """Return the residuals, (n, n) px, of each shot's relative pose in each other shot."""
    pairing = Pairing(seen, eyes, link.camera, link.other, link.shots, link.shots)
    rows = [pairing.miss(place, pairing.poses) for place in pairing.places]
    # A pose with the board behind the camera counts as a residual of the image's width, instead of infinity.
    return np.minimum(np.array(rows).reshape(len(rows), -1), float(link.width))
