"""A fleet's registry: queries, outputs and changes.

>>> from calibrary.jobs.fleet import open_registry
>>> [entry.id for entry in open_registry("fleet").entries()]
['dji/fc6310r/5472x3648']
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Self

from msgspec import Meta, Struct

from calibrary.arguments import CameraLike, File, Folder, Place, PolicyLike, Reading, Stated, Workers, paths
from calibrary.camera_key import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.progress import Progress, labelled

if TYPE_CHECKING:
    from calibrary.calibration import Calibration
    from calibrary.jobs.audit.report import AuditReport
    from calibrary.jobs.diff.fleet import FleetDiffReport
    from calibrary.jobs.exchange.resolve import FleetAnswer
    from calibrary.jobs.fleet.changes import NewRegistry, ProposedChange
    from calibrary.jobs.fleet.exchange import ExportResult, ImportResult
    from calibrary.jobs.fleet.locks import LockResult
    from calibrary.jobs.fleet.results import Blame, CheckResult, EntryListing, History, ShownEntry
    from calibrary.jobs.fleet.units import UnitsChange
    from calibrary.jobs.site.building import Site
    from calibrary.jobs.site.server import Server
    from calibrary.registry.contribution import Contribution
    from calibrary.registry.entry import Entry, Validity
    from calibrary.registry.firmware import FirmwareRange
    from calibrary.registry.git.remotes import Pulled
    from calibrary.registry.published.write import Publication
    from calibrary.registry.registry import Registry
    from calibrary.registry.snapshot import Snapshot
    from calibrary.registry.stored import StoredEntry

__all__ = ["Fleet", "create_registry", "open_registry"]

COMMIT: Final = re.compile("[0-9a-f]{7,40}")


class Fleet(Struct, frozen=True, eq=False, dict=True):
    """A registry. All queries are of one state, which is determined at first use and then kept.

    A change is first proposed, can be inspected, and is then written as one commit.

    Attributes:
        place: folder of the registry.
        at: a commit, tag, branch or day; None for the state that is checked out.
    """

    place: Path
    at: str | None = None

    @classmethod
    def named(cls, path: Place | None = None, at: str | None = None) -> Self:
        """Return the registry at a path, else the one of :func:`calibrary.registry.places.registries`.

        Raises:
            UsageError: the path is the address of a published registry.
            RegistryError: there is no registry. A path without a registry raises this error only at first use.
        """
        from calibrary.registry.places import one_registry

        return cls(one_registry(path), at)

    @classmethod
    def named_or_new(cls, path: Place | None = None) -> tuple[Self, bool]:
        """Return the registry as :meth:`named` does, or create the user's own; and whether it was created."""
        from calibrary.registry.places import default_place, one_registry, registries

        if path is not None or registries():
            return cls(one_registry(path)), False
        from calibrary.registry.init import init

        return cls(init(default_place()).registry.repo.path), True

    @cached_property
    def snapshot(self) -> Snapshot:
        """The entries of this state; also of a plain folder, named ``folder:PATH``."""
        from calibrary.registry.places import plain_folder
        from calibrary.registry.registry import open_snapshot

        if plain_folder(self.place) is not None:
            return open_snapshot(self.place, self.at)
        return self.registry.snapshot(self.at)

    @cached_property
    def registry(self) -> Registry:
        """The registry in git.

        Raises:
            RegistryError: the registry is not in git.
        """
        from calibrary.registry.registry import Registry

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
        from calibrary.jobs.exchange.layers import Layers, layer_of_snapshot
        from calibrary.jobs.exchange.resolve import resolved

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
        from calibrary.jobs.fleet.results import EntryListing
        from calibrary.registry.query import listed

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
        from calibrary.jobs.fleet.results import ShownEntry
        from calibrary.registry.approvals import approvals_of
        from calibrary.registry.fields import differences
        from calibrary.registry.history import recorded
        from calibrary.registry.places import plain_folder

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
        from calibrary.jobs.fleet.results import History

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
        from calibrary.jobs.fleet.results import Blame

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
        from calibrary.jobs.fleet.results import CheckResult
        from calibrary.policy_file import policy_of
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

    def changes(
        self,
        *,
        since: str | None = None,
        firmware: str | None = None,
        policy: PolicyLike = "fleet",
        progress: Progress | None = None,
    ) -> FleetDiffReport:
        """Compare entries with an earlier state; arguments as of :func:`calibrary.jobs.diff.compare_fleet`."""
        from calibrary.jobs.diff import compare_fleet

        return compare_fleet(self.registry, since=since, firmware=firmware, policy=policy, progress=progress)

    def audit(
        self,
        folders: Folder | Sequence[Folder],
        *,
        since: date | None = None,
        stale_after_months: Annotated[int, Meta(ge=1, le=1200)] = 24,
        verify: bool = False,
        verify_minutes: Annotated[float, Meta(ge=0.1, le=10_000)] = 15.0,
        html: File | None = None,
        workers: Workers = 0,
        progress: Progress | None = None,
    ) -> AuditReport:
        """Compare the registry with images of recent flights; the registry is only read.

        Args:
            folders: folders of images, with their sub-folders.
            since: skip images that were taken before this day, such as 2026-04-01.
            stale_after_months: report calibrations of this age and older.
            verify: also compare the registered K's with the pixels of a dozen images of one flight of each unit and
                date: K over time (needs calibrary[sfm]; about a minute for each flight).
            verify_minutes: time limit of ``verify``: no flight is started after it.
            html: also write the audit as a page.
            workers: number of processes that read images; 0 chooses it.
            progress: called with (images read, number of images, "images"); with ``verify`` also for each flight.

        Raises:
            InputError: a folder cannot be read, or there is no image.
            MissingExtraError: ``verify`` is set and pycolmap is not installed.

        >>> [finding.rule for finding in calibrary.open_registry("fleet").audit(["survey"]).findings]
        [<Rule.UNDATED: 'calibration date unknown'>]
        """
        from calibrary.jobs.audit.run import audit
        from calibrary.pages import check_page_place, write_page

        place = check_page_place(html)
        done = audit(
            self.snapshot,
            paths(folders),
            since=since,
            stale_after_months=stale_after_months,
            verify_minutes=verify_minutes if verify else None,
            workers=workers,
            progress=progress,
        )
        if place is not None:
            from calibrary.jobs.audit.page import audit_page

            write_page(place, audit_page(done))
        return done

    def export(
        self,
        format: str,  # noqa: A002  as in calibrary.read
        out: str | Path,
        *,
        statuses: Collection[str] = ("approved", "held"),
        max_error_px: float | None = None,
    ) -> ExportResult:
        """Write all entries in a form that another program reads.

        Args:
            format: csv, yaml, odm, opensfm, colmap, or the name of any format that can be written.
            out: a file; a folder if each entry gets its own file.
            statuses: statuses to include.
            max_error_px: largest allowed error in px of a fitted distortion model; 0.05 px by default.

        Raises:
            InputError: there is nothing to write, or the output cannot be written.

        >>> [one.entry for one in calibrary.open_registry("fleet").export("odm", "cameras.json").export.written]
        ['dji/fc6310r/5472x3648']
        """
        from calibrary.jobs.fleet.exchange import exported

        return exported(self.snapshot, format, Path(out), statuses, max_error_px)

    def export_units(self, out: str | Path, *, where: Sequence[str] = (), excel: bool = False) -> int:
        """Write the entries as a table for a spreadsheet, one row each; return their number.

        Args:
            out: the CSV file.
            where: conditions as for :meth:`listing`; by default all entries.
            excel: use the form that Excel reads in countries with a decimal comma.

        Raises:
            InputError: the file cannot be written.
        """
        from calibrary.jobs.fleet.units import write_units

        return write_units(self.listing(where=where), Path(out), excel=excel)

    def lock(self, what: Sequence[str | Path] = (), *, recursive: bool = False) -> LockResult:
        """Pin entries in their current state, so that a run can be repeated with them; nothing is written yet.

        Args:
            what: KEYs, and folders of images, for the entries that apply to these; by default every usable entry.
            recursive: include sub-folders.

        Raises:
            RegistryError: an entry does not exist, or there is none to pin.
        """
        from calibrary.jobs.fleet.locks import locked

        return locked(self.snapshot, what, recursive=recursive)

    def write_site(
        self, out: Folder = "site", *, workers: Workers = 0, progress: Progress | None = None
    ) -> Site:
        """Write the registry as web pages into a folder.

        Args:
            out: a folder that is new, empty or an earlier site, which is replaced as a whole.
            workers: number of processes that make the pages; 0 for one per processor.
            progress: called with (entries done, number of entries, "pages").

        Raises:
            InputError: the folder contains other files.
            MissingExtraError: the libraries for pages are not installed.
        """
        from calibrary.extras import PAGES, require

        require(PAGES, "a site")
        from calibrary.jobs.site.building import build
        from calibrary.jobs.site.folder import check_out

        check_out(Path(out))
        return build(self.place, Path(out), workers=workers or None, progress=labelled(progress, "pages"))

    def publish(
        self,
        out: Folder,
        *,
        site: bool = False,
        base_url: Annotated[str, Meta(title="URL")] | None = None,
        sign: Annotated[str | Path, Meta(title="KEY")] | None = None,
        workers: Workers = 0,
        progress: Progress | None = None,
    ) -> Publication:
        """Write the registry as static files, from which programs resolve cameras over HTTP.

        Args:
            out: a folder that is new, empty or an earlier publication; only changed files are written.
            site: also write the pages for people into the folder, as a site has them.
            base_url: URL at which the folder is served: also write the JSON Schemas of the files, with URLs there
                as their ids.
            sign: an ssh key to sign the root file with.
            workers: number of processes; 0 for one per processor.
            progress: called with (entries done, number of entries, "entries"); then for the pages.

        Raises:
            InputError: the folder contains other files.
            RegistryError: an entry cannot be read or must not be published.
            MissingExtraError: with ``site``, the libraries for pages are not installed.

        >>> calibrary.open_registry("fleet").publish("public").entries
        1
        """
        from calibrary.extras import PAGES, require
        from calibrary.registry.published.write import publish

        if site:
            require(PAGES, "a site")
        done = publish(
            self.snapshot,
            Path(out),
            key=Path(sign) if sign is not None else None,
            base_url=base_url,
            workers=workers or None,
            progress=labelled(progress, "entries"),
        )
        if site:
            self.write_site(out, workers=workers, progress=progress)
        return done

    def contribute(self, key: str, out: str | Path) -> Contribution:
        """Write an approved entry as a proposal for a public registry, without private data.

        Args:
            key: key of the entry.
            out: output folder: a clone of that registry, or any other folder.

        Raises:
            RegistryError: the entry is not approved, or cannot be generalised to its camera model.
        """
        from calibrary.registry.contribution import contribute

        return contribute(self.snapshot, key, Path(out))

    def server(
        self,
        *,
        port: Annotated[int, Meta(ge=0, le=65_535)] = 0,
        workers: Workers = 0,
        told: Callable[[str], None] | None = None,
        progress: Progress | None = None,
    ) -> Server:
        """Return a web server for the registry's pages on this machine only; enter it, then call its ``run``.

        Args:
            port: port number; 0 for any free port.
            workers: number of processes that make the pages; 0 for one per processor.
            told: called with later messages: the pages were rebuilt, or the reason why not.
            progress: called with (pages done, number of pages, "pages").

        Raises:
            InputError: the port is in use.
            MissingExtraError: the libraries for pages are not installed.
        """
        from calibrary.extras import PAGES, require

        require(PAGES, "a site")
        from calibrary.jobs.site.server import Server

        reported = labelled(progress, "pages")
        return Server(self.place, port=port, workers=workers or None, progress=reported, told=told)

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
        from calibrary.arguments import overlay
        from calibrary.jobs.exchange.add import AddRequest, propose_file
        from calibrary.jobs.fleet.changes import ProposedChange

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
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.proposals import propose

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
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.entry import Status
        from calibrary.registry.proposals import propose_status, require_digests

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
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.editing import labelling

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
            where: conditions as for :meth:`listing`; matching entries are edited as well.
            add_tags: tags to add.
            remove_tags: tags to remove.
            approve: approve new days at once, if the check finds no error.

        Raises:
            InputError: a condition, field or value is not valid.
            RegistryError: an entry does not exist.
        """
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.editing import assigned, edit, parse_assignment, retagged

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
        from calibrary.registry.paths import unit_folder

        found = snapshot.matching(key)
        units = {unit_folder(path) for path in found}
        return found if len(units) == 1 and None not in units else [snapshot.find(key)]

    def import_units(self, file: str | Path) -> UnitsChange:
        """Propose the labels, tags and notes in a table of units; nothing is written yet.

        Args:
            file: a table in the form of :meth:`export_units`, or with the columns ``serial`` and ``label``.

        Raises:
            InputError: the file cannot be read, or is not such a table. Errors in single rows are in the result.
        """
        from calibrary.jobs.fleet.units import UnitsChange

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
        from calibrary.arguments import overlay
        from calibrary.jobs.exchange.add import AddRequest
        from calibrary.jobs.exchange.import_ import import_folder
        from calibrary.jobs.fleet.exchange import ImportResult

        request = AddRequest(
            key=overlay(camera), stated=stated or Stated(), reason=reason, approve=approve, force=force
        )
        reported = labelled(progress, "files")
        found = import_folder(self.registry, Path(folder), reading or Reading(), request, progress=reported)
        return ImportResult(self.registry, found)

    def import_catalogue(self) -> ImportResult:
        """Propose a draft entry for every camera of the catalogue for which K can be derived."""
        from calibrary.jobs.exchange.import_ import import_catalogue
        from calibrary.jobs.fleet.exchange import ImportResult

        return ImportResult(self.registry, import_catalogue(self.registry))

    def remote_named(self, word: str | None) -> tuple[str, str | None]:
        """Return the remote for a name or address, and the address if it was new and has been added as ``origin``."""
        from calibrary.registry.sync import remote_named

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
        from calibrary.registry.sync import Choice, pull

        return pull(self.registry.repo, remote, Choice(ours=ours, theirs=theirs))

    def push(self, remote: str = "origin") -> str:
        """Push the local commits; return the commit that both sides now have.

        Raises:
            ConflictError: the remote has new commits; pull first.
        """
        from calibrary.registry.git.remotes import push

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
    from calibrary.jobs.fleet.changes import NewRegistry
    from calibrary.registry.init import folder_for, init, init_from

    if remote is not None:
        return NewRegistry(init_from(remote, path or folder_for(remote), bare=bare))
    new = NewRegistry(init(path or Path(), bare=bare, starter=starter))
    if starter:
        from calibrary.jobs.exchange.import_ import import_catalogue, write_import

        write_import(new.made.registry, import_catalogue(new.made.registry))
    return new
