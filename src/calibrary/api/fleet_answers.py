"""What a fleet's registry answers."""

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
from calibrary.registry.listing import listed
from calibrary.registry.reader import RegistryReader, open_snapshot
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry

if TYPE_CHECKING:
    from calibrary.api.changes import FleetChanges

__all__ = ["FleetAnswers"]


class FleetAnswers(Struct, frozen=True, eq=False, dict=True):
    """A registry. What it answers is of one state, which is found when it is first asked for and then kept.

    Attributes:
        place: its folder.
        at: which state: a commit, tag, branch or day; None for the one that is checked out.
    """

    place: Path
    at: str | None = None

    @classmethod
    def named(cls, path: Path | None = None, at: str | None = None) -> Self:
        """The registry at a path, else the one that $CALIBRARY_REGISTRY or the current folder means.

        Raises:
            RegistryError: none is meant; a path that holds none is found out when the registry is first used.
        """
        return cls(require_registry(path), at)

    @cached_property
    def snapshot(self) -> Snapshot:
        """Its entries; also of a plain folder, where it is named so: ``folder:PATH``."""
        if plain_folder(self.place) is not None:
            return open_snapshot(self.place, self.at)
        return self.registry.snapshot(self.at)

    @cached_property
    def registry(self) -> RegistryReader:
        """The registry in git.

        Raises:
            RegistryError: it is not in git.
        """
        return RegistryReader.open(self.place)

    @property
    def commit(self) -> str | None:
        """Which state, 40 hexadecimal digits; None for a plain folder."""
        return self.snapshot.commit

    def waiting(self, paths: Iterable[str]) -> str | None:
        """A sentence on those of some entries for which another K waits for approval; None without any."""
        return self.snapshot.waiting(paths)

    @property
    def cut(self) -> str | None:
        """What a person should know of a history that begins with a cut, as in a shallow clone; None of a whole one."""
        repo = self.snapshot.repo
        if repo is None or not repo.is_shallow:
            return None
        return (
            f"this clone is shallow and lacks older commits: git -C {repo.path} fetch --unshallow brings them"
        )

    def entries(self) -> Iterator[Entry]:
        """Every entry, whatever its status.

        Raises:
            RegistryError: one cannot be read.
        """
        return (stored.entry for stored in self.snapshot.entries())

    def resolve(
        self,
        camera: str | Path | Calibration | CameraKey | None = None,
        *,
        stated: CameraLike | None = None,
        on: date | None = None,
    ) -> FleetAnswer:
        """The calibration that applies to a camera.

        Args:
            camera: an image of it, its KEY such as "dji/fc6310r", a calibration or key of it.
            stated: what is known of the camera besides, instead of what the image or entry says.
            on: the day it is for, as entries may be valid for some only; the image's, else today, when not given.

        Raises:
            InputError: the image cannot be read, or make and model are not known.
            RegistryError: the KEY is of several models, or several entries fit equally well; they are named.

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
        """The entries whose id or label holds every word, of these statuses and grades; of all where none are given.

        A proposal is listed where it is of a camera that has no entry in use, and wherever drafts are asked for.

        Args:
            words: parts of the id or of the label.
            statuses: of the entries.
            grades: of the entries.
            where: conditions such as "grade=calibrated date<2025-01-01 label~P4R"; :mod:`calibrary.registry.query` says
                how they are written.
            sort: fields such as "date,-fx", the - for the largest first; by id when not given.

        Raises:
            InputError: a condition or a field is none.

        >>> [stored.id for stored in calibrary.open_registry("fleet").listing(["fc6310r"]).entries]
        ['dji/fc6310r/5472x3648']
        """
        chosen, unreadable = listed(
            self.snapshot, words, statuses=statuses, grades=grades, where=where, sort=sort
        )
        return EntryListing(chosen, unreadable, self.snapshot)

    def show(self, key: str, *, against: str | None = None) -> ShownEntry:
        """One entry.

        Args:
            key: KEY or KEY@REV: a commit, tag, branch, day or firmware.
            against: the REV of another state to compare it with.

        Raises:
            RegistryError: there is no such entry or state, or several.

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
        """An entry's YAML, as it is in the registry."""
        snapshot = self.snapshot if stored.commit is None else self.registry.snapshot(stored.commit)
        return snapshot.read(stored.path)

    def history(self, key: str | None = None, *, most: int | None = None) -> History:
        """The newest revisions of an entry, or of the whole registry.

        Raises:
            RegistryError: there is no such entry and never was.
        """
        return History(key, self.registry.history(key, most=most))

    def blame(self, key: str, fields: Sequence[str] = ()) -> Blame:
        """Which commit last changed each field of an entry.

        Args:
            key: of the entry.
            fields: only these and those below them, such as "intrinsics" or "distortion.k1".

        Raises:
            RegistryError: there is no such entry.
            InputError: it has none of these fields.
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
        """Whether every entry is sound: schema, digest, path, provenance, the policy's limits, one another.

        Args:
            span: REV..REV, to check only what changed between two revisions.
            policy: in place of the registry's own.
            work_tree: check the files of the checkout, committed or not.
            progress: called with (entries done, entries in all, "entries").

        Raises:
            RegistryError: there are no such revisions, or the registry cannot be listed.

        >>> calibrary.open_registry("fleet").check().is_good
        True
        """
        from calibrary.jobs.exchange.material import with_material_changes_of_range
        from calibrary.registry.checks.changes import check_range, parse_range
        from calibrary.registry.checks.whole import check_all, check_work_tree

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
        """The commits that no listed person signed, each with the reason.

        Args:
            signers: a file as of ssh-keygen(1), "ALLOWED SIGNERS"; without one only OpenPGP keys are known.
            span: REV..REV, to look at these commits only.

        Raises:
            RegistryError: the registry is a plain folder, or there are no such revisions.
        """
        from calibrary.registry.checks.approval import check_signatures
        from calibrary.registry.checks.changes import parse_range

        before, after = parse_range(span) if span is not None else (None, None)
        return check_signatures(self.snapshot, signers, before=before, after=after)

    def changes_since(
        self, rev: str, *, policy: PolicyLike = "fleet", progress: Progress | None = None
    ) -> FleetChanges:
        """Every entry that differs from what it was at a commit, tag or day, worst first."""
        from calibrary.api.changes import fleet_since

        return fleet_since(self.registry, rev, policy, progress)

    def changes_of_firmware(
        self, old: str, new: str, *, policy: PolicyLike = "fleet", progress: Progress | None = None
    ) -> FleetChanges:
        """Every camera that was calibrated with two firmware versions, worst first."""
        from calibrary.api.changes import fleet_by_firmware

        return fleet_by_firmware(self.registry, old, new, policy, progress)
