"""The K of an entry, weighed against what is known of its camera: catalogue, sensor, relatives, and what is in use.

A policy limits what any lens can be. What is known of a camera limits what *this* camera can be. A deviation of a few
percent may be due to the unit, the focus or a nominal focal length, and is a warning. A larger one indicates the K of
another camera or image size, a K in millimetres, or a typing error: this is an error, which a person can override with
a reason that is kept in the entry.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from typing import Final

from msgspec import Struct

from calibrary.admission import ADMISSION, admission
from calibrary.calibration import Calibration, CameraKey, ImageSize, Intrinsics
from calibrary.catalogue import shipped_catalogue
from calibrary.catalogue.sensor_widths import sensor_width
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.readings import Prior, Reading, readings
from calibrary.jobs.survey import Claim, Survey, Who
from calibrary.jobs.survey.limits import NOMINAL, known_tolerance
from calibrary.known_camera import KnownCamera, match_key, normalise_sub_camera
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.paths import file_path
from calibrary.validation import Finding, Severity

BY_CATALOGUE: Final = "against-catalogue"
BY_SENSOR: Final = "against-sensor"
BY_RELATIVES: Final = "against-relatives"
BY_LAST_APPROVED: Final = "against-last-approved"

CONTRADICTIONS: Final = frozenset({ADMISSION, BY_CATALOGUE, BY_SENSOR, BY_RELATIVES, BY_LAST_APPROVED})
"""Rules of this module: the errors of a check that a person can override."""
REMEDY: Final = "correct K or the camera's key; if it is right, --force --reason TEXT says so"

GROSS: Final = 0.10
"""Units of a model and focus settings differ by less than this; cameras of one payload by more."""
GROSS_BY_SENSOR: Final = 0.20
"""Lists of sensor widths contain errors of a few percent; a 35 mm equivalent is at least 1.5 times the focal
length."""
FOCAL_TOLERANCE: Final = 0.02
SAME_CAMERA: Final = ("make", "model", "sub_camera", "lens", "capture_mode")
PHOTO: Final = (4 / 3, 3 / 2)


class _Known(Struct, frozen=True, kw_only=True):
    """What is known of the camera of an entry.

    Attributes:
        rule: name of the finding where it contradicts K.
        claim: what it states, at the entry's image size.
        gross: relative difference of fx beyond which a contradiction needs a person's override.
        hint: what such a difference usually is.
    """

    rule: str
    claim: Claim
    gross: float
    hint: str = ""


def contradictions(
    path: str, entry: Entry, entries: Mapping[str, Entry], last_approved: Entry | None, policy: Policy
) -> Iterator[Finding]:
    """Find contradictions between the K of an entry and known facts about its camera.

    Of the K in use for this very camera, only a gross difference is told here: smaller ones are told with what they do
    to a map.

    Args:
        path: path of the entry.
        entry: the entry.
        entries: all entries of its model, by path.
        last_approved: the entry approved before it; None if there was none, or it is not to be compared.
        policy: policy of the registry, with its tolerance of a known camera and the limits of ``diff``.
    """
    if entry.status is Status.RETIRED:
        return
    alone = admission(entry.calibration)
    if alone is not None:
        yield _finding(path, entry, ADMISSION, alone.measured, alone.limit, alone.message)
        if alone.severity is Severity.ERROR:
            return
    calibration, known = entry.calibration, [*_known(path, entry, entries, last_approved, policy)]
    fx, size = calibration.intrinsics.fx, ImageMetadata(size=calibration.intrinsics.image_size)
    own = _in_registry(path, calibration, None, policy)
    by_name = {one.claim.name: one for one in known}
    claims = [own, *(one.claim for one in known)]
    for one in Survey(size, claims, policy).weigh(own).against:
        about, off = by_name[one.one.claim.name], fx / one.one.fx - 1.0
        said = f"fx = {fx:.1f} px, and {one.message}"
        if abs(off) > about.gross:
            severity = Severity.WARNING if one.shown_by else Severity.ERROR
            yield _finding(path, entry, about.rule, off, about.gross, said + about.hint, severity)
        elif about.rule != BY_LAST_APPROVED:
            yield _finding(path, entry, about.rule, off, one.limit, said, Severity.WARNING)


def _in_registry(name: str, K: Calibration, granted: float | None, policy: Policy) -> Claim:
    is_measured = K.grade.is_measured
    return Claim(
        who=Who.ENTRY,
        name=name,
        calibration=K,
        tolerance=0.0 if is_measured else known_tolerance(policy),
        granted=granted,
        is_measured=is_measured,
        rests_on=frozenset({name}),
        voice=name,
    )


def _finding(
    path: str,
    entry: Entry,
    rule: str,
    off: float | None,
    limit: float | None,
    message: str,
    severity: Severity = Severity.ERROR,
) -> Finding:
    if entry.override is not None:
        message, severity = f"{message}; used in spite of that: {entry.override}", Severity.WARNING
    remedy = REMEDY if severity is Severity.ERROR else None
    return Finding(
        rule=rule,
        severity=severity,
        place=path,
        measured=off,
        limit=limit,
        message=message,
        remedy=remedy,
    )


def _known(
    path: str, entry: Entry, entries: Mapping[str, Entry], last_approved: Entry | None, policy: Policy
) -> Iterator[_Known]:
    """All that is known of an entry's camera besides its K."""
    usual = known_tolerance(policy)
    yield from (_of_catalogue(entry, usual) or _of_sensor(entry))
    yield from _of_relatives(path, entry, entries, usual)
    used = (
        _in_frame_of(entry, last_approved) if last_approved is not None and last_approved.is_usable else None
    )
    if last_approved is not None and used is not None:
        name = f"{last_approved.id}, {last_approved.status.value} for this very camera,"
        tolerance = last_approved.tolerance
        claim = _in_registry(name, used, tolerance, policy)
        yield _Known(rule=BY_LAST_APPROVED, claim=claim, gross=tolerance if tolerance is not None else usual)


def _stated(entry: Entry, name: str, fx: float, tolerance: float, engraved: float = 0.0) -> Claim:
    """A nominal claim of the focal length alone."""
    K = entry.calibration
    square = replace(K.intrinsics, fx=fx, fy=fx * K.intrinsics.fy / K.intrinsics.fx)
    return Claim(
        who=Who.CATALOGUE,
        name=name,
        calibration=replace(K, intrinsics=square, quality=None),
        tolerance=tolerance,
        engraved=engraved,
        rests_on=frozenset({name}),
        voice=name,
    )


def _of_sensor(entry: Entry) -> list[_Known]:
    """The fx that follows from the key's focal length and the sensor that the entry states, or a listed width."""
    camera, stated = entry.calibration.camera, entry.sensor
    width, height = entry.calibration.intrinsics.image_size
    if camera.focal_mm is None or camera.capture_mode is not None:
        return []
    width_mm, source = stated.width_mm if stated is not None else None, "the sensor that the entry states"
    if stated is not None and width_mm is None and stated.pitch_um is not None:
        width_mm = stated.pitch_um / 1000 * width
    if width_mm is None:
        listed = sensor_width(camera.make, camera.model)
        if listed is None:
            return []
        width_mm, source = (
            listed.mm * width / max(width, height),
            f"the sensor width that {listed.source} list",
        )
    fx = camera.focal_mm / width_mm * width
    shape = max(width, height) / min(width, height)
    # Still images show the whole sensor; for video frames the shown part is unknown, and so may be a longer lens.
    is_whole = stated is not None or any(abs(shape / usual - 1.0) < 0.02 for usual in PHOTO)
    is_sure = is_whole or entry.calibration.intrinsics.fx < fx
    name = f"the key's {camera.focal_mm:g} mm by {source} ({width_mm:.2f} mm for the image's width)"
    return [
        _Known(
            rule=BY_SENSOR,
            claim=_stated(entry, name, fx, 0.02, NOMINAL),
            gross=GROSS_BY_SENSOR if is_sure else inf,
            hint=": a 35 mm equivalent taken for the focal length, or another camera's K",
        )
    ]


def _of_relatives(path: str, entry: Entry, entries: Mapping[str, Entry], usual: float) -> Iterator[_Known]:
    """The nearest of the usable entries for other units and image sizes of the same camera."""
    fx, own = entry.calibration.intrinsics.fx, {path, file_path(path)}
    others = {
        other_path: (
            found.intrinsics.fx,
            max(other.tolerance if other.tolerance is not None else usual, usual),
        )
        for other_path, other in entries.items()
        if other_path not in own and other.is_usable and other.override is None
        if (found := _in_frame_of(entry, other)) is not None
    }
    if others:
        nearest, (expected, tolerance) = min(others.items(), key=lambda item: abs(fx / item[1][0] - 1.0))
        claim = _stated(entry, f"{nearest}, the nearest of the same camera,", expected, tolerance)
        yield _Known(rule=BY_RELATIVES, claim=claim, gross=max(GROSS, tolerance))


def _in_frame_of(entry: Entry, other: Entry) -> Calibration | None:
    """Return the calibration of another entry at this one's image size; None if it is not comparable."""
    one, two = entry.calibration.camera, other.calibration.camera
    same = all(_same(getattr(one, name), getattr(two, name)) for name in SAME_CAMERA)
    focal = one.focal_mm, two.focal_mm
    if not same or (focal[0] and focal[1] and abs(focal[0] / focal[1] - 1.0) > FOCAL_TOLERANCE):
        return None
    if (focal[0] is None) != (focal[1] is None):
        return None
    fx, size = entry.calibration.intrinsics.fx, entry.calibration.intrinsics.image_size
    at_size = [way.intrinsics for way in _usual(other.calibration.intrinsics, size)]
    K = min(at_size, key=lambda one: abs(one.fx / fx - 1.0), default=None)
    return replace(other.calibration, intrinsics=K, camera=replace(two, image_size=size)) if K else None


def _usual(K: Intrinsics, size: ImageSize, mode: str | None = None) -> tuple[Reading, ...]:
    """How a K may be of an image size; what cameras and programs usually do goes before all else, but for a mode."""
    ways = readings(K, ImageMetadata(size=size))
    usual = tuple(one for one in ways if one.prior is not Prior.POSSIBLE) if mode is None else ()
    return usual or ways


def _same(one: str | None, other: str | None) -> bool:
    if one is None or other is None:
        return one is other
    return match_key(one) == match_key(other)


def _of_catalogue(entry: Entry, usual: float) -> list[_Known]:
    """What the catalogue knows of the camera; of several that are possible, the nearest."""
    K, camera = entry.calibration.intrinsics, entry.calibration.camera
    if camera.capture_mode is not None and "zoom" in camera.capture_mode:
        return []
    match = shipped_catalogue().find(
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
    found: list[tuple[float, KnownCamera]] = []
    for row in rows:
        possible = _expected(row, camera, K.image_size)
        if not possible:
            # If nothing is known of one possible camera, every K is allowed.
            return []
        found.append((min(max(K.fx, min(possible)), max(possible)), row))
    if not found:
        return []
    fx, row = min(found, key=lambda one: abs(K.fx / one[0] - 1.0))
    spread = row.spread or 0.0
    claim = _stated(entry, f"the catalogue's {row.title}", fx, max(usual, spread))
    return [_Known(rule=BY_CATALOGUE, claim=claim, gross=max(GROSS, 2 * spread))]


def _expected(row: KnownCamera, camera: CameraKey, size: ImageSize) -> list[float]:
    """The fx in px that a known camera may have at an image size: the ends of a range; empty if it is not known."""
    shares = [row.fx_over_w_at(camera.focal_mm)]
    if shares[0] is None and row.zoom_mm is not None:
        shares = [row.fx_over_w_at(end) for end in row.zoom_mm]
    ends = [share for share in shares if share is not None]
    if len(ends) < len(shares):
        return []
    return [fx for share in ends for fx in _in_frame(share, row.native_size, size, camera.capture_mode)]


def _in_frame(share: float, native: ImageSize | None, size: ImageSize, mode: str | None) -> list[float]:
    """The possible fx of a share of the full width; where the full frame is unknown, or smaller, of the image's."""
    W, H = native if native is not None else size
    K = Intrinsics(fx=share * W, fy=share * W, cx=W / 2, cy=H / 2, image_size=(W, H))
    return [way.intrinsics.fx for way in _usual(K, size, mode)] or [share * size[0]]
