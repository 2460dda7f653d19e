"""A fleet's registry: queries, outputs and changes.

>>> from calibrary.jobs.fleet import open_registry
>>> [entry.id for entry in open_registry("fleet").entries()]
['dji/fc6310r/5472x3648']
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import date, timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, Self, TypeAlias

from msgspec import Meta, Struct

from calibrary.arguments import (
    CameraLike,
    File,
    Folder,
    FormatName,
    Place,
    PolicyLike,
    Reading,
    Sides,
    Stated,
    Terms,
    Text,
    Workers,
    paths,
)
from calibrary.errors import RegistryError, UsageError
from calibrary.known_camera import CameraKey
from calibrary.progress import Progress, labelled
from calibrary.registry.firmware import FirmwareRange

if TYPE_CHECKING:
    from calibrary.calibration import Calibration
    from calibrary.jobs.audit.report import AuditReport
    from calibrary.jobs.diff.fleet import FleetDiffReport
    from calibrary.jobs.export.run import ExportReport
    from calibrary.jobs.fleet.changes import ProposedChange
    from calibrary.jobs.layers import Layer
    from calibrary.jobs.resolve.run import FleetAnswer
    from calibrary.jobs.site.building import Site
    from calibrary.jobs.status.run import RegistryStatus as RegistryStatus
    from calibrary.jobs.use import Allowed

    # "as": records that the methods return; the registry declares them, and commands take them from here.
    from calibrary.registry.checks import CheckDocument as CheckDocument
    from calibrary.registry.entry import Entry as Entry
    from calibrary.registry.fields import Field as Field
    from calibrary.registry.fields import FieldChange as FieldChange
    from calibrary.registry.fields import Row as Row
    from calibrary.registry.history import Approval as Approval
    from calibrary.registry.history import LoggedRevision as LoggedRevision
    from calibrary.registry.history import LogReport as LogReport
    from calibrary.registry.history import Recorded as Recorded
    from calibrary.registry.history import ShownEntry as ShownEntry
    from calibrary.registry.init import InitReport as InitReport
    from calibrary.registry.locking import Lock
    from calibrary.registry.proposals import AddedSource as AddedSource
    from calibrary.registry.proposals import ChangedEntry as ChangedEntry
    from calibrary.registry.proposals import ChangeReport as ChangeReport
    from calibrary.registry.published.write import Publication
    from calibrary.registry.query import EntryListing as EntryListing
    from calibrary.registry.registry import Registry
    from calibrary.registry.snapshot import Snapshot, StoredEntry
    from calibrary.registry.sync import EntryConflict as EntryConflict
    from calibrary.registry.sync import SyncReport as SyncReport

__all__ = ["Details", "Fleet", "create_registry", "open_registry"]

CATALOGUE: Final = "catalogue"
"""In place of a file: the cameras of the catalogue. ``./catalogue`` is a file or folder of that name."""
COMMIT: Final = re.compile("[0-9a-f]{7,40}")
LARGEST_TABLE: Final = 256 << 20
"""Bytes; a row has about 300."""
Key: TypeAlias = Annotated[str, Meta(title="KEY")]
Digest: TypeAlias = Annotated[str, Meta(title="HEX")]
Remote: TypeAlias = Annotated[str | Path, Meta(title="REMOTE")]
Conditions: TypeAlias = Annotated[str, Meta(title="CONDITIONS")]
Fields: TypeAlias = Annotated[str, Meta(title="FIELDS")]


class Details(Struct, frozen=True, kw_only=True):
    """What the entry states besides the calibration.

    Attributes:
        firmware_range: firmware versions for which it is valid, both included; you may omit either.
        notes: note for people.
        label: your name for the unit, as P4R-03; a KEY from then on.
        tags: a tag for searching; may be given several times.
    """

    firmware_range: Annotated[FirmwareRange, Meta(title="MIN..MAX")] | None = None
    notes: Sequence[Text] = ()
    label: str | None = None
    tags: Sequence[Annotated[str, Meta(title="WORD")]] = ()


class Fleet(Struct, frozen=True, eq=False, dict=True):
    """A registry. All queries are of one state, which is determined at first use and then kept.

    A change is first proposed, can be inspected, and is then written as one commit. Of a published registry only
    :meth:`resolve` and ``commit`` are there.

    Attributes:
        place: folder of the registry, or the address of a published one.
        at: a commit, tag, branch or day; None for the state that is checked out.
    """

    place: Place
    at: str | None = None

    @classmethod
    def named(
        cls,
        registry: Annotated[str | Path, Meta(title="PATH")] | None = None,
        at: Annotated[str, Meta(title="REV")] | None = None,
    ) -> Self:
        """Return a registry that is named, else the one of :func:`calibrary.registry.places.registries`.

        Args:
            registry: the registry; folder:PATH for files without git. calibrary registry --help explains the default.
            at: as it was at a commit, tag, branch or day.

        Raises:
            UsageError: the path is the address of a published registry.
            RegistryError: there is no registry. A path without a registry raises this error only at first use.
        """
        from calibrary.registry.places import one_registry

        return cls(one_registry(registry), at)

    @classmethod
    def named_or_new(cls, registry: Place | None = None) -> tuple[Self, bool]:
        """Return the registry as :meth:`named` does, or create the user's own; and whether it was created."""
        from calibrary.registry.places import default_place, one_registry, registries

        if registry is not None or registries():
            return cls(one_registry(registry)), False
        from calibrary.registry.init import init

        return cls(init(default_place()).place), True

    @property
    def is_published(self) -> bool:
        """Whether the registry is read over HTTP."""
        from calibrary.registry.places import is_published

        return is_published(str(self.place))

    @property
    def folder(self) -> Path:
        """Folder of the registry.

        Raises:
            RegistryError: it is a published one.
        """
        if self.is_published:
            raise RegistryError(
                f"{self.place}: a published registry resolves cameras, and nothing else; all else needs a clone of "
                "the registry that it was published from"
            )
        return Path(self.place)

    @cached_property
    def layer(self) -> Layer:
        """What resolves cameras: the entries of this state, or a published registry, whose root is read at once."""
        from calibrary.jobs.layers import layer_of_snapshot, open_layers

        if not self.is_published:
            return layer_of_snapshot(self.snapshot)
        [layer] = open_layers([self.place], at=self.at).layers
        layer.index_for(CameraKey())
        return layer

    @cached_property
    def snapshot(self) -> Snapshot:
        """The entries of this state; also of a plain folder, named ``folder:PATH``."""
        from calibrary.registry.places import plain_folder
        from calibrary.registry.registry import open_snapshot

        if plain_folder(self.folder) is not None:
            return open_snapshot(self.folder, self.at)
        return self.registry.snapshot(self.at)

    @cached_property
    def registry(self) -> Registry:
        """The registry in git.

        Raises:
            RegistryError: the registry is not in git.
        """
        from calibrary.registry.registry import Registry

        return Registry.open(self.folder)

    @property
    def commit(self) -> str | None:
        """Commit of this state, 40 hexadecimal digits; None for a plain folder."""
        return self.layer.commit if self.is_published else self.snapshot.commit

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
        from calibrary.jobs.layers import Layers
        from calibrary.jobs.resolve.run import resolved

        return resolved(Layers((self.layer,)), camera, stated=stated, on=on)

    def listing(
        self,
        words: Sequence[str] = (),
        *,
        statuses: Sequence[Literal["draft", "approved", "retired"]] = (),
        grades: Sequence[Literal["calibrated", "adjusted", "design", "derived"]] = (),
        where: Sequence[Conditions] = (),
        sort: Fields | None = None,
        columns: Fields | None = None,
    ) -> EntryListing:
        """List the cameras of the fleet, selected and sorted by any of their fields; by default all, by id.

        A proposal is included if its camera has no entry in use, or if drafts are asked for.

        Args:
            words: only entries with every word in their id or label.
            statuses: only entries of this status; may be given several times.
            grades: only entries of this grade; may be given several times.
            where: only entries that meet these conditions; see below.
            sort: fields to sort by, as date,-fx; - for the largest first.
            columns: fields to show, as label,fx,date.

        Raises:
            InputError: a condition or a field is not valid.

        >>> [stored.id for stored in calibrary.open_registry("fleet").listing(["fc6310r"]).entries]
        ['dji/fc6310r/5472x3648']
        """
        from calibrary.registry.query import listed

        return listed(
            self.snapshot, words, statuses=statuses, grades=grades, where=where, sort=sort, columns=columns
        )

    def show(self, key: str, *, against: Annotated[str, Meta(title="REV")] | None = None) -> ShownEntry:
        """Show an entry, now or at a revision.

        Args:
            key: an entry; KEY@REV as it was, at a commit, tag, branch, day or firmware.
            against: what changed since this revision, with Δ in px and in standard deviations.

        Raises:
            RegistryError: the entry or state does not exist, or several match.

        >>> calibrary.open_registry("fleet").show("fc6310r").status
        <Status.APPROVED: 'approved'>
        """
        from calibrary.records import replace
        from calibrary.registry.fields import differences
        from calibrary.registry.history import ShownEntry, approvals_of, recorded
        from calibrary.registry.places import plain_folder

        is_plain = plain_folder(self.folder) is not None and "@" not in key and against is None
        stored = self.snapshot.get(key) if is_plain else self.registry.get(key)
        use = self.use_of(stored)
        shown = ShownEntry(
            **stored.members, recorded=None, use=use.use.value, use_reason=use.why, stored=stored
        )
        if stored.is_pending:
            at = self.snapshot if is_plain else self.registry.snapshot(stored.commit)
            shown = replace(shown, use="none", use_reason=str(at.only_proposed(stored.path)))
        if is_plain:
            return shown
        repo = self.registry.repo
        other = f"{stored.id}@{against}" if against is not None else None
        return replace(
            shown,
            recorded=recorded(repo, stored),
            approved=approvals_of(repo, stored),
            against=other,
            changes=differences(self.registry.get(other).entry, stored.entry) if other is not None else None,
        )

    def use_of(self, stored: StoredEntry) -> Allowed:
        """Return what a solver may do with the K of an entry, as a resolution of its camera without an image says."""
        from calibrary.jobs.use import allowed
        from calibrary.registry.entry import noted

        own, policy = noted(stored.entry), self.snapshot.policy
        if stored.entry.override is None:
            return allowed(own, policy)
        # The check of a registry lets no K in against the rules of what a camera can be but by force.
        from calibrary.evidence.metadata import ImageMetadata
        from calibrary.jobs.survey import Survey, of_entry
        from calibrary.registry.resolution import Resolution

        found = Resolution(path=stored.path, entry=stored.entry, calibration=own, why="", near=())
        claim = of_entry(found, policy)
        return Survey(ImageMetadata(size=own.intrinsics.image_size), [claim], policy).weigh(claim).use

    def file(self, entry: ShownEntry) -> bytes:
        """Return the YAML of an entry, as it is in the registry."""
        from calibrary.registry.entry import Status
        from calibrary.registry.paths import proposed_name

        snapshot = self.snapshot if entry.commit is None else self.registry.snapshot(entry.commit)
        is_proposed = entry.status is Status.DRAFT
        return snapshot.read(proposed_name(entry.path) if is_proposed else entry.path)

    def history(
        self,
        key: Key | None = None,
        *,
        most: Annotated[int, Meta(ge=1)] | None = None,
    ) -> LogReport:
        """List the revisions of an entry with what changed in its K, newest first, or all commits.

        Args:
            key: an entry; for a removed one its whole id.
            most: only the newest N.

        Raises:
            RegistryError: the entry does not exist and never did.
        """
        from calibrary.registry.history import log_report

        return log_report(self.registry.history(key, most=most), key)

    def check(
        self,
        span: Annotated[str, Meta(title="REV..REV")] | None = None,
        *,
        worktree: bool = False,
        policy: PolicyLike | None = None,
        progress: Progress | None = None,
    ) -> CheckDocument:
        """Check entries against the schema, their digest, path, provenance, the policy and one another.

        Args:
            span: only what changed between two revisions.
            worktree: the files of the checkout, committed or not.
            policy: use these limits instead of those in registry.yaml.
            progress: called with (entries done, number of entries, "entries").

        Raises:
            RegistryError: a revision does not exist, or the registry cannot be listed.
            UsageError: ``worktree`` with ``span``.

        >>> calibrary.open_registry("fleet").check().is_good
        True
        """
        from calibrary.jobs.survey.known import contradictions
        from calibrary.policy_file import policy_of
        from calibrary.registry import checks

        if worktree and span is not None:
            raise UsageError("--worktree looks at files: it does not go with REV..REV")
        limits, reported = policy_of(policy) if policy is not None else None, labelled(progress, "entries")
        before, after = checks.parse_range(span) if span is not None else (None, None)
        if worktree:
            done = checks.check_work_tree(self.snapshot, limits, contradictions, progress=reported)
        elif before is None:
            done = checks.check_all(self.snapshot, limits, contradictions, progress=reported)
        else:
            done = checks.check_range(self.snapshot, before, after, limits, contradictions, progress=reported)
            from calibrary.jobs.fleet.changes import with_material_changes_of_range

            policy_used = limits or self.snapshot.policy
            done = with_material_changes_of_range(done, self.snapshot, policy_used)
        return done

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
            from calibrary.jobs.audit.told import told

            write_page(place, told(done))
        return done

    def status(
        self,
        folders: Folder | Sequence[Folder] = (),
        *,
        within_days: Annotated[int, Meta(ge=0, le=3650)] = 30,
        stale_after_months: Annotated[int, Meta(ge=1, le=1200)] = 24,
        published: Annotated[str | Path, Meta(title="PLACE")] | None = None,
        workers: Workers = 0,
        progress: Progress | None = None,
    ) -> RegistryStatus:
        """Return what waits: proposals and for whom, what runs out, statements without effect, the published copy.

        Args:
            folders: folders of recent images: also tell what an audit finds there, as units without an entry and drift.
            within_days: tell what ends within so many days.
            stale_after_months: age from which a measured calibration is to be repeated.
            published: address or folder of the published copy, whose age is told.
            workers: number of processes that read images; 0 chooses it.
            progress: called with (images read, number of images, "images").

        Raises:
            InputError: a folder cannot be read.
            RegistryError: the registry cannot be read.

        >>> [matter.what for matter in calibrary.open_registry("fleet").status().matters]
        []
        """
        from calibrary.jobs.status.run import copy_matter, status

        given = paths(folders)
        audited = (
            self.audit(given, stale_after_months=stale_after_months, workers=workers, progress=progress)
            if given
            else None
        )
        horizon = date.today() + timedelta(days=within_days)
        return status(
            self.snapshot,
            within_days=within_days,
            stale_after_months=stale_after_months,
            audited=audited,
            copy=copy_matter(self.snapshot, str(published), horizon) if published is not None else None,
        )

    def export(
        self,
        out: Annotated[str | Path, Meta(title="FILE|DIR")],
        *,
        to: FormatName | None = None,
        statuses: Sequence[Literal["draft", "approved", "retired"]] = ("approved",),
        max_error_px: Annotated[float, Meta(ge=0)] | None = None,
        drop_distortion: bool = False,
    ) -> ExportReport:
        """Write all entries in a form that another program reads, and report how exactly it represents them.

        Args:
            out: file to write; a folder if each entry gets its own file.
            to: csv, yaml (the entries' files as one stream), or any format or program that calibrary formats lists as
                written (default: by the name of the file).
            statuses: only entries of this status; may be given several times (default: approved).
            max_error_px: largest difference in px that may remain anywhere in the image (default: 0.05).
            drop_distortion: write K alone if the format has no place for a distortion, and an unknown distortion as
                none if the format always states one.

        Raises:
            InputError: there is nothing to write, or the output cannot be written.

        >>> [one.entry for one in calibrary.open_registry("fleet").export("cameras.json", to="odm").written]
        ['dji/fc6310r/5472x3648']
        """
        from calibrary.jobs.export.run import export

        return export(
            self.snapshot,
            to,
            Path(out),
            statuses=statuses,
            max_error_px=max_error_px,
            drop_distortion=drop_distortion,
        )

    def write_table(self, out: File, *, where: Sequence[Conditions] = ()) -> int:
        """Write the entries as a table for a spreadsheet, one row each; return their number.

        Label, tags and notes may be edited and taken back with :meth:`propose_edit`; no cell is a formula.

        Args:
            out: write the entries as a table to this file, for a spreadsheet.
            where: only entries that meet these conditions; see below.

        Raises:
            InputError: the file cannot be written.
        """
        from calibrary.atomic import write_files
        from calibrary.registry.editing import units_csv

        listing = self.listing(where=where)
        if listing.unreadable:
            raise listing.unreadable[0]
        write_files({Path(out): units_csv(listing.entries)})
        return len(listing.entries)

    def lock(
        self,
        what: Sequence[Annotated[str | Path, Meta(title="IMAGE_DIR|KEY")]] = (),
        *,
        out: File = "calibrary.lock",
        recursive: bool = False,
    ) -> Lock:
        """Pin entries as they are now in a file, so that a run can be repeated on the same ones.

        Args:
            what: KEYs, and folders of images, for the entries that apply to these (default: every usable entry).
            out: the lock file.
            recursive: go into the sub-folders of folders of images.

        Raises:
            RegistryError: an entry does not exist, or there is none to pin.
            InputError: the file cannot be written.
        """
        from calibrary.atomic import write_files
        from calibrary.records import replace
        from calibrary.registry.locking import lock_yaml, pinned, usable_paths
        from calibrary.registry.paths import file_path, single_match

        snapshot = self.snapshot
        unanswered: list[str] = []
        pins: list[str] = [] if what else usable_paths(snapshot, unanswered)
        for one in what:
            if Path(one).is_dir():
                from calibrary.jobs.extract.knowledge import flight_entries

                found, without = flight_entries(snapshot, Path(one), recursive=recursive)
                pins += found
                unanswered += without
            else:
                pins.append(file_path(single_match(snapshot.matching(str(one)), snapshot.cameras, str(one))))
        if not pins:
            waiting = snapshot.all_proposed() or "'calibrary registry add FILE' proposes one"
            why = unanswered[0] if unanswered and not what else f"none is approved; {waiting}"
            raise RegistryError(f"no entry to pin: {why}")
        lock = replace(pinned(snapshot, pins), unanswered=tuple(unanswered))
        write_files({Path(out): lock_yaml(lock)})
        return lock

    def write_site(
        self,
        out: Folder = "site",
        *,
        workers: Workers = 0,
        progress: Progress | None = None,
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
        return build(
            self.folder,
            Path(out),
            workers=workers,
            progress=labelled(progress, "pages"),
        )

    def publish(
        self,
        out: Folder,
        *,
        site: bool = False,
        base_url: Annotated[str, Meta(title="URL")] | None = None,
        sign: Annotated[str | Path, Meta(title="KEY")] | None = None,
        valid_days: Annotated[int, Meta(ge=1, le=3650)] = 90,
        workers: Workers = 0,
        progress: Progress | None = None,
    ) -> Publication:
        """Write the registry as static files, from which programs resolve cameras over HTTP.

        Args:
            out: a folder that is new, empty or an earlier publication; only changed files are written.
            site: also write the pages for people into the folder, as a site has them.
            base_url: URL at which the folder is served: also write the JSON Schemas of the files, with URLs there
                as their ids.
            sign: an ssh key to sign with, as ssh-keygen takes it; then readers accept nothing else at this address.
            valid_days: days until readers refuse what is written, unless it is published again.
            workers: number of processes for the pages; 0 for one per processor.
            progress: called with (entries done, number of entries, "entries"); then for the pages.

        Raises:
            InputError: the folder contains other files.
            RegistryError: an entry cannot be read or must not be published, or the keys are not those of the folder.
            MissingExtraError: with ``site``, the libraries for pages are not installed.

        >>> calibrary.open_registry("fleet").publish("public").entries
        1
        """
        from calibrary.extras import PAGES, require
        from calibrary.registry.published.write import publish

        if site:
            require(PAGES, "publishing with pages")

        done = publish(
            self.snapshot,
            Path(out),
            sign=Path(sign) if sign is not None else None,
            valid_days=valid_days,
            base_url=base_url,
            progress=labelled(progress, "entries"),
        )
        if site:
            self.write_site(out, workers=workers, progress=progress)
        return done

    def propose(
        self,
        source: Annotated[str | Path, Meta(title="FILE|DIR")],
        *,
        reading: Reading | None = None,
        camera: CameraLike | None = None,
        stated: Stated | None = None,
        details: Details | None = None,
        terms: Terms | None = None,
        progress: Progress | None = None,
    ) -> ProposedChange:
        """Put the cameras of a calibration file, an image or an entry's file into the registry; or all of a folder.

        Nothing is written before :meth:`ProposedChange.write`.

        Args:
            source: a file of any format, an image, or an entry's YAML; a folder, for every calibration file below it;
                or the word catalogue, for every known camera with a K that can be derived.
            reading: settings for the files, and which camera to use.
            camera: facts about the camera that a file does not state or states wrongly.
            stated: how it was calibrated, if a file does not state it.
            details: what the entries state besides.
            terms: on what terms the registry changes.
            progress: called with (files read, number of files, "files"), of a folder.

        Raises:
            InputError: the file cannot be read, the camera is unknown, or its K is only an estimate. A file of a folder
                that cannot be added is one of the result's sources.
            RegistryError: the folder cannot be read.
            UsageError: the catalogue does not take what is stated.

        >>> camera = calibrary.CameraKey(make="DJI", model="FC6310R")
        >>> change = calibrary.open_registry("fleet").propose("camera.xml", camera=camera)
        >>> [(one.id, one.is_new) for one in change.proposals.items]
        [('dji/fc6310r/5472x3648', False)]
        """
        from calibrary.catalogue import overlay
        from calibrary.jobs.fleet.adding import Said, add_catalogue, add_file, add_folder
        from calibrary.jobs.fleet.changes import ProposedChange

        terms, file = terms or Terms(), Path(source)
        if str(source) == CATALOGUE:
            _check_catalogue(camera, stated, details, terms)
            return ProposedChange(self.registry, add_catalogue(self.registry, terms), terms)
        said = Said(
            reading=reading or Reading(),
            camera=overlay(camera),
            stated=stated or Stated(),
            details=details or Details(),
            terms=terms,
        )
        if file.is_dir():
            found = add_folder(self.registry, file, said, progress=labelled(progress, "files"))
            return ProposedChange(self.registry, found, terms)
        return ProposedChange(self.registry, add_file(self.registry, file, said), terms, file)

    def propose_entries(self, entries: Entry | Sequence[Entry], terms: Terms | None = None) -> ProposedChange:
        """Propose entries in one change, such as those of a rig, checked against the current ones.

        Args:
            entries: one or several.
            terms: on what terms the registry changes; an entry keeps its own days.
        """
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.entry import Entry
        from calibrary.registry.proposals import propose

        terms, given = terms or Terms(), [entries] if isinstance(entries, Entry) else [*entries]
        return ProposedChange(self.registry, propose(self.registry.branch(terms.branch), given, terms), terms)

    def propose_approval(
        self,
        keys: Sequence[Key] = (),
        *,
        source: Annotated[str, Meta(title="BRANCH")] | None = None,
        digests: Sequence[Digest] = (),
        terms: Terms | None = None,
    ) -> ProposedChange:
        """Approve proposals, so that runs use them: all of those named, or none if the check reports an error for one.

        :meth:`ProposedChange.write` writes exactly the returned change; it fails if a proposal has changed since.

        Args:
            keys: make/model[/variant], as short as it is unambiguous; KEY@COMMIT is the proposal of that commit only.
            source: approve the proposals of this branch, into the branch in use; without a KEY all of them.
            digests: approve the proposal whose digest begins with these digits; give it once for each KEY.
            terms: on what terms the registry changes.

        Raises:
            RegistryError: an entry does not exist, or a proposal differs from the reviewed one.
            UsageError: there is neither a KEY nor a branch.
        """
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.proposals import propose_approvals, require_digests

        terms = terms or Terms()
        if not keys:
            keys = self._proposed_on(source)
        names, seen = self._looked_at(keys)
        now, there = self.registry.snapshot(), self.registry.snapshot(source)
        proposals = propose_approvals(now, there, names, terms)
        require_digests(proposals, (*digests, *seen))
        return ProposedChange(self.registry, proposals, terms)

    def rules(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Return what registry.yaml asks for, and what is in force, each as text, with git's id of registry.yaml.

        Raises:
            RegistryError: the registry has no registry.yaml.
        """
        from calibrary.registry.rules import rules_text, stated_rules

        asked, oid = stated_rules(self.registry)
        return (rules_text(asked), oid), (rules_text(self.registry.snapshot().book.rules), "")

    def approve_rules(self, digest: str, reason: Text | None = None) -> ChangeReport:
        """Put in force what registry.yaml asks for: people, their keys, and whose approval an entry takes.

        Args:
            digest: beginning of git's id of the registry.yaml that was looked at.
            reason: why, for the history.

        Raises:
            RegistryError: registry.yaml is another one, its rules cannot be in force, or this approval does not count.
        """
        from calibrary.registry.rules import approve_rules

        return approve_rules(self.registry, digest, reason)

    def propose_retirement(
        self,
        keys: Sequence[Key],
        reason: Text,
        *,
        superseded_by: Key | None = None,
        start: date | None = None,
        digests: Sequence[Digest] = (),
    ) -> ProposedChange:
        """Stop using entries. Their files and history stay.

        Args:
            keys: make/model[/variant], as short as it is unambiguous.
            reason: why; kept in the entry and its history.
            superseded_by: the entry that replaces it; that entry records this.
            start: only for images from this day on, as when a unit was sold; those of the days before keep their K.
            digests: only if the entry's file has the digest that begins so; give it once for each KEY.

        Raises:
            RegistryError: an entry does not exist, differs from the one that was looked at, or the other one supersedes
                another already.
        """
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.proposals import propose_retirements, require_digests

        proposals = propose_retirements(
            self.registry.snapshot(), keys, reason, successor=superseded_by, start=start
        )
        require_digests(proposals, digests)
        return ProposedChange(self.registry, proposals, Terms(reason=reason))

    def propose_edit(
        self,
        keys: Sequence[str] = (),
        changes: Sequence[str] = (),
        *,
        where: Sequence[Conditions] = (),
        table: File | None = None,
        terms: Terms | None = None,
    ) -> ProposedChange:
        """Set labels, tags, notes or days of one entry or of many, in one commit; K is never changed.

        Labels, tags and notes are changed in the entry itself. New days become a proposal, unless the terms approve.

        Args:
            keys: keys of entries; the key of a unit is for all its entries, and so is a label.
            changes: such as "label=P4R-03", "+survey", "-spare", "notes=spare lens", "valid-until=2026-05-01".
            where: only entries that meet these conditions; see below.
            table: take labels, tags and notes from this table: one that was written here, or one with the columns
                serial and label.
            terms: on what terms the registry changes.

        Raises:
            InputError: a condition, field or value is not valid, or the table cannot be read. Errors in single rows of
                a table are in the result.
            RegistryError: an entry does not exist, or a key is of several units.
            UsageError: nothing is set, it is not stated of which entries, or a table goes with neither.
        """
        from calibrary.jobs.fleet.changes import ProposedChange
        from calibrary.registry.editing import edit_by_table, edit_keys, parse_assignment

        if table is not None:
            if keys or changes or where:
                raise UsageError(
                    "a table says itself which entries get what; leave out KEY, FIELD=VALUE and --where"
                )
            from calibrary.parsers.files import read_regular_file

            data = read_regular_file(Path(table), max_bytes=LARGEST_TABLE)
            found = edit_by_table(self.registry.snapshot(), data, str(table))
            return ProposedChange(self.registry, found, terms or Terms())
        if not changes:
            raise UsageError("expected FIELD=VALUE, +TAG or -TAG")
        if not (keys or where):
            raise UsageError("say of which entries: KEY, or --where CONDITIONS")
        terms, said = terms or Terms(), [parse_assignment(text) for text in changes]
        selected = self.listing(where=where).chosen.paths if where else ()
        proposals = edit_keys(self.registry.snapshot(), keys, said, terms, paths=selected)
        return ProposedChange(self.registry, proposals, terms)

    def _proposed_on(self, branch: str | None) -> list[str]:
        """Return the ids of all that a branch proposes; errors as of :meth:`propose_approval`."""
        from calibrary.registry.paths import id_of
        from calibrary.registry.pending import pending

        if branch is None:
            raise UsageError("say what to approve: KEY, or --from BRANCH for all that a branch proposes")
        self.registry.snapshot(branch)
        found = [id_of(one.path) for one in pending(self.registry.snapshot(), of=branch) if one.branch]
        if not found:
            raise RegistryError(f"the branch {branch} proposes nothing that is not here already")
        return found

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
                seen.append(self.registry.snapshot(rev).filed(name).oid or "")
        return names, tuple(seen)

    def sync(
        self,
        remote: Remote | None = None,
        *,
        sides: Sides | None = None,
        removed: Literal["drop", "keep"] | None = None,
        propose: bool = False,
        told: Callable[[str], None] | None = None,
    ) -> SyncReport:
        """Fetch the commits of others, put your own on top and send them: both sides have the same commits.

        Args:
            remote: a remote's name or address (default: origin); a new address is saved as origin.
            sides: which version counts of an entry that both sides changed.
            removed: what becomes of commits that the remote had and, rewritten, no longer has.
            propose: move your commits to a branch and send that for review, as a protected branch needs it.
            told: called with a message that an address was saved.

        Returns:
            What was done. If both sides changed an entry and no side was chosen, or the remote was rewritten and it is
            not said what becomes of the commits that it lost, nothing: the result has all of them. If the commits of
            others came but your own could not be sent, it says why.

        Raises:
            UsageError: a proposal is to decide about commits of the remote, which it does not touch.
            RegistryError: the remote cannot be reached; nothing was changed.
        """
        from calibrary.registry.sync import propose as proposed
        from calibrary.registry.sync import sync

        if propose and (sides is not None or removed is not None):
            raise UsageError(
                "--propose takes no --ours, --theirs or --removed: nothing is put on top of theirs"
            )
        repo, name = self.registry.repo, self._remote(remote, told)
        return proposed(repo, name) if propose else sync(repo, name, sides, removed)

    def _remote(self, word: str | Path | None, told: Callable[[str], None] | None) -> str:
        """The remote that a name or address means; a new address is saved as ``origin``."""
        from calibrary.registry.sync import remote_named

        name, saved = remote_named(self.registry.repo, str(word) if word is not None else None)
        if saved is not None and told is not None:
            told(f"{name} is {saved} from now on")
        return name


def open_registry(path: str | Path, *, at: str | None = None) -> Fleet:
    """Open a fleet's registry.

    Args:
        path: a registry in git, bare or checked out, read as committed; "folder:PATH" reads the files as they are;
            the https:// address of a published registry, which only resolves cameras.
        at: a commit, tag, branch or day; by default the state that is checked out.

    Raises:
        RegistryError: there is no registry, or no such state.

    >>> fleet = calibrary.open_registry("fleet")
    >>> [entry.id for entry in fleet.entries()]
    ['dji/fc6310r/5472x3648']
    """
    fleet = Fleet(path, at)
    _ = fleet.layer if fleet.is_published else fleet.snapshot
    return fleet


def create_registry(
    path: Folder | None = None,
    *,
    remote: Annotated[str, Meta(title="URL")] | None = None,
    bare: bool = False,
    migrate: bool = False,
) -> InitReport:
    """Create a registry of camera calibrations in git, or copy one, or bring one of the former layout to this one.

    Args:
        path: folder of the registry (default: this folder, or for a copy the last part of its address).
        remote: copy this registry: https://, ssh://, user@host:path, or a folder.
        bare: without a work tree, for a server.
        migrate: bring the registry that is there from the former layout to this one, in one commit.

    Raises:
        RegistryError: the folder already contains a registry or other files, or the address cannot be reached.
    """
    from calibrary.registry.init import folder_for, init, init_from, migrated

    if migrate:
        if remote is not None or bare:
            raise UsageError("--migrate goes with neither --remote nor --bare")
        return migrated(Path(path or ""))
    if remote is not None:
        return init_from(remote, Path(path) if path else folder_for(remote), bare=bare)
    return init(Path(path or ""), bare=bare)


def _check_catalogue(
    camera: CameraLike | None, stated: Stated | None, details: Details | None, terms: Terms
) -> None:
    """Refuse what the catalogue's entries do not take."""
    refused = {
        "the catalogue's entries are drafts: 'calibrary registry approve KEY' decides on each": terms.approve,
        "the catalogue says which camera each entry is of; leave out --make and the like": camera,
        "the catalogue says where each entry is from; leave out --date and the like": stated,
        "the catalogue's entries have no label, tags, notes, firmware or days": details
        or terms.valid_from
        or terms.valid_until,
        "the catalogue's entries contradict nothing; leave out --force": terms.force,
    }
    for why, is_given in refused.items():
        if is_given:
            raise UsageError(why)
