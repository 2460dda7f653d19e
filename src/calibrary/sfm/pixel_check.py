"""Records of the pixel check: whether the pixels of a few images agree with K."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from calibrary.records import Meta, Record
from calibrary.sfm.alterations import Alteration


class PixelVerdict(StrEnum):
    """Verdict of the pixels on K."""

    AGREES = "agrees"
    CONTRADICTS = "contradicts"
    CANNOT_TELL = "cannot tell"


class DistortionCheck(Record):
    """Distortion at the image corners by K and by the pixels.

    Attributes:
        stated_px: outward shift by K, px; 0 if K states that there is no distortion.
        measured_px: outward shift by the adjustment, px.
        std_px: standard deviation of measured_px.
        removed: whether K states a distortion that the pixels no longer have.
        present: whether K states no distortion, but the pixels have one.
    """

    stated_px: float
    measured_px: float
    std_px: Annotated[float, Meta(ge=0)]
    removed: bool
    present: bool


class CentreCheck(Record):
    """Principal point by K and by the pixels.

    Attributes:
        stated_px: (cx, cy) by K, px.
        measured_px: (cx, cy) by the adjustment, px.
        std_px: standard deviations of measured_px.
        judged: whether the pixels determine it well enough to agree or to contradict.
        off: whether they contradict.
        assumed: whether K states the middle of the image, which nobody measured.
    """

    stated_px: tuple[float, float]
    measured_px: tuple[float, float]
    std_px: tuple[float, float]
    judged: bool
    off: bool
    assumed: bool

    @property
    def figures(self) -> str:
        """The measured principal point with its uncertainty, in words."""
        at = ", ".join(
            f"{value:.1f} ± {std:.1f}" for value, std in zip(self.measured_px, self.std_px, strict=True)
        )
        stated = ", ".join(f"{value:.1f}" for value in self.stated_px)
        return f"principal point ({at}) px, and K states ({stated}) px"


class PixelCheck(Record):
    """Comparison of K with the pixels of some images.

    Attributes:
        verdict: agrees, contradicts or cannot tell.
        fx: fx of K, px.
        measured_fx: fx by the pixels, px; None if they do not determine it.
        difference: measured_fx ÷ fx − 1.
        std: relative standard deviation of the difference.
        images: number of images in the adjustment.
        chosen: number of images evaluated.
        reason: reason for the verdict, in one sentence.
        pair_fx: fx by pairs of images alone, px; None if they do not determine it.
        pair_std: relative standard deviation of pair_fx.
        pairs: number of pairs that determine pair_fx.
        distortion: comparison of the distortion; None if K states none to compare, or nothing was measured.
        centre: comparison of the principal point; None if it was not measured.
        explained: tag that explains a contradiction (digital zoom, crop); None if none does.
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
    centre: CentreCheck | None = None
    explained: Alteration | None = None

    @property
    def figures(self) -> str:
        """The measured focal length with its uncertainty, in words."""
        if self.measured_fx is None or self.difference is None or self.std is None:
            return ""
        return f"fx = {self.measured_fx:.1f} px ± {self.std:.1%}, {self.difference:+.1%} from K's {self.fx:.1f} px"
