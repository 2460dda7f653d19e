"""Why the cameras of a rig contradict each other, where it can be determined: by what the shots say one by one.

Every shot that two cameras share states their relative pose. A matrix of how far each shot's statement misses every
other shot shows the pattern: two blocks where a camera moved between two shots, single columns where one shot was
taken while something moved, an inverse where two frames were exchanged.
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

__all__ = ["RigCause", "RigTrouble", "moved", "swapped"]

FEWEST_ASIDE: Final = 3
"""Shots on either side of the moment in which a camera moved."""
CLEARLY: Final = 0.4
"""Two poses, one before and one after, miss by this part of what one pose misses."""
BY_ITSELF_PX: Final = 1.0
"""What one pose must miss for a move to be looked for; single shots' poses are not better than that."""
EXCHANGED: Final = 0.2


class RigCause(StrEnum):
    """Why the shots do not agree."""

    CAMERA_MOVED = "camera-moved"
    SWAPPED_FRAMES = "swapped-frames"
    NOT_SIMULTANEOUS = "not-simultaneous"


class RigTrouble(Record):
    """A cause, with the camera and the shots it is about.

    Attributes:
        cause: which.
        camera: the camera's name.
        shots: the first shot after a move; the shots whose frames were exchanged.
        before_px, after_px: what the shots miss by without and with the cause, mean over the shots.
    """

    cause: RigCause
    camera: str
    shots: tuple[str, ...]
    before_px: float
    after_px: float


def moved(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> RigTrouble | None:
    """Whether a camera has one place in the shots up to some moment and another one after it."""
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


def swapped(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> RigTrouble | None:
    """The shots in which each of the two cameras has the other's frame."""
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
    """(n, n) px by which the relative pose that one shot states misses the corners of each other shot."""
    pairing = Pairing(seen, eyes, link.camera, link.other, link.shots, link.shots)
    rows = [pairing.miss(place, pairing.poses) for place in pairing.stated]
    # A place that puts a board behind the camera misses by all of the frame, and not by infinity.
    return np.minimum(np.array(rows).reshape(len(rows), -1), float(link.width))
