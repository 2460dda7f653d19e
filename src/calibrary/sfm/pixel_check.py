"""What the pixels of a few images say of K, as a report states it."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from calibrary.records import Meta, Record
from calibrary.sfm.as_stated import Alteration

__all__ = ["DistortionCheck", "PixelCheck", "PixelVerdict"]


class PixelVerdict(StrEnum):
    """What the pixels say of K."""

    AGREES = "agrees"
    CONTRADICTS = "contradicts"
    CANNOT_TELL = "cannot tell"


class DistortionCheck(Record):
    """The lens's distortion as K states it and as the pixels show it, at the image's corners.

    Attributes:
        stated_px: outwards positive; 0 where K states that there is none.
        measured_px: by the adjustment.
        std_px: of it.
        removed: whether K states a distortion that the pixels do not have any more.
        present: whether K states that there is none, and the pixels have one.
    """

    stated_px: float
    measured_px: float
    std_px: Annotated[float, Meta(ge=0)]
    removed: bool
    present: bool


class PixelCheck(Record):
    """What the pixels of some images say of K.

    Attributes:
        verdict: agrees, contradicts or cannot tell.
        fx: of K, px.
        measured_fx: by the pixels, px; None where they determine none.
        difference: measured ÷ K − 1.
        std: of the difference, relative, one σ.
        images: how many the adjustment has.
        chosen: how many were looked at.
        reason: in one sentence.
        pair_fx: focal length by pairs of images alone, px; None where they determine none.
        pair_std: of it, relative.
        pairs: how many pairs determine it.
        distortion: None where K states none that could be compared, or nothing was measured.
        explained: what of the tags explains a contradiction: digital zoom, a crop; None where nothing does.
    """

    verdict: PixelVerdict
    fx: Annotated[float, Meta(gt=0)]
    measured_fx: float | None = None
    difference: float | None = None
    std: float | None = None
    images: Annotated[int, Meta(ge=0)] = 0
    chosen: Annotated[int, Meta(ge=0)] = 0
    reason: str
    pair_fx: float | None = None
    pair_std: float | None = None
    pairs: Annotated[int, Meta(ge=0)] = 0
    distortion: DistortionCheck | None = None
    explained: Alteration | None = None

    @property
    def figures(self) -> str:
        """The measured focal length with its uncertainty, in words."""
        if self.measured_fx is None or self.difference is None or self.std is None:
            return ""
        return f"fx = {self.measured_fx:.1f} px ± {self.std:.1%}, {self.difference:+.1%} from K's {self.fx:.1f} px"
