"""Everything about a registry that a schema cannot say, found in one pass that nothing stops."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations, groupby
from types import MappingProxyType
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.contradictions import contradictions
from calibrary.registry.entry import UNSTATED, Entry, Status
from calibrary.registry.entry_form import PARAMETERS
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import (
    ROOT,
    SUFFIX,
    folder_of,
    in_use_path,
    is_proposal,
    match_key,
    path_of,
    scripts,
    slug,
    unit_folder,
)
from calibrary.registry.resolution import answering
from calibrary.validation import Finding, Severity, validate

__all__ = ["BOARD_BLOCK", "CheckReport", "check", "check_order"]

SENSOR_AGREEMENT: Final = 0.05
"""Between a principal distance and a nominal focal length lie some per cent; a wrong sensor is off by more."""
PITCH_AGREEMENT: Final = 0.02
STD_AGREEMENT: Final = 1e-3
SMALLEST_EIGENVALUE: Final = -1e-9
"""Of a correlation matrix, whose rounding lies far below."""


BOARD_BLOCK: Final = "x-board-calibration"
"""What a calibration from a board or a flight adds to its entry: its verdict, and how it was come by."""


class CheckReport(Struct, frozen=True, kw_only=True):
    """What a check found.

    Attributes:
        entries: how many were looked at.
        findings: in the order of their paths.
    """

    entries: int
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that keep the registry from being good."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    @property
    def is_good(self) -> bool:
        """Whether there are no errors; warnings are allowed."""
        return not self.errors


def check(
    entries: Mapping[str, bytes],
    policy: Policy,
    former: Mapping[str, Entry] = MappingProxyType({}),
    parse: Callable[[bytes, str], Entry] = parse_entry,
) -> CheckReport:
    """Hold every entry against the schema, its digest, its path, the policy, its camera, and every other entry.

    Args:
        entries: the bytes of each file by its path. Each is asked for once or twice, in the order of
            :func:`check_order`, so the mapping may read them when it is asked.
        policy: what is physically plausible.
        former: by path, what was in use before; of those whose change is checked.
        parse: reads an entry from its bytes and path, and raises InputError.
    """
    tree = _Tree(entries)
    findings = list(tree.names())
    for _, paths in groupby(sorted(entries, key=check_order), key=_folder):
        group = {}
        for path in paths:
            try:
                entry = parse(entries[path], path)
            except InputError as error:
                broken = "digest" if error.place == "digest" else "entry"
                findings.append(_finding(path, broken, str(error)))
                continue
            if is_proposal(path) and entry.status is not Status.DRAFT:
                message = f"is {entry.status.value} and lies among the proposals, expected a draft"
                findings.append(
                    _finding(path, "proposal", f"{message}; 'calibrary registry approve' puts it to use")
                )
                entry = replace(entry, status=Status.DRAFT)
            group[path] = entry
        for path, entry in group.items():
            for rule in _RULES:
                findings += rule(path, entry, policy)
            findings += tree.references(path, entry)
            findings += tree.labels(path, entry)
            # A proposal stands beside what it is to replace.
            before = former.get(in_use_path(path)) or (
                group.get(in_use_path(path)) if is_proposal(path) else None
            )
            findings += contradictions(path, entry, group, before, policy)
        findings += _overlaps(group)
        findings += _resolves_to_itself(group)
    findings += tree.shared_aliases()
    return CheckReport(entries=len(tree.paths), findings=tuple(sorted(findings, key=_place)))


def _place(finding: Finding) -> tuple[str, str, str]:
    return finding.place or "", finding.rule, finding.message


def _finding(path: str, rule: str, message: str, severity: Severity = Severity.ERROR) -> Finding:
    # Errors of reading name the file themselves.
    said = message.removeprefix(f"{path}: ")
    return Finding(rule=rule, severity=severity, place=path, message=said)


def _folder(path: str) -> str:
    return "/".join(in_use_path(path).split("/")[:3])


def check_order(path: str) -> tuple[str, str]:
    """A sort key: what is proposed for a model follows on what is in use."""
    return _folder(path), path


class _Tree:
    """What is asked across folders: the names of all entries, and what they are called besides."""

    def __init__(self, entries: Mapping[str, bytes]) -> None:
        self.entries = entries
        self.paths: Sequence[str] = sorted(entries)
        self._named: dict[tuple[str, str], dict[str, str]] = {}
        self._labels: dict[str, dict[str, str]] = {}
        self._units: dict[str, tuple[str, str]] = {}

    def names(self) -> Iterator[Finding]:
        """Paths that a file system without letter case takes for one."""
        seen: dict[str, str] = {}
        for path in self.paths:
            other = seen.setdefault(path.casefold(), path)
            if other != path:
                yield _finding(
                    path, "unique", f"differs from {other} only in letter case; remove one of them"
                )

    def references(self, path: str, entry: Entry) -> Iterator[Finding]:
        """What an entry says of others: the one it supersedes, and the names it claims."""
        if entry.supersedes is not None:
            yield from self._superseded(path, entry, entry.supersedes)
        camera = entry.calibration.camera
        own = folder_of(camera.make or "", camera.model or "")
        for alias in entry.aliases:
            folder = folder_of(alias.make, alias.model)
            name = f"{alias.make} {alias.model}"
            if folder == own:
                yield _finding(path, "alias", f"{name} is its own name, not an alias; remove it")
                continue
            at = bisect_left(self.paths, folder)
            if entry.is_usable and at < len(self.paths) and self.paths[at].startswith(folder):
                message = f"{name} has entries of its own, such as {self.paths[at]}; one camera has one name"
                yield _finding(path, "alias", message)
            if entry.is_usable:
                names = match_key(alias.make), match_key(alias.model)
                self._named.setdefault(names, {}).setdefault(own, path)

    @cached_property
    def _words(self) -> dict[str, str]:
        """Makes and models as KEYs have them, each with an entry of it."""
        return {word: path for path in self.paths for word in in_use_path(path).split("/")[1:3]}

    def labels(self, path: str, entry: Entry) -> Iterator[Finding]:
        """What else is called as this entry is: a unit has one label, and no other unit has it."""
        if entry.label is None:
            return
        unit = unit_folder(path) or in_use_path(path)
        if unit_folder(path) is None:
            message = f"{entry.label} is the label of one unit, and the entry is of every unit of its model"
            yield _finding(path, "label", f"{message}; state its serial number", Severity.WARNING)
        units = self._labels.setdefault(match_key(entry.label), {})
        units.setdefault(unit, path)
        first = next(iter(units))
        if first != unit:
            message = f"{entry.label} is the label of {units[first]} as well, of another unit"
            yield _finding(path, "label", f"{message}; 'calibrary registry label KEY OTHER' gives it another")
        label, other = self._units.setdefault(unit, (entry.label, path))
        if label != entry.label:
            message = f"its unit is {entry.label} here and {label} in {other}"
            yield _finding(
                path, "label", f"{message}; 'calibrary registry label KEY ONE' says one", Severity.WARNING
            )
        taken = self._words.get(slug(entry.label))
        if taken is not None:
            yield _finding(
                path, "label", f"{entry.label} names the cameras of {taken}; call the unit otherwise"
            )

    def _superseded(self, path: str, entry: Entry, target: str) -> Iterator[Finding]:
        there = f"{ROOT}{target}{SUFFIX}"
        if there == path:
            yield _finding(path, "supersedes", "it supersedes itself")
            return
        if there not in self.entries:
            yield _finding(path, "supersedes", f"it supersedes {target}, which does not exist")
            return
        try:
            other = parse_entry(self.entries[there], there)
        except InputError:
            return
        if entry.is_usable and other.is_usable:
            message = f"it supersedes {target}, which is still {other.status.value}; retire that one"
            yield _finding(path, "supersedes", message)

    def shared_aliases(self) -> Iterator[Finding]:
        """One name for two cameras."""
        for (make, model), owners in self._named.items():
            first, *others = owners.values()
            for path in others:
                yield _finding(
                    path, "alias", f"{make} {model} is an alias in {first} as well, of another camera"
                )


def _path(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    if entry.path != in_use_path(path):
        yield _finding(path, "path", f"its key gives {entry.path}; move it there, or correct the key")


def _provenance(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    if entry.is_usable and entry.calibration.provenance == UNSTATED:
        yield _finding(
            path, "provenance", f"{entry.status.value} without a provenance; state where K is from"
        )


def _plausible(path: str, entry: Entry, policy: Policy) -> Iterator[Finding]:
    """The policy's own rules. An entry is what knows its camera: it is not held to the band of unknown ones."""
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
        yield _finding(path, "sensor", message, Severity.WARNING)
    pixel_mm = sensor.width_mm / width if sensor.width_mm is not None else pitch_mm
    if pixel_mm is None or camera.focal_mm is None:
        return
    focal_mm = K.fx * pixel_mm
    if abs(focal_mm / camera.focal_mm - 1.0) > SENSOR_AGREEMENT:
        message = (
            f"fx = {K.fx:.1f} px on this sensor is {focal_mm:.2f} mm, {focal_mm / camera.focal_mm - 1.0:+.0%} from "
            f"the key's {camera.focal_mm:g} mm: a wrong sensor size, or a K of another lens"
        )
        yield _finding(path, "sensor", message, Severity.WARNING)


def _uncertainty(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    quality, lens = entry.calibration.quality, entry.calibration.distortion
    if quality is None:
        return
    known = {*PARAMETERS, *(lens.names() if lens is not None else ())}
    covariance = quality.covariance
    named = [*quality.std, *(covariance.names if covariance is not None else ())]
    if unknown := sorted({name for name in named if name not in known}):
        message = f"an uncertainty of {', '.join(unknown)}, which are not parameters of this calibration"
        yield _finding(path, "uncertainty", message)
    if covariance is None:
        return
    matrix = covariance.matrix
    spread = np.sqrt(np.diag(matrix))
    if (fault := _not_positive(matrix, spread)) is not None:
        yield _finding(path, "uncertainty", fault)
    for name, std in zip(covariance.names, spread.tolist(), strict=True):
        stated = quality.std.get(name)
        if stated is not None and abs(stated - std) > STD_AGREEMENT * max(stated, std):
            message = f"std of {name} is {stated:g}, and the covariance gives {std:g}"
            yield _finding(path, "uncertainty", message)


def _not_positive(matrix: FloatArray, spread: FloatArray) -> str | None:
    """A covariance has no direction with a negative variance."""
    scale = np.where(spread > 0, spread, 1.0)
    smallest = float(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0])
    if smallest >= SMALLEST_EIGENVALUE:
        return None
    return (
        f"the covariance is invalid: its correlations have the eigenvalue {smallest:.3g}, expected 0 or above"
    )


def _spelling(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    """A Cyrillic letter in a Latin name is equal to the eye and to nothing else."""
    camera = entry.calibration.camera
    for name, text in (("make", camera.make), ("model", camera.model)):
        if text and not text.isascii() and len(found := scripts(text)) > 1:
            message = f"the {name} {text!r} mixes {' and '.join(sorted(found)).title()} letters"
            yield _finding(path, "spelling", message, Severity.WARNING)


def _board(path: str, entry: Entry, _: Policy) -> Iterator[Finding]:
    """A calibration from a board says itself whether it may be used."""
    block = entry.extensions.get(BOARD_BLOCK)
    verdict = block.get("verdict") if isinstance(block, dict) else None
    if verdict is None or verdict == "pass" or not entry.is_usable:
        return
    reasons = block.get("reasons") if isinstance(block, dict) else None
    why = f" ({', '.join(map(str, reasons))})" if isinstance(reasons, list) and reasons else ""
    yield _finding(
        path,
        "board",
        f"its calibration ended {str(verdict).upper()}{why}, and only PASS may be used: photograph what the reasons "
        "ask for and calibrate again, or keep it a draft",
    )


_RULES: Final[tuple[Callable[[str, Entry, Policy], Iterator[Finding]], ...]] = (
    _path,
    _provenance,
    _plausible,
    _sensor,
    _uncertainty,
    _spelling,
    _board,
)


def _overlaps(group: Mapping[str, Entry]) -> Iterator[Finding]:
    """Entries of one camera whose ranges of firmware and whose days both overlap: neither is the one to take."""
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
                yield _finding(
                    path, "overlap", f"{error}, which is that of {other_path}; write both the same way"
                )
                continue
            if overlaps:
                message = f"{entry.firmware} overlaps {other.firmware} of {other_path}; end one where the other begins"
                yield _finding(path, "overlap", message)


def _resolves_to_itself(group: Mapping[str, Entry]) -> Iterator[Finding]:
    """An entry that its own key does not lead to is dead, or hides another entry."""
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
        found = answering(candidates, key, on=day)
    except RegistryError as error:
        yield _finding(path, "reachable", str(error))
        return
    if found != path:
        yield _finding(
            path,
            "reachable",
            f"its own camera resolves to {found or 'no entry'}; make the keys differ, or retire one",
        )
