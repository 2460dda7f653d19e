"""Estimates that disagree, and the most likely cause."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import StrEnum

from msgspec import Struct

from calibrary.evidence.context import Scene
from calibrary.evidence.estimate import AGREEMENT, Source, SourceEstimate
from calibrary.evidence.frame import files_frame

__all__ = ["Cause", "Conflict", "conflicts", "disagreement"]

RATIO_SLACK = 0.03

WIDE_ASPECT = 1.7
"""No UAV still sensor has an aspect ratio this wide; an image that has was cropped."""


class Cause(StrEnum):
    """Most likely cause of a disagreement between two estimates; the value is the text shown to the user."""

    LEAK_35MM = "the 35 mm equivalent was written as the focal length in millimetres"
    DIGITAL_ZOOM = "digital zoom is applied in one of them only"
    OTHER_SUB_CAMERA = "the tag belongs to another sub-camera of this Model"
    STALE_EXIF_SIZE = "the image size in EXIF differs from that of the file"
    CROP = "the image was cropped or resized, which only one of them takes into account"
    UNIT = "millimetres were read as pixels, or pixels as millimetres"
    SENSOR_SIZE = "the sensor size is not this camera's"
    UNKNOWN = "unknown cause; check the tags"


class Conflict(Struct, frozen=True, kw_only=True):
    """Two estimates that differ by more than is allowed.

    Attributes:
        chosen: the estimate that is used.
        other: the estimate that disagrees with it.
        difference: (other − chosen) / chosen of the focal lengths.
        cause: the most likely cause.
    """

    chosen: SourceEstimate
    other: SourceEstimate
    difference: float
    cause: Cause


def disagreement(a: SourceEstimate, b: SourceEstimate) -> float:
    """(b − a) / a of the focal lengths, or 0.0 if they agree within 5 % or within their rounding."""
    difference = b.intrinsics.fx / a.intrinsics.fx - 1.0
    return difference if abs(difference) > max(AGREEMENT, a.tolerance, b.tolerance) else 0.0


def conflicts(scene: Scene, chosen: SourceEstimate, others: Sequence[SourceEstimate]) -> Iterator[Conflict]:
    """Every other estimate that disagrees with the chosen one."""
    for other in others:
        difference = disagreement(chosen, other)
        if difference:
            yield Conflict(
                chosen=chosen, other=other, difference=difference, cause=_cause(scene, chosen, other)
            )


def _cause(scene: Scene, chosen: SourceEstimate, other: SourceEstimate) -> Cause:
    ratio = other.intrinsics.fx / chosen.intrinsics.fx
    metadata = scene.metadata
    focal_mm, focal_35mm = metadata.focal_mm, metadata.focal_35mm
    if focal_mm is not None and focal_35mm is not None and _near(focal_mm / focal_35mm, 1.0):
        return Cause.LEAK_35MM
    zoom = scene.written.zoom
    if zoom > 1.0 and _near_either(ratio, zoom):
        return Cause.DIGITAL_ZOOM
    if any(_is_sibling(scene, estimate) for estimate in (other, chosen)):
        return Cause.OTHER_SUB_CAMERA
    sources = {chosen.source, other.source}
    wide = Source.FOCAL_35MM in sources and _is_wide_crop(scene, ratio)
    if sources & {Source.GIVEN_SENSOR, Source.LISTED_SENSOR, Source.ASSUMED_SENSOR}:
        return Cause.CROP if wide else Cause.SENSOR_SIZE
    exif_size, size = metadata.exif_size, metadata.size
    if exif_size is not None and exif_size != size and _near_either(ratio, exif_size[0] / size[0]):
        return Cause.STALE_EXIF_SIZE
    native = scene.native_size
    resized = native is not None and native != size and native[0] / files_frame(metadata)[0]
    if wide or (resized and _near_either(ratio, resized)):
        return Cause.CROP
    per_mm = scene.px_per_mm()
    if per_mm is not None and _near_either(ratio, per_mm[0]):
        return Cause.UNIT
    return Cause.UNKNOWN


def _is_wide_crop(scene: Scene, ratio: float) -> bool:
    """Whether the 35 mm equivalent differs by as much as a 16:9 crop of a 4:3 or 3:2 sensor explains.

    The 35 mm equivalent refers to the diagonal of the full sensor, which is unknown for an unknown camera.
    """
    width, height = files_frame(scene.metadata)
    if scene.native_size is not None or width / height < WIDE_ASPECT:
        return False
    shrunk = [math.hypot(1, height / width) / math.hypot(1, side) for side in (3 / 4, 2 / 3)]
    return any(_near_either(ratio, factor) for factor in shrunk)


def _is_sibling(scene: Scene, estimate: SourceEstimate) -> bool:
    """Whether an estimate matches the focal length of another camera with the same EXIF Model."""
    own = scene.known.fx_over_w_at(scene.focal_mm) if scene.known is not None else None
    over_width = estimate.intrinsics.fx / estimate.intrinsics.image_size[0]
    if own is not None and _near(over_width / own, 1.0):
        return False
    focal_mm = scene.metadata.focal_mm
    rests_on_focal = estimate.tag.startswith("EXIF FocalLength ")
    for sibling in scene.siblings:
        if sibling.fx_over_w is not None and _near(over_width / sibling.fx_over_w, 1.0):
            return True
        if rests_on_focal and focal_mm and sibling.focal_mm and _near(focal_mm / sibling.focal_mm, 1.0):
            own_focal = scene.known.focal_mm if scene.known is not None else None
            return own_focal is None or not _near(focal_mm / own_focal, 1.0)
    return False


def _near(a: float, b: float) -> bool:
    return abs(a / b - 1.0) <= RATIO_SLACK


def _near_either(ratio: float, factor: float) -> bool:
    return factor != 1.0 and (_near(ratio, factor) or _near(ratio, 1.0 / factor))
