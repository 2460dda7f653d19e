"""XMP exif:CameraHorizontalFOV (Teledyne FLIR, Teal), in degrees: fx = W/2 ÷ tan(HFOV/2)."""

from __future__ import annotations

import math
from collections.abc import Iterator

from calibrary.calibration import Grade, Intrinsics
from calibrary.evidence.context import Finding, Scene, numbers
from calibrary.evidence.estimate import Dropped, Source
from calibrary.evidence.frame import files_frame

__all__ = ["estimates"]

TAG = "exif:CameraHorizontalFOV"

PLAUSIBLE_DEG = (3.0, 130.0)


def estimates(scene: Scene) -> Iterator[Finding]:
    """The focal length computed from the horizontal field of view that the camera states."""
    text = scene.metadata.xmp_text("exif", "CameraHorizontalFOV")
    if text is None:
        return
    horizontal = numbers(text)
    if (
        horizontal is None
        or len(horizontal) != 1
        or not PLAUSIBLE_DEG[0] <= horizontal[0] <= PLAUSIBLE_DEG[1]
    ):
        yield Dropped(
            source=Source.FIELD_OF_VIEW,
            tag=TAG,
            reason="does not contain an angle between 3 and 130 degrees",
        )
        return
    width, height = files_frame(scene.metadata)
    focal = width / 2 / math.tan(math.radians(horizontal[0]) / 2)
    intrinsics = Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=(width, height))
    yield scene.estimate(Source.FIELD_OF_VIEW, TAG, Grade.DESIGN, intrinsics)
