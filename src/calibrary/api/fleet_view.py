"""Read-only outputs of a fleet's registry: files for other programs, pages, and an audit."""

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
    """A registry for reading: queries and outputs."""

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
            folders: folders of images, with their sub-folders.
            since: skip images of earlier days.
            stale_months: age in months above which a calibration is reported.
            workers: number of processes that read images; 0 chooses it automatically.
            verify: also compare the registered K's with the pixels of one flight of each unit and date: a dozen images
                and about a minute each.
            verify_minutes: time limit in minutes, after which no further flight is verified.
            progress: called with (images read, number of images, "images"); with ``verify`` also for each flight.

        Raises:
            InputError: a folder cannot be read, or there is no image.
            MissingExtraError: ``verify`` is set and pycolmap is not installed.

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
        from calibrary.api.exchange import exported

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
        from calibrary.api.units import write_units

        return write_units(self.listing(where=where), Path(out), excel=excel)

    def lock(self, what: Sequence[str | Path] = (), *, recursive: bool = False) -> LockResult:
        """Pin entries in their current state, so that a run can be repeated with them; nothing is written yet.

        Args:
            what: KEYs, and folders of images, for the entries that apply to these; by default every usable entry.
            recursive: include sub-folders.

        Raises:
            RegistryError: an entry does not exist, or there is none to pin.
        """
        from calibrary.api.locks import locked

        return locked(self.snapshot, what, recursive=recursive)

    def write_site(
        self, out: str | Path, *, workers: int | None = None, progress: Progress | None = None
    ) -> Site:
        """Write the registry as web pages into a folder that is new, empty or an earlier site.

        Raises:
            InputError: the folder contains other files.
            MissingExtraError: the libraries for pages are not installed.
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
            out: a folder that is new, empty or an earlier publication; only changed files are written.
            key: an ssh key for signing.
            base_url: URL at which ``out`` is served; if given, the JSON Schemas are also written, with URLs below it
                as their ids.
            workers: number of processes; by default one per processor.
            progress: called with (entries done, number of entries, "entries").

        Raises:
            InputError: the folder contains other files.
            RegistryError: an entry cannot be read or must not be published.

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
        port: int = 0,
        workers: int | None = None,
        progress: Progress | None = None,
        told: Callable[[str], None] | None = None,
    ) -> Server:
        """Return a web server for the registry's pages on this machine only; enter it, then call its ``run``.

        Args:
            port: port number; 0 for any free port.
            workers: number of processes that make the pages.
            progress: called with (pages done, number of pages, "pages").
            told: called with later messages: the pages were rebuilt, or the reason why not.

        Raises:
            InputError: the port is in use.
            MissingExtraError: the libraries for pages are not installed.
        """
        require(PAGES, "a site")
        from calibrary.jobs.site.server import Server

        return Server(self.place, port=port, workers=workers, progress=labelled(progress, "pages"), told=told)
