"""The registry of a fleet, and changes of its entries."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

from calibrary.api.fleet_view import FleetView
from calibrary.api.registry_changes import NewRegistry, ProposedChange
from calibrary.api.registry_results import FleetAnswer
from calibrary.api.stated import CameraLike, overlay
from calibrary.errors import RegistryError
from calibrary.progress import Progress, labelled
from calibrary.registry.configuration import default_place, find_registry
from calibrary.registry.editing import assigned, edit, labelling, parse_assignment, retagged
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.remotes import push
from calibrary.registry.init import folder_for, init, init_from
from calibrary.registry.paths import unit_folder
from calibrary.registry.proposals import propose, propose_status, require_digests
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.sync import Choice, pull, remote_named

if TYPE_CHECKING:
    from calibrary.api.exchange import ImportResult, Reading, Stated
    from calibrary.api.units import UnitsChange
    from calibrary.registry.git.remotes import Pulled

COMMIT: Final = re.compile("[0-9a-f]{7,40}")

__all__ = ["Fleet", "FleetAnswer", "create_registry", "open_registry"]


class Fleet(FleetView, frozen=True, eq=False):
    """A registry. A change is first proposed, can be inspected, and is then written as one commit."""

    @cached_property
    def registry(self) -> Registry:
        """The registry in git, for changes.

        Raises:
            RegistryError: the registry is not in git.
        """
        return Registry.open(self.place)

    @classmethod
    def named_or_new(cls, path: Path | None = None) -> tuple[Self, bool]:
        """Return the registry as :meth:`named` does, or create the user's own; and whether it was created."""
        place = find_registry(path)
        return (
            (cls(place), False)
            if place is not None
            else (cls(init(default_place()).registry.repo.path), True)
        )

    def propose(
        self,
        file: str | Path,
        *,
        reading: Reading | None = None,
        camera: CameraLike | None = None,
        stated: Stated | None = None,
        firmware: FirmwareRange | None = None,
        notes: Sequence[str] = (),
        reason: str | None = None,
        approve: bool = False,
        override_held: bool = False,
        force: str | None = None,
        branch: str | None = None,
        valid: Validity | None = None,
        label: str | None = None,
        tags: Sequence[str] = (),
    ) -> ProposedChange:
        """Propose the entries of a calibration file, an image or an entry file; nothing is written yet.

        Args:
            file: a file of any format.
            reading: settings for the file, and which camera to use.
            camera: facts about the camera that the file does not state or states wrongly.
            stated: date, tool and operator of the calibration, if the file does not state them.
            firmware: firmware versions that the entry applies to.
            notes: remarks for the user.
            reason: reason for the change, for the history.
            approve: approve the entry at once, if the check finds no error.
            override_held: replace an entry that is held.
            force: reason for accepting a K that contradicts what is known of the camera; it is kept in the entry.
            branch: branch for the proposal, for a pull request; by default the one that is checked out.
            valid: days on which an image must be taken for the entry to apply; by default all days.
            label: name of the unit, "P4R-03"; by default its current label.
            tags: short words for searching.

        Raises:
            InputError: the file cannot be read, the camera is unknown, or its K is only an estimate.
            RegistryError: the current entry is held and ``override_held`` is false.

        >>> camera = calibrary.CameraKey(make="DJI", model="FC6310R")
        >>> change = calibrary.open_registry("fleet").propose("camera.xml", camera=camera)
        >>> [(one.entry.id, one.is_new) for one in change.proposals.items]
        [('dji/fc6310r/5472x3648', False)]
        """
        from calibrary.api.exchange import AddRequest, Reading, Stated
        from calibrary.jobs.exchange.add import propose_file

        request = AddRequest(
            key=overlay(camera),
            stated=stated or Stated(),
            firmware=firmware,
            notes=tuple(notes),
            reason=reason,
            approve=approve,
            override_held=override_held,
            force=force,
            branch=branch,
            validity=valid,
            label=label,
            tags=tuple(tags),
        )
        proposals = propose_file(self.registry, Path(file), reading or Reading(), request)
        return ProposedChange(self.registry, proposals, Path(file), branch=branch)

    def propose_entry(
        self,
        entry: Entry,
        *,
        reason: str | None = None,
        approve: bool = False,
        override_held: bool = False,
        force: str | None = None,
        branch: str | None = None,
    ) -> ProposedChange:
        """Propose an entry, checked against the current one; arguments and errors as for :meth:`propose`."""
        return self.propose_entries(
            [entry],
            reason=reason,
            approve=approve,
            override_held=override_held,
            force=force,
            branch=branch,
        )

    def propose_entries(
        self,
        entries: Sequence[Entry],
        *,
        reason: str | None = None,
        approve: bool = False,
        override_held: bool = False,
        force: str | None = None,
        branch: str | None = None,
    ) -> ProposedChange:
        """Propose several entries in one change, such as those of a rig; arguments as for :meth:`propose`."""
        proposals = propose(
            self.registry.branch(branch),
            list(entries),
            approve=approve,
            reason=reason,
            override_held=override_held,
            force=force,
        )
        return ProposedChange(self.registry, proposals, branch=branch)

    def propose_status(
        self,
        keys: Sequence[str],
        status: str,
        *,
        reason: str | None = None,
        branch: str | None = None,
        successor: str | None = None,
        digests: Sequence[str] = (),
        force: str | None = None,
        valid: Validity | None = None,
    ) -> ProposedChange:
        """Propose to approve, hold or retire entries; nothing is written yet.

        :meth:`ProposedChange.write` writes exactly the returned change; it fails if a proposal has changed since.

        Args:
            keys: keys of the entries; KEY@COMMIT approves only the proposal at that commit.
            status: "approved", "held" or "retired".
            reason: reason for the change, for the history.
            branch: branch with the proposals, such as one made by ``onboard``.
            successor: KEY of the entry that replaces a retired one.
            digests: ids, or their beginnings, of the reviewed files, as ``add`` prints them; others are rejected.
            force: reason for approving a K that contradicts what is known of the camera; it is kept in the entry.
            valid: days on which an image must be taken for the entry to apply; by default unchanged.

        Raises:
            RegistryError: an entry does not exist, or a proposal differs from the reviewed one.
        """
        names, seen = self._looked_at(keys) if status == Status.APPROVED.value else (keys, ())
        proposals = propose_status(
            self.registry,
            names,
            Status(status),
            reason,
            branch=branch,
            successor=successor,
            force=force,
            validity=valid,
        )
        if digests or seen:
            require_digests(proposals, (*digests, *seen))
        return ProposedChange(self.registry, proposals)

    def propose_label(self, key: str, label: str | None) -> ProposedChange:
        """Propose a label, or its removal, for all entries of a unit; nothing is written yet.

        Args:
            key: the unit, such as "dji/fc6310r/sn-0e25", its serial number or label, or the key of one of its entries.
            label: new label, such as "P4R-03"; None removes the label.

        Raises:
            InputError: the label is not valid.
            RegistryError: the unit does not exist, or several match.
        """
        registry = self.registry
        return ProposedChange(registry, labelling(registry.snapshot(), key, label))

    def propose_edit(
        self,
        keys: Sequence[str] = (),
        assignments: Sequence[str] = (),
        *,
        where: Sequence[str] = (),
        add_tags: Sequence[str] = (),
        remove_tags: Sequence[str] = (),
        approve: bool = False,
    ) -> ProposedChange:
        """Propose new labels, tags, notes or validity days for many entries; nothing is written yet.

        Labels, tags and notes are changed in the entry itself. New days become a proposal, unless ``approve`` is true.

        Args:
            keys: keys of entries; the label of a unit selects all its entries.
            assignments: such as "tags+=survey", "notes=spare lens", "valid-until=2026-05-01".
            where: conditions as for :meth:`FleetAnswers.listing`; matching entries are edited as well.
            add_tags: tags to add.
            remove_tags: tags to remove.
            approve: approve new days at once, if the check finds no error.

        Raises:
            InputError: a condition, field or value is not valid.
            RegistryError: an entry does not exist.
        """
        registry = self.registry
        snapshot = registry.snapshot()
        said = [parse_assignment(text) for text in assignments]
        steps = [assigned(said), retagged(add_tags, remove_tags)]
        paths = dict.fromkeys(path for key in keys for path in self._meant(snapshot, key))
        if where:
            paths |= dict.fromkeys(one.path for one in self.listing(where=where).entries)
        words = list(
            dict.fromkeys([*(one.field for one in said), *(["tags"] if add_tags or remove_tags else [])])
        )
        edits = dict.fromkeys(paths, lambda entry: steps[1](steps[0](entry)))
        verb = f"Set {', '.join(words)} of"
        return ProposedChange(registry, edit(snapshot, edits, verb=verb, approve=approve))

    @staticmethod
    def _meant(snapshot: Snapshot, key: str) -> list[str]:
        """Return the entry that a key names, or all entries of the one unit that it names."""
        found = snapshot.matching(key)
        units = {unit_folder(path) for path in found}
        return found if len(units) == 1 and None not in units else [snapshot.find(key)]

    def import_units(self, file: str | Path) -> UnitsChange:
        """Propose the labels, tags and notes in a table of units; nothing is written yet.

        Args:
            file: a table in the form of :meth:`FleetView.export_units`, or with the columns ``serial`` and ``label``.

        Raises:
            InputError: the file cannot be read, or is not such a table. Errors in single rows are in the result.
        """
        from calibrary.api.units import UnitsChange

        return UnitsChange.of(self.registry, Path(file))

    def _looked_at(self, keys: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
        """Split keys from their revisions; return the keys, and the file ids of the entries at those revisions.

        Raises:
            RegistryError: a revision is not a commit, and so may change later.
        """
        names, seen = [], []
        for key in keys:
            name, at, rev = key.partition("@")
            names.append(name)
            if at:
                if COMMIT.fullmatch(rev) is None:
                    raise RegistryError(
                        f"{key}: an approval is of what was looked at: name the commit, not a branch, tag or day"
                    )
                seen.append(self.registry.snapshot(rev).pending(name).oid or "")
        return names, tuple(seen)

    def import_folder(
        self,
        folder: str | Path,
        *,
        reading: Reading | None = None,
        camera: CameraLike | None = None,
        stated: Stated | None = None,
        reason: str | None = None,
        approve: bool = False,
        force: str | None = None,
        progress: Progress | None = None,
    ) -> ImportResult:
        """Propose an entry for every calibration file below a folder; arguments as for :meth:`propose`.

        Raises:
            RegistryError: the folder cannot be read. A file that cannot be imported is one of the items of the result.
        """
        from calibrary.api.exchange import AddRequest, ImportResult, Reading, Stated
        from calibrary.jobs.exchange.import_ import import_folder

        request = AddRequest(
            key=overlay(camera), stated=stated or Stated(), reason=reason, approve=approve, force=force
        )
        reported = labelled(progress, "files")
        found = import_folder(self.registry, Path(folder), reading or Reading(), request, progress=reported)
        return ImportResult(self.registry, found)

    def import_catalogue(self) -> ImportResult:
        """Propose a draft entry for every camera of the catalogue for which K can be derived."""
        from calibrary.api.exchange import ImportResult
        from calibrary.jobs.exchange.import_ import import_catalogue

        return ImportResult(self.registry, import_catalogue(self.registry))

    def remote_named(self, word: str | None) -> tuple[str, str | None]:
        """Return the remote for a name or address, and the address if it was new and has been added as ``origin``."""
        return remote_named(self.registry.repo, word)

    def pull(self, remote: str = "origin", *, ours: Sequence[str] = (), theirs: Sequence[str] = ()) -> Pulled:
        """Fetch commits from a remote and rebase the local commits onto them.

        Args:
            remote: name of the remote.
            ours: keys of entries changed on both sides for which the local version is kept; "all" for all others.
            theirs: keys of those for which the remote version is kept.

        Raises:
            FileConflictError: both sides changed an entry and no side was chosen; nothing was changed.
            RegistryError: the remote cannot be reached.
        """
        return pull(self.registry.repo, remote, Choice(ours=ours, theirs=theirs))

    def push(self, remote: str = "origin") -> str:
        """Push the local commits; return the commit that both sides now have.

        Raises:
            ConflictError: the remote has new commits; pull first.
        """
        return push(self.registry.repo, remote)


def open_registry(path: str | Path, *, at: str | None = None) -> Fleet:
    """Open a fleet's registry.

    Args:
        path: a registry in git, bare or checked out, read as committed; "folder:PATH" reads the files as they are.
        at: a commit, tag, branch or day; by default the state that is checked out.

    Raises:
        RegistryError: there is no registry, or no such state.

    >>> fleet = calibrary.open_registry("fleet")
    >>> [entry.id for entry in fleet.entries()]
    ['dji/fc6310r/5472x3648']
    """
    fleet = Fleet(Path(path), at)
    _ = fleet.snapshot
    return fleet


def create_registry(
    path: Path | None = None, *, remote: str | None = None, bare: bool = False, starter: bool = False
) -> NewRegistry:
    """Create a registry in a folder, or clone one from an address.

    Args:
        path: folder of the registry; by default the current folder, or the last part of the address.
        remote: address of the registry to clone.
        bare: create it without a work tree, for a server.
        starter: prepare a public registry: a licence, review rules, and the catalogue's cameras as proposals.

    Raises:
        RegistryError: the folder already contains a registry or other files, or the address cannot be reached.
    """
    if remote is not None:
        return NewRegistry(init_from(remote, path or folder_for(remote), bare=bare))
    new = NewRegistry(init(path or Path(), bare=bare, starter=starter))
    if starter:
        from calibrary.jobs.exchange.import_ import import_catalogue, write_import

        write_import(new.made.registry, import_catalogue(new.made.registry))
    return new
