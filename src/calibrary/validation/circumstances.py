"""What is known around a calibration when it is judged."""

from __future__ import annotations

from msgspec import Struct

__all__ = ["Circumstances", "Expected", "NamedFocal"]


class Expected(Struct, frozen=True, kw_only=True):
    """Expected fx of a known camera, at the image size of the calibration.

    Attributes:
        fx: px.
        spread: relative half-width that is known for this camera, None for the policy's.
        tolerance: of the registry entry, in place of the policy's; larger or smaller.
        source: "catalogue" or "registry".
        entry: path of the registry's entry that states it.
        by_exif_focal: whether it is EXIF's focal length over a known pitch, so that a wrong one shows in neither.
    """

    fx: float
    spread: float | None = None
    tolerance: float | None = None
    source: str
    entry: str | None = None
    by_exif_focal: bool = False


class NamedFocal(Struct, frozen=True, kw_only=True):
    """Another source's focal length in the frame of the calibration.

    Attributes:
        name: the tag it is from.
        fx: px.
        tolerance: relative rounding of the source itself.
        cause: what most likely makes it disagree.
        independent: whether it shares nothing with the judged one, so that agreeing with it proves something.
        confirms_within: how near it must be for that; None for the policy's source agreement.
    """

    name: str
    fx: float
    tolerance: float = 0.0
    cause: str | None = None
    independent: bool = True
    confirms_within: float | None = None


class Circumstances(Struct, frozen=True, kw_only=True):
    """What is known around a calibration when it is judged.

    Attributes:
        expected: of a known camera.
        others: what other sources say, the judged one not among them.
        focal_mm, focal_35mm: EXIF's, where the K rests on them.
        weighed: nothing is known of the camera, and the sources of an image are all there is.
        resized: the K assumes that the image was resized, where it may have been cropped to the same proportions.
        sensor_assumed: the K rests on an assumed sensor size.
        sensor_given: it rests on one that the user stated.
        zoom: by how much digital zoom may have enlarged the image: the K rests on how the camera handles it.
        edits: what an editor did to the pixels since the camera wrote them.
        spread: how far K's numbers spread over the images of this camera, as a share of fx.
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
