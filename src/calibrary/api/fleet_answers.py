"""Queries of a fleet's registry."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self

from msgspec import Struct

from calibrary.api.limits import PolicyLike, policy_of
from calibrary.api.registry_results import Blame, CheckResult, EntryListing, FleetAnswer, History, ShownEntry
from calibrary.api.stated import CameraLike
from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import InputError
from calibrary.progress import Progress, labelled
from calibrary.registry.configuration import plain_folder, require_registry
from calibrary.registry.entry import Entry
from calibrary.registry.fields import differences
from calibrary.registry.history import recorded
from calibrary.registry.query import listed
from calibrary.registry.registry import Registry, open_snapshot
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry

if TYPE_CHECKING:
    from calibrary.api.changes import FleetChanges

__all__ = ["FleetAnswers"]


class FleetAnswers(Struct, frozen=True, eq=False, dict=True):
    """A registry for queries. All results are of one state, which is determined at first use and then kept.

    Attributes:
        place: folder of the registry.
        at: a commit, tag, branch or day; None for the state that is checked out.
    """

    place: Path
    at: str | None = None

    @classmethod
    def named(cls, path: Path | None = None, at: str | None = None) -> Self:
        """Return the registry at a path, else the one given by $CALIBRARY_REGISTRY or the current folder.

        Raises:
            RegistryError: no registry is given. A path without a registry raises this error only at first use.
        """
        return cls(require_registry(path), at)

    @cached_property
    def snapshot(self) -> Snapshot:
        """The entries of this state; also of a plain folder, named ``folder:PATH``."""
        if plain_folder(self.place) is not None:
            return open_snapshot(self.place, self.at)
        return self.registry.snapshot(self.at)

    @cached_property
    def registry(self) -> Registry:
        """The registry in git.

        Raises:
            RegistryError: the registry is not in git.
        """
        return Registry.open(self.place)

    @property
    def commit(self) -> str | None:
        """Commit of this state, 40 hexadecimal digits; None for a plain folder."""
        return self.snapshot.commit

    def waiting(self, paths: Iterable[str]) -> str | None:
        """Return a sentence about entries in ``paths`` with another K waiting for approval; None if there are none."""
        return self.snapshot.waiting(paths)

    @property
    def cut(self) -> str | None:
        """A warning if the history is incomplete, as in a shallow clone; None if it is complete."""
        repo = self.snapshot.repo
        if repo is None or not repo.is_shallow:
            return None
        return (
            f"this clone is shallow and lacks older commits: git -C {repo.path} fetch --unshallow brings them"
        )

    def entries(self) -> Iterator[Entry]:
        """Yield every entry of any status.

        Raises:
            RegistryError: an entry cannot be read.
        """
        return (stored.entry for stored in self.snapshot.entries())

    def resolve(
        self,
        camera: str | Path | Calibration | CameraKey | None = None,
        *,
        stated: CameraLike | None = None,
        on: date | None = None,
    ) -> FleetAnswer:
        """Find the calibration that applies to a camera.

        Args:
            camera: an image of the camera, its KEY such as "dji/fc6310r", a calibration, or a camera key.
            stated: further facts about the camera, instead of those of the image or entry.
            on: day for which the calibration must be valid; by default the day of the image, else today.

        Raises:
            InputError: the image cannot be read, or make and model are unknown.
            RegistryError: the KEY matches several models, or several entries match equally well; the message names
                them.

        >>> fleet = calibrary.open_registry("fleet")
        >>> answer = fleet.resolve("survey/DJI_0001.JPG")
        >>> answer.status, answer.calibration.intrinsics.fx
        (<Status.APPROVED: 'approved'>, 3659.5)
        """
        from calibrary.api.layers import resolved
        from calibrary.jobs.exchange.layers import Layers, layer_of_snapshot

        return resolved(Layers((layer_of_snapshot(self.snapshot),)), camera, stated=stated, on=on)

    def listing(
        self,
        words: Sequence[str] = (),
        *,
        statuses: Collection[str] = (),
        grades: Collection[str] = (),
        where: Sequence[str] = (),
        sort: str | None = None,
    ) -> EntryListing:
        """Select entries by words in their id or label, by status, grade and conditions; by default all entries.

        A proposal is included if its camera has no entry in use, or if drafts are asked for.

        Args:
            words: parts of the id or the label; all must occur.
            statuses: statuses to include.
            grades: grades to include.
            where: conditions such as "grade=calibrated date<2025-01-01 label~P4R"; for the syntax see
                :mod:`calibrary.registry.query`.
            sort: fields such as "date,-fx"; - sorts from large to small. By default entries are sorted by id.

        Raises:
            InputError: a condition or a field is not valid.

        >>> [stored.id for stored in calibrary.open_registry("fleet").listing(["fc6310r"]).entries]
        ['dji/fc6310r/5472x3648']
        """
        chosen, unreadable = listed(
            self.snapshot, words, statuses=statuses, grades=grades, where=where, sort=sort
        )
        return EntryListing(chosen, unreadable, self.snapshot)

    def show(self, key: str, *, against: str | None = None) -> ShownEntry:
        """Return one entry.

        Args:
            key: KEY or KEY@REV: a commit, tag, branch, day or firmware.
            against: REV of another state to compare with.

        Raises:
            RegistryError: the entry or state does not exist, or several match.

        >>> calibrary.open_registry("fleet").show("fc6310r").stored.entry.status
        <Status.APPROVED: 'approved'>
        """
        from calibrary.registry.approvals import approvals_of

        if plain_folder(self.place) is not None and "@" not in key and against is None:
            return ShownEntry(self.snapshot.get(key), None, ())
        stored = self.registry.get(key)
        repo = self.registry.repo
        who, approved = recorded(repo, stored), approvals_of(repo, stored)
        if against is None:
            return ShownEntry(stored, who, approved)
        other = f"{stored.id}@{against}"
        changes = differences(self.registry.get(other).entry, stored.entry)
        return ShownEntry(stored, who, approved, other, changes)

    def file(self, stored: StoredEntry) -> bytes:
        """Return the YAML of an entry, as it is in the registry."""
        snapshot = self.snapshot if stored.commit is None else self.registry.snapshot(stored.commit)
        return snapshot.read(stored.path)

    def history(self, key: str | None = None, *, most: int | None = None) -> History:
        """Return the newest revisions of an entry, or of the whole registry.

        Raises:
            RegistryError: the entry does not exist and never did.
        """
        return History(key, self.registry.history(key, most=most))

    def blame(self, key: str, fields: Sequence[str] = ()) -> Blame:
        """Return the commit that last changed each field of an entry.

        Args:
            key: key of the entry.
            fields: limit to these fields and those below them, such as "intrinsics" or "distortion.k1".

        Raises:
            RegistryError: the entry does not exist.
            InputError: the entry has none of these fields.
        """
        every = self.registry.blame(key)
        kept = tuple(
            one
            for one in every
            if not fields or any(one.field == name or one.field.startswith(f"{name}.") for name in fields)
        )
        if not kept:
            there = ", ".join(dict.fromkeys(one.field.partition(".")[0] for one in every))
            raise InputError(f"{key} says nothing of {', '.join(fields)}; it has {there}")
        return Blame(self.registry.get(key).id, kept)

    def check(
        self,
        span: str | None = None,
        *,
        policy: PolicyLike | None = None,
        work_tree: bool = False,
        progress: Progress | None = None,
    ) -> CheckResult:
        """Check every entry: schema, digest, path, provenance, the policy's limits, and consistency with other entries.

        Args:
            span: REV..REV, to check only changes between two revisions.
            policy: policy to use instead of the registry's own.
            work_tree: check the files of the checkout, committed or not.
            progress: called with (entries done, number of entries, "entries").

        Raises:
            RegistryError: a revision does not exist, or the registry cannot be listed.

        >>> calibrary.open_registry("fleet").check().is_good
        True
        """
        from calibrary.jobs.exchange.material import with_material_changes_of_range
        from calibrary.registry.checks import check_all, check_range, check_work_tree, parse_range

        limits, reported = policy_of(policy) if policy is not None else None, labelled(progress, "entries")
        if work_tree:
            return CheckResult(check_work_tree(self.snapshot, limits, progress=reported))
        if span is None:
            return CheckResult(check_all(self.snapshot, limits, progress=reported))
        before, after = parse_range(span)
        done = check_range(self.snapshot, before, after, limits, progress=reported)
        return CheckResult(
            with_material_changes_of_range(done, self.snapshot, limits or self.snapshot.configuration.policy)
        )

    def unsigned(self, signers: Path | None = None, span: str | None = None) -> tuple[str, ...]:
        """Return the commits without a signature of a listed person, each with the reason.

        Args:
            signers: an "ALLOWED SIGNERS" file of ssh-keygen(1); without it only OpenPGP keys can be verified.
            span: REV..REV, to check only these commits.

        Raises:
            RegistryError: the registry is a plain folder, or a revision does not exist.
        """
        from calibrary.registry.checks import check_signatures, parse_range

        before, after = parse_range(span) if span is not None else (None, None)
        return check_signatures(self.snapshot, signers, before=before, after=after)

    def changes_since(
        self, rev: str, *, policy: PolicyLike = "fleet", progress: Progress | None = None
    ) -> FleetChanges:
        """Compare every entry with its state at a commit, tag or day; return those that differ, worst first."""
        from calibrary.api.changes import fleet_since

        return fleet_since(self.registry, rev, policy, progress)

    def changes_of_firmware(
        self, old: str, new: str, *, policy: PolicyLike = "fleet", progress: Progress | None = None
    ) -> FleetChanges:
        """Compare the entries of every camera calibrated with both firmware versions, worst first."""
        from calibrary.api.changes import fleet_by_firmware

        return fleet_by_firmware(self.registry, old, new, policy, progress)
