"""Comparison of the sources of an unknown camera with each other.

A focal plane resolution describes the sensor as long as the file is the original. Programs that resize an image
rewrite its size in EXIF but keep the resolution, which then implies a smaller or larger sensor than the camera has.
The sensor width listed for the camera's name reveals this. Such an image is assumed to be resized, not cropped,
because nearly all such files are; the assumption is recorded.
"""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.calibration import Grade
from calibrary.evidence.context import Scene
from calibrary.evidence.estimate import AGREEMENT, UNCONFIRMED, Dropped, Source, SourceEstimate
from calibrary.evidence.frame import RESIZED, files_frame
from calibrary.evidence.metadata import ImageMetadata
from calibrary.records import replace

__all__ = ["weigh"]


def weigh(
    scene: Scene, estimates: Sequence[SourceEstimate]
) -> tuple[list[SourceEstimate], tuple[Dropped, ...]]:
    """Credible estimates, with grades raised where they confirm each other; and the dropped ones."""
    stale = _stale_focal_plane(estimates)
    kept = [one for one in estimates if one is not stale]
    dropped: tuple[Dropped, ...] = ()
    focal_mm = scene.metadata.focal_mm
    if stale is not None and scene.listed is not None and focal_mm is not None:
        found = _width_mm(focal_mm, scene.metadata, stale)
        reason = (
            f"would be a sensor {found:.2f} mm wide, and {scene.listed.source} list {scene.listed.mm:g} mm: "
            f"assumed that {RESIZED}, and the tag kept"
        )
        dropped = (Dropped(source=stale.source, tag=stale.tag, reason=reason),)
        kept = [replace(one, assumptions=tuple(dict.fromkeys((*one.assumptions, RESIZED)))) for one in kept]
    return sorted((_graded(one, kept) for one in kept), key=lambda one: one.rank), dropped


def _stale_focal_plane(estimates: Sequence[SourceEstimate]) -> SourceEstimate | None:
    """The focal plane's estimate if the listed width contradicts it and no third source supports it, else None."""
    by_source = {one.source: one for one in estimates}
    plane, listed = by_source.get(Source.FOCAL_PLANE), by_source.get(Source.LISTED_SENSOR)
    if plane is None or listed is None or _agree(plane, listed, AGREEMENT):
        return None
    others = [one for one in estimates if one not in (plane, listed)]
    sides = [_agree(one, plane, AGREEMENT) and not _agree(one, listed, AGREEMENT) for one in others]
    return None if any(sides) else plane


def _graded(estimate: SourceEstimate, estimates: Sequence[SourceEstimate]) -> SourceEstimate:
    """The estimate, raised from prior to derived if it needs confirmation and an independent source gives it."""
    confirmed = any(
        one.is_independent_of(estimate) and _agree(one, estimate, estimate.confirms_within(one))
        for one in estimates
        if one.source is not Source.ASSUMED_SENSOR
    )
    is_raised = estimate.source in UNCONFIRMED and confirmed
    return replace(estimate, grade=Grade.DERIVED) if is_raised else estimate


def _agree(one: SourceEstimate, other: SourceEstimate, within: float) -> bool:
    return abs(one.intrinsics.fx / other.intrinsics.fx - 1.0) <= within


def _width_mm(focal_mm: float, metadata: ImageMetadata, estimate: SourceEstimate) -> float:
    scale = max(files_frame(metadata)) / max(metadata.size)
    return focal_mm * max(files_frame(metadata)) / (estimate.intrinsics.fx * scale)
