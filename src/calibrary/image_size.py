"""Image sizes; this module does not need NumPy."""

from __future__ import annotations

from typing import Annotated, NamedTuple, TypeAlias

from calibrary.errors import InputError
from calibrary.records import Meta

Pixels: TypeAlias = Annotated[int, Meta(ge=1)]
ImageSize: TypeAlias = tuple[Pixels, Pixels]
"""(width, height) px."""


class Part(NamedTuple):
    """A part of an image, in px from its top-left corner."""

    left: int
    top: int
    width: int
    height: int

    @classmethod
    def parse(cls, text: str) -> Part:
        """Parse "100,50,4000,3000"."""
        try:
            return cls(*map(int, text.split(",")))
        except (TypeError, ValueError):
            raise InputError("expected X,Y,W,H in whole pixels, such as 100,50,4000,3000") from None


ASPECT_TOLERANCE = 0.01
"""Two sizes can be the same image at two scales if their aspect ratios agree within 1 %."""


def same_aspect(a: ImageSize, b: ImageSize, tolerance: float = ASPECT_TOLERANCE) -> bool:
    """Return whether two sizes can be one image at two scales; one pixel of rounding is always allowed."""
    (wa, ha), (wb, hb) = a, b
    rounding = 1.0 / min(wa, ha, wb, hb)
    return abs(wa * hb / (ha * wb) - 1.0) <= max(tolerance, rounding)


def is_resized(a: ImageSize, b: ImageSize) -> bool:
    """Return whether one size is the other resized, its sides rounded to whole pixels: 5472×3648 to 2048×1365."""
    (width, height), (w, h) = sorted((a, b), reverse=True)
    return abs(height * w / width - h) < 1.0
