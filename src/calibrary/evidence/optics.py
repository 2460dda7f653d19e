"""Estimates from the EXIF focal length and each pixel or sensor size, the 35 mm equivalent, and a field of view.

EXIF FocalLength (0x920A) divided by a pixel pitch is metric. FocalLengthIn35mmFilm (0xA405) is not: it is a whole
number of millimetres that refers to the diagonal of the *native* frame (43.27 mm for 36 × 24), so it serves as a
prior to compare with and never becomes a K. If it equals FocalLength, either the sensor is 36 × 24 mm, or the
equivalent was written as the focal length; another source decides which.

XMP exif:CameraHorizontalFOV (Teledyne FLIR, Teal) is an angle in degrees: fx = W/2 ÷ tan(HFOV/2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from calibrary.calibration import Grade, ImageSize, Intrinsics
from calibrary.evidence.context import AGREEMENT, EQUAL_FOCAL, Dropped, Finding, Scene, Source, numbers
from calibrary.evidence.frame import files_frame
from calibrary.evidence.metadata import FocalPlaneUnit
from calibrary.evidence.readings import Prior, readings
from calibrary.image_size import same_aspect

DIAGONAL_35MM = math.hypot(36.0, 24.0)
WIDTH_35MM = 36.0
THERMAL = "thermal"
PITCH_UM = (0.7, 20.0)
"""Range of pixel pitches implied by a focal plane resolution: from phones to binned images of large sensors."""

SQUARE_PIXELS = 0.05
"""Allowed difference between the x and y pitch; Canon's two resolutions differ by up to 2 % for square pixels."""

SENSOR_ASPECT = (1.0, 1.95)
"""Longer ÷ shorter side, from square to 16:9 with slack; an image outside this range is a panorama or a strip."""

LARGEST_SENSOR_MM = 56.0
"""Digital medium format sensors are up to 53.9 mm wide."""

WIDE_SENSORS_MM = ((12.5, 13.5), (20.0, 37.0))
"""Widths of 3:2 sensors: the 1-inch type, and APS-C to full frame. Smaller sensors, four thirds and medium format
are 4:3."""

NARROW = 0.9
"""An image narrower than this fraction of its sensor's width was cropped in width: 4:3 or 5:4 from 3:2, square from
4:3. It does not detect 5:4 from 4:3, because small 5:4 sensors exist."""

CUT_SLACK = 0.09
"""Tolerance of the 35 mm equivalent for an image that may be a crop of a 4:3 image."""

NOMINAL_FACTOR = 0.02
"""Makers multiply by a nominal crop factor: Nikon by 1.5 for sensors of 23.5 mm, which is 1.53."""

FISHEYE_FACTOR = 0.3
"""A fisheye's equivalent is of the lens with its field of view, or of its scale on the axis: tan(θ) ÷ θ apart."""

SMALL_SENSOR = 3.0
"""Ratio of 35 mm equivalent to focal length above which sensors are 4:3 and a 3:2 image is a crop."""

FIELD_OF_VIEW_TAG = "exif:CameraHorizontalFOV"
PLAUSIBLE_DEG = (3.0, 130.0)


def estimates(scene: Scene) -> Iterator[Finding]:
    """Estimates from a stated field of view, each pixel or sensor size, the catalogue's fx and the 35 mm equivalent."""
    yield from _by_field_of_view(scene)
    yield from _stated(scene)
    if "focal" not in scene.metadata.stated:
        yield from _metric(scene)
    yield from _design(scene)
    yield from _prior(scene)


def _by_field_of_view(scene: Scene) -> Iterator[Finding]:
    text = scene.metadata.xmp_text("exif", "CameraHorizontalFOV")
    if text is None:
        return
    horizontal = numbers(text)
    if (
        horizontal is None
        or len(horizontal) != 1
        or not PLAUSIBLE_DEG[0] <= horizontal[0] <= PLAUSIBLE_DEG[1]
    ):
        yield Dropped(
            source=Source.FIELD_OF_VIEW,
            tag=FIELD_OF_VIEW_TAG,
            reason="does not contain an angle between 3 and 130 degrees",
        )
        return
    width, height = files_frame(scene.metadata)
    focal = width / 2 / math.tan(math.radians(horizontal[0]) / 2)
    intrinsics = Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=(width, height))
    yield scene.estimate(Source.FIELD_OF_VIEW, FIELD_OF_VIEW_TAG, Grade.DESIGN, intrinsics)


def _stated(scene: Scene) -> Iterator[Finding]:
    """What a person states: a focal length over a sensor or the catalogue's pitch, else the catalogue's fx alone."""
    written, known = scene.metadata, scene.known
    focal_mm = written.focal_mm if "focal" in written.stated else None
    if focal_mm is not None and scene.given_sensor_mm is not None:
        width, height = scene.given_sensor_mm
        fx, fy = focal_mm / width * written.size[0], focal_mm / height * written.size[1]
        tag, K = "stated focal length ÷ stated sensor", _centred(fx, fy, written.size)
    elif known is None or known.native_size is None:
        return
    elif focal_mm is not None and known.pitch_um is not None:
        focal = focal_mm * 1000.0 / known.pitch_um
        tag, K = "stated focal length ÷ catalogue pitch", _centred(focal, focal, known.native_size)
    elif "camera" in written.stated and written.focal_mm is None and known.zoom_mm is None:
        over_width = known.fx_over_w_at(known.focal_mm)
        if over_width is None:
            return
        focal = over_width * known.native_size[0]
        tag, K = "catalogue fx of the stated camera", _centred(focal, focal, known.native_size)
    else:
        return
    yield scene.estimate(Source.STATED, tag, Grade.DERIVED, K)


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
    stated = scene.given_sensor_mm is not None
    if known is not None and known.pitch_um is not None and known.native_size is not None:
        stated = True
        yield _by_pitch(scene, focal_mm, known.pitch_um, known.native_size)
    for finding in (*_by_focal_plane(scene, focal_mm), *_inferred(scene, focal_mm)):
        stated = stated or not isinstance(finding, Dropped)
        yield finding
    if not stated and scene.assumed_sensor_mm is not None:
        yield _by_sensor(scene, focal_mm, scene.assumed_sensor_mm, Source.ASSUMED_SENSOR)


def _design(scene: Scene) -> Iterator[Finding]:
    """The catalogue's own fx, used if EXIF FocalLength ÷ pitch is not available."""
    known = scene.known
    if known is None or known.native_size is None or known.zoom_mm is not None or scene.metadata.stated:
        return
    focal_mm, nominal = scene.focal_mm, known.focal_mm
    if focal_mm is None:
        # Thermal cameras write no FocalLength.
        is_thermal = known.sub_camera == THERMAL and nominal is not None and known.pitch_um is not None
        has_optics = scene.fills or (is_thermal and scene.metadata.focal_mm is None)
    else:
        has_optics = known.pitch_um is None and (
            nominal is None or abs(focal_mm / nominal - 1.0) <= AGREEMENT
        )
    tag = "catalogue fx" if known.fx_over_w is not None else "catalogue focal length ÷ catalogue pitch"
    over_width = known.fx_over_w_at(known.focal_mm)
    if has_optics and over_width is not None:
        focal = over_width * known.native_size[0]
        intrinsics = _centred(focal, focal, known.native_size)
        yield scene.estimate(Source.CATALOGUE_DESIGN, tag, Grade.DESIGN, intrinsics)


def _inferred(scene: Scene, focal_mm: float) -> Iterator[Finding]:
    """Estimates for an unknown camera: from the listed sensor width, or 36 mm if FocalLength equals its equivalent."""
    if not scene.weighs:
        return
    listed, focal_35mm = scene.listed, scene.metadata.focal_35mm
    if listed is not None:
        yield _by_width(scene, focal_mm, listed.mm, Source.LISTED_SENSOR, f"sensor width by {listed.source}")
    if focal_35mm is not None and abs(focal_mm / focal_35mm - 1.0) <= EQUAL_FOCAL:
        yield _by_width(
            scene, focal_mm, WIDTH_35MM, Source.FULL_FRAME, "36 mm, for it is its 35 mm equivalent"
        )


def _by_width(scene: Scene, focal_mm: float, width_mm: float, source: Source, what: str) -> Finding:
    """Focal length ÷ length of the sensor's longer side, assuming that the image spans that side."""
    size = files_frame(scene.metadata)
    spanned = _spanned(size, width_mm)
    focal = focal_mm / width_mm * spanned
    assumptions = (f"the image spans the sensor's {width_mm:g} mm",)
    if spanned > max(size):
        assumptions = (
            f"the image spans the sensor's height, and {max(size) / spanned:.0%} of its {width_mm:g} mm",
        )
    return scene.estimate(
        source,
        f"EXIF FocalLength ÷ {what}",
        Grade.PRIOR,
        _centred(focal, focal, size),
        tolerance=EQUAL_FOCAL if source is Source.FULL_FRAME else 0.0,
        assumptions=assumptions,
    )


def _spanned(size: ImageSize, width_mm: float) -> float:
    """Length in px of the image's longer side before its width was cropped; the present length if it was not.

    Cameras and editors crop the width around the centre and keep the height: 5:4 or 4:3 from 3:2, square from 4:3.
    """
    longer, shorter = max(size), min(size)
    is_wide = any(low <= width_mm <= high for low, high in WIDE_SENSORS_MM)
    native = shorter * (3 / 2 if is_wide else 4 / 3)
    return native if longer < NARROW * native else longer


def _by_sensor(scene: Scene, focal_mm: float, sensor_mm: tuple[float, float], source: Source) -> Finding:
    """Focal length ÷ sensor size × true size of the output image, per axis, as in the source document."""
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
    frame = files_frame(scene.metadata)
    part = is_part(scene, focal, native_size)
    intrinsics = _centred(focal, focal, frame if part else native_size)
    return scene.estimate(
        Source.CATALOGUE_PITCH,
        "EXIF FocalLength ÷ catalogue pitch",
        Grade.DERIVED,
        intrinsics,
        assumptions=("the crop is centred",) if part else (),
    )


def is_part(scene: Scene, focal: float, native_size: ImageSize) -> bool:
    """Whether a smaller image is a 1:1 crop of the sensor, as in the APS-C mode of a full-frame body.

    The 35 mm equivalent decides: it refers to the cropped part, so it agrees with the focal length in px of the full
    frame only if the image was not scaled.

    Args:
        scene: of the image.
        focal: focal length of the camera in px of the full frame.
        native_size: size of the full frame in px.
    """
    focal_35mm, frame = scene.metadata.focal_35mm, files_frame(scene.metadata)
    if focal_35mm is None or not same_aspect(frame, native_size) or frame[0] >= native_size[0]:
        return False
    stated = focal_35mm / DIAGONAL_35MM * math.hypot(*frame)
    within = AGREEMENT + 1.0 / focal_35mm
    return abs(stated / focal - 1.0) <= within < abs(stated / (focal * frame[0] / native_size[0]) - 1.0)


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
    odd = _odd_focal_plane(scene, per_mm) if scene.weighs else None
    if odd is not None:
        yield Dropped(source=Source.FOCAL_PLANE, tag=tag, reason=odd)
        return
    assumptions = (
        ("FocalPlaneResolution is in pixels per inch",) if scene.metadata.focal_plane_unit is None else ()
    )
    intrinsics = _centred(focal_mm * per_mm[0], focal_mm * per_mm[1], files_frame(scene.metadata))
    foreign = scene.is_foreign(intrinsics) if scene.known is not None else None
    if foreign is not None and not _fits_a_part(scene, intrinsics):
        yield Dropped(source=Source.FOCAL_PLANE, tag=tag, reason=foreign)
        return
    yield scene.estimate(Source.FOCAL_PLANE, tag, Grade.DERIVED, intrinsics, assumptions=assumptions)


def _fits_a_part(scene: Scene, K: Intrinsics) -> bool:
    """Whether a focal plane that is not of the known camera's whole frame is of a part of it, and nothing denies that.

    Where cameras and programs usually scale, the tag is what a program left as it was.
    """
    expected, native = scene.expected_over_width(), scene.native_size
    if expected is None or native is None:
        return False
    focal = expected * native[0]
    ways = readings(_centred(focal, focal, native), scene.metadata)
    is_open = all(way.prior is Prior.POSSIBLE for way in ways)
    return is_open and any(way.is_cut and abs(K.fx / way.intrinsics.fx - 1.0) <= AGREEMENT for way in ways)


def _odd_focal_plane(scene: Scene, per_mm: tuple[float, float]) -> str | None:
    """Reason why the focal plane resolution cannot belong to a sensor that this image fills, or None if it can."""
    pitch, (low, high) = 1000.0 / max(per_mm), PITCH_UM
    if not low <= pitch <= high:
        return f"would be pixels of {pitch:.2g} µm, expected {low:g} … {high:g} µm"
    if max(files_frame(scene.metadata)) / max(per_mm) > LARGEST_SENSOR_MM:
        found = max(files_frame(scene.metadata)) / max(per_mm)
        return f"would be a sensor {found:.0f} mm wide, expected up to {LARGEST_SENSOR_MM:g} mm: another unit is meant"
    if abs(per_mm[0] / per_mm[1] - 1.0) > SQUARE_PIXELS:
        return f"would be pixels {per_mm[1] / per_mm[0]:.2f} times as wide as high"
    width, height = files_frame(scene.metadata)
    aspect, (low, high) = max(width, height) / min(width, height), SENSOR_ASPECT
    if not low <= aspect <= high:
        return f"the image's sides are {aspect:.2f} to 1, which no sensor's are: it was cropped or resized"
    return None


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
        tolerance=_slack_35mm(scene, size, focal_35mm),
        assumptions=assumptions,
    )


def _slack_35mm(scene: Scene, size: ImageSize, focal_35mm: float) -> float:
    """Relative error that a correct 35 mm equivalent may have.

    Cameras truncate as often as they round: 52.8 is written as 52. An image of unknown origin may be a crop of a 4:3
    image, which has a diagonal 8.2 % longer than 16:9 at the same width, and 4.0 % longer than 3:2. For an unknown
    camera it is also unknown whether the maker uses the diagonal or the width, which at 4:3 makes 3.9 % difference.
    """
    rounding = 1.0 / focal_35mm
    if scene.is_fisheye:
        return rounding + FISHEYE_FACTOR
    if scene.native_size is not None:
        return rounding
    if not scene.weighs:
        return max(rounding, CUT_SLACK if size[0] * 10 > size[1] * 16 else 0.0)
    rounding += NOMINAL_FACTOR
    longer, shorter = max(size), min(size)
    width_mm = scene.listed.mm if scene.listed is not None else WIDTH_35MM
    spanned = _spanned(size, width_mm)
    if spanned > longer and (scene.listed is not None or scene.focal_mm == focal_35mm):
        # The equivalent may refer to the diagonal of the whole sensor or to that of the image.
        return rounding + math.hypot(spanned, shorter) / math.hypot(longer, shorter) - 1.0
    is_small = focal_35mm > SMALL_SENSOR * (scene.focal_mm or math.inf)
    if longer * 10 > shorter * (14 if is_small else 16):
        return max(rounding, CUT_SLACK)
    return rounding + abs(DIAGONAL_35MM / WIDTH_35MM / math.hypot(1.0, shorter / longer) - 1.0)


def _centred(fx: float, fy: float, size: ImageSize) -> Intrinsics:
    return Intrinsics(fx=fx, fy=fy, cx=size[0] / 2, cy=size[1] / 2, image_size=size)
