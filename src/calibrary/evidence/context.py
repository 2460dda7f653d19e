"""What a source may be checked against while it is being heard, and the shared steps of hearing one."""

from __future__ import annotations

import math
from collections.abc import Iterator

from msgspec import Struct

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.distortion import Distortion
from calibrary.errors import FrameError, InputError
from calibrary.evidence.estimate import Dropped, Source, SourceEstimate
from calibrary.evidence.frame import adapt, files_frame
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.evidence.numerals import as_float
from calibrary.known_camera import KnownCamera, Projection, SensorWidth
from calibrary.records import replace

__all__ = ["Finding", "Scene", "numbers"]

Finding = SourceEstimate | Dropped

FOREIGN_TAG = 0.20
"""A calibration further than this from FocalLength ÷ pitch is another camera's (X2's thermal frames carry the
colour camera's)."""

POSSIBLE_OVER_WIDTH = (0.001, 1000.0)
"""fx / W of anything that can be a lens, be it taken in the wrong unit or frame; all else is a corrupt number,
which would only carry infinities into what is computed of it."""

SENSOR_DIAGONAL_MM = (1.0, 100.0)
"""What exiftool accepts as a sensor when it reads focal plane resolutions; kills 72 dpi copied from XResolution."""


class Scene(Struct, frozen=True, kw_only=True):
    """One image's facts together with what is known from elsewhere.

    Attributes:
        metadata: what the image says.
        known: the catalogue's row for this camera, if there is one.
        siblings: the other cameras that share this Model.
        given_sensor_mm: (width, height) the user stated, None where not stated.
        assumed_sensor_mm: (width, height) to fall back on when nothing else tells, None to do without.
        weighs: whether the sources of a camera that nothing is known of are weighed against each other.
        listed: what public databases list as the width of its sensor, where they are asked.
    """

    metadata: ImageMetadata
    known: KnownCamera | None = None
    siblings: tuple[KnownCamera, ...] = ()
    given_sensor_mm: tuple[float, float] | None = None
    assumed_sensor_mm: tuple[float, float] | None = None
    weighs: bool = False
    listed: SensorWidth | None = None

    @property
    def written(self) -> ImageMetadata:
        """The metadata without a digital zoom that this camera is known to write and not to apply."""
        if self.known is None or self.known.exif_zoom_trusted or self.metadata.digital_zoom is None:
            return self.metadata
        return replace(self.metadata, digital_zoom=None)

    @property
    def focal_mm(self) -> float | None:
        """EXIF's focal length, unless this camera is known to write a wrong one."""
        if self.known is not None and not self.known.exif_focal_trusted:
            return None
        return self.metadata.focal_mm

    @property
    def native_size(self) -> ImageSize | None:
        """The known camera's full frame."""
        return self.known.native_size if self.known is not None else None

    def focal_plane_px_per_mm(self) -> tuple[float, float] | None:
        """EXIF's focal plane resolution, or None when it cannot be one of a sensor."""
        resolution = self.metadata.focal_plane_resolution
        if resolution is None:
            return None
        unit = self.metadata.focal_plane_unit or FocalPlaneUnit.INCH
        per_mm = (resolution[0] / unit.millimetres, resolution[1] / unit.millimetres)
        width, height = files_frame(self.metadata)
        low, high = SENSOR_DIAGONAL_MM
        return per_mm if low <= math.hypot(width / per_mm[0], height / per_mm[1]) <= high else None

    def px_per_mm(self) -> tuple[float, float] | None:
        """Pixels per millimetre of the written frame: EXIF's focal plane, else the known camera's pitch."""
        focal_plane = self.focal_plane_px_per_mm()
        if focal_plane is not None:
            return focal_plane
        if self.known is not None and self.known.pitch_um is not None:
            return 1000.0 / self.known.pitch_um, 1000.0 / self.known.pitch_um
        return None

    def frames(self) -> Iterator[ImageSize]:
        """The frames a tag without a frame of its own may count in, likeliest first."""
        seen: set[ImageSize] = set()
        for size in (files_frame(self.metadata), self.native_size, self.metadata.size):
            if size is not None and size not in seen:
                seen.add(size)
                yield size

    def is_foreign(self, intrinsics: Intrinsics) -> str | None:
        """Why intrinsics cannot be of this image's camera, or None when nothing speaks against them."""
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
        """Fx / W of the full frame by this camera's optics, None where they are not known."""
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
        """Whether the image or the known camera says that no pinhole K describes the lens."""
        if self.known is not None and self.known.projection is Projection.FISHEYE:
            return True
        model_type = self.metadata.xmp_text("Camera", "ModelType")
        if model_type is not None:
            return model_type.lower() == "fisheye"
        return self.metadata.xmp_text("Camera", "FisheyeAffineMatrix") is not None

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
        """Bring a source's intrinsics to the file's frame, or say why it is not believed."""
        try:
            adapted = adapt(intrinsics, self.written)
        except (FrameError, InputError) as error:
            return Dropped(source=source, tag=tag, reason=error.message)
        K, (low, high) = adapted.intrinsics, POSSIBLE_OVER_WIDTH
        over_width = [focal / K.image_size[0] for focal in (K.fx, K.fy)]
        if not low <= min(over_width) <= max(over_width) <= high:
            found = " and ".join(f"{value:.3g}" for value in over_width)
            reason = f"fx and fy are {found} W, expected {low:g} … {high:g} W of any lens"
            return Dropped(source=source, tag=tag, reason=reason)
        return SourceEstimate(
            source=source,
            tag=tag,
            grade=grade,
            intrinsics=adapted.intrinsics,
            distortion=distortion,
            measured_centre=measured_centre,
            reference_size=adapted.reference_size,
            steps=adapted.steps,
            assumptions=(*assumptions, *adapted.assumptions),
            tolerance=tolerance,
            pinhole=not self.is_fisheye,
        )


def numbers(text: str) -> tuple[float, ...] | None:
    """A comma- or space-separated list of finite numbers, or None when it is anything else."""
    values = [as_float(part) for part in text.replace(",", " ").split()]
    known = tuple(value for value in values if value is not None)
    return known if known and len(known) == len(values) else None
