"""Selection of the entry for a camera: the most specific usable one, with the reason for the choice.

An entry is matched with the camera: whether it applies, at which image size, and how specific it is.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import date
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Provenance, SourceFile
from calibrary.errors import AmbiguousEntryError, InputError, RegistryError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.readings import Reading, usual
from calibrary.image_size import same_aspect
from calibrary.known_camera import match_key, normalise_sub_camera
from calibrary.records import Record, replace
from calibrary.registry.entry import USABLE, Entry, Status, noted
from calibrary.registry.paths import UNIT, folder_of, id_of, slug

AliasMap: TypeAlias = Mapping[tuple[str, str], frozenset[str]]
"""Folders with entries that have an alias (make, model), by the alias as match keys."""

PROPOSED: Final = frozenset({Status.DRAFT})
MOST_NEAR: Final = 8
MOST_FOLDERS: Final = 2048
"""Number of folders whose entries are kept parsed."""


class OnlyProposed(Struct, frozen=True, kw_only=True):
    """What every reader says of a K that is proposed, in place of using it.

    Attributes:
        key: KEY of the entry.
        by: who proposed it; None in a plain folder.
        have: number of people whose approval counts.
        asked: number of approvals that the rules ask for; 0 if they are not known.
        digest: the file for ``approve --digest``; None in a plain folder.
    """

    key: str
    by: str | None = None
    have: int = 0
    asked: int = 0
    digest: str | None = None

    @property
    def lacks(self) -> str:
        """Who proposed it and what it lacks."""
        by = f" by {self.by}" if self.by is not None else ""
        said = f"proposed{by} and not approved, so not used"
        if not self.asked:
            return said
        lacking = max(self.asked - self.have, 0)
        return f"{said}: it lacks {lacking} of {self.asked} approval{'s' if self.asked != 1 else ''}"

    @property
    def command(self) -> str | None:
        """The command that approves it; None in a plain folder."""
        return f"calibrary registry approve {self.key} --digest {self.digest}" if self.digest else None

    def __str__(self) -> str:
        """Return the sentence for a terminal and a report."""
        said = f"{self.key} is {self.lacks}"
        return f"{said}; '{self.command}' approves it" if self.command is not None else said


class RejectedEntry(Record):
    """An entry that was not chosen, and the reason."""

    path: str
    reason: str


class Resolution(Struct, frozen=True, kw_only=True):
    """The entry chosen for a camera.

    Attributes:
        path: path of the entry.
        entry: the entry that is in force.
        calibration: calibration at the camera's image size; its provenance is the entry and the entry's source.
        why: reason for the choice, in words.
        near: other entries of the same make and model with the reason against each (only the first few).
        remark: of a proposal, who proposed it, what it lacks and what approves it; None of an entry in use.
        is_of_its_day: whether it is in force on the day that was asked for, and another one on others.
        layer: name of the registry with the entry, if several were searched.
        disagreements: contradictions by the registries later in the search order.
    """

    path: str
    entry: Entry
    calibration: Calibration
    why: str
    near: tuple[RejectedEntry, ...]
    remark: str | None = None
    is_of_its_day: bool = False
    layer: str | None = None
    disagreements: tuple[str, ...] = ()

    @property
    def stated(self) -> Calibration:
        """The entry's calibration at the image size at which it was measured; its provenance is the entry."""
        own = noted(self.entry)
        K = own.intrinsics
        # Of its own unit alone, whichever unit asks.
        camera = replace(self.calibration.camera, image_size=K.image_size, serial=own.camera.serial)
        return replace(own, camera=camera, provenance=_behind(self.path, own, Reading(intrinsics=K)))


def resolve(
    entries: Mapping[str, Entry],
    key: CameraKey,
    *,
    on: date | None = None,
    statuses: Collection[Status] = USABLE,
) -> Resolution | None:
    """Find the most specific entry for a camera, converted to its image size.

    A field that an entry does not state matches every camera. Among the matching entries, one for this unit comes
    before one for its firmware, its lens or focal length, its sub-camera, its model; then the closest image size, and
    the closest focal length.

    Args:
        entries: entries by path.
        key: the camera, as far as it is known; without an image size, entries keep their own.
        on: day on which the entry must be valid; None ignores the validity.
        statuses: allowed statuses; by default only those of usable entries.

    Raises:
        AmbiguousEntryError: two entries match equally well; the message names them.
    """
    fits, misses = _matches_and_misses(entries, key, on, statuses)
    best = _best(fits, key)
    if best is None:
        return None
    less = [
        RejectedEntry(path=other.path, reason=f"it matches, and is less specific: {_words(other)}")
        for other in fits[1:]
    ]
    return Resolution(
        path=best.path,
        entry=best.entry,
        calibration=best.calibration(key),
        why=_why(best, len(less)),
        near=(*less, *misses)[:MOST_NEAR],
    )


def matching_path(entries: Mapping[str, Entry], key: CameraKey, *, on: date | None = None) -> str | None:
    """Return only the path of the entry that :func:`resolve` finds.

    Raises:
        AmbiguousEntryError: two entries match equally well.
    """
    best = _best(_matches_and_misses(entries, key, on, USABLE)[0], key)
    return best.path if best is not None else None


def near(
    entries: Mapping[str, Entry],
    key: CameraKey,
    *,
    on: date | None = None,
    statuses: Collection[Status] = USABLE,
) -> tuple[RejectedEntry, ...]:
    """Return the first few entries of a camera's make and model that do not match, with the reason."""
    return tuple(_matches_and_misses(entries, key, on, statuses)[1][:MOST_NEAR])


Choices: TypeAlias = Mapping[str, Sequence[Entry]]
"""What is in force of entries on any day, first that of no particular one, and what is proposed last; by path."""


class RegistryIndex:
    """A registry's entries, found by make and model through their paths: only candidates are read.

    An entry at a path other than that of its key is not found; reporting this is the task of
    :mod:`calibrary.registry.checks`.
    """

    def __init__(
        self,
        paths: Iterable[str],
        load: Callable[[str], Iterable[Entry]],
        *,
        aliases: Callable[[], AliasMap] | None = None,
        prepare: Callable[[Sequence[str]], object] | None = None,
        unapproved: Callable[[str], str] | None = None,
    ) -> None:
        """List a registry, without reading any entry.

        Args:
            paths: paths of all entries, from the registry's root.
            load: returns what is in force of an entry on any day, first that of no particular one, and what is
                proposed last.
            aliases: returns the folders of entries by their aliases, if available faster; otherwise all entries are
                read when none matches a camera by its own name.
            prepare: called with the paths that will be loaded next.
            unapproved: returns what is to say of what is only proposed.
        """
        self.paths: Final[Sequence[str]] = sorted(paths)
        self._load = load
        self._prepare = prepare
        self._unapproved = unapproved or (lambda path: str(OnlyProposed(key=id_of(path))))
        self._find_aliases = aliases
        self._aliases: AliasMap | None = None
        self._folders: dict[tuple[str, ...], Choices] = {}

    def resolve(
        self, key: CameraKey, *, on: date | None = None, statuses: Collection[Status] = USABLE
    ) -> Resolution | None:
        """Find the most specific entry for a camera; see :func:`resolve`.

        Raises:
            AmbiguousEntryError: two entries match equally well.
            RegistryError: a candidate cannot be read.
        """
        for candidates in (self._by_name, self._by_alias):
            choices = candidates(key)
            found = resolve(_on(choices, on, statuses), key, on=on, statuses=statuses)
            if found is None:
                continue
            if on is None or found.entry is choices[found.path][0] or not found.entry.is_usable:
                return found
            why = f"{found.why}; by what was approved for the days {found.entry.validity}"
            return replace(found, is_of_its_day=True, why=why)
        return None

    def proposed_for(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        """Return the proposal that would be used for a camera if it were approved; None for none, or for several."""
        with suppress(RegistryError):
            found = self.resolve(key, on=on, statuses=PROPOSED)
            if found is not None:
                return replace(found, remark=self._unapproved(found.path))
        return None

    def is_dated(self, key: CameraKey) -> bool:
        """Return whether the result for a camera may depend on the day."""
        choices = self._by_name(key) or self._by_alias(key)
        return any(one.validity is not None for entries in choices.values() for one in entries)

    def near(
        self, key: CameraKey, *, on: date | None = None, statuses: Collection[Status] = USABLE
    ) -> tuple[RejectedEntry, ...]:
        """Return the entries of the camera's make and model that do not match, with the reason.

        Raises:
            RegistryError: an entry cannot be read.
        """
        choices = {**self._by_name(key), **self._by_alias(key)}
        found = near(_on(choices, on, statuses), key, on=on, statuses=statuses)
        return tuple(
            replace(one, reason=self._unapproved(one.path)) if one.reason == ONLY_PROPOSED else one
            for one in found
        )

    def candidates(self, key: CameraKey) -> Mapping[str, Entry]:
        """Return the entries of a make and model, without those of other units.

        Raises:
            RegistryError: an entry cannot be read.
        """
        return {path: entries[0] for path, entries in self._by_name(key).items()}

    def _by_name(self, key: CameraKey) -> Choices:
        if not key.make or not key.model:
            return {}
        return self._parsed((folder_of(key.make, key.model),), key.serial)

    def _by_alias(self, key: CameraKey) -> Choices:
        if not key.make or not key.model:
            return {}
        if self._aliases is None:
            self._aliases = (self._find_aliases or self._scan)()
        folders = self._aliases.get((match_key(key.make), match_key(key.model)), frozenset())
        return self._parsed(tuple(sorted(folders)), key.serial) if folders else {}

    def _scan(self) -> AliasMap:
        found: dict[tuple[str, str], set[str]] = {}
        for path in self.paths:
            with suppress(RegistryError):
                for alias in (alias for entry in self._load(path) for alias in entry.aliases):
                    folder = path.rpartition(f"/{UNIT}")[0] or path.rpartition("/")[0]
                    found.setdefault((match_key(alias.make), match_key(alias.model)), set()).add(f"{folder}/")
        return {name: frozenset(folders) for name, folders in found.items()}

    def _parsed(self, folders: tuple[str, ...], serial: str | None) -> Choices:
        at = (*folders, slug(serial) if serial is not None else "")
        choices = self._folders.get(at)
        if choices is None:
            if len(self._folders) >= MOST_FOLDERS:
                self._folders.clear()
            paths = [path for folder in folders for path in self._in_folder(folder, serial)]
            if self._prepare is not None:
                self._prepare(paths)
            read = {path: tuple(self._load(path)) for path in paths}
            choices = self._folders[at] = {path: entries for path, entries in read.items() if entries}
        return choices

    def _in_folder(self, folder: str, serial: str | None) -> list[str]:
        # File names start with a digit and folders of units with a letter, so the files come first.
        folders = [folder, *([f"{folder}{UNIT}{slug(serial)}/"] if serial is not None else [])]
        return [path for one in folders for path in _between(self.paths, one)]


def _on(choices: Choices, day: date | None, statuses: Collection[Status]) -> Mapping[str, Entry]:
    """Return of each entry what counts on a day, else what says best why nothing does."""
    found = {}
    for path, entries in choices.items():
        asked = [one for one in entries if one.status in statuses]
        there = [one for one in asked if day is None or one.validity is None or one.validity.holds(day)]
        found[path] = (there or asked or sorted(entries, key=lambda one: one.status is not Status.DRAFT))[0]
    return found


def _between(paths: Sequence[str], folder: str) -> Sequence[str]:
    """Return the files directly in a folder."""
    # ":" follows "9", and the names of files start with a digit, so this ends before the folders of units.
    return paths[bisect_left(paths, folder) : bisect_left(paths, f"{folder}:")]


def _matches_and_misses(
    entries: Mapping[str, Entry], key: CameraKey, on: date | None, statuses: Collection[Status]
) -> tuple[list[EntryMatch], list[RejectedEntry]]:
    """Return the matching entries, most specific first, and the others with the reason."""
    fits, misses = [], []
    for path, entry in entries.items():
        outcome = match_entry(path, entry, key, on, statuses)
        if isinstance(outcome, EntryMatch):
            fits.append(outcome)
        elif outcome is not None:
            misses.append(RejectedEntry(path=path, reason=outcome))
    # List proposals that would match first.
    misses.sort(key=lambda miss: miss.reason != ONLY_PROPOSED)
    return sorted(fits, key=lambda found: (found.rank, found.path)), misses


def _best(fits: Sequence[EntryMatch], key: CameraKey) -> EntryMatch | None:
    if not fits:
        return None
    best, *others = fits
    alike = [other.path for other in others if other.rank == best.rank]
    if alike:
        raise AmbiguousEntryError(
            f"{len(alike) + 1} entries match {key} equally well: {', '.join([best.path, *alike][:MOST_NEAR])}; retire "
            "all but one, or state in each what it applies to"
        )
    return best


def _words(found: EntryMatch) -> str:
    return ", ".join(found.states) or "its model only"


def _why(found: EntryMatch, others: int) -> str:
    camera = found.entry.calibration.camera
    text = f"{found.path} is of {_words(found)}" if found.states else f"{found.path} is of this model"
    if found.alias:
        text += f"; it is of {camera.make} {camera.model}, of which this is an alias"
    if others:
        text += f"; {others} more match and are less specific"
    return text


FOCAL_TOLERANCE: Final = 0.02
"""Cameras round the focal length that they write, and zoom lenses do not stop exactly at the same position."""

ONLY_PROPOSED: Final = "it is only a proposal, which nothing uses before it is approved"

Rank = tuple[float, ...]


class EntryMatch(Struct, frozen=True, kw_only=True):
    """An entry that applies to a camera.

    Attributes:
        path: path of the entry.
        entry: the entry, as in its file.
        adapted: its K at the camera's image size.
        states: properties of the camera that it states and another entry might not.
        alias: whether the camera has another name in this entry.
        rank: sort key, the most specific first.
    """

    path: str
    entry: Entry
    adapted: Reading
    states: tuple[str, ...]
    alias: bool
    rank: Rank

    def calibration(self, key: CameraKey) -> Calibration:
        """Return the entry's calibration for the camera; the provenance is the entry and its source."""
        calibration, adapted = noted(self.entry), self.adapted
        quality, (width, height) = calibration.quality, calibration.intrinsics.image_size
        size = adapted.intrinsics.image_size
        if quality is not None and adapted.steps and same_aspect((width, height), size):
            quality = quality.scaled(size[0] / width, size[1] / height)
        return replace(
            calibration,
            camera=replace(key, image_size=size),
            intrinsics=adapted.intrinsics,
            quality=quality,
            provenance=_behind(self.path, calibration, adapted),
        )


def match_entry(
    path: str, entry: Entry, key: CameraKey, on: date | None, statuses: Collection[Status]
) -> EntryMatch | str | None:
    """Match an entry with a camera; return the reason if it does not apply, None for another make or model.

    A field that the entry does not state matches every camera. A stated field must be known of the camera and equal,
    except for the focal length: an unknown one is accepted.
    """
    if not _is_of(entry, key):
        return None
    for rule in _RULES:
        if (reason := rule(entry, key)) is not None:
            return reason
    if entry.status not in statuses:
        if entry.status is Status.DRAFT:
            return ONLY_PROPOSED
        return f"it is {entry.status.value}" + (f": {entry.reason}" if entry.reason else "")
    if on is not None and entry.validity is not None and not entry.validity.holds(on):
        return f"it is valid {entry.validity}, not on {on}"
    K = entry.calibration.intrinsics
    try:
        adapted = usual(K, ImageMetadata(size=key.image_size or K.image_size))
    except InputError as error:
        return error.message
    return EntryMatch(
        path=path,
        entry=entry,
        adapted=adapted,
        states=_states(entry),
        alias=not _same(entry.calibration.camera.model, key.model)
        or not _same(entry.calibration.camera.make, key.make),
        rank=_rank(entry, key),
    )


def _is_of(entry: Entry, key: CameraKey) -> bool:
    camera = entry.calibration.camera
    names = [(camera.make, camera.model), *((alias.make, alias.model) for alias in entry.aliases)]
    return any(_same(make, key.make) and _same(model, key.model) for make, model in names)


def _unit(entry: Entry, key: CameraKey) -> str | None:
    serial = entry.calibration.camera.serial
    if serial is None or _same(serial, key.serial):
        return None
    return "it is of one unit, and the camera's serial number is " + (
        "not known" if key.serial is None else "another"
    )


def _firmware(entry: Entry, key: CameraKey) -> str | None:
    if entry.firmware is None:
        return None
    if key.firmware is None:
        return f"it is of {entry.firmware}, and the camera's is not known"
    try:
        holds = entry.firmware.holds(key.firmware)
    except InputError as error:
        return error.message
    return None if holds else f"it is of {entry.firmware}, not {key.firmware}"


def _focal(entry: Entry, key: CameraKey) -> str | None:
    stated, seen = entry.calibration.camera.focal_mm, key.focal_mm
    if stated is None or seen is None or abs(seen / stated - 1.0) <= FOCAL_TOLERANCE:
        return None
    return f"it is of {stated:g} mm, not {seen:g} mm"


def _sub_camera(entry: Entry, key: CameraKey) -> str | None:
    stated, seen = entry.calibration.camera.sub_camera, key.sub_camera
    if stated is None or (seen is not None and _sub_camera_key(stated) == _sub_camera_key(seen)):
        return None
    return f"it is of the {stated} camera" + (
        ", and the image's sub-camera is not known" if seen is None else ""
    )


def _lens(entry: Entry, key: CameraKey) -> str | None:
    stated = entry.calibration.camera.lens
    if stated is None or _same(stated, key.lens):
        return None
    return f"it is of the lens {stated}" + (", and the lens is not known" if key.lens is None else "")


def _mode(entry: Entry, key: CameraKey) -> str | None:
    # An image processed by the camera (dewarped, zoomed) is of another camera unless the entry states the same mode.
    stated, seen = entry.calibration.camera.capture_mode, key.capture_mode
    if stated is None and seen is None:
        return None
    if stated is not None and _same(stated, seen):
        return None
    return (
        f"it is of images without a capture mode, not {seen}"
        if stated is None
        else f"it is of {stated} images"
    )


_RULES: Final[tuple[Callable[[Entry, CameraKey], str | None], ...]] = (
    _unit,
    _firmware,
    _lens,
    _focal,
    _sub_camera,
    _mode,
)


def _rank(entry: Entry, key: CameraKey) -> Rank:
    """Return the rank: serial, firmware, lens, focal length, sub-camera; then similarity of size, then focal length."""
    camera = entry.calibration.camera
    compared = camera.focal_mm is not None and key.focal_mm is not None
    stated = (
        camera.serial is not None,
        entry.firmware is not None,
        camera.lens is not None,
        compared,
        camera.sub_camera is not None,
    )
    apart = (
        abs(math.log(key.focal_mm / camera.focal_mm))
        if compared and key.focal_mm and camera.focal_mm
        else 0.0
    )
    return (
        *(not is_stated for is_stated in stated),
        *_frame_rank(camera, key),
        camera.focal_mm is not None,
        apart,
    )


def _frame_rank(camera: CameraKey, key: CameraKey) -> tuple[float, float]:
    """Return the rank of the image size: the same, resized (the less the better), then a crop."""
    if camera.image_size is None or key.image_size is None or camera.image_size == key.image_size:
        return 0, 0.0
    scale = abs(math.log(key.image_size[0] / camera.image_size[0]))
    return (1, scale) if same_aspect(camera.image_size, key.image_size) else (2, scale)


def _states(entry: Entry) -> tuple[str, ...]:
    camera = entry.calibration.camera
    said = (
        "this unit" if camera.serial is not None else None,
        str(entry.firmware) if entry.firmware is not None else None,
        f"the lens {camera.lens}" if camera.lens is not None else None,
        f"{camera.focal_mm:g} mm" if camera.focal_mm is not None else None,
        f"the {camera.sub_camera} camera" if camera.sub_camera is not None else None,
        f"{camera.capture_mode} frames" if camera.capture_mode is not None else None,
    )
    return tuple(text for text in said if text is not None)


def _behind(path: str, own: Calibration, adapted: Reading) -> Provenance:
    """Return the provenance: the entry, with what it states about its own origin."""
    made, files = own.provenance, own.provenance.sources
    if not files and made.source is not None and made.sha256 is not None:
        files = (SourceFile(name=made.source, sha256=made.sha256),)
    stated = (made.kind, made.source, made.tag)
    return replace(
        made,
        kind="registry",
        source=path,
        tag=" ".join(text for text in stated if text is not None),
        reference_size=own.intrinsics.image_size,
        adaptation="; ".join(text for text in (made.adaptation, *adapted.steps) if text) or None,
        assumptions=(*made.assumptions, *adapted.assumes),
        sha256=None,
        sources=files,
    )


def _same(stated: str | None, seen: str | None) -> bool:
    return stated is not None and seen is not None and match_key(stated) == match_key(seen)


def _sub_camera_key(text: str) -> str:
    return normalise_sub_camera(text) or match_key(text)
