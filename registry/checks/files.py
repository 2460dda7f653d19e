"""Reading of the checked entries' files in blocks."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Final, Self

from calibrary.errors import InputError, RegistryError
from calibrary.registry.checks.entries import check_order
from calibrary.registry.checks.findings import CheckReport, finding_of
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.index import Index
from calibrary.registry.paths import check_path

__all__ = ["EntryFiles", "Progress", "completed", "readable_entries"]

BLOCK: Final = 250
"""Number of entries read at once; one by one, waiting for git would take a third of the time."""

Progress = Callable[[int, int], None]


class EntryFiles(Mapping[str, bytes]):
    """Entries by path, read in blocks on demand, so that even 100 000 entries need little memory.

    Attributes:
        unreadable: reason for each file that could not be read; its content is empty.
    """

    def __init__(
        self,
        paths: Collection[str],
        read: Callable[[Sequence[str]], Iterable[bytes]],
        progress: Progress | None = None,
        index: Index | None = None,
    ) -> None:
        self.unreadable: dict[str, str] = {}
        self._index = index
        self._entries: Mapping[str, Entry | InputError] = {}
        self._order = sorted(paths, key=check_order)
        self._known = frozenset(paths)
        self._read = read
        self._progress = progress
        self._block: Mapping[str, bytes] = {}
        self._next = 0

    @classmethod
    def in_git(cls, repo: Repository, listed: Mapping[str, str], progress: Progress | None = None) -> Self:
        """Read entries by their blob ids."""
        return cls(listed, lambda names: repo.read_many([listed[name] for name in names]), progress)

    def __getitem__(self, path: str) -> bytes:
        if path not in self._known:
            raise KeyError(path)
        found = self._block.get(path)
        if found is not None:
            return found
        if self._next < len(self._order) and self._order[self._next] == path:
            names = self._order[self._next : self._next + BLOCK]
            self._block = self._contents(names)
            self._entries = self._parsed(self._block)
            self._next += len(names)
            if self._progress is not None:
                self._progress(self._next, len(self._order))
            return self._block[path]
        # Out of order, for a reference from another entry.
        return self._contents([path])[path]

    def _parsed(self, block: Mapping[str, bytes]) -> dict[str, Entry | InputError]:
        """Return the entries of a block from the index, by the ids of their content."""
        if self._index is None:
            return {}
        return dict(self._index.parsed((blob_id(data), path, data) for path, data in block.items()))

    def parse(self, data: bytes, path: str) -> Entry:
        """Return the entry of one of these files.

        Raises:
            InputError: as for :func:`parse_entry`.
        """
        found = self._entries.get(path) if self._block.get(path) == data else None
        if isinstance(found, InputError):
            raise found
        return found if found is not None else parse_entry(data, path)

    def _contents(self, names: Sequence[str]) -> dict[str, bytes]:
        try:
            return dict(zip(names, self._read(names), strict=True))
        except RegistryError as error:
            if len(names) > 1:
                return {name: self._contents([name])[name] for name in names}
            self.unreadable[names[0]] = str(error)
            return {names[0]: b""}

    def __iter__(self) -> Iterator[str]:
        return iter(self._order)

    def __len__(self) -> int:
        return len(self._order)


def readable_entries(
    repo: Repository, listed: Mapping[str, str], paths: Sequence[str]
) -> Iterator[tuple[str, Entry]]:
    """Yield the entries at some paths; unreadable ones are skipped, as the check reports them separately."""
    for path, data in zip(paths, repo.read_many([listed[path] for path in paths]), strict=True):
        with suppress(InputError):
            entry = parse_entry(data, path)
            yield path, entry


def completed(report: CheckReport, files: EntryFiles, paths: Iterable[str]) -> CheckReport:
    """Add findings on unreadable files, and on names that some file system or git does not allow, to a report."""
    listed = [finding for finding in report.findings if finding.place not in files.unreadable]
    listed += [finding_of(path, "entry", message) for path, message in files.unreadable.items()]
    for path in paths:
        try:
            check_path(path)
        except RegistryError as error:
            listed.append(finding_of(path, "place", f"{error}; move it"))
    return CheckReport.of(report.entries, listed)
