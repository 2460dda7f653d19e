"""One independent source of a camera's focal length, and the ways to get one."""

from __future__ import annotations

from enum import StrEnum

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.distortion import AnyDistortion
from calibrary.records import Record

__all__ = ["AGREEMENT", "UNCONFIRMED", "Dropped", "Source", "SourceEstimate"]


class Source(StrEnum):
    """Where a estimate's focal length is from, most trusted first."""

    DJI_DEWARP_K6 = "dji-dewarp-k6"
    DJI_DEWARP = "dji-dewarp"
    CAMERA_PERSPECTIVE = "camera-perspective"
    CAMERA_FISHEYE = "camera-fisheye"
    SKYDIO_CALIBRATED = "skydio-calibrated"
    GIVEN_SENSOR = "given-sensor"
    FOCAL_PLANE = "focal-plane"
    CATALOGUE_PITCH = "catalogue-pitch"
    DJI_DESIGN = "dji-design"
    FIELD_OF_VIEW = "field-of-view"
    CATALOGUE_DESIGN = "catalogue-design"
    LISTED_SENSOR = "listed-sensor"
    FULL_FRAME = "full-frame"
    ASSUMED_SENSOR = "assumed-sensor"
    FOCAL_35MM = "focal-35mm"

    @property
    def rank(self) -> int:
        """0 for the most trusted, counting up."""
        return list(Source).index(self)

    @property
    def rests_on(self) -> frozenset[str]:
        """What was written once and would make every source that uses it wrong together."""
        return frozenset(RESTS_ON[self].split(", "))


RESTS_ON = {
    Source.DJI_DEWARP_K6: "DJI calibration",
    Source.DJI_DEWARP: "DJI calibration",
    Source.CAMERA_PERSPECTIVE: "Camera calibration",
    Source.CAMERA_FISHEYE: "Camera calibration",
    Source.SKYDIO_CALIBRATED: "Skydio calibration",
    # Divided by a sensor's size, EXIF FocalLength is what is measured with; in doubt is the size.
    Source.GIVEN_SENSOR: "given sensor",
    Source.FOCAL_PLANE: "focal plane",
    Source.CATALOGUE_PITCH: "catalogue",
    Source.DJI_DESIGN: "DJI design",
    Source.FIELD_OF_VIEW: "field of view",
    Source.CATALOGUE_DESIGN: "catalogue",
    Source.LISTED_SENSOR: "listed sensor",
    Source.FULL_FRAME: "35 mm equivalent",
    Source.ASSUMED_SENSOR: "assumed sensor",
    Source.FOCAL_35MM: "35 mm equivalent",
}


SENSOR_SIZES = frozenset(
    {
        Source.GIVEN_SENSOR,
        Source.FOCAL_PLANE,
        Source.CATALOGUE_PITCH,
        Source.LISTED_SENSOR,
        Source.FULL_FRAME,
        Source.ASSUMED_SENSOR,
    }
)
"""Sources of a sensor's size, which EXIF FocalLength is divided by."""

UNCONFIRMED = frozenset({Source.LISTED_SENSOR, Source.FULL_FRAME})
"""Sources whose K is a prior until another one confirms it: a width by a camera's name, or by two equal numbers."""

AGREEMENT = 0.05
"""Independent ways to one focal length agree within this; further apart is a conflict."""

SENSOR_AGREEMENT = 0.03
"""Two statements of one sensor's width confirm each other within this: neither is rounded to whole millimetres."""


class SourceEstimate(Record):
    """What one source says K is, brought to the file's frame.

    Attributes:
        source: which kind of source.
        tag: the tag or rule, as people know it.
        grade: what such a source is good for.
        intrinsics: in the file's frame, canonical origin.
        distortion: beside it, where the source gives one; None is unknown.
        measured_centre: whether the principal point is the source's, and not just the middle of the frame.
        reference_size: the frame the source counts in.
        steps: what brought it from there to the file's frame.
        assumptions: what had to be taken for granted.
        tolerance: relative rounding of the source itself (a 35 mm equivalent is a whole number of mm).
        pinhole: False for a fisheye: its focal length can be compared, but is not a K.
        by_focal_plane: whether FocalPlaneResolution turned its millimetres into pixels.
        date: when the source says that it was calibrated, as it writes it.
    """

    source: Source
    tag: str
    grade: Grade
    intrinsics: Intrinsics
    distortion: AnyDistortion | None = None
    measured_centre: bool = False
    reference_size: ImageSize
    steps: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    tolerance: float = 0.0
    pinhole: bool = True
    by_focal_plane: bool = False
    date: str | None = None

    def confirms_within(self, other: SourceEstimate) -> float:
        """How near another estimate must be for the two to confirm each other."""
        return SENSOR_AGREEMENT if {self.source, other.source} <= SENSOR_SIZES else AGREEMENT

    def is_independent_of(self, other: SourceEstimate) -> bool:
        """Whether nothing that was written once stands behind both: only then does agreement prove anything."""
        return not self._rests_on & other._rests_on

    @property
    def is_k(self) -> bool:
        """Whether it states a K, and not only a number to compare one with."""
        return self.grade.is_metric or self.source in UNCONFIRMED

    @property
    def _rests_on(self) -> frozenset[str]:
        return self.source.rests_on | ({"focal plane"} if self.by_focal_plane else set())

    @property
    def rank(self) -> tuple[int, int]:
        """Sorts estimates best first.

        A maker's design value is focal length ÷ pitch as well, but its pitch cannot be checked, so it does
        not stand above the derived ones: between those the source decides.
        """
        grade = Grade.DESIGN if self.grade is Grade.DERIVED else self.grade
        return grade.rank, self.source.rank


class Dropped(Record):
    """A source that is there but cannot be believed.

    Attributes:
        source: which kind of source.
        tag: the tag, as people know it.
        reason: what was found and why it cannot be of this image.
    """

    source: Source
    tag: str
    reason: str
