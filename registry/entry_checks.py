"""Checks of entries: each alone, against what is known of its camera, and against the others.

A policy limits what any lens can be. What is known of a camera (catalogue, sensor, related entries, the K approved
before) limits what *this* camera can be. A deviation of a few percent may be due to the unit, the focus or a nominal
focal length, and is a warning. A larger one indicates the K of another camera or image size, a K in millimetres, or a
typing error: this is an error, which a person can override with a reason that is kept in the entry.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations, groupby
from types import MappingProxyType
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, CameraKey, ImageSize, Intrinsics
from calibrary.catalogue import Catalogue, shipped_catalogue
from calibrary.catalogue.sensor_widths import sensor_width
from calibrary.errors import FrameError, InputError, RegistryError
from calibrary.evidence.frame import adapt
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import same_aspect
from calibrary.known_camera import KnownCamera, match_key, normalise_sub_camera
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import PARAMETERS, UNSTATED, USUAL_TOLERANCE, Entry, Status, sealed
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import (
    ROOT,
    SUFFIX,
    folder_of,
    in_use_path,
    is_proposal,
    model_folder,
    path_of,
    scripts,
    slug,
    unit_folder,
)
from calibrary.registry.resolution import matching_path
from calibrary.validation import Finding, Severity, validate

__all__ = [
    "CONTRADICTIONS",
    "RULES",
    "check",
    "check_order",
    "contradictions",
    "finding_of",
    "in_order",
]


def in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings by path."""
    return tuple(sorted(findings, key=lambda one: (one.place or "", one.rule, one.message)))


def finding_of(path: str, rule: str, message: str, severity: Severity = Severity.ERROR) -> Finding:
    """Make a finding about a file; its path is removed from the start of the message."""
    said = message.removeprefix(f"{path}: ")
    return Finding(rule=rule, severity=severity, place=path, message=said)


SENSOR_AGREEMENT: Final = 0.05
"""Principal distance and nominal focal length differ by a few percent; a wrong sensor size by more."""
PITCH_AGREEMENT: Final = 0.02
STD_AGREEMENT: Final = 1e-3
SMALLEST_EIGENVALUE: Final = -1e-9
"""Limit for a correlation matrix; rounding errors are far smaller."""


def _path(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    if entry.path != in_use_path(path):
        yield finding_of(path, "path", f"its key gives {entry.path}; move it there, or correct the key")


def _provenance(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    if entry.is_usable and entry.calibration.provenance == UNSTATED:
        yield finding_of(
            path, "provenance", f"{entry.status.value} without a provenance; state where K is from"
        )


def _plausible(path: str, entry: Entry, policy: Policy) -> Iterator[Finding]:
    """Apply the policy's rules, except the range for unknown cameras, since the camera of an entry is known."""
    known, made = entry.calibration, entry.calibration.provenance
    if made.kind == "image-metadata":
        known = replace(known, provenance=replace(made, kind="registry"))
    for finding in validate(known, policy).findings:
        if finding.severity is Severity.PASS:
            continue
        is_error = finding.severity is Severity.ERROR and entry.is_usable
        yield replace(finding, severity=Severity.ERROR if is_error else Severity.WARNING, place=path)


def _sensor(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    sensor, K, camera = entry.sensor, entry.calibration.intrinsics, entry.calibration.camera
    if sensor is None:
        return
    width, height = K.image_size
    pitch_mm = sensor.pitch_um / 1000 if sensor.pitch_um is not None else None
    sides = ((sensor.width_mm, width, "width"), (sensor.height_mm, height, "height"))
    for side_mm, side_px, name in sides:
        if side_mm is None or pitch_mm is None or abs(pitch_mm * side_px / side_mm - 1.0) <= PITCH_AGREEMENT:
            continue
        message = (
            f"{side_px} pixels of {sensor.pitch_um:g} µm are {pitch_mm * side_px:.3f} mm, the sensor's {name} is "
            f"{side_mm:g} mm; the pitch is the frame's, after binning"
        )
        yield finding_of(path, "sensor", message, Severity.WARNING)
    pixel_mm = sensor.width_mm / width if sensor.width_mm is not None else pitch_mm
    if pixel_mm is None or camera.focal_mm is None:
        return
    focal_mm = K.fx * pixel_mm
    if abs(focal_mm / camera.focal_mm - 1.0) > SENSOR_AGREEMENT:
        message = (
            f"fx = {K.fx:.1f} px on this sensor is {focal_mm:.2f} mm, {focal_mm / camera.focal_mm - 1.0:+.0%} from "
            f"the key's {camera.focal_mm:g} mm: a wrong sensor size, or a K of another lens"
        )
        yield finding_of(path, "sensor", message, Severity.WARNING)


def _uncertainty(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    quality, lens = entry.calibration.quality, entry.calibration.distortion
    if quality is None:
        return
    known = {*PARAMETERS, *(lens.names() if lens is not None else ())}
    covariance = quality.covariance
    named = [*quality.std, *(covariance.names if covariance is not None else ())]
    if unknown := sorted({name for name in named if name not in known}):
        message = f"an uncertainty of {', '.join(unknown)}, which are not parameters of this calibration"
        yield finding_of(path, "uncertainty", message)
    if covariance is None:
        return
    matrix = covariance.matrix
    spread = np.sqrt(np.diag(matrix))
    if (fault := _not_positive(matrix, spread)) is not None:
        yield finding_of(path, "uncertainty", fault)
    for name, std in zip(covariance.names, spread.tolist(), strict=True):
        stated = quality.std.get(name)
        if stated is not None and abs(stated - std) > STD_AGREEMENT * max(stated, std):
            message = f"std of {name} is {stated:g}, and the covariance gives {std:g}"
            yield finding_of(path, "uncertainty", message)


def _not_positive(matrix: FloatArray, spread: FloatArray) -> str | None:
    """Return why a matrix is not a covariance (a negative variance in some direction); None if it is one."""
    scale = np.where(spread > 0, spread, 1.0)
    smallest = float(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0])
    if smallest >= SMALLEST_EIGENVALUE:
        return None
    return (
        f"the covariance is invalid: its correlations have the eigenvalue {smallest:.3g}, expected 0 or above"
    )


def _spelling(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    """Find mixed scripts: a Cyrillic letter in a Latin name looks the same but makes another name."""
    camera = entry.calibration.camera
    for name, text in (("make", camera.make), ("model", camera.model)):
        if text and not text.isascii() and len(found := scripts(text)) > 1:
            message = f"the {name} {text!r} mixes {' and '.join(sorted(found)).title()} letters"
            yield finding_of(path, "spelling", message, Severity.WARNING)


def _board(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    """Check the verdict sealed in a measured entry."""
    found = sealed(entry)
    if found is None or found.is_usable or not entry.is_usable:
        return
    yield finding_of(
        path,
        "board",
        f"{found}, so it is good for nothing: do what the reasons ask for and calibrate again, or keep it a draft",
    )


RULES: Final[tuple[Callable[[str, Entry, Policy], Iterator[Finding]], ...]] = (
    _path,
    _provenance,
    _plausible,
    _sensor,
    _uncertainty,
    _spelling,
    _board,
)


def check(
    entries: Mapping[str, bytes],
    policy: Policy,
    last_approved: Mapping[str, Entry] = MappingProxyType({}),
    parse: Callable[[bytes, str], Entry] = parse_entry,
) -> tuple[Finding, ...]:
    """Check every entry against the schema, its digest, its path, the policy, its camera, and the other entries.

    Args:
        entries: content of each file by path. Each is read once or twice, in the order of :func:`check_order`, so the
            mapping may load it on demand.
        policy: limits of plausibility.
        last_approved: usable entries before the checked change, by path.
        parse: reads an entry from its content and path, and raises InputError.
    """
    tree = _Tree(entries)
    findings = list(tree.names())
    for _, paths in groupby(sorted(entries, key=check_order), key=model_folder):
        group: dict[str, Entry] = {}
        for path in paths:
            findings += _read_into(group, path, entries[path], parse)
        for path, entry in group.items():
            for rule in RULES:
                findings += rule(path, entry, policy)
            findings += tree.references(path, entry)
            findings += tree.labels(path, entry)
            # Compare a proposal with the entry that it will replace.
            before = last_approved.get(in_use_path(path)) or (
                group.get(in_use_path(path)) if is_proposal(path) else None
            )
            findings += contradictions(path, entry, group, before, policy, shipped_catalogue())
        findings += _overlaps(group)
        findings += _resolves_to_itself(group)
    findings += tree.shared_aliases()
    return in_order(findings)


def _read_into(
    group: dict[str, Entry], path: str, data: bytes, parse: Callable[[bytes, str], Entry]
) -> Iterator[Finding]:
    """Read an entry into its group; a proposal is treated as a draft, whatever its status."""
    try:
        entry = parse(data, path)
    except InputError as error:
        yield finding_of(path, "digest" if error.place == "digest" else "entry", str(error))
        return
    if is_proposal(path) and entry.status is not Status.DRAFT:
        message = f"is {entry.status.value} and is among the proposals, expected a draft"
        yield finding_of(path, "proposal", f"{message}; 'calibrary registry approve' puts it to use")
        entry = replace(entry, status=Status.DRAFT)
    group[path] = entry


def check_order(path: str) -> tuple[str, str]:
    """Return the sort key of a path: the proposals for a model follow its usable entries."""
    return model_folder(path), path


class _Tree:
    """Data compared across folders: the paths, aliases and labels of all entries."""

    def __init__(self, entries: Mapping[str, bytes]) -> None:
        self.entries = entries
        self.paths: Sequence[str] = sorted(entries)
        self._named: dict[tuple[str, str], dict[str, str]] = {}
        self._labels: dict[str, dict[str, str]] = {}
        self._units: dict[str, tuple[str, str]] = {}

    def names(self) -> Iterator[Finding]:
        """Find paths that are identical on a file system that ignores letter case."""
        seen: dict[str, str] = {}
        for path in self.paths:
            other = seen.setdefault(path.casefold(), path)
            if other != path:
                yield finding_of(
                    path, "unique", f"differs from {other} only in letter case; remove one of them"
                )

    def references(self, path: str, entry: Entry) -> Iterator[Finding]:
        """Check the entry that one supersedes, and its aliases."""
        if entry.supersedes is not None:
            yield from self._superseded(path, entry, entry.supersedes)
        camera = entry.calibration.camera
        own = folder_of(camera.make or "", camera.model or "")
        for alias in entry.aliases:
            folder = folder_of(alias.make, alias.model)
            name = f"{alias.make} {alias.model}"
            if folder == own:
                yield finding_of(path, "alias", f"{name} is its own name, not an alias; remove it")
                continue
            at = bisect_left(self.paths, folder)
            if entry.is_usable and at < len(self.paths) and self.paths[at].startswith(folder):
                message = f"{name} has entries of its own, such as {self.paths[at]}; one camera has one name"
                yield finding_of(path, "alias", message)
            if entry.is_usable:
                names = match_key(alias.make), match_key(alias.model)
                self._named.setdefault(names, {}).setdefault(own, path)

    @cached_property
    def _words(self) -> dict[str, str]:
        """Map the makes and models in KEYs to the path of one of their entries."""
        return {word: path for path in self.paths for word in in_use_path(path).split("/")[1:3]}

    def labels(self, path: str, entry: Entry) -> Iterator[Finding]:
        """Check that a unit has one label, which no other unit has."""
        if entry.label is None:
            return
        unit = unit_folder(path) or in_use_path(path)
        if unit_folder(path) is None:
            message = f"{entry.label} is the label of one unit, and the entry is of every unit of its model"
            yield finding_of(path, "label", f"{message}; state its serial number", Severity.WARNING)
        units = self._labels.setdefault(match_key(entry.label), {})
        units.setdefault(unit, path)
        first = next(iter(units))
        if first != unit:
            message = f"{entry.label} is the label of {units[first]} as well, of another unit"
            yield finding_of(
                path, "label", f"{message}; 'calibrary registry set KEY label=OTHER' gives it another"
            )
        label, other = self._units.setdefault(unit, (entry.label, path))
        if label != entry.label:
            message = f"its unit is {entry.label} here and {label} in {other}"
            yield finding_of(
                path, "label", f"{message}; 'calibrary registry set KEY label=ONE' says one", Severity.WARNING
            )
        taken = self._words.get(slug(entry.label))
        if taken is not None:
            yield finding_of(
                path, "label", f"{entry.label} names the cameras of {taken}; call the unit otherwise"
            )

    def _superseded(self, path: str, entry: Entry, target: str) -> Iterator[Finding]:
        there = f"{ROOT}{target}{SUFFIX}"
        if there == path:
            yield finding_of(path, "supersedes", "it supersedes itself")
            return
        if there not in self.entries:
            yield finding_of(path, "supersedes", f"it supersedes {target}, which does not exist")
            return
        try:
            other = parse_entry(self.entries[there], there)
        except InputError:
            return
        if entry.is_usable and other.is_usable:
            message = f"it supersedes {target}, which is still {other.status.value}; retire that one"
            yield finding_of(path, "supersedes", message)

    def shared_aliases(self) -> Iterator[Finding]:
        """Find aliases that name two cameras."""
        for (make, model), owners in self._named.items():
            first, *others = owners.values()
            for path in others:
                yield finding_of(
                    path, "alias", f"{make} {model} is an alias in {first} as well, of another camera"
                )


def _overlaps(group: Mapping[str, Entry]) -> Iterator[Finding]:
    """Find entries of one camera with overlapping firmware ranges and days, between which the choice is undefined."""
    ranged = [
        (path, entry) for path, entry in group.items() if entry.is_usable and entry.firmware is not None
    ]
    ranged.sort(key=lambda item: path_of(item[1].calibration.camera))
    for _, alike in groupby(ranged, key=lambda item: path_of(item[1].calibration.camera)):
        for (path, entry), (other_path, other) in combinations(alike, 2):
            if entry.firmware is None or other.firmware is None:
                continue
            one, another = entry.validity, other.validity
            if one is not None and another is not None and not one.overlaps(another):
                continue
            try:
                overlaps = entry.firmware.overlaps(other.firmware)
            except InputError as error:
                yield finding_of(
                    path, "overlap", f"{error}, which is that of {other_path}; write both the same way"
                )
                continue
            if overlaps:
                message = f"{entry.firmware} overlaps {other.firmware} of {other_path}; end one where the other begins"
                yield finding_of(path, "overlap", message)


def _resolves_to_itself(group: Mapping[str, Entry]) -> Iterator[Finding]:
    """Find entries that their own key does not resolve to: they are unused, or hide another entry."""
    by_unit: dict[str | None, dict[str, Entry]] = {}
    for path, entry in group.items():
        serial = entry.calibration.camera.serial
        by_unit.setdefault(match_key(serial) if serial is not None else None, {})[path] = entry
    general = by_unit.get(None, {})
    for unit, entries in by_unit.items():
        candidates = {**general, **entries} if unit is not None else general
        for path, entry in entries.items():
            if entry.is_usable and entry.path == path:
                yield from _leads_home(path, entry, candidates)


def _leads_home(path: str, entry: Entry, candidates: Mapping[str, Entry]) -> Iterator[Finding]:
    firmware, validity = entry.firmware, entry.validity
    key: CameraKey = entry.calibration.camera
    if firmware is not None:
        key = replace(key, firmware=firmware.min or firmware.max)
    day = (validity.first or validity.last) if validity is not None else None
    try:
        found = matching_path(candidates, key, on=day)
    except RegistryError as error:
        yield finding_of(path, "reachable", str(error))
        return
    if found != path:
        yield finding_of(
            path,
            "reachable",
            f"its own camera resolves to {found or 'no entry'}; make the keys differ, or retire one",
        )


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
    usual = policy.known_camera_tolerance if policy.known_camera_tolerance is not None else USUAL_TOLERANCE
    known = _of_catalogue(entry.calibration, catalogue)
    listed = _by_sensor(entry) if not known else None
    # What is known of the camera besides K and the entries: with K it shows an entry wrong that it contradicts.
    witnesses = (listed[0],) if listed is not None else known
    found = [
        *_image_size(entry.calibration),
        *_catalogue(entry.calibration, known, usual),
        *(_focal_by_sensor(entry) if not known else ()),
        *_relatives(path, entry, entries, witnesses, usual),
        *(
            _against_last_approved(entry, last_approved, witnesses, usual)
            if last_approved is not None
            else ()
        ),
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


def _by_sensor(entry: Entry) -> tuple[_Range, float] | None:
    """The fx that follows from the key's focal length and a sensor width, and that width in mm for the image's."""
    c, camera = entry.calibration, entry.calibration.camera
    width, height = c.intrinsics.image_size
    if camera.focal_mm is None or camera.capture_mode is not None:
        return None
    stated = entry.sensor
    width_mm = stated.width_mm if stated is not None else None
    if stated is not None and width_mm is None and stated.pitch_um is not None:
        width_mm = stated.pitch_um / 1000 * width
    source = "the sensor that the entry states"
    if width_mm is None:
        listed = sensor_width(camera.make, camera.model)
        if listed is None:
            return None
        width_mm = listed.mm * width / max(width, height)
        source = f"the sensor width that {listed.source} list"
    fx = camera.focal_mm / width_mm * width
    return _Range(low=fx, high=fx, spread=0.0, source=source), width_mm


def _focal_by_sensor(entry: Entry) -> Iterator[_Contradiction]:
    """Check that fx times the pixel pitch is close to the nominal focal length."""
    found = _by_sensor(entry)
    if found is None:
        return
    c, camera = entry.calibration, entry.calibration.camera
    (width, height), (expected, width_mm) = c.intrinsics.image_size, found
    off = expected.off(c.intrinsics.fx)
    if abs(off) <= SENSOR_AGREEMENT:
        return
    message = (
        f"fx = {c.intrinsics.fx:.1f} px is {_off_by(off)} the key's {camera.focal_mm:g} mm by {expected.source} "
        f"({width_mm:.2f} mm for the image's width)"
    )
    if abs(off) <= SENSOR_CONTRADICTION:
        message += f", and lenses are within {SENSOR_AGREEMENT:.0%} of what is engraved"
        yield BY_SENSOR, Severity.WARNING, off, SENSOR_AGREEMENT, message
        return
    shape = max(width, height) / min(width, height)
    # Still images show the whole sensor; for video frames the shown part is unknown.
    is_sure = entry.sensor is not None or off < 0 or any(abs(shape / usual - 1.0) < 0.02 for usual in PHOTO)
    message += ": a 35 mm equivalent taken for the focal length, or another camera's K"
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
    return any(abs(one.off(fx)) <= max(USUAL_TOLERANCE, one.spread) for one in known)


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
