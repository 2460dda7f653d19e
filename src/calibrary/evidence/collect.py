"""Collect all estimates of K for one image and choose the best."""

from __future__ import annotations

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Provenance
from calibrary.dates import iso_date
from calibrary.distortion import NoDistortion
from calibrary.evidence import camera_namespace, dji, field_of_view, optics, skydio
from calibrary.evidence.conflict import Conflict, conflicts
from calibrary.evidence.context import Scene
from calibrary.evidence.estimate import Dropped, Source, SourceEstimate
from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.weighing import weigh

__all__ = ["Evidence", "collect"]

SOURCES = (dji, camera_namespace, skydio, field_of_view, optics)


class Evidence(Struct, frozen=True, kw_only=True):
    """All evidence about K from one image and from the known camera.

    Attributes:
        scene: the image's metadata and what is known about its camera.
        estimates: best first.
        dropped: sources that are present but not credible.
        conflicts: estimates that disagree with the chosen one.
        contradiction: reason why the image size in EXIF cannot belong to this file; if set, no source is read.
    """

    scene: Scene
    estimates: tuple[SourceEstimate, ...] = ()
    dropped: tuple[Dropped, ...] = ()
    conflicts: tuple[Conflict, ...] = ()
    contradiction: str | None = None

    @property
    def chosen(self) -> SourceEstimate | None:
        """The best estimate of K: the first with a metric grade, otherwise the first that lacks confirmation."""
        usable = [one for one in self.estimates if one.pinhole and one.is_k]
        return next((one for one in usable if one.grade.is_metric), usable[0] if usable else None)

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
        return Calibration(
            camera=camera,
            intrinsics=estimate.intrinsics,
            distortion=NoDistortion() if dji.is_dewarped(self.scene.metadata) else estimate.distortion,
            grade=estimate.grade,
            provenance=Provenance(
                kind="image-metadata",
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


def collect(scene: Scene) -> Evidence:
    """Read every source of one image. Raises nothing: sources that are not credible are listed in ``dropped``."""
    contradiction = exif_contradiction(scene.metadata)
    if contradiction is not None:
        return Evidence(scene=scene, contradiction=contradiction)
    findings = [finding for source in SOURCES for finding in source.estimates(scene)]
    found = sorted((f for f in findings if isinstance(f, SourceEstimate)), key=lambda estimate: estimate.rank)
    if any(w.source is not Source.ASSUMED_SENSOR and w.grade.is_metric for w in found):
        # An assumed sensor size is not evidence: it must neither confirm nor contradict a K.
        found = [w for w in found if w.source is not Source.ASSUMED_SENSOR]
    dropped = tuple(f for f in findings if isinstance(f, Dropped))
    if scene.weighs:
        found, stale = weigh(scene, found)
        dropped = (*dropped, *stale)
    evidence = Evidence(scene=scene, estimates=tuple(found), dropped=dropped)
    chosen = evidence.chosen
    if chosen is None:
        return evidence
    others = [estimate for estimate in found if estimate is not chosen]
    return Evidence(
        scene=scene,
        estimates=tuple(found),
        dropped=dropped,
        conflicts=tuple(conflicts(scene, chosen, others)),
    )
