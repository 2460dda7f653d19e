"""Focal length in millimetres over the size of a pixel, by every way a pixel's size is told; and 35 mm.

EXIF FocalLength (0x920A) divided by a pixel pitch is metric. FocalLengthIn35mmFilm (0xA405) is not: it is a
whole number of millimetres that refers to the diagonal of the *native* frame (43.27 mm for 36 × 24), so it is
heard as a prior to compare with and never becomes a K.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.evidence.context import Finding, Scene
from calibrary.evidence.estimate import Dropped, Source
from calibrary.evidence.frame import files_frame
from calibrary.evidence.metadata import FocalPlaneUnit

__all__ = ["estimates"]

DIAGONAL_35MM = math.hypot(36.0, 24.0)


def estimates(scene: Scene) -> Iterator[Finding]:
    """Given sensor, catalogue pitch, focal plane resolution, assumed sensor, 35 mm equivalent."""
    yield from _metric(scene)
    yield from _prior(scene)


def _metric(scene: Scene) -> Iterator[Finding]:
    focal_mm = scene.focal_mm
    if focal_mm is None:
        if scene.metadata.focal_mm is not None:
            yield Dropped(
                source=Source.CATALOGUE_PITCH,
                tag="EXIF FocalLength",
                reason=f"{scene.metadata.focal_mm:g} mm: this camera model is known to write a wrong focal length",
            )
        return
    if scene.given_sensor_mm is not None:
        yield _by_sensor(scene, focal_mm, scene.given_sensor_mm, Source.GIVEN_SENSOR)
    known = scene.known
    told = scene.given_sensor_mm is not None
    if known is not None and known.pitch_um is not None and known.native_size is not None:
        told = True
        yield _by_pitch(scene, focal_mm, known.pitch_um, known.native_size)
    for finding in _by_focal_plane(scene, focal_mm):
        told = told or not isinstance(finding, Dropped)
        yield finding
    if not told and scene.assumed_sensor_mm is not None:
        yield _by_sensor(scene, focal_mm, scene.assumed_sensor_mm, Source.ASSUMED_SENSOR)


def _by_sensor(scene: Scene, focal_mm: float, sensor_mm: tuple[float, float], source: Source) -> Finding:
    """The source document's arithmetic: against the true output resolution, each axis by its own side."""
    width, height = scene.metadata.size
    how = "given" if source is Source.GIVEN_SENSOR else "assumed"
    intrinsics = Intrinsics(
        fx=(focal_mm / sensor_mm[0]) * width,
        fy=(focal_mm / sensor_mm[1]) * height,
        cx=width / 2.0,
        cy=height / 2.0,
        image_size=(width, height),
    )
    assumptions: tuple[str, ...] = ()
    if source is Source.ASSUMED_SENSOR:
        assumptions = (f"the sensor is {sensor_mm[0]:g} × {sensor_mm[1]:g} mm",)
    tag = f"EXIF FocalLength ÷ {how} sensor"
    return scene.estimate(source, tag, Grade.DERIVED, intrinsics, assumptions=assumptions)


def _by_pitch(scene: Scene, focal_mm: float, pitch_um: float, native_size: ImageSize) -> Finding:
    focal = focal_mm * 1000.0 / pitch_um
    intrinsics = _centred(focal, focal, native_size)
    return scene.estimate(
        Source.CATALOGUE_PITCH, "EXIF FocalLength ÷ catalogue pitch", Grade.DERIVED, intrinsics
    )


def _by_focal_plane(scene: Scene, focal_mm: float) -> Iterator[Finding]:
    resolution = scene.metadata.focal_plane_resolution
    if resolution is None:
        return
    tag = "EXIF FocalLength × FocalPlaneResolution"
    per_mm = scene.focal_plane_px_per_mm()
    if per_mm is None:
        unit = scene.metadata.focal_plane_unit or FocalPlaneUnit.INCH
        yield Dropped(
            source=Source.FOCAL_PLANE,
            tag=tag,
            reason=f"{resolution[0]:g} {unit.value} would be a sensor outside 1 … 100 mm diagonal",
        )
        return
    assumptions = (
        ("FocalPlaneResolution is in pixels per inch",) if scene.metadata.focal_plane_unit is None else ()
    )
    intrinsics = _centred(focal_mm * per_mm[0], focal_mm * per_mm[1], files_frame(scene.metadata))
    foreign = scene.is_foreign(intrinsics) if scene.known is not None else None
    if foreign is not None:
        yield Dropped(source=Source.FOCAL_PLANE, tag=tag, reason=foreign)
        return
    yield scene.estimate(Source.FOCAL_PLANE, tag, Grade.DERIVED, intrinsics, assumptions=assumptions)


def _prior(scene: Scene) -> Iterator[Finding]:
    focal_35mm = scene.metadata.focal_35mm
    if focal_35mm is None:
        return
    size = scene.native_size or files_frame(scene.metadata)
    focal = focal_35mm / DIAGONAL_35MM * math.hypot(*size)
    assumptions = () if scene.native_size else ("the image covers the full sensor diagonal",)
    yield scene.estimate(
        Source.FOCAL_35MM,
        "EXIF FocalLengthIn35mmFilm",
        Grade.PRIOR,
        _centred(focal, focal, size),
        # Cameras truncate as often as they round: 52.8 is written 52.
        tolerance=max(1.0 / focal_35mm, 0.0 if scene.native_size else _crop_slack(size)),
        assumptions=assumptions,
    )


def _crop_slack(size: ImageSize) -> float:
    """How far a 16:9 frame of unknown origin may be off: cut from 4:3, its diagonal is 8.2 % short."""
    return 0.09 if size[0] * 10 > size[1] * 16 else 0.0


def _centred(fx: float, fy: float, size: ImageSize) -> Intrinsics:
    return Intrinsics(fx=fx, fy=fy, cx=size[0] / 2, cy=size[1] / 2, image_size=size)
