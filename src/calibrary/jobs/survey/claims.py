"""Claims: who states a K for a camera, how far it may be off, and on what it rests.

Each kind of source is a function of a few lines that makes claims where it is read. What follows asks of which kind a
claim is only where the kind itself means something.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.evidence.context import Source as Tag
from calibrary.evidence.context import SourceEstimate
from calibrary.evidence.weighing import Evidence
from calibrary.jobs.survey.limits import (
    EXIF,
    OF_KNOWN,
    OTHER_FOCAL,
    SQUARE,
    TOLERANCES,
    engraved,
    known_to_be_off,
    known_tolerance,
)
from calibrary.policy import Policy
from calibrary.provenance import Provenance

if TYPE_CHECKING:
    from calibrary.registry.resolution import Resolution

OF_WHOLE_FRAME: Final = frozenset({Tag.LISTED_SENSOR, Tag.FULL_FRAME, Tag.FOCAL_35MM})
"""What states a focal length of the whole frame, whatever its size in px."""


CATALOGUE: Final = "catalogue"
"""Input of what is known of a camera by its name."""


class Who(StrEnum):
    """What a claim comes from."""

    TAG = "tag"
    CATALOGUE = "catalogue"
    ENTRY = "entry"
    FILE = "file"
    BOARD = "board"
    FLIGHT = "flight"


class Claim(Struct, frozen=True, kw_only=True):
    """A statement of K.

    Attributes:
        who: what it comes from.
        name: as the user knows it: a tag, the path of an entry.
        calibration: as stated, at the image size at which it is stated.
        is_whole: whether it is of the whole frame, whatever its size.
        is_framed: whether it is stated of this very image, and not of the camera's whole frame.
        is_kept: whether programs that resize an image leave it as it was.
        tolerance: largest share of its focal length by which it may be off.
        rounding: what the rounding of a tag adds to that.
        engraved: least share by which it contradicts a measured K, as the focal length engraved on a lens is nominal.
        granted: what a person grants in place of these three.
        is_measured: whether its numbers were measured on one unit.
        rests_on: its inputs; two claims that have one in common are one witness.
        voice: who speaks: a firmware that writes another lens's focal length writes it into all tags of EXIF.
    """

    who: Who
    name: str
    calibration: Calibration
    is_whole: bool = False
    is_framed: bool = False
    is_kept: bool = False
    tolerance: float = 0.0
    rounding: float = 0.0
    engraved: float = 0.0
    granted: float | None = None
    is_measured: bool = False
    rests_on: frozenset[str] = frozenset()
    voice: str = ""


def of_images(evidence: Evidence, camera: CameraKey, policy: Policy) -> tuple[Claim, ...]:
    """What is known of an image without a file and without a registry."""
    return (*of_tags(evidence, camera, policy), *of_catalogue(evidence, camera, policy))


def of_tags(evidence: Evidence, camera: CameraKey, policy: Policy) -> Iterator[Claim]:
    """What the tags of an image state."""
    return (of_tag(one, evidence, camera, policy) for one in evidence.estimates if is_statement(one))


def is_statement(one: SourceEstimate) -> bool:
    """Whether a tag states something: an assumed sensor size does not, nor one that contradicts itself."""
    return one.source is not Tag.ASSUMED_SENSOR and abs(one.intrinsics.fx / one.intrinsics.fy - 1.0) <= SQUARE


def of_tag(one: SourceEstimate, evidence: Evidence, camera: CameraKey, policy: Policy) -> Claim:
    """What a tag of an image states."""
    known, usual = evidence.scene.known, known_tolerance(policy)
    tolerance = TOLERANCES.get(one.source, 0.0)
    if one.source in OF_KNOWN:
        tolerance = max(usual, known.spread or 0.0) if known is not None else usual
    is_measured = one.grade.is_measured
    return Claim(
        who=Who.TAG,
        name=one.tag,
        calibration=_of_tag(one, camera, is_zoomed=evidence.scene.written.zoom > 1.0),
        is_whole=one.source in OF_WHOLE_FRAME and evidence.scene.native_size is None,
        is_framed=is_measured or one.source in {Tag.FOCAL_PLANE, Tag.FIELD_OF_VIEW},
        is_kept=one.source is Tag.FOCAL_PLANE,
        tolerance=tolerance + min(known_to_be_off(one.source, evidence), OTHER_FOCAL),
        rounding=one.tolerance,
        engraved=engraved(one),
        is_measured=is_measured,
        rests_on=one.rests_on,
        voice=one.tag if one.source.rank < Tag.GIVEN_SENSOR.rank else EXIF,
    )


def of_catalogue(evidence: Evidence, camera: CameraKey, policy: Policy) -> Iterator[Claim]:
    """The catalogue's own focal length, of the full frame; none for a zoom, or where only a pixel pitch is known."""
    known = evidence.scene.known
    if known is None or known.native_size is None or known.fx_over_w is None:
        return
    over_width = known.fx_over_w_at(evidence.scene.written.focal_mm)
    if over_width is None or evidence.scene.written.zoom > 1.0:
        return
    W, H = known.native_size
    K = Intrinsics(fx=over_width * W, fy=over_width * W, cx=W / 2, cy=H / 2, image_size=(W, H))
    yield Claim(
        who=Who.CATALOGUE,
        name=f"the catalogue's {known.title}",
        calibration=Calibration(
            camera=camera,
            intrinsics=K,
            grade=Grade.DESIGN,
            provenance=Provenance(kind="catalogue", tag=known.title),
        ),
        tolerance=max(known_tolerance(policy), known.spread or 0.0),
        rests_on=frozenset({CATALOGUE}),
        voice=CATALOGUE,
    )


def of_entry(found: Resolution, policy: Policy, *, rests_on: str | None = None) -> Claim:
    """An entry of a registry, at the size at which it was measured.

    Args:
        found: the entry.
        policy: with the tolerance of a known camera.
        rests_on: what it was made from; by default it is a source of its own.
    """
    is_measured = found.entry.calibration.grade.is_measured
    return Claim(
        who=Who.ENTRY,
        name=found.path,
        calibration=found.stated,
        tolerance=0.0 if is_measured else known_tolerance(policy),
        granted=found.entry.tolerance,
        is_measured=is_measured,
        rests_on=frozenset({rests_on or found.path}),
        voice=found.path,
    )


def of_file(name: str, calibration: Calibration, tolerance: float = 0.0) -> Claim:
    """A calibration file, at the size at which it states its K; what is no measurement may be off by a tolerance."""
    is_measured = calibration.grade.is_measured
    return Claim(
        who=Who.FILE,
        name=name,
        calibration=calibration,
        tolerance=0.0 if is_measured else tolerance,
        is_measured=is_measured,
        rests_on=frozenset({name}),
        voice=name,
    )


def _of_tag(one: SourceEstimate, camera: CameraKey, *, is_zoomed: bool) -> Calibration:
    # What its reader converted by the zoom that the image states is not read again.
    return Calibration(
        camera=camera,
        intrinsics=one.intrinsics if is_zoomed else one.stated or one.intrinsics,
        distortion=one.distortion,
        grade=one.grade,
        provenance=Provenance(kind="image-metadata", tag=one.tag),
    )
