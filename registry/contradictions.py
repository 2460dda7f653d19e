"""Comparison of a K with known facts about its camera: catalogue, sensor, related entries, and the K approved before.

A policy limits what any lens can be; these checks limit what *this* camera can be. A deviation of a few percent may be
due to the unit, the focus or a nominal focal length, and is a warning. A larger one indicates the K of another camera
or image size, a K in millimetres, or a typing error: this is an error, which a person can override with a reason that
is kept in the entry.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, ImageSize, Intrinsics
from calibrary.catalogue import Catalogue
from calibrary.catalogue.sensor_widths import sensor_width
from calibrary.errors import FrameError
from calibrary.evidence.frame import adapt
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import same_aspect
from calibrary.known_camera import KnownCamera, normalise_sub_camera
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.paths import in_use_path, match_key
from calibrary.validation import Finding, Severity

__all__ = ["CONTRADICTIONS", "contradictions"]

BY_UNIT: Final = "length-unit"
BY_SIZE: Final = "image-size"
BY_CATALOGUE: Final = "against-catalogue"
BY_SENSOR: Final = "against-sensor"
BY_RELATIVES: Final = "against-relatives"
BY_LAST_APPROVED: Final = "against-last-approved"

CONTRADICTIONS: Final = frozenset({BY_UNIT, BY_SIZE, BY_CATALOGUE, BY_SENSOR, BY_RELATIVES, BY_LAST_APPROVED})
"""Rules of this module: the errors of a check that a person can override."""

CONTRADICTION: Final = 0.10
"""Units of a model and focus settings differ by less than this; cameras of one payload by more."""
SENSOR_CONTRADICTION: Final = 0.20
"""Lists of sensor widths contain errors of a few percent; a 35 mm equivalent is at least 1.5 times the focal
length."""
USUAL: Final = 0.03
"""Tolerance if the policy states none."""
MILLIMETRES: Final = 0.05
"""Share of the width below which fx cannot be in pixels: a field of view of 169 degrees."""
QUARTER: Final = 0.15
SAME_SHARE: Final = 0.04
"""Largest difference between cx / W and cy / H for a K that refers to another image size."""
FOCAL_TOLERANCE: Final = 0.02
SAME_CAMERA: Final = ("make", "model", "sub_camera", "lens", "capture_mode")
WHOLE: Final = 0.01
PHOTO: Final = (4 / 3, 3 / 2)


class _Range(Struct, frozen=True, kw_only=True):
    """Expected range of fx in px; several values if the part of the sensor shown by the image is unknown."""

    low: float
    high: float
    spread: float
    source: str

    def off(self, fx: float) -> float:
        """Return the relative distance of ``fx`` from the range."""
        if self.low <= fx <= self.high:
            return 0.0
        return fx / (self.low if fx < self.low else self.high) - 1.0

    def __str__(self) -> str:
        if self.high / self.low < 1.001:
            return f"{self.low:.1f} px"
        return f"{self.low:.1f} … {self.high:.1f} px"


def contradictions(
    path: str,
    entry: Entry,
    entries: Mapping[str, Entry],
    last_approved: Entry | None,
    policy: Policy,
    catalogue: Catalogue,
) -> Iterator[Finding]:
    """Find contradictions between the K of an entry and known facts about its camera.

    Args:
        path: path of the entry.
        entry: the entry.
        entries: all entries of its model, by path.
        last_approved: the entry approved before it; None if there was none, or it is not to be compared.
        policy: policy of the registry; its tolerance of a known camera is the limit for warnings.
        catalogue: cameras known by name.
    """
    if entry.status is Status.RETIRED:
        return
    if wrong := [*_unit(entry.calibration)]:
        yield from _findings(path, entry, wrong)
        return
    usual = policy.known_camera_tolerance if policy.known_camera_tolerance is not None else USUAL
    known = _of_catalogue(entry.calibration, catalogue)
    found = [
        *_image_size(entry.calibration),
        *_catalogue(entry.calibration, known, usual),
        *(_sensor(entry) if not known else ()),
        *_relatives(path, entry, entries, known, usual),
        *(_against_last_approved(entry, last_approved, known, usual) if last_approved is not None else ()),
    ]
    yield from _findings(path, entry, found)


def _findings(path: str, entry: Entry, contradictions: Iterable[_Contradiction]) -> Iterator[Finding]:
    for rule, severity, off, limit, message in contradictions:
        finding = Finding(
            rule=rule, severity=severity, place=path, measured=off, limit=limit, message=message
        )
        if entry.override is not None:
            said = f"{message}; used in spite of that: {entry.override}"
            finding = replace(finding, severity=Severity.WARNING, message=said)
        yield replace(finding, remedy=REMEDY) if finding.severity is Severity.ERROR else finding


REMEDY: Final = "correct K or the camera's key; if it is right, --force --reason TEXT says so"
_Contradiction = tuple[str, Severity, float, float, str]


def _unit(c: Calibration) -> Iterator[_Contradiction]:
    K = c.intrinsics
    share = K.fx / K.image_size[0]
    if share < MILLIMETRES:
        message = (
            f"fx = {K.fx:g} of an image {K.image_size[0]} px wide is not in pixels; is it a length in mm?"
        )
        yield BY_UNIT, Severity.ERROR, share, MILLIMETRES, message


def _image_size(c: Calibration) -> Iterator[_Contradiction]:
    """Detect a K of another image size: cx / W and cy / H are equal, and not one half."""
    K, (width, height) = c.intrinsics, c.intrinsics.image_size
    across, down = 2 * K.cx / width, 2 * K.cy / height
    if abs(across - 1.0) > QUARTER and abs(across / down - 1.0) <= SAME_SHARE:
        message = (
            f"the principal point ({K.cx:.1f}, {K.cy:.1f}) px is the middle of an image of "
            f"{across * width:.0f}×{across * height:.0f} px, and the key says {width}×{height}"
        )
        yield BY_SIZE, Severity.ERROR, abs(across - 1.0), QUARTER, message


def _catalogue(c: Calibration, known: tuple[_Range, ...], usual: float) -> Iterator[_Contradiction]:
    if not known:
        return
    # If several cameras are possible, K has to match one of them.
    nearest = min(known, key=lambda one: abs(one.off(c.intrinsics.fx)))
    off, tolerance = nearest.off(c.intrinsics.fx), max(usual, nearest.spread)
    if abs(off) <= tolerance:
        return
    limit = max(CONTRADICTION, 2 * nearest.spread)
    severity, limit = (Severity.ERROR, limit) if abs(off) > limit else (Severity.WARNING, tolerance)
    message = f"fx = {c.intrinsics.fx:.1f} px is {_off_by(off)} the catalogue's {nearest} of {nearest.source}"
    yield BY_CATALOGUE, severity, off, limit, message


def _sensor(entry: Entry) -> Iterator[_Contradiction]:
    """Check that fx times the pixel pitch is close to the nominal focal length."""
    c, camera = entry.calibration, entry.calibration.camera
    width, height = c.intrinsics.image_size
    if camera.focal_mm is None or camera.capture_mode is not None:
        return
    stated = entry.sensor
    width_mm = stated.width_mm if stated is not None else None
    if stated is not None and width_mm is None and stated.pitch_um is not None:
        width_mm = stated.pitch_um / 1000 * width
    source = "the sensor that the entry states"
    if width_mm is None:
        listed = sensor_width(camera.make, camera.model)
        if listed is None:
            return
        width_mm, source = (
            listed.mm * width / max(width, height),
            f"the sensor width that {listed.source} list",
        )
    off = c.intrinsics.fx * width_mm / width / camera.focal_mm - 1.0
    if abs(off) <= SENSOR_CONTRADICTION:
        return
    shape = max(width, height) / min(width, height)
    # Still images show the whole sensor; for video frames the shown part is unknown.
    is_sure = stated is not None or off < 0 or any(abs(shape / usual - 1.0) < 0.02 for usual in PHOTO)
    message = (
        f"fx = {c.intrinsics.fx:.1f} px is {_off_by(off)} the key's {camera.focal_mm:g} mm by {source} "
        f"({width_mm:.2f} mm for the image's width): a 35 mm equivalent taken for the focal length, "
        "or another camera's K"
    )
    severity = Severity.ERROR if is_sure else Severity.WARNING
    yield BY_SENSOR, severity, off, SENSOR_CONTRADICTION, message


def _relatives(
    path: str, entry: Entry, entries: Mapping[str, Entry], known: tuple[_Range, ...], usual: float
) -> Iterator[_Contradiction]:
    """Compare with the usable entries for other units and image sizes of the same camera."""
    fx, own = entry.calibration.intrinsics.fx, {path, in_use_path(path)}
    others = {
        other_path: (expected, other.tolerance if other.tolerance is not None else usual)
        for other_path, other in entries.items()
        if other_path not in own and other.is_usable and other.override is None
        if (expected := _fx_in_frame_of(entry, other)) is not None
    }
    if not others:
        return
    nearest, (expected, tolerance) = min(others.items(), key=lambda item: abs(fx / item[1][0] - 1.0))
    off = fx / expected - 1.0
    if abs(off) <= max(tolerance, usual):
        return
    contradicts = abs(off) > max(CONTRADICTION, tolerance) and not _is_confirmed_by(known, fx)
    limit = max(CONTRADICTION, tolerance) if contradicts else max(tolerance, usual)
    message = f"fx = {fx:.1f} px is {_off_by(off)} the {expected:.1f} px of {nearest}, the nearest of the same camera"
    yield BY_RELATIVES, Severity.ERROR if contradicts else Severity.WARNING, off, limit, message


def _against_last_approved(
    entry: Entry, last_approved: Entry, known: tuple[_Range, ...], usual: float
) -> Iterator[_Contradiction]:
    if not last_approved.is_usable:
        return
    expected, fx = _fx_in_frame_of(entry, last_approved), entry.calibration.intrinsics.fx
    if expected is None:
        return
    tolerance = last_approved.tolerance if last_approved.tolerance is not None else usual
    off = fx / expected - 1.0
    if abs(off) <= tolerance:
        return
    # A K that the catalogue confirms may replace one that it contradicts.
    corrects = _is_confirmed_by(known, fx) and not _is_confirmed_by(known, expected)
    now = f"{expected:.1f} px that are {last_approved.status.value}"
    message = f"fx = {fx:.1f} px is {_off_by(off)} the {now} for this very camera"
    yield BY_LAST_APPROVED, Severity.WARNING if corrects else Severity.ERROR, off, tolerance, message


def _is_confirmed_by(known: Iterable[_Range], fx: float) -> bool:
    return any(abs(one.off(fx)) <= max(USUAL, one.spread) for one in known)


def _fx_in_frame_of(entry: Entry, other: Entry) -> float | None:
    """Return the fx of another entry at this one's image size; None if it is not comparable."""
    one, two = entry.calibration.camera, other.calibration.camera
    same = all(_same(getattr(one, name), getattr(two, name)) for name in SAME_CAMERA)
    focal = one.focal_mm, two.focal_mm
    if not same or (focal[0] and focal[1] and abs(focal[0] / focal[1] - 1.0) > FOCAL_TOLERANCE):
        return None
    if (focal[0] is None) != (focal[1] is None):
        return None
    try:
        size = entry.calibration.intrinsics.image_size
        return adapt(other.calibration.intrinsics, ImageMetadata(size=size)).intrinsics.fx
    except FrameError:
        return None


def _same(one: str | None, other: str | None) -> bool:
    if one is None or other is None:
        return one is other
    return match_key(one) == match_key(other)


def _of_catalogue(c: Calibration, catalogue: Catalogue) -> tuple[_Range, ...]:
    """Return the catalogue's expected range for each of its cameras that is possible."""
    camera = c.camera
    if camera.capture_mode is not None and "zoom" in camera.capture_mode:
        return ()
    match = catalogue.find(
        camera.make,
        camera.model,
        sub_camera=camera.sub_camera,
        size=camera.image_size,
        focal_mm=camera.focal_mm,
        lens=camera.lens,
    )
    if match.camera is not None:
        rows: tuple[KnownCamera, ...] = (match.camera,)
    else:
        # The focal length in a key may itself be wrong, so any camera of this Model is possible.
        tag = normalise_sub_camera(camera.sub_camera) if camera.sub_camera else None
        rows = tuple(
            row
            for row in match.candidates or match.siblings
            if (camera.lens is None or row.lens is None) and (tag is None or row.may_answer(tag))
        )
    found = [_expected(row, camera, c.intrinsics.image_size) for row in rows]
    # If nothing is known of one possible camera, every K is allowed.
    return tuple(one for one in found if one is not None) if None not in found else ()


def _expected(row: KnownCamera, camera: CameraKey, size: ImageSize) -> _Range | None:
    shares = [row.fx_over_w_at(camera.focal_mm)]
    if shares[0] is None and row.zoom_mm is not None:
        shares = [row.fx_over_w_at(end) for end in row.zoom_mm]
    ends = [share for share in shares if share is not None]
    if not ends or len(ends) < len(shares):
        return None
    frames = [fx for share in ends for fx in _in_frame(share, row.native_size, size, camera.capture_mode)]
    return _Range(low=min(frames), high=max(frames), spread=row.spread or 0.0, source=row.title)


def _in_frame(share: float, native: ImageSize | None, size: ImageSize, mode: str | None) -> tuple[float, ...]:
    """Return the possible fx: for the whole width, scaled; and, for a possible 1:1 crop, unscaled."""
    if native is None:
        return (share * size[0],)
    native_fx, (width, height) = share * native[0], native
    if mode is None and (native == size or (same_aspect(native, size) and _is_whole(width / size[0]))):
        return (share * size[0],)
    if mode is None and not same_aspect(native, size):
        K = Intrinsics(fx=native_fx, fy=native_fx, cx=width / 2, cy=height / 2, image_size=native)
        try:
            return (adapt(K, ImageMetadata(size=size)).intrinsics.fx,)
        except FrameError:
            pass
    return share * size[0], native_fx


def _is_whole(ratio: float) -> bool:
    ratio = max(ratio, 1 / ratio)
    return abs(ratio / round(ratio) - 1.0) <= WHOLE


def _off_by(off: float) -> str:
    if off > 1.0:
        return f"{off + 1.0:.2g} times"
    if off < -0.5:
        return f"{off + 1.0:.2g} of"
    return f"{off:+.1%} off"
