"""What a detector answers: the points it found, or why there are none."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray

__all__ = ["Found", "NotFound", "Reason", "Remark"]


class Reason(StrEnum):
    """What is wrong with a frame or its view of the board; stable, for programs."""

    UNREADABLE = "unreadable"
    OTHER_SIZE = "other-size"
    NO_BOARD = "no-board"
    LARGER_BOARD = "larger-board"
    UNEVEN = "uneven"
    FEW_POINTS = "few-points"
    DISPLACED_CORNERS = "displaced-corners"
    AT_BORDER = "at-border"
    BLURRED = "blurred"
    DRAGGED = "dragged"
    SMALL = "small"
    LOW_CONTRAST = "low-contrast"
    OVEREXPOSED = "overexposed"
    GLARE = "glare"
    SAME_FILE = "same-file"
    SAME_POSE = "same-pose"
    PARTIAL_BOARD = "partial-board"
    PERSPECTIVE_BIAS = "perspective-bias"
    NOT_PLACED = "not-placed"


class Remark(Struct, frozen=True, kw_only=True):
    """Something a person should know of one frame.

    Attributes:
        reason: which kind.
        text: what was measured, what was expected and what to do, without the frame's name.
        rejects: whether the view must not be calibrated with.
    """

    reason: Reason
    text: str
    rejects: bool = False


class Found(Struct, frozen=True, kw_only=True, eq=False):
    """The board's points as seen in one image.

    Attributes:
        ids: (N,) indices into :attr:`Board.points`, ascending.
        points: (N, 2) px in the canonical origin.
        spacing_px: smallest distance between neighbouring points.
        lattice: (rows, columns, 2) px as OpenCV counts them, where all points of a grid were seen.
        remarks: what the detector left out or could not do.
    """

    ids: IntArray
    points: FloatArray
    spacing_px: float
    lattice: FloatArray | None = None
    remarks: tuple[Remark, ...] = ()


class NotFound(Struct, frozen=True, kw_only=True):
    """No board, and why.

    Attributes:
        reason: which kind.
        text: what was found and what was expected, without the frame's name.
    """

    reason: Reason
    text: str
