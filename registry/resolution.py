"""Which entry is used for a camera: the most specific one that may be used, and the reason for the choice."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from datetime import date
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import AmbiguousEntryError, InputError, RegistryError
from calibrary.records import Record, replace
from calibrary.registry.entry import USABLE, Entry, Status
from calibrary.registry.entry_match import ONLY_PROPOSED, EntryMatch, match_entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import (
    ROOT,
    SUFFIX,
    folder_of,
    is_entry,
    is_proposal,
    match_key,
    proposal_path,
    slug,
)

__all__ = [
    "AliasMap",
    "Earlier",
    "RegistryIndex",
    "RejectedEntry",
    "Resolution",
    "answering",
    "is_keyed",
    "near",
    "resolve",
    "scan_aliases",
]

Earlier: TypeAlias = Callable[[str], Iterable[tuple[str, Entry]]]
"""Gives the commit and content of an entry's earlier revisions that were in use, newest first, by its path."""
AliasMap: TypeAlias = Mapping[tuple[str, str], frozenset[str]]
"""The folders whose entries go by another (make, model), both as match keys."""

MOST_NEAR: Final = 8
MOST_FOLDERS: Final = 2048
"""Folders whose entries are kept parsed."""

_REGULAR = re.compile(rf"{ROOT}[^/]+/[^/]+/(?:sn-[^/]+/)?[0-9][^/]*{re.escape(SUFFIX)}")


class RejectedEntry(Record):
    """An entry that was not used, and the reason."""

    path: str
    reason: str


class Resolution(Struct, frozen=True, kw_only=True):
    """The entry that is used for a camera.

    Attributes:
        path: of the entry.
        entry: as its file says it.
        calibration: at the camera's image size, its provenance the entry and the entry's own source.
        why: the reason for the choice, in words.
        near: other entries of the same make and model with the reason against each; the first few.
        revision: the commit of an earlier revision, where that is the one for the day; None for what is in use now.
        layer: name of the registry that answers, where it was asked for as one of several.
        disagreements: what registries that are asked after that one say against the answer.
    """

    path: str
    entry: Entry
    calibration: Calibration
    why: str
    near: tuple[RejectedEntry, ...]
    revision: str | None = None
    layer: str | None = None
    disagreements: tuple[str, ...] = ()


def resolve(
    entries: Mapping[str, Entry],
    key: CameraKey,
    *,
    on: date | None = None,
    statuses: Collection[Status] = USABLE,
) -> Resolution | None:
    """The most specific entry for a camera, brought to its image size.

    A field that an entry leaves out fits every camera. Of the entries that fit, one for this unit comes before
    one for its firmware, its lens or focal length, its sub-camera, its model; then the nearest frame, and the
    nearest focal length.

    Args:
        entries: by path.
        key: the camera, as far as it is known; without an image size entries stay at their own.
        on: the day it is for; None asks nothing of an entry's validity.
        statuses: of the entries that may be taken; drafts and retired ones only where they are asked for.

    Raises:
        AmbiguousEntryError: two entries fit equally well; the message names them.
    """
    fits, misses = _sorted_out(entries, key, on, statuses)
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


def answering(entries: Mapping[str, Entry], key: CameraKey, *, on: date | None = None) -> str | None:
    """The path of the entry that :func:`resolve` finds, for those who want no more of it.

    Raises:
        AmbiguousEntryError: two entries fit equally well.
    """
    best = _best(_sorted_out(entries, key, on, USABLE)[0], key)
    return best.path if best is not None else None


def near(
    entries: Mapping[str, Entry],
    key: CameraKey,
    *,
    on: date | None = None,
    statuses: Collection[Status] = USABLE,
) -> tuple[RejectedEntry, ...]:
    """The entries of a camera's make and model that do not fit it, and why not; the first few."""
    return tuple(_sorted_out(entries, key, on, statuses)[1][:MOST_NEAR])


def scan_aliases(files: Iterable[tuple[str, bytes]]) -> AliasMap:
    """What else the cameras of a registry are called; files that cannot be read name none.

    Args:
        files: path and bytes of every entry; only those that hold the word are parsed.
    """
    found: dict[tuple[str, str], set[str]] = {}
    for path, data in files:
        if b"aliases" not in data:
            continue
        try:
            entry = parse_entry(data, path, require_digest=False)
        except InputError:
            continue
        camera = entry.calibration.camera
        folder = folder_of(camera.make or "", camera.model or "")
        for alias in entry.aliases:
            found.setdefault((match_key(alias.make), match_key(alias.model)), set()).add(folder)
    return {name: frozenset(folders) for name, folders in found.items()}


def is_keyed(path: str) -> bool:
    """Whether some camera's key gives a path, so that whoever asks for that camera looks there."""
    return _REGULAR.fullmatch(path) is not None


class RegistryIndex:
    """A registry's entries, found by make and model through their paths: only candidates are read.

    An entry that does not lie where its key says is found only if its path is one that no key gives; saying so
    is for :mod:`calibrary.registry.checks`. A file beside them of another kind, a README, is none.
    """

    def __init__(
        self,
        paths: Iterable[str],
        load: Callable[[str], bytes],
        *,
        proposed: Iterable[str] = (),
        aliases: Callable[[], AliasMap] | None = None,
        earlier: Earlier | None = None,
        require_digest: bool = True,
    ) -> None:
        """List a registry; nothing is read yet.

        Args:
            paths: of all entries, from the registry's root.
            load: gives the bytes of one.
            proposed: paths of what is proposed beside them, which is drafts whatever it says of itself.
            aliases: gives :func:`scan_aliases` of all entries, for those who have it at hand; else every entry
                is looked through when a camera is asked for that no entry fits by its own name.
            earlier: gives the commit and content of an entry's earlier revisions that were in use, newest first.
            require_digest: refuse entries without a digest.
        """
        self.paths: Final[Sequence[str]] = sorted(paths)
        self.proposed: Final[Sequence[str]] = sorted(filter(is_entry, proposed))
        self._load = load
        self._earlier = earlier
        self._require_digest = require_digest
        self._find_aliases = aliases
        self._aliases: AliasMap | None = None
        self._irregular = [path for path in self.paths if is_entry(path) and not is_keyed(path)]
        self._folders: dict[tuple[str, ...], Mapping[str, Entry]] = {}

    def resolve(
        self, key: CameraKey, *, on: date | None = None, statuses: Collection[Status] = USABLE
    ) -> Resolution | None:
        """The most specific entry for a camera; see :func:`resolve`.

        Raises:
            AmbiguousEntryError: two entries fit equally well.
            RegistryError: a candidate cannot be read.
        """
        for candidates in (self.candidates, self._by_alias):
            entries, commits = self._valid_on(candidates(key), on)
            found = resolve(entries, key, on=on, statuses=statuses)
            if found is None:
                continue
            commit = commits.get(found.path)
            why = f"{found.why}; by its revision of {commit[:12]}, valid on {on}" if commit else found.why
            return replace(found, revision=commit, why=why)
        return None

    def is_dated(self, key: CameraKey) -> bool:
        """Whether what answers for a camera may depend on the day."""
        entries = self.candidates(key) or self._by_alias(key)
        return any(entry.validity is not None for entry in entries.values())

    def _valid_on(
        self, entries: Mapping[str, Entry], on: date | None
    ) -> tuple[Mapping[str, Entry], dict[str, str]]:
        """The entries, each by its newest approved revision that is valid on a day; and the commits of earlier ones."""
        if on is None or self._earlier is None:
            return entries, {}
        past: dict[str, tuple[str, Entry]] = {}
        for path, entry in entries.items():
            if entry.is_usable and entry.validity is not None and not entry.validity.holds(on):
                found = _newest_valid(entry, self._earlier(path), on)
                if found is not None:
                    past[path] = found
        commits = {path: commit for path, (commit, _) in past.items()}
        return {**entries, **{path: entry for path, (_, entry) in past.items()}}, commits

    def near(
        self, key: CameraKey, *, on: date | None = None, statuses: Collection[Status] = USABLE
    ) -> tuple[RejectedEntry, ...]:
        """The entries of the camera's make and model that do not fit it, and why.

        Raises:
            RegistryError: one of them cannot be read.
        """
        return near({**self.candidates(key), **self._by_alias(key)}, key, on=on, statuses=statuses)

    def candidates(self, key: CameraKey) -> Mapping[str, Entry]:
        """The entries of a make and model, but for those of other units.

        Raises:
            RegistryError: one of them cannot be read.
        """
        if not key.make or not key.model:
            return {}
        return self._parsed((folder_of(key.make, key.model),), key.serial)

    def _by_alias(self, key: CameraKey) -> Mapping[str, Entry]:
        if not key.make or not key.model:
            return {}
        if self._aliases is None:
            find = self._find_aliases or self._scan
            self._aliases = find()
        folders = self._aliases.get((match_key(key.make), match_key(key.model)), frozenset())
        return self._parsed(tuple(sorted(folders)), key.serial) if folders else {}

    def _scan(self) -> AliasMap:
        return scan_aliases((path, self._load(path)) for path in self.paths)

    def _parsed(self, folders: tuple[str, ...], serial: str | None) -> Mapping[str, Entry]:
        at = (*folders, slug(serial) if serial is not None else "")
        entries = self._folders.get(at)
        if entries is None:
            if len(self._folders) >= MOST_FOLDERS:
                self._folders.clear()
            paths = [path for folder in folders for path in self._in_folder(folder, serial)]
            read = {path: self._read(path) for path in dict.fromkeys([*paths, *self._irregular])}
            entries = {path: entry for path, entry in read.items() if entry is not None}
            self._folders[at] = entries
        return entries

    def _in_folder(self, folder: str, serial: str | None) -> list[str]:
        # Leaves start with a digit, and folders of units with a letter: the leaves come first.
        folders = [folder, *([f"{folder}sn-{slug(serial)}/"] if serial is not None else [])]
        paths = [path for one in folders for path in _between(self.paths, one)]
        return paths + [path for one in folders for path in _between(self.proposed, proposal_path(one))]

    def _read(self, path: str) -> Entry | None:
        try:
            entry = parse_entry(self._load(path), path, require_digest=self._require_digest)
        except InputError as error:
            if is_proposal(path):
                # It answers for nothing; saying what is wrong with it is for the check.
                return None
            raise RegistryError(str(error)) from None
        return (
            entry
            if entry.status is Status.DRAFT or not is_proposal(path)
            else replace(entry, status=Status.DRAFT)
        )


def _newest_valid(entry: Entry, earlier: Iterable[tuple[str, Entry]], on: date) -> tuple[str, Entry] | None:
    """The newest of an entry's earlier revisions that is valid on a day.

    One without a last day is valid until a newer one begins: what was in use before a period that has ended is not in
    use again after it.
    """
    begins = entry.validity.first if entry.validity is not None else None
    for commit, one in earlier:
        days = one.validity
        has_end = days is not None and days.last is not None
        if (days is None or days.holds(on)) and (has_end or (begins is not None and on < begins)):
            return commit, one
        if days is not None and days.first is not None:
            begins = min(begins, days.first) if begins is not None else days.first
    return None


def _between(paths: Sequence[str], folder: str) -> Sequence[str]:
    """The files of a folder that are not in a folder of it."""
    return paths[bisect_left(paths, folder) : bisect_left(paths, f"{folder}:")]


def _sorted_out(
    entries: Mapping[str, Entry], key: CameraKey, on: date | None, statuses: Collection[Status]
) -> tuple[list[EntryMatch], list[RejectedEntry]]:
    """What fits, the most specific first, and what does not."""
    fits, misses = [], []
    for path, entry in entries.items():
        outcome = match_entry(path, entry, key, on, statuses)
        if isinstance(outcome, EntryMatch):
            fits.append(outcome)
        elif outcome is not None:
            misses.append(RejectedEntry(path=path, reason=outcome))
    # What would answer if it were approved is what a person has to know first.
    misses.sort(key=lambda miss: not (is_proposal(miss.path) and miss.reason == ONLY_PROPOSED))
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
    if found.adapted.steps:
        text += f"; {'; '.join(found.adapted.steps)}"
    if others:
        text += f"; {others} more match and are less specific"
    return text
