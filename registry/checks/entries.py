"""Checks of entries: each alone, against its camera, and against the others; all findings are collected."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations, groupby
from types import MappingProxyType

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.checks.findings import CheckReport, finding_of
from calibrary.registry.checks.rules import RULES
from calibrary.registry.contradictions import contradictions
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import (
    ROOT,
    SUFFIX,
    folder_of,
    in_use_path,
    is_proposal,
    match_key,
    model_folder,
    path_of,
    slug,
    unit_folder,
)
from calibrary.registry.resolution import answering
from calibrary.validation import Finding, Severity

__all__ = ["check", "check_order"]


def check(
    entries: Mapping[str, bytes],
    policy: Policy,
    former: Mapping[str, Entry] = MappingProxyType({}),
    parse: Callable[[bytes, str], Entry] = parse_entry,
) -> CheckReport:
    """Check every entry against the schema, its digest, its path, the policy, its camera, and the other entries.

    Args:
        entries: content of each file by path. Each is read once or twice, in the order of :func:`check_order`, so the
            mapping may load it on demand.
        policy: limits of plausibility.
        former: usable entries before the checked change, by path.
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
            before = former.get(in_use_path(path)) or (
                group.get(in_use_path(path)) if is_proposal(path) else None
            )
            findings += contradictions(path, entry, group, before, policy)
        findings += _overlaps(group)
        findings += _resolves_to_itself(group)
    findings += tree.shared_aliases()
    return CheckReport.of(len(tree.paths), findings)


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
                path, "label", f"{message}; 'calibrary registry label KEY OTHER' gives it another"
            )
        label, other = self._units.setdefault(unit, (entry.label, path))
        if label != entry.label:
            message = f"its unit is {entry.label} here and {label} in {other}"
            yield finding_of(
                path, "label", f"{message}; 'calibrary registry label KEY ONE' says one", Severity.WARNING
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
        found = answering(candidates, key, on=day)
    except RegistryError as error:
        yield finding_of(path, "reachable", str(error))
        return
    if found != path:
        yield finding_of(
            path,
            "reachable",
            f"its own camera resolves to {found or 'no entry'}; make the keys differ, or retire one",
        )
