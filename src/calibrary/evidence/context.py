"""Sources of a focal length, the estimate that each gives, the facts it is checked against, and the steps all share."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from enum import StrEnum

from msgspec import Struct

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.distortion import AnyDistortion, Distortion, FisheyePolynomial
from calibrary.errors import FrameError, InputError
from calibrary.evidence.frame import files_frame
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata, as_float
from calibrary.evidence.readings import usual
from calibrary.known_camera import KnownCamera, Projection, SensorWidth
from calibrary.records import Record, replace


class Source(StrEnum):
    """Source of an estimate's focal length, most trusted first."""

    DJI_DEWARP_K6 = "dji-dewarp-k6"
    DJI_DEWARP = "dji-dewarp"
    CAMERA_PERSPECTIVE = "camera-perspective"
    CAMERA_FISHEYE = "camera-fisheye"
    SKYDIO_CALIBRATED = "skydio-calibrated"
    GIVEN_SENSOR = "given-sensor"
    STATED = "stated"
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
        return _SOURCES.index(self)

    @property
    def rests_on(self) -> frozenset[str]:
        """The inputs that this source depends on: an error in one makes every source that uses it wrong."""
        return frozenset(RESTS_ON[self].split(", "))


_SOURCES = tuple(Source)

RESTS_ON = {
    Source.DJI_DEWARP_K6: "DJI calibration",
    Source.DJI_DEWARP: "DJI calibration",
    Source.CAMERA_PERSPECTIVE: "Camera calibration",
    Source.CAMERA_FISHEYE: "Camera calibration",
    Source.SKYDIO_CALIBRATED: "Skydio calibration",
    # For a source of a sensor size, EXIF FocalLength is taken as correct and the size is in doubt.
    Source.GIVEN_SENSOR: "given sensor",
    Source.STATED: "stated",
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

EQUAL_FOCAL = 0.01
"""Two focal lengths in mm count as equal within this fraction."""

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
        stated: the intrinsics before they were converted to the file's image size; None if read from a document.
    """

    _unwritten = frozenset({"stated"})

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
    stated: Intrinsics | None = None

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
        is_open: whether it may belong to it, and only what part of its frame the image shows is unknown.
    """

    _unwritten = frozenset({"is_open"})

    source: Source
    tag: str
    reason: str
    is_open: bool = False


Finding = SourceEstimate | Dropped

FOREIGN_TAG = 0.20
"""A calibration that differs from FocalLength ÷ pitch by more than this belongs to another camera (thermal
images of the Skydio X2 contain the colour camera's calibration)."""

POSSIBLE_OVER_WIDTH = (0.001, 1000.0)
"""Range of fx / W for any possible lens, even if read in the wrong unit or image size. A value outside is corrupt,
and would produce infinities in later computations."""

SENSOR_DIAGONAL_MM = (1.0, 100.0)
"""Sensor diagonals that exiftool accepts for a focal plane resolution; excludes 72 dpi copied from XResolution."""

FISHEYE_NAME = re.compile(r"fish[ -]?eye", re.IGNORECASE)
"""In the names of lenses, such as "EF8-15mm f/4L FISHEYE USM" or "AF DX Fisheye-Nikkor 10.5mm"."""


class Scene(Struct, frozen=True, kw_only=True):
    """The metadata of one image together with what is known from elsewhere.

    Attributes:
        metadata: of the image.
        known: catalogue entry of this camera, if there is one.
        siblings: the other cameras with the same EXIF Model.
        given_sensor_mm: sensor (width, height) stated by the user, or None.
        assumed_sensor_mm: sensor (width, height) used when nothing else states one; None for no such fallback.
        weighs: whether the sources of an unknown camera are weighed against each other.
        fills: whether the catalogue's lens is used where EXIF states no focal length that can be believed.
        listed: the sensor width that public databases list for the camera, if they were consulted.
    """

    metadata: ImageMetadata
    known: KnownCamera | None = None
    siblings: tuple[KnownCamera, ...] = ()
    given_sensor_mm: tuple[float, float] | None = None
    assumed_sensor_mm: tuple[float, float] | None = None
    weighs: bool = False
    fills: bool = False
    listed: SensorWidth | None = None

    @property
    def written(self) -> ImageMetadata:
        """The metadata, without a digital zoom that this camera is known to write but not to apply."""
        if self.known is None or self.known.exif_zoom_trusted or self.metadata.digital_zoom is None:
            return self.metadata
        return replace(self.metadata, digital_zoom=None)

    @property
    def focal_mm(self) -> float | None:
        """EXIF's focal length, unless this camera is known to write a wrong one, and it is not that of the lens."""
        stated, known = self.metadata.focal_mm, self.known
        if stated is None or known is None or known.exif_focal_trusted:
            return stated
        is_nominal = known.focal_mm is not None and abs(stated / known.focal_mm - 1.0) <= EQUAL_FOCAL
        return stated if is_nominal else None

    @property
    def native_size(self) -> ImageSize | None:
        """Size in px of the known camera's full frame."""
        return self.known.native_size if self.known is not None else None

    def focal_plane_px_per_mm(self) -> tuple[float, float] | None:
        """EXIF focal plane resolution (x, y) in px/mm, or None if no sensor can have it."""
        resolution = self.metadata.focal_plane_resolution
        if resolution is None:
            return None
        unit = self.metadata.focal_plane_unit or FocalPlaneUnit.INCH
        per_mm = (resolution[0] / unit.millimetres, resolution[1] / unit.millimetres)
        width, height = files_frame(self.metadata)
        low, high = SENSOR_DIAGONAL_MM
        return per_mm if low <= math.hypot(width / per_mm[0], height / per_mm[1]) <= high else None

    def px_per_mm(self) -> tuple[float, float] | None:
        """Pixels per millimetre (x, y) of the written image: from the EXIF focal plane, else from the known pitch."""
        focal_plane = self.focal_plane_px_per_mm()
        if focal_plane is not None:
            return focal_plane
        if self.known is not None and self.known.pitch_um is not None:
            return 1000.0 / self.known.pitch_um, 1000.0 / self.known.pitch_um
        return None

    def frames(self) -> Iterator[ImageSize]:
        """Image sizes that a tag may refer to if it states none, most likely first."""
        seen: set[ImageSize] = set()
        for size in (files_frame(self.metadata), self.native_size, self.metadata.size):
            if size is not None and size not in seen:
                seen.add(size)
                yield size

    def is_foreign(self, intrinsics: Intrinsics) -> str | None:
        """Reason why the intrinsics cannot belong to this image's camera, or None if there is no objection."""
        width, height = intrinsics.image_size
        if not (0 <= intrinsics.cx <= width and 0 <= intrinsics.cy <= height):
            return (
                f"the optical centre ({intrinsics.cx:.1f}, {intrinsics.cy:.1f}) lies outside the "
                f"{width}×{height} image: the tag belongs to another sub-camera"
            )
        expected = self.expected_over_width()
        if expected is None:
            return None
        off = intrinsics.fx / width / expected - 1.0
        if abs(off) <= FOREIGN_TAG:
            return None
        return (
            f"fx = {intrinsics.fx:.1f} px at {width}×{height} differs by {off:+.0%} from this camera's focal length ÷ "
            "pixel pitch: the tag belongs to another sub-camera, or refers to another image size"
        )

    def expected_over_width(self) -> float | None:
        """Expected fx / W of the full frame from this camera's optics, or None if these are unknown."""
        if self.known is None or self.known.native_size is None:
            per_mm = self.focal_plane_px_per_mm()
            if per_mm is None or self.focal_mm is None:
                return None
            return self.focal_mm * per_mm[0] / files_frame(self.metadata)[0]
        if self.focal_mm is not None and self.known.pitch_um is not None:
            return self.focal_mm * 1000.0 / self.known.pitch_um / self.known.native_size[0]
        return self.known.fx_over_w_at(self.focal_mm)

    @property
    def is_fisheye(self) -> bool:
        """Whether the image or the catalogue states a fisheye lens, which no K describes without its distortion."""
        if self.known is not None and self.known.projection is Projection.FISHEYE:
            return True
        model_type = self.metadata.xmp_text("Camera", "ModelType")
        if model_type is not None:
            return model_type.lower() == "fisheye"
        if self.metadata.lens is not None and FISHEYE_NAME.search(self.metadata.lens):
            return True
        return self.metadata.xmp_text("Camera", "FisheyeAffineMatrix") is not None

    def _holds_zoom(self, source: Source, intrinsics: Intrinsics) -> bool:
        """Whether a tag contains the digital zoom: the sensor that it implies is smaller by it than the camera's.

        Canon's focal plane is of the part that was enlarged: 7.11 mm are written as 2.73 at 2.6 ×. Of an equivalent
        only a known sensor width tells: makers write it with the zoom and without.
        """
        zoom, focal_mm = self.written.zoom, self.focal_mm
        if zoom <= 1.0 or focal_mm is None or source not in {Source.FOCAL_PLANE, Source.FOCAL_35MM}:
            return False
        if self.listed is not None:
            whole = focal_mm / self.listed.mm
        elif self.known is not None and self.known.pitch_um is not None and self.native_size is not None:
            whole = focal_mm * 1000.0 / self.known.pitch_um / max(self.native_size)
        else:
            return source is Source.FOCAL_PLANE and (self.metadata.make or "").casefold().startswith("canon")
        stated = intrinsics.fx / max(intrinsics.image_size)
        return abs(math.log(stated / (whole * zoom))) < abs(math.log(stated / whole))

    def estimate(
        self,
        source: Source,
        tag: str,
        grade: Grade,
        intrinsics: Intrinsics,
        *,
        distortion: Distortion | None = None,
        measured_centre: bool = False,
        tolerance: float = 0.0,
        assumptions: tuple[str, ...] = (),
    ) -> Finding:
        """Convert a source's intrinsics to the file's image size, or give the reason why the source is dropped."""
        written = self.written
        if self._holds_zoom(source, intrinsics):
            written = replace(written, digital_zoom=None)
        try:
            read = usual(intrinsics, written)
        except InputError as error:
            is_open = isinstance(error, FrameError)
            return Dropped(source=source, tag=tag, reason=error.message, is_open=is_open)
        if read.is_turned and distortion is not None and not _is_radial(distortion):
            distortion = None
        K, (low, high) = read.intrinsics, POSSIBLE_OVER_WIDTH
        over_width = [focal / K.image_size[0] for focal in (K.fx, K.fy)]
        if not low <= min(over_width) <= max(over_width) <= high:
            found = " and ".join(f"{value:.3g}" for value in over_width)
            reason = f"fx and fy are {found} W, expected {low:g} … {high:g} W of any lens"
            return Dropped(source=source, tag=tag, reason=reason)
        return SourceEstimate(
            source=source,
            tag=tag,
            grade=grade,
            intrinsics=K,
            distortion=distortion,
            measured_centre=measured_centre and not read.is_turned,
            reference_size=intrinsics.image_size,
            steps=read.steps,
            assumptions=(*assumptions, *read.assumes),
            tolerance=tolerance,
            is_whole=not self.is_fisheye or isinstance(distortion, FisheyePolynomial),
            stated=intrinsics,
        )


def _is_radial(distortion: Distortion) -> bool:
    """Whether a distortion is the same in an image that is turned."""
    return not any(value for name, value in distortion.coefficients.items() if not name.startswith("k"))


def numbers(text: str) -> tuple[float, ...] | None:
    """Parse a comma- or space-separated list of finite numbers; None if the text is anything else."""
    values = [as_float(part) for part in text.replace(",", " ").split()]
    known = tuple(value for value in values if value is not None)
    return known if known and len(known) == len(values) else None
