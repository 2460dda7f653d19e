"""Results of a detector: the points found, or the reason why there are none."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray


class Reason(StrEnum):
    """Problem of an image or of its view of the board; stable codes for programs."""

    UNREADABLE = "unreadable"
    OTHER_SIZE = "other-size"
    RESAVED = "resaved"
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
    """A remark on one image.

    Attributes:
        reason: code of the remark.
        text: what was measured, what was expected and what to do, without the name of the image.
        rejects: whether the view must not be used for calibration.
    """

    reason: Reason
    text: str
    rejects: bool = False


class Found(Struct, frozen=True, kw_only=True, eq=False):
    """The points of the board found in one image.

    Attributes:
        ids: (N,) indices into :attr:`Board.points`, ascending.
        points: (N, 2) px in the canonical origin.
        spacing_px: smallest distance between neighbouring points, px.
        lattice: (rows, columns, 2) px with OpenCV's pixel origin, if all points of a grid were found.
        remarks: points that the detector left out, and other remarks.
    """

    ids: IntArray
    points: FloatArray
    spacing_px: float
    lattice: FloatArray | None = None
    remarks: tuple[Remark, ...] = ()


class NotFound(Remark, frozen=True, kw_only=True):
    """No board was found; the text says what was found and what was expected."""

    rejects: bool = True
