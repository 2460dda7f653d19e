"""A fleet's registry, and changes of its entries."""

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
from calibrary.registry.init import folder_for, init, init_from
from calibrary.registry.paths import unit_folder
from calibrary.registry.proposals import require_digests
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.sync import Choice, remote_named

if TYPE_CHECKING:
    from calibrary.api.exchange import ImportResult, Reading, Stated
    from calibrary.api.units import UnitsChange
    from calibrary.registry.git.remotes import Pulled

COMMIT: Final = re.compile("[0-9a-f]{7,40}")

__all__ = ["Fleet", "FleetAnswer", "create_registry", "open_registry"]


class Fleet(FleetView, frozen=True, eq=False):
    """A registry; a change of it is proposed, can be looked at, and is then written as one commit."""

    @cached_property
    def registry(self) -> Registry:
        """The registry in git, to be changed.

        Raises:
            RegistryError: it is not in git.
        """
        return Registry.open(self.place)

    @classmethod
    def named_or_new(cls, path: Path | None = None) -> tuple[Self, bool]:
        """As :meth:`named`, but the user's own registry is made where none is meant; and whether it was."""
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
        """The entries that a calibration file, an image or an entry's file would become; nothing is written yet.

        Args:
            file: of any format.
            reading: answers to what the file leaves open, and which camera of several.
            camera: what the file does not say of the camera, or says wrong.
            stated: date, tool and operator of the calibration, where the file does not say them.
            firmware: of which firmware it is.
            notes: what a person should know about it.
            reason: why, for the history.
            approve: use it at once, if the check has nothing against it.
            override_held: replace an entry that is held.
            force: why to take a K that contradicts what is known of its camera; it stays visible.
            branch: to propose it on, for a pull request; the one that is checked out when not given.
            valid: the days that images may be of for it; every day when not given.
            label: what the unit is called, "P4R-03"; as it is called already when not given.
            tags: short words to find it by.

        Raises:
            InputError: it cannot be read, its camera is not known, or its K is a guess.
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
        """An entry beside the current one, checked; arguments and errors as of :meth:`propose`."""
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
        """Several entries in one change, such as a rig's; arguments and errors as of :meth:`propose`."""
        proposals = self.registry.propose(
            list(entries),
            approve=approve,
            reason=reason,
            override_held=override_held,
            force=force,
            branch=branch,
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
        """Entries approved, held or retired; nothing is written yet.

        What is written by :meth:`ProposedChange.write` is what stands in the change that is returned: if a proposal
        has changed since, that fails.

        Args:
            keys: of the entries; KEY@COMMIT approves what was proposed at that commit, and nothing else.
            status: "approved", "held" or "retired".
            reason: why, for the history.
            branch: on which they are proposed, as ``onboard`` does.
            successor: KEY of the entry that takes the place of a retired one.
            digests: the ids of the files that were looked at, as ``add`` prints them, or how they begin; a proposal
                that has another is refused.
            force: why to approve a K that contradicts what is known of its camera; it stays visible.
            valid: the days that images may be of for it; as it states itself when not given.

        Raises:
            RegistryError: there is no such entry, or what is proposed is not what was looked at.
        """
        names, seen = self._looked_at(keys) if status == Status.APPROVED.value else (keys, ())
        proposals = self.registry.propose_status(
            names, Status(status), reason, branch=branch, successor=successor, force=force, validity=valid
        )
        if digests or seen:
            require_digests(proposals, (*digests, *seen))
        return ProposedChange(self.registry, proposals)

    def propose_label(self, key: str, label: str | None) -> ProposedChange:
        """All entries of a unit with a label, or without one; nothing is written yet.

        Args:
            key: of the unit, such as "dji/fc6310r/sn-0e25", its serial number or its label; or of one of its entries.
            label: as "P4R-03"; None takes it away.

        Raises:
            InputError: it is not a label.
            RegistryError: there is no such unit, or several.
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
        """Labels, tags, notes or days of many entries; nothing is written yet.

        Labels, tags and notes are written where the entry is. Other days are a proposal, unless ``approve`` is said.

        Args:
            keys: of entries; of a unit's label, all of the unit.
            assignments: as "tags+=survey", "notes=spare lens", "valid-until=2026-05-01".
            where: conditions as of :meth:`FleetAnswers.listing`; their entries are edited as well.
            add_tags: that these entries get.
            remove_tags: that they lose.
            approve: use other days at once, if the check has nothing against it.

        Raises:
            InputError: a condition, field or value is none.
            RegistryError: there is no such entry.
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
        """The entry that a KEY means, or all entries of the one unit that it means."""
        found = snapshot.matching(key)
        units = {unit_folder(path) for path in found}
        return found if len(units) == 1 and None not in units else [snapshot.find(key)]

    def import_units(self, file: str | Path) -> UnitsChange:
        """What a table of units says of labels, tags and notes; nothing is written yet.

        Args:
            file: as :meth:`FleetView.export_units` writes it, saved by any spreadsheet; or of one's own, with the
                columns ``serial`` and ``label``.

        Raises:
            InputError: it cannot be read, or is not such a table. What is wrong with a row is in the result.
        """
        from calibrary.api.units import UnitsChange

        return UnitsChange.of(self.registry, Path(file))

    def _looked_at(self, keys: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
        """KEYs without their revision, and the ids of the files that those with one had there.

        Raises:
            RegistryError: a revision is not a commit, and so may be another tomorrow.
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
        """Every calibration file below a folder, as it would be written; arguments as of :meth:`propose`.

        Raises:
            RegistryError: the folder cannot be read. A file that cannot be imported is one of the items.
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
        """Every camera of the catalogue whose K can be derived, as it would be written: as a draft."""
        from calibrary.api.exchange import ImportResult
        from calibrary.jobs.exchange.import_ import import_catalogue

        return ImportResult(self.registry, import_catalogue(self.registry))

    def remote_named(self, word: str | None) -> tuple[str, str | None]:
        """The remote that a name or an address means, and the address if it was new and is ``origin`` now."""
        return remote_named(self.registry.repo, word)

    def pull(self, remote: str = "origin", *, ours: Sequence[str] = (), theirs: Sequence[str] = ()) -> Pulled:
        """Bring what others have written; our commits are made again on top of it.

        Args:
            remote: its name.
            ours: KEYs of entries that both sides changed, of which ours is right; "all" for the others.
            theirs: those of which theirs is right.

        Raises:
            FileConflictError: both sides changed an entry and no side was chosen; nothing was changed.
            RegistryError: the remote cannot be reached.
        """
        return self.registry.pull(remote, Choice(ours=ours, theirs=theirs))

    def push(self, remote: str = "origin") -> str:
        """Publish what was written here; the commit that both sides have now.

        Raises:
            ConflictError: the remote has moved on; pull first.
        """
        return self.registry.push(remote)


def open_registry(path: str | Path, *, at: str | None = None) -> Fleet:
    """Open a fleet's registry.

    Args:
        path: a registry in git, bare or checked out, read as committed; "folder:PATH" for files as they lie there.
        at: which state: a commit, tag, branch or day; the one that is checked out when not given.

    Raises:
        RegistryError: there is none, or no such state.

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
    """Create a registry in a folder, or copy one from an address.

    Args:
        path: its folder; the current one, or one named as the address's last part, when not given.
        remote: the address of the registry that is copied.
        bare: without a work tree, for a server.
        starter: open to everyone: with a licence, rules of review, and the catalogue's cameras as proposals.

    Raises:
        RegistryError: there is a registry already or something else in the way, or the address cannot be reached.
    """
    if remote is not None:
        return NewRegistry(init_from(remote, path or folder_for(remote), bare=bare))
    new = NewRegistry(init(path or Path(), bare=bare, starter=starter))
    if starter:
        from calibrary.jobs.exchange.import_ import import_catalogue, write_import

        write_import(new.made.registry, import_catalogue(new.made.registry))
    return new
