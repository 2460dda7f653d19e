"""Checks of entries: each alone, and against the others.

Whether a K can be that of its camera is not told here: what is known of a camera is weighed by ``judge``, which callers
pass in, because it takes more than the registry.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import combinations, groupby
from types import MappingProxyType
from typing import Final

from msgspec import Struct

from calibrary.arrays import FloatArray, np
from calibrary.calibration import CameraKey
from calibrary.catalogue import as_written
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import match_key
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.entry import PARAMETERS, UNSTATED, Alias, Entry, Status, sealed
from calibrary.registry.paths import (
    ROOT,
    SUFFIX,
    file_path,
    folder_of,
    is_proposal,
    model_folder,
    path_of,
    scripts,
    slug,
    unit_folder,
)
from calibrary.registry.resolution import matching_path
from calibrary.validation import Finding, Severity, validate


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
    if entry.path != file_path(path):
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
    """Find mixed scripts: a Cyrillic letter in a Latin name looks the same but makes another name.

    And a unit's make in other letters than images have it, which may be part of its serial number's hash.
    """
    camera = entry.calibration.camera
    for name, text in (("make", camera.make), ("model", camera.model)):
        if text and not text.isascii() and len(found := scripts(text)) > 1:
            message = f"the {name} {text!r} mixes {' and '.join(sorted(found)).title()} letters"
            yield finding_of(path, "spelling", message, Severity.WARNING)
    if camera.serial and camera.make and (written := as_written(camera.make)) != camera.make:
        message = f"the make is {camera.make!r}, and {written!r} in images: if its serial number was hashed with that, "
        message += "neither they nor --serial find it; then add it again with --serial, and retire this one"
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


Judge = Callable[[str, Entry, Mapping[str, Entry], Entry | None, Policy], Iterable[Finding]]
"""Weighs the K of an entry, given its path, all entries of its model by path, and the one approved before it."""


class Naming(Struct, frozen=True):
    """What an entry says that is compared with entries of other models.

    Attributes:
        path: path of the entry.
        folder: folder of its model, by its key.
        status, label, aliases, supersedes: as in the entry.
    """

    path: str
    folder: str
    status: Status
    label: str | None
    aliases: tuple[Alias, ...]
    supersedes: str | None


def check(
    entries: Mapping[str, Entry],
    policy: Policy,
    last_approved: Mapping[str, Entry] = MappingProxyType({}),
    judge: Judge | None = None,
) -> tuple[Finding, ...]:
    """Check every entry against its path, the policy, its camera, and the other entries.

    Args:
        entries: what is in force by its path, and what is proposed by its name. Each is read once or twice, in the
            order of :func:`check_order`, so the mapping may load it on demand; one that raises InputError is left out.
        policy: limits of plausibility.
        last_approved: usable entries before the checked change, by path.
        judge: weighs K against what is known of its camera; None leaves that out.
    """
    tree = _Tree(entries)
    findings: list[Finding] = []
    for _, names in groupby(sorted(entries, key=check_order), key=model_folder):
        group = dict[str, Entry]()
        for name in names:
            with suppress(InputError):
                group[name] = entries[name]
        findings += _of_model(group, policy, last_approved, judge)
        for naming in _namings(group):
            findings += tree.references(naming)
            findings += tree.labels(naming)
    findings += tree.shared_aliases()
    return in_order(replace(one, place=file_path(one.place or "")) for one in findings)


def _namings(group: Mapping[str, Entry]) -> Iterator[Naming]:
    for path, one in group.items():
        if one.label is not None or one.aliases or one.supersedes is not None:
            camera = one.calibration.camera
            folder = folder_of(camera.make or "", camera.model or "")
            yield Naming(path, folder, one.status, one.label, one.aliases, one.supersedes)


def _of_model(
    group: Mapping[str, Entry], policy: Policy, last_approved: Mapping[str, Entry], judge: Judge | None
) -> Iterator[Finding]:
    """Check the entries of one model, each and against one another."""
    for path, entry in group.items():
        for rule in RULES:
            yield from rule(path, entry, policy)
        if judge is not None:
            # Compare a proposal with the entry that it will replace.
            there = group.get(file_path(path)) if is_proposal(path) else None
            yield from judge(path, entry, group, last_approved.get(file_path(path)) or there, policy)
    yield from _overlaps(group)
    yield from _resolves_to_itself(group)


def check_order(path: str) -> tuple[str, str]:
    """Return the sort key of a name: by model."""
    return model_folder(path), path


class _Tree:
    """Data compared across folders: the paths, aliases and labels of all entries."""

    def __init__(self, entries: Mapping[str, Entry]) -> None:
        self.entries = entries
        self.paths: Sequence[str] = sorted(entries)
        self._named: dict[tuple[str, str], dict[str, str]] = {}
        self._labels: dict[str, dict[str, str]] = {}
        self._units: dict[str, tuple[str, str]] = {}

    def references(self, entry: Naming) -> Iterator[Finding]:
        """Check the entry that one supersedes, and its aliases."""
        path, own, is_usable = entry.path, entry.folder, entry.status.is_usable
        if entry.supersedes is not None:
            yield from self._superseded(entry, entry.supersedes)
        for alias in entry.aliases:
            folder = folder_of(alias.make, alias.model)
            name = f"{alias.make} {alias.model}"
            if folder == own:
                yield finding_of(path, "alias", f"{name} is its own name, not an alias; remove it")
                continue
            at = bisect_left(self.paths, folder)
            if is_usable and at < len(self.paths) and self.paths[at].startswith(folder):
                message = f"{name} has entries of its own, such as {self.paths[at]}; one camera has one name"
                yield finding_of(path, "alias", message)
            if is_usable:
                names = match_key(alias.make), match_key(alias.model)
                self._named.setdefault(names, {}).setdefault(own, path)

    @cached_property
    def _words(self) -> dict[str, str]:
        """Map the makes and models in KEYs to the path of one of their entries."""
        return {word: path for path in self.paths for word in path.split("/")[1:3]}

    def labels(self, entry: Naming) -> Iterator[Finding]:
        """Check that a unit has one label, which no other unit has."""
        path = entry.path
        if entry.label is None:
            return
        unit = unit_folder(path) or file_path(path)
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

    def _superseded(self, entry: Naming, target: str) -> Iterator[Finding]:
        path, there = entry.path, f"{ROOT}{target}{SUFFIX}"
        if there == path:
            yield finding_of(path, "supersedes", "it supersedes itself")
            return
        if there not in self.entries:
            yield finding_of(path, "supersedes", f"it supersedes {target}, which does not exist")
            return
        try:
            other = self.entries[there]
        except InputError:
            return
        if entry.status.is_usable and other.is_usable:
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
