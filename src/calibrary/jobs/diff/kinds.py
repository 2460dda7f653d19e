"""The changes that are of kind rather than of degree, by name."""

from __future__ import annotations

from enum import StrEnum
from typing import Final, Literal

from calibrary.records import Record

__all__ = ["ALARMING", "Kind", "Structural"]


class Kind(StrEnum):
    """What changed."""

    RESIZE = "resize"
    CROP = "crop"
    TURNED = "turned"
    MIRRORED = "mirrored"
    DEWARP_ON = "dewarp switched on"
    DEWARP_OFF = "dewarp switched off"
    HALF_PIXEL = "half-pixel convention"
    ORIGIN = "pixel origin"
    FROM_CENTRE = "principal point from the centre"
    OTHER_SIZE = "K of another image size"
    OTHER_UNIT = "distortion in another unit"
    COEFFICIENT_LOST = "coefficient lost"
    DISTORTION_LOST = "distortion lost"
    TANGENTIAL_SWAP = "p1 and p2 swapped"
    TANGENTIAL_SIGN = "sign of p1 and p2"
    DIRECTION = "distortion the other way round"
    FOCAL_SWAP = "fx and fy swapped"
    EQUIVALENT_LEAK = "35 mm equivalent"
    STRETCH = "transcode"
    OTHER_CAMERA = "another camera or lens"


ALARMING: Final = frozenset(
    {
        Kind.CROP,
        Kind.TURNED,
        Kind.MIRRORED,
        Kind.DEWARP_ON,
        Kind.DEWARP_OFF,
        Kind.HALF_PIXEL,
        Kind.ORIGIN,
        Kind.FROM_CENTRE,
        Kind.OTHER_SIZE,
        Kind.OTHER_UNIT,
        Kind.EQUIVALENT_LEAK,
        Kind.STRETCH,
        Kind.OTHER_CAMERA,
    }
)
"""Changes of the frame, the lens or its convention need attention whatever their size; a coefficient that was lost or
swapped needs it where the projections differ by more than the limits, and a resize never."""


class Structural(Record):
    """One change of kind.

    Attributes:
        kind: which.
        reason: the numbers that show it, and what it means, in one sentence.
        faulty: "A" or "B", the one that is wrong, where that shows.
    """

    kind: Kind
    reason: str
    faulty: Literal["A", "B"] | None = None
