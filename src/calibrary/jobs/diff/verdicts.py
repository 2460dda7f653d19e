"""Verdicts on the comparison of two calibrations, and the kinds of structural changes, as opposed to drift."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final, Literal

from calibrary.records import Meta, Record


class ChangeVerdict(StrEnum):
    """Verdict of a comparison, best first."""

    IDENTICAL = "identical"
    NOISE = "within noise"
    NEGLIGIBLE = "negligible"
    UNRESOLVED = "unresolved"
    DRIFT = "drift"
    STRUCTURAL = "structural"


class Kind(StrEnum):
    """Kind of a structural change."""

    RESIZE = "resize"
    CROP = "crop"
    FIELD = "another field of view"
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
    CENTRE_SWAP = "cx and cy swapped"
    OTHER_MODEL = "coefficients of another model"
    ORDER = "order of the coefficients"
    TANGENTIAL_SWAP = "p1 and p2 swapped"
    TANGENTIAL_SIGN = "sign of p1 and p2"
    DIRECTION = "distortion the other way round"
    FOCAL_SWAP = "fx and fy swapped"
    EQUIVALENT_LEAK = "35 mm equivalent"
    STRETCH = "transcode"
    OTHER_CAMERA = "another camera or lens"


ALARMING: Final = frozenset(Kind) - {
    Kind.RESIZE,
    Kind.COEFFICIENT_LOST,
    Kind.DISTORTION_LOST,
    Kind.CENTRE_SWAP,
    Kind.OTHER_MODEL,
    Kind.ORDER,
    Kind.TANGENTIAL_SWAP,
    Kind.TANGENTIAL_SIGN,
    Kind.DIRECTION,
    Kind.FOCAL_SWAP,
}
"""Changes of the frame, the lens or its convention need attention whatever their size. A lost or swapped coefficient
needs attention if the projections differ by more than the limits; a resize never does."""


class Structural(Record):
    """One structural change.

    Attributes:
        kind: of the change.
        reason: the numbers that show it and their meaning, in one sentence.
        faulty: "A" or "B", the calibration that is wrong, if this can be determined.
        likelihood: of this cause among all that were weighed; null if its numbers are fitted to the two.
    """

    kind: Kind
    reason: str
    faulty: Literal["A", "B"] | None = None
    likelihood: Annotated[float, Meta(ge=0, le=1)] | None = None


class Use(StrEnum):
    """Which of the two to use."""

    A = "A"
    B = "B"
    EITHER = "either"
    EACH = "each for its own images"
    NEITHER = "neither yet"
