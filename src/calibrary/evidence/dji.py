"""DJI's XMP, http://www.dji.com/drone-dji/1.0/.

``DewarpData`` is "date;fx,fy,cx,cy,k1,k2,p1,p2,k3": the calibration of the individual camera in px, the principal
point as an offset from the image centre (x right, y down; a bundle adjustment of the same flight confirms the
signs), Brown's coefficients in OpenCV's order. ``DewarpDataK6`` appends k4, k5, k6: OpenCV's rational model
(Matrice 4 manual). ``DewarpFlag`` = 1 means that the camera has already undistorted the image: K applies, without
distortion. ``CalibratedFocalLength`` and ``CalibratedOpticalCenterX/Y`` are the *design* values according to DJI's
manuals: focal length ÷ pitch, and the image centre.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, NoDistortion, Rational
from calibrary.errors import InputError
from calibrary.evidence.context import Dropped, Finding, Scene, Source, SourceEstimate, numbers
from calibrary.evidence.metadata import ImageMetadata
from calibrary.records import replace

SCHEMA = "drone-dji"

LARGEST_SIDE = 1 << 24
"""px; a principal point beyond this is a corrupt number."""


def is_dewarped(metadata: ImageMetadata) -> bool:
    """Whether the metadata states that the camera has already undistorted the image."""
    return metadata.xmp_text(SCHEMA, "DewarpFlag") == "1"


def is_mechanical(metadata: ImageMetadata) -> bool:
    """Whether the metadata states that a mechanical shutter exposed all rows at once."""
    return metadata.xmp_text(SCHEMA, "ShutterType") == "Mechanical"


def estimates(scene: Scene) -> Iterator[Finding]:
    """DewarpDataK6, DewarpData and the design values."""
    centre = _design_centre(scene.metadata)
    sizes = tuple(_frames(scene, centre))
    for name, source, count in (
        ("DewarpDataK6", Source.DJI_DEWARP_K6, 12),
        ("DewarpData", Source.DJI_DEWARP, 9),
    ):
        text = scene.metadata.xmp_text(SCHEMA, name)
        if text is not None:
            yield _dewarp(scene, sizes, text, f"drone-dji:{name}", source, count)
    yield from _design(scene, sizes, centre)


def _dewarp(
    scene: Scene, sizes: Sequence[ImageSize], text: str, tag: str, source: Source, count: int
) -> Finding:
    # DewarpData begins with a date and a semicolon; the manual does not say whether DewarpDataK6 does.
    made, _, terms = text.rpartition(";")
    values = numbers(terms)
    if values is None or len(values) != count:
        found = "no list of numbers" if values is None else f"{len(values)} numbers"
        return Dropped(source=source, tag=tag, reason=f"contains {found}, expected {count} numbers")
    fx, fy, dx, dy, *rest = values
    if fx <= 0 or fy <= 0:
        return Dropped(
            source=source,
            tag=tag,
            reason="contains zeros: this camera was never calibrated, or lost its calibration in a repair",
        )
    reason = "no image size is known that it could refer to"
    for size in sizes:
        try:
            intrinsics = Intrinsics(fx=fx, fy=fy, cx=size[0] / 2 + dx, cy=size[1] / 2 + dy, image_size=size)
        except InputError as error:
            return Dropped(source=source, tag=tag, reason=error.message)
        foreign = scene.is_foreign(intrinsics)
        if foreign is None:
            estimate = scene.estimate(
                source,
                tag,
                Grade.CALIBRATED,
                intrinsics,
                distortion=_distortion(scene.metadata, tuple(rest)),
                measured_centre=True,
            )
            return (
                replace(estimate, date=made.strip() or None)
                if isinstance(estimate, SourceEstimate)
                else estimate
            )
        reason = foreign
    return Dropped(source=source, tag=tag, reason=reason)


def _distortion(metadata: ImageMetadata, rest: tuple[float, ...]) -> Distortion:
    if is_dewarped(metadata):
        return NoDistortion()
    k1, k2, p1, p2, k3, *higher = rest
    if not higher:
        return BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)
    k4, k5, k6 = higher
    return Rational(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3, k4=k4, k5=k5, k6=k6)


def _design(
    scene: Scene, sizes: Sequence[ImageSize], centre: tuple[float, float] | None
) -> Iterator[Finding]:
    tag = "drone-dji:CalibratedFocalLength"
    text = scene.metadata.xmp_text(SCHEMA, "CalibratedFocalLength")
    if text is None:
        return
    values = numbers(text)
    if values is None or len(values) != 1 or values[0] <= 0:
        yield Dropped(
            source=Source.DJI_DESIGN, tag=tag, reason="does not contain a positive number of pixels"
        )
        return
    reason = "no image size is known that it could refer to"
    for size in sizes:
        cx, cy = centre or (size[0] / 2, size[1] / 2)
        intrinsics = Intrinsics(fx=values[0], fy=values[0], cx=cx, cy=cy, image_size=size)
        foreign = scene.is_foreign(intrinsics)
        if foreign is None:
            yield scene.estimate(Source.DJI_DESIGN, tag, Grade.DESIGN, intrinsics)
            return
        reason = foreign
    yield Dropped(source=Source.DJI_DESIGN, tag=tag, reason=reason)


def _design_centre(metadata: ImageMetadata) -> tuple[float, float] | None:
    centre = [
        numbers(metadata.xmp_text(SCHEMA, f"CalibratedOpticalCenter{axis}") or "") for axis in ("X", "Y")
    ]
    if centre[0] is None or centre[1] is None or len(centre[0]) != 1 or len(centre[1]) != 1:
        return None
    return centre[0][0], centre[1][0]


def _frames(scene: Scene, centre: tuple[float, float] | None) -> Iterator[ImageSize]:
    """Candidate image sizes: first the one whose exact centre is the design centre, then the likely ones."""
    if centre is not None and min(centre) >= 1 and max(centre) <= LARGEST_SIDE:
        yield round(centre[0] * 2), round(centre[1] * 2)
    yield from scene.frames()
