"""What a keyed calibration sheet may leave open, and the words that settle it."""

from __future__ import annotations

from calibrary.conventions import Origin
from calibrary.parsers.format import Option

__all__ = ["DISTORTION", "OPTIONS", "ORIGIN", "ORIGINS", "UNIT", "Y_AXIS"]

ORIGINS = {
    "corner": Origin.CORNER,
    "pixel-centre": Origin.PIXEL_CENTRE,
    "image-centre": Origin.IMAGE_CENTRE,
}
UNIT = Option(
    name="unit",
    values=("px", "mm"),
    meaning="what focal length and principal point are in where no key says it",
)
ORIGIN = Option(
    name="origin",
    values=tuple(ORIGINS),
    meaning="what the principal point is counted from: the outer corner of the top-left pixel, that pixel's "
    "centre, or the middle of the image",
)
Y_AXIS = Option(
    name="y_axis", values=("down", "up"), meaning="which way y grows, in the image and in the distortion"
)
DISTORTION = Option(
    name="distortion",
    values=("none", "brown", "rational", "thin-prism", "tilted", "kannala-brandt", "metashape"),
    meaning="which model k1, k2 … belong to, on x/z and y/z",
)
OPTIONS = (UNIT, ORIGIN, Y_AXIS, DISTORTION)
