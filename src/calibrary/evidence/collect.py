"""Hearing every witness of one image, and choosing the best of them."""

from __future__ import annotations

from dataclasses import dataclass

from calibrary.calibration import Calibration, CameraKey, Provenance
from calibrary.dates import iso_date
from calibrary.distortion import NoDistortion
from calibrary.evidence import camera_namespace, dji, field_of_view, optics, skydio
from calibrary.evidence.conflict import Conflict, conflicts
from calibrary.evidence.context import Scene
from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.witness import Dropped, Source, Witness

__all__ = ["Evidence", "collect"]

SOURCES = (dji, camera_namespace, skydio, field_of_view, optics)


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """All that one image and the known camera say about K.

    Attributes:
        scene: what the witnesses were heard about.
        witnesses: best first.
        dropped: sources that are there but cannot be believed.
        conflicts: witnesses that disagree with the chosen one.
        contradiction: why EXIF's frame cannot be this file's; nothing is heard then.
    """

    scene: Scene
    witnesses: tuple[Witness, ...] = ()
    dropped: tuple[Dropped, ...] = ()
    conflicts: tuple[Conflict, ...] = ()
    contradiction: str | None = None

    @property
    def chosen(self) -> Witness | None:
        """The best witness whose K may reach a solver."""
        return next((w for w in self.witnesses if w.grade.is_metric and w.pinhole), None)

    def calibration(self, camera: CameraKey, source_name: str | None = None) -> Calibration | None:
        """The chosen witness as a calibration of ``camera``, or None when there is no K."""
        witness = self.chosen
        if witness is None:
            return None
        orientation = self.scene.metadata.orientation
        notes: tuple[str, ...] = ()
        if orientation is not None and orientation != 1:
            notes = (
                f"EXIF Orientation is {orientation}: K counts in the stored pixels; "
                "turn it together with an image that a viewer turns",
            )
        date = iso_date(witness.date) if witness.date else None
        if witness.date and date is None:
            notes = (
                *notes,
                f"{witness.tag} states the date {witness.date!r}, which is ambiguous or not a date",
            )
        return Calibration(
            camera=camera,
            intrinsics=witness.intrinsics,
            distortion=NoDistortion() if dji.is_dewarped(self.scene.metadata) else witness.distortion,
            grade=witness.grade,
            provenance=Provenance(
                kind="image-metadata",
                source=source_name,
                tag=witness.tag,
                reference_size=witness.reference_size,
                adaptation="; ".join(witness.steps) or None,
                assumptions=witness.assumptions,
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
    findings = [finding for source in SOURCES for finding in source.witnesses(scene)]
    heard = sorted((f for f in findings if isinstance(f, Witness)), key=lambda witness: witness.rank)
    if any(w.source is not Source.ASSUMED_SENSOR and w.grade.is_metric for w in heard):
        # A guess for want of better is no witness: it must neither confirm a K nor speak against one.
        heard = [w for w in heard if w.source is not Source.ASSUMED_SENSOR]
    dropped = tuple(f for f in findings if isinstance(f, Dropped))
    evidence = Evidence(scene=scene, witnesses=tuple(heard), dropped=dropped)
    chosen = evidence.chosen
    if chosen is None:
        return evidence
    others = [witness for witness in heard if witness is not chosen]
    return Evidence(
        scene=scene,
        witnesses=tuple(heard),
        dropped=dropped,
        conflicts=tuple(conflicts(scene, chosen, others)),
    )
