"""Sources of a camera's focal length, and the estimate that one source gives."""

from __future__ import annotations

from enum import StrEnum

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.distortion import AnyDistortion
from calibrary.records import Record

__all__ = ["AGREEMENT", "UNCONFIRMED", "Dropped", "Source", "SourceEstimate"]


class Source(StrEnum):
    """Source of an estimate's focal length, most trusted first."""

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
        """Position in the order of trust; 0 is the most trusted."""
        return list(Source).index(self)

    @property
    def rests_on(self) -> frozenset[str]:
        """The inputs that this source depends on: an error in one makes every source that uses it wrong."""
        return frozenset(RESTS_ON[self].split(", "))


RESTS_ON = {
    Source.DJI_DEWARP_K6: "DJI calibration",
    Source.DJI_DEWARP: "DJI calibration",
    Source.CAMERA_PERSPECTIVE: "Camera calibration",
    Source.CAMERA_FISHEYE: "Camera calibration",
    Source.SKYDIO_CALIBRATED: "Skydio calibration",
    # For a source of a sensor size, EXIF FocalLength is taken as correct and the size is in doubt.
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
"""Sources of a sensor size; fx is EXIF FocalLength divided by that size."""

UNCONFIRMED = frozenset({Source.LISTED_SENSOR, Source.FULL_FRAME})
"""Sources that give only a prior until another source confirms it: the sensor width listed for the camera's name,
or the 36 mm inferred from FocalLength being equal to its 35 mm equivalent."""

AGREEMENT = 0.05
"""Independent estimates of one focal length agree within this fraction; a larger difference is a conflict."""

SENSOR_AGREEMENT = 0.03
"""Two values of a sensor width confirm each other within this fraction: neither is rounded to whole millimetres."""


class SourceEstimate(Record):
    """K according to one source, converted to the file's image size.

    Attributes:
        source: which kind of source.
        tag: name of the tag or rule, as users know it.
        grade: origin of the intrinsics that this kind of source gives.
        intrinsics: at the file's image size, canonical origin.
        distortion: if the source states it; None if unknown.
        measured_centre: whether the source states the principal point; otherwise it is the image centre.
        reference_size: the image size that the source refers to.
        steps: operations that converted from the reference size to the file's image size.
        assumptions: assumptions that were made.
        tolerance: relative rounding of the source itself (a 35 mm equivalent is a whole number of mm).
        is_whole: False for a fisheye without its distortion: its focal length can be compared, and is not a K.
        by_focal_plane: whether FocalPlaneResolution was used to convert its millimetres to pixels.
        date: calibration date that the source states, as written there.
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
    is_whole: bool = True
    by_focal_plane: bool = False
    date: str | None = None

    def confirms_within(self, other: SourceEstimate) -> float:
        """Largest relative difference in focal length at which this and another estimate confirm each other."""
        return SENSOR_AGREEMENT if {self.source, other.source} <= SENSOR_SIZES else AGREEMENT

    def is_independent_of(self, other: SourceEstimate) -> bool:
        """Whether the two estimates share no input; only then is their agreement evidence."""
        return not self.rests_on & other.rests_on

    @property
    def is_k(self) -> bool:
        """Whether it gives a K rather than only a number to compare with."""
        return self.grade.is_metric or self.source in UNCONFIRMED

    @property
    def rests_on(self) -> frozenset[str]:
        """The inputs that it depends on."""
        return self.source.rests_on | ({"focal plane"} if self.by_focal_plane else set())

    @property
    def rank(self) -> tuple[int, int]:
        """Sort key that puts the best estimate first.

        A maker's design value is also focal length ÷ pitch, but with a pitch that cannot be checked, so it does not
        rank above derived estimates: among these the source decides.
        """
        grade = Grade.DESIGN if self.grade is Grade.DERIVED else self.grade
        return grade.rank, self.source.rank


class Dropped(Record):
    """A source that is present but not credible.

    Attributes:
        source: which kind of source.
        tag: name of the tag, as users know it.
        reason: what was found and why it cannot belong to this image.
    """

    source: Source
    tag: str
    reason: str
