"""What is known about a calibration and its camera when it is validated."""

from __future__ import annotations

from msgspec import Struct

__all__ = ["Circumstances", "Expected", "NamedFocal"]


class Expected(Struct, frozen=True, kw_only=True):
    """Expected fx of a known camera, at the image size of the calibration.

    Attributes:
        fx: px.
        spread: relative tolerance known for this camera, None for the policy's.
        tolerance: relative tolerance of the registry entry, which replaces the policy's.
        source: "catalogue" or "registry".
        entry: path of the registry entry that states it.
        by_exif_focal: whether it is EXIF FocalLength ÷ known pitch, so that comparing cannot reveal a wrong
            FocalLength.
    """

    fx: float
    spread: float | None = None
    tolerance: float | None = None
    source: str
    entry: str | None = None
    by_exif_focal: bool = False


class NamedFocal(Struct, frozen=True, kw_only=True):
    """Focal length from another source, at the image size of the calibration.

    Attributes:
        name: tag of the source.
        fx: px.
        tolerance: relative rounding of the source itself.
        cause: most likely cause if it disagrees.
        independent: whether it shares no input with the validated source, so that agreement confirms K.
        confirms_within: largest relative difference that counts as agreement; None for the policy's.
    """

    name: str
    fx: float
    tolerance: float = 0.0
    cause: str | None = None
    independent: bool = True
    confirms_within: float | None = None


class Circumstances(Struct, frozen=True, kw_only=True):
    """What is known about a calibration and its camera when it is validated.

    Attributes:
        expected: expected fx of a known camera.
        others: focal lengths from the other sources.
        focal_mm, focal_35mm: from EXIF, if the K is based on them.
        weighed: whether the camera is unknown, so that only the sources in its images can be compared.
        resized: whether the K assumes that the image was resized, although it may have been cropped to the same
            aspect ratio.
        sensor_assumed: whether the K is based on an assumed sensor size.
        sensor_given: whether the K is based on a sensor size stated by the user.
        zoom: factor by which digital zoom may have enlarged the image; K depends on how the camera applies it.
        edits: edits made to the pixels after the camera wrote them.
        spread: spread of K over the images of this camera, as a fraction of fx.
    """

    expected: Expected | None = None
    others: tuple[NamedFocal, ...] = ()
    focal_mm: float | None = None
    focal_35mm: float | None = None
    weighed: bool = False
    resized: bool = False
    sensor_assumed: bool = False
    sensor_given: bool = False
    zoom: float = 1.0
    edits: tuple[str, ...] = ()
    spread: float | None = None
