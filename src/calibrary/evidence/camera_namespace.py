"""The ``Camera:`` XMP of Pix4D's camera description, as MicaSense, Parrot, DJI and senseFly write it.

Perspective cameras: ``PerspectiveFocalLength`` in mm by the specification, ``PrincipalPoint`` "cx,cy" in mm
from the upper left (MicaSense's own reader, DJI's white paper; Pix4D's help figure shows the lower left, so
the y direction is an assumption), ``PerspectiveDistortion`` k1, k2, k3, p1, p2 — in that order, which is not
OpenCV's. RedEdge firmware 2 wrote the focal length in *pixels* without a unit; later firmware writes
``PerspectiveFocalLengthUnits``. If that tag is missing, the unit is the one in which the value agrees with
FocalLength and the focal plane.

Fisheye cameras: ``FisheyeAffineMatrix`` C, D, E, F in px and ``FisheyePolynomial`` p0, p1, p2, p3, as Pix4D's
"Camera internals for fisheye lens" defines them: with t = 2/π · atan2(r, z), ρ = p0 + p1·t + p2·t² + p3·t³ and
u = C·ρ·x/r + D·ρ·y/r + cx. Without its polynomial, the focal length near the axis, 2C/π, can be compared with others
and is not a K.

Both kinds state the principal point in millimetres from the corner. Through the right pitch it lies near the middle of
the image, so it confirms the pitch that the focal length in millimetres needs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, FisheyePolynomial
from calibrary.errors import InputError
from calibrary.evidence.context import Dropped, Finding, Scene, Source, numbers
from calibrary.evidence.frame import files_frame
from calibrary.records import replace

SCHEMA = "Camera"
FOCAL_TAG = "Camera:PerspectiveFocalLength"
FISHEYE_TAG = "Camera:FisheyeAffineMatrix"

UNIT_AGREEMENT = 0.20
CENTRE_SLACK = 0.25
"""A principal point farther than this from the centre, as a fraction of the image side, is in the wrong unit."""

CONFIRMS_PITCH = 0.05
"""A principal point in millimetres this close to the centre, as a fraction of the image side, confirms the pitch: those
of real cameras are up to 2.9 % away, and another pitch moves it by half of its own error."""

MILLIMETRE_UNITS = frozenset({"mm", "millimeter", "millimeters", "millimetre", "millimetres"})
PIXEL_UNITS = frozenset({"px", "pixel", "pixels"})


def estimates(scene: Scene) -> Iterator[Finding]:
    """The perspective or the fisheye calibration."""
    if scene.metadata.xmp_text(SCHEMA, "PerspectiveFocalLength") is not None:
        yield _perspective(scene)
    if scene.metadata.xmp_text(SCHEMA, "FisheyeAffineMatrix") is not None:
        yield _fisheye(scene)


def _perspective(scene: Scene) -> Finding:
    source = Source.CAMERA_PERSPECTIVE
    values = numbers(scene.metadata.xmp_text(SCHEMA, "PerspectiveFocalLength") or "")
    if values is None or len(values) != 1 or values[0] <= 0:
        return Dropped(source=source, tag=FOCAL_TAG, reason="contains no positive focal length")
    size = files_frame(scene.metadata)
    focal_px, how = _focal_px(scene, values[0], size)
    if focal_px is None:
        return Dropped(source=source, tag=FOCAL_TAG, reason=how)
    centre, centre_note, confirms_pitch = _centre(scene, size)
    cx, cy = centre or (size[0] / 2, size[1] / 2)
    try:
        intrinsics = Intrinsics(fx=focal_px[0], fy=focal_px[1], cx=cx, cy=cy, image_size=size)
        distortion = _distortion(scene)
    except InputError as error:
        return Dropped(source=source, tag=FOCAL_TAG, reason=error.message)
    foreign = scene.is_foreign(intrinsics)
    if foreign is not None:
        return Dropped(source=source, tag=FOCAL_TAG, reason=foreign)
    estimate = scene.estimate(
        source,
        FOCAL_TAG,
        Grade.CALIBRATED,
        intrinsics,
        distortion=distortion,
        measured_centre=centre is not None,
        assumptions=tuple(note for note in (how, centre_note) if note),
    )
    if isinstance(estimate, Dropped) or focal_px[0] == values[0] or confirms_pitch:
        return estimate
    return replace(estimate, by_focal_plane=scene.focal_plane_px_per_mm() is not None)


def _focal_px(scene: Scene, value: float, size: ImageSize) -> tuple[tuple[float, float] | None, str]:
    """The focal lengths (fx, fy) in px and the assumption about their unit; or None and the reason."""
    per_mm = scene.px_per_mm()
    unit = (scene.metadata.xmp_text(SCHEMA, "PerspectiveFocalLengthUnits") or "").lower()
    as_px = (value, value)
    as_mm = (value * per_mm[0], value * per_mm[1]) if per_mm is not None else None
    no_pitch = "is in mm, and neither FocalPlaneResolution nor the catalogue states the pixel pitch"
    if unit in MILLIMETRE_UNITS:
        return (as_mm, "") if as_mm is not None else (None, no_pitch)
    if unit in PIXEL_UNITS:
        return as_px, ""
    if unit:
        return None, f"has the unknown unit {unit[:20]!r}, expected mm or pixels"
    return _unit_by_cross_check(scene, value, size, as_px, as_mm)


def _unit_by_cross_check(
    scene: Scene,
    value: float,
    size: ImageSize,
    as_px: tuple[float, float],
    as_mm: tuple[float, float] | None,
) -> tuple[tuple[float, float] | None, str]:
    expected = scene.expected_over_width()
    if expected is not None:
        expected_px = expected * size[0]
        if abs(as_px[0] / expected_px - 1.0) <= UNIT_AGREEMENT:
            return as_px, "no unit tag: taken as pixels, which agrees with FocalLength"
        if as_mm is not None and abs(as_mm[0] / expected_px - 1.0) <= UNIT_AGREEMENT:
            return as_mm, "no unit tag: taken as mm, which agrees with FocalLength"
        return None, f"= {value:g} has no unit, and agrees with FocalLength neither in mm nor in pixels"
    # Fields of view of 3 … 130 degrees; nothing else decides.
    if 0.23 * size[0] <= value <= 19 * size[0]:
        return as_px, "no unit tag: taken as pixels, because no lens is that long in mm"
    if as_mm is not None and 0.23 * size[0] <= as_mm[0] <= 19 * size[0]:
        return as_mm, "no unit tag: taken as mm, because no lens is that wide in pixels"
    return None, f"= {value:g} has no unit, and no other tag shows whether it is in mm or pixels"


class _Centre(NamedTuple):
    """The principal point.

    Attributes:
        point: in px; None to use the image centre.
        note: the assumption made, "" if none.
        confirms_pitch: whether it was stated in mm, and shows that the pitch is this image's.
    """

    point: tuple[float, float] | None
    note: str = ""
    confirms_pitch: bool = False


def _centre(scene: Scene, size: ImageSize) -> _Centre:
    text = scene.metadata.xmp_text(SCHEMA, "PrincipalPoint")
    if text is None:
        return _Centre(None)
    values = numbers(text)
    if values is None or len(values) != 2:
        return _Centre(None, "PrincipalPoint does not contain two numbers: the image centre is used instead")
    per_mm = scene.px_per_mm()
    readings = [(values[0], values[1])]
    if per_mm is not None:
        readings.insert(0, (values[0] * per_mm[0], values[1] * per_mm[1]))
    for point in readings:
        off = max(abs(c / side - 0.5) for c, side in zip(point, size, strict=True))
        if off <= CENTRE_SLACK:
            in_mm = point != (values[0], values[1])
            return _Centre(
                point,
                "PrincipalPoint is measured from the upper left corner",
                confirms_pitch=in_mm and off <= CONFIRMS_PITCH,
            )
    return _Centre(
        None,
        "PrincipalPoint is far from the image centre both in mm and in pixels: the image centre is used instead",
    )


def _distortion(scene: Scene) -> Distortion | None:
    values = numbers(scene.metadata.xmp_text(SCHEMA, "PerspectiveDistortion") or "")
    if values is None or len(values) != 5:
        return None
    k1, k2, k3, p1, p2 = values
    return BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)


def _fisheye(scene: Scene) -> Finding:
    values = numbers(scene.metadata.xmp_text(SCHEMA, "FisheyeAffineMatrix") or "")
    if values is None or len(values) != 4 or values[0] <= 0 or values[3] <= 0:
        return Dropped(
            source=Source.CAMERA_FISHEYE,
            tag=FISHEYE_TAG,
            reason="does not contain C, D, E, F with positive C and F",
        )
    c, d, e, f = values
    if e != 0.0:
        reason = f"has E = {e:g}: a turned image, which no K describes"
        return Dropped(source=Source.CAMERA_FISHEYE, tag=FISHEYE_TAG, reason=reason)
    size = files_frame(scene.metadata)
    centre, note, _ = _centre(scene, size)
    cx, cy = centre or (size[0] / 2, size[1] / 2)
    lens = _polynomial(scene)
    # A lens without its polynomial has p1 = 1. The quotient is by π/2, for 2C overflows for the largest floats.
    p1, distortion = lens if lens is not None else (1.0, None)
    right_angle = math.pi / 2
    try:
        intrinsics = Intrinsics(
            fx=c / right_angle * p1,
            fy=f / right_angle * p1,
            cx=cx,
            cy=cy,
            skew=d / right_angle * p1,
            image_size=size,
        )
    except InputError as error:
        return Dropped(source=Source.CAMERA_FISHEYE, tag=FISHEYE_TAG, reason=error.message)
    foreign = scene.is_foreign(intrinsics)
    if foreign is not None:
        return Dropped(source=Source.CAMERA_FISHEYE, tag=FISHEYE_TAG, reason=foreign)
    return scene.estimate(
        Source.CAMERA_FISHEYE,
        FISHEYE_TAG,
        Grade.CALIBRATED,
        intrinsics,
        distortion=distortion,
        measured_centre=centre is not None,
        assumptions=(note,) if note else (),
    )


def _polynomial(scene: Scene) -> tuple[float, FisheyePolynomial] | None:
    """p1, and the lens in radians: k_i = p_i ÷ p1 · (2/π)^(i−1); None without one that starts at the axis."""
    values = numbers(scene.metadata.xmp_text(SCHEMA, "FisheyePolynomial") or "")
    if values is None or not 2 <= len(values) <= 5 or values[0] != 0.0 or values[1] <= 0.0:
        return None
    p1 = values[1]
    terms = [
        p / p1 * (2 / math.pi) ** power for power, p in enumerate((*values, 0.0, 0.0, 0.0)[2:5], start=1)
    ]
    if not all(math.isfinite(term) for term in terms):
        return None
    return p1, FisheyePolynomial(k2=terms[0], k3=terms[1], k4=terms[2])
