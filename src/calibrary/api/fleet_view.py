"""What is made of a fleet's registry: files for other programs, pages, and an audit; nothing here changes it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.api.fleet_answers import FleetAnswers
from calibrary.extras import PAGES, require
from calibrary.progress import Progress, labelled

if TYPE_CHECKING:
    from calibrary.api.exchange import AuditResult, ExportResult
    from calibrary.api.locks import LockResult
    from calibrary.jobs.site.building import Site
    from calibrary.jobs.site.server import Server
    from calibrary.registry.contribution import Contribution
    from calibrary.registry.published.write import Publication

__all__ = ["FleetView"]


class FleetView(FleetAnswers, frozen=True, eq=False):
    """A registry that is read: its answers, and what is made of them."""

    def audit(
        self,
        folders: Sequence[str | Path],
        *,
        since: date | None = None,
        stale_months: int = 24,
        workers: int = 0,
        verify: bool = False,
        verify_minutes: float = 15,
        progress: Progress | None = None,
    ) -> AuditResult:
        """Compare the registry with images of recent flights.

        Args:
            folders: of images, with their sub-folders.
            since: leave out images of earlier days.
            stale_months: age from which a calibration is a finding.
            workers: processes that read images; 0 decides by itself.
            verify: hold the registered K's against the pixels of one flight of each unit and date as well, a dozen
                images and about a minute each.
            verify_minutes: after which no other flight is looked at.
            progress: called with (images read, images in all, "images"); to verify also of each flight.

        Raises:
            InputError: a folder cannot be read, or there is no image.
            MissingExtraError: the pixels are to be looked at, and pycolmap is not installed.

        >>> [finding.rule for finding in calibrary.open_registry("fleet").audit(["survey"]).findings]
        [<Rule.UNDATED: 'calibration date unknown'>]
        """
        from calibrary.api.exchange import audited

        return audited(
            self.snapshot,
            folders,
            since=since,
            stale_months=stale_months,
            workers=workers,
            verify=verify,
            verify_minutes=verify_minutes,
            progress=progress,
        )

    def export(
        self,
        format: str,  # noqa: A002  as in calibrary.read
        out: str | Path,
        *,
        statuses: Collection[str] = ("approved", "held"),
        max_error_px: float | None = None,
    ) -> ExportResult:
        """Write all entries in the form that another program reads.

        Args:
            format: csv, yaml, odm, opensfm, colmap, or the name of any format that is written.
            out: a file; a folder for a file each.
            statuses: of the entries.
            max_error_px: largest error from a distortion model that the format lacks; 0.05 when not given.

        Raises:
            InputError: there is nothing to write, or it cannot be written.

        >>> [one.entry for one in calibrary.open_registry("fleet").export("odm", "cameras.json").export.written]
        ['dji/fc6310r/5472x3648']
        """
        from calibrary.api.exchange import exported

        return exported(self.snapshot, format, Path(out), statuses, max_error_px)

    def export_units(self, out: str | Path, *, where: Sequence[str] = (), excel: bool = False) -> int:
        """Write the entries as a table for a spreadsheet, a row each; how many there are.

        Args:
            out: the CSV file.
            where: conditions as of :meth:`listing`; all entries when not given.
            excel: as Excel reads it where the comma is the decimal sign.

        Raises:
            InputError: it cannot be written.
        """
        from calibrary.api.units import write_units

        return write_units(self.listing(where=where), Path(out), excel=excel)

    def lock(self, what: Sequence[str | Path] = (), *, recursive: bool = False) -> LockResult:
        """Pin entries as they are, so that a run can be repeated on the same ones; nothing is written yet.

        Args:
            what: KEYs, and folders of images for the entries that apply to these; every usable entry if empty.
            recursive: go into the folders' sub-folders.

        Raises:
            RegistryError: there is no such entry, or none to pin.
        """
        from calibrary.api.locks import locked

        return locked(self.snapshot, what, recursive=recursive)

    def write_site(
        self, out: str | Path, *, workers: int | None = None, progress: Progress | None = None
    ) -> Site:
        """Write the registry as web pages into a folder that is new, empty or an earlier site.

        Raises:
            InputError: the folder holds something else.
            MissingExtraError: what draws pages is not installed.
        """
        require(PAGES, "a site")
        from calibrary.jobs.site.building import build
        from calibrary.jobs.site.place import check_out

        check_out(Path(out))
        return build(self.place, Path(out), workers=workers, progress=labelled(progress, "pages"))

    def publish(
        self,
        out: str | Path,
        *,
        key: str | Path | None = None,
        base_url: str | None = None,
        workers: int | None = None,
        progress: Progress | None = None,
    ) -> Publication:
        """Write the registry as static files, from which programs resolve cameras over HTTP.

        Args:
            out: a folder that is new, empty or an earlier publication; only what changed is written.
            key: an ssh key to sign it with.
            base_url: where ``out`` is served; the JSON Schemas are written too then, with URLs there as their ids.
            workers: processes; one for each processor when not given.
            progress: called with (entries done, entries in all, "entries").

        Raises:
            InputError: the folder contains something else.
            RegistryError: an entry cannot be read or may not be published.

        >>> calibrary.open_registry("fleet").publish("public").entries
        1
        """
        from calibrary.registry.published.write import publish

        signer = Path(key) if key is not None else None
        reported = labelled(progress, "entries")
        return publish(
            self.snapshot, Path(out), key=signer, base_url=base_url, workers=workers, progress=reported
        )

    def contribute(self, key: str, out: str | Path) -> Contribution:
        """Write an approved entry as a proposal for a public registry, without what is private.

        Args:
            key: of the entry.
            out: the folder: a clone of that registry, or any other.

        Raises:
            RegistryError: it is not approved, or it cannot be said of its model.
        """
        from calibrary.registry.contribution import contribute

        return contribute(self.snapshot, key, Path(out))

    def server(
        self,
        *,
        port: int = 0,
        workers: int | None = None,
        progress: Progress | None = None,
        told: Callable[[str], None] | None = None,
    ) -> Server:
        """A web server for the registry's pages, for this machine only; enter it, then call its ``run``.

        Args:
            port: 0 for any that is free.
            workers: processes that make the pages.
            progress: called with (pages done, pages in all, "pages").
            told: called with what happens later: that pages were rebuilt, or the reason that they were not.

        Raises:
            InputError: the port is taken.
            MissingExtraError: what draws pages is not installed.
        """
        require(PAGES, "a site")
        from calibrary.jobs.site.server import Server

        return Server(self.place, port=port, workers=workers, progress=labelled(progress, "pages"), told=told)
