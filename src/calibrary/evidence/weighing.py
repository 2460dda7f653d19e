"""All estimates of K for one image, compared with each other, and the best of them.

For an unknown camera the sources are weighed. A focal plane resolution describes the sensor as long as the file is the
original. Programs that resize an image rewrite its size in EXIF but keep the resolution, which then implies a smaller
or larger sensor than the camera has. The sensor width listed for the camera's name reveals this. Such an image is
assumed to be resized, not cropped, because nearly all such files are; the assumption is recorded.

Where estimates disagree, the most likely cause is named.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade, Provenance
from calibrary.dates import iso_date
from calibrary.distortion import NoDistortion
from calibrary.evidence import camera_namespace, dji, optics, skydio
from calibrary.evidence.context import AGREEMENT, UNCONFIRMED, Dropped, Scene, Source, SourceEstimate
from calibrary.evidence.frame import files_frame
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import has_lens_correction, no_frame
from calibrary.evidence.readings import RESIZED
from calibrary.records import replace

SOURCES = (dji, camera_namespace, skydio, optics)
"""Each module of sources has a function ``estimates(scene)``; what one image states in several is weighed here."""


class Evidence(Struct, frozen=True, kw_only=True):
    """All evidence about K from one image and from the known camera.

    Attributes:
        scene: the image's metadata and what is known about its camera.
        estimates: best first.
        dropped: sources that are present but not credible.
        contradiction: reason why the image size in EXIF cannot belong to this file; if set, no source is read.
    """

    scene: Scene
    estimates: tuple[SourceEstimate, ...] = ()
    dropped: tuple[Dropped, ...] = ()
    contradiction: str | None = None

    @property
    def chosen(self) -> SourceEstimate | None:
        """The best estimate of K: the first with a metric grade, otherwise the first that lacks confirmation.

        Of an unknown camera of which nothing else is known, that is the 35 mm equivalent.
        """
        whole = [one for one in self.estimates if one.is_whole]
        usable = [one for one in whole if one.grade.is_metric] or [one for one in whole if one.is_k]
        if not usable and self.scene.weighs:
            usable = whole
        return usable[0] if usable else None

    def cause(self, tag: str) -> Cause | None:
        """The most likely cause why a tag disagrees with the chosen estimate; None if it does not."""
        other, chosen = next((one for one in self.estimates if one.tag == tag), None), self.chosen
        if other is None or chosen is None or not disagreement(chosen, other):
            return None
        return _cause(self.scene, chosen, other)

    def calibration(self, camera: CameraKey, source_name: str | None = None) -> Calibration | None:
        """The chosen estimate as a calibration of ``camera``, or None when there is no K."""
        estimate = self.chosen
        if estimate is None:
            return None
        orientation = self.scene.metadata.orientation
        notes: tuple[str, ...] = ()
        if orientation is not None and orientation != 1:
            notes = (
                f"EXIF Orientation is {orientation}: K counts in the stored pixels; "
                "turn it together with an image that a viewer turns",
            )
        date = iso_date(estimate.date) if estimate.date else None
        if estimate.date and date is None:
            notes = (
                *notes,
                f"{estimate.tag} states the date {estimate.date!r}, which is ambiguous or not a date",
            )
        grade, distortion = estimate.grade, estimate.distortion
        if dji.is_dewarped(self.scene.metadata):
            distortion = NoDistortion()
        if has_lens_correction(self.scene.metadata):
            # What was measured of the lens is no longer that of the image.
            grade, distortion = max(grade, Grade.DERIVED, key=lambda one: one.rank), None
        return Calibration(
            camera=camera,
            intrinsics=estimate.intrinsics,
            distortion=distortion,
            grade=grade,
            provenance=Provenance(
                kind="stated" if estimate.source is Source.STATED else "image-metadata",
                source=source_name,
                tag=estimate.tag,
                reference_size=estimate.reference_size,
                adaptation="; ".join(estimate.steps) or None,
                assumptions=estimate.assumptions,
                # EXIF dates state when the photograph was taken, so only the source's own date is used.
                date=date,
            ),
            notes=notes,
        )


def evidence_of(scene: Scene) -> Evidence:
    """Read every source of one image. Raises nothing: sources that are not credible are listed in ``dropped``."""
    contradiction = no_frame(scene.metadata)
    if contradiction is not None:
        return Evidence(scene=scene, contradiction=contradiction)
    findings = [finding for source in SOURCES for finding in source.estimates(scene)]
    found = sorted((f for f in findings if isinstance(f, SourceEstimate)), key=lambda estimate: estimate.rank)
    if any(w.source is not Source.ASSUMED_SENSOR and (w.grade.is_metric or scene.weighs) for w in found):
        # An assumed sensor size is not evidence: it must neither confirm nor contradict a K.
        found = [w for w in found if w.source is not Source.ASSUMED_SENSOR]
    dropped = tuple(f for f in findings if isinstance(f, Dropped))
    if scene.weighs:
        found, stale = _weigh(scene, found)
        dropped = (*dropped, *stale)
    return Evidence(scene=scene, estimates=tuple(found), dropped=dropped)


def _weigh(
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


def disagreement(a: SourceEstimate, b: SourceEstimate) -> float:
    """(b − a) / a of the focal lengths, or 0.0 if they agree within 5 % or within their rounding."""
    difference = b.intrinsics.fx / a.intrinsics.fx - 1.0
    return difference if abs(difference) > max(AGREEMENT, a.tolerance, b.tolerance) else 0.0


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
