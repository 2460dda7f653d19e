"""Hearing every estimate of one image, and choosing the best of them."""

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
    """All that one image and the known camera say about K.

    Attributes:
        scene: what the estimates were heard about.
        estimates: best first.
        dropped: sources that are there but cannot be believed.
        conflicts: estimates that disagree with the chosen one.
        contradiction: why EXIF's frame cannot be this file's; nothing is heard then.
    """

    scene: Scene
    estimates: tuple[SourceEstimate, ...] = ()
    dropped: tuple[Dropped, ...] = ()
    conflicts: tuple[Conflict, ...] = ()
    contradiction: str | None = None

    @property
    def chosen(self) -> SourceEstimate | None:
        """The best estimate of K: one of a grade that may reach a solver, else one that only lacks confirmation."""
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
                # EXIF's dates are the photograph's: only a source that states its own has one.
                date=date,
            ),
            notes=notes,
        )


def collect(scene: Scene) -> Evidence:
    """Hear every source about one image. Nothing is raised: what cannot be believed is listed."""
    contradiction = exif_contradiction(scene.metadata)
    if contradiction is not None:
        return Evidence(scene=scene, contradiction=contradiction)
    findings = [finding for source in SOURCES for finding in source.estimates(scene)]
    found = sorted((f for f in findings if isinstance(f, SourceEstimate)), key=lambda estimate: estimate.rank)
    if any(w.source is not Source.ASSUMED_SENSOR and w.grade.is_metric for w in found):
        # A guess for want of better is not an estimate: it must neither confirm a K nor speak against one.
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
