"""Conversion of calibration files to other formats, one file or many, or into a COLMAP database."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.calibration import Grade
from calibrary.errors import InputError
from calibrary.jobs.convert.database import DATABASE, Into, write_into_database
from calibrary.jobs.convert.report import ConvertFilesReport, ConvertReport
from calibrary.jobs.convert.run import Converted, ConvertRequest, convert_files
from calibrary.jobs.exchange.reading import choose, read_file
from calibrary.parsers.format import WriteVerdict
from calibrary.parsers.plausible import refuse_implausible
from calibrary.progress import Progress

__all__ = ["Conversion", "Converted", "conversion_report", "convert", "convert_all"]


class Conversion(Struct, frozen=True, eq=False):
    """Result of converting one file.

    Attributes:
        output: output file.
        format: name of its format.
        verdict: how exactly it represents the calibration.
        priors: grades of the cameras with a K that was not measured.
        into: cameras that were changed, if the file existed and contains others.
        backup: file that restores the previous state.
    """

    output: Path
    format: str
    verdict: WriteVerdict
    priors: tuple[Grade, ...] = ()
    into: tuple[int, ...] = ()
    backup: Path | None = None

    def report(self) -> ConvertReport:
        """Report for machines (schemas/convert-1.schema.json)."""
        return ConvertReport(
            output=self.output.name,
            format=self.format,
            verdict=self.verdict.outcome,
            rms_px=self.verdict.rms_px,
            max_px=self.verdict.max_px,
            radius_px=self.verdict.radius_px,
            dropped=self.verdict.dropped,
            priors=self.priors,
            into=self.into,
            backup=self.backup.name if self.backup is not None else None,
        )


def convert(
    source: str | Path,
    output: str | Path,
    *,
    to: str | None = None,
    reading: Reading | None = None,
    max_error_px: float | None = None,
    allow_prior: bool = False,
    force: bool = False,
    into: Into = None,
) -> Conversion:
    """Write the calibrations of a file in another format, or into the cameras of a COLMAP database.

    Args:
        source: a file of any format, or an image.
        output: output file.
        to: output format; by default determined by the output's name.
        reading: settings for the source, and which camera to use; by default all.
        max_error_px: as for :func:`calibrary.write`.
        allow_prior: as for :func:`calibrary.write`.
        force: write the file even if K is implausible for any camera.
        into: camera numbers in a COLMAP database, "all", or None for the only possible ones.

    Raises:
        InputError: the source cannot be read, its K is implausible, the output name matches no format or several, the
            output cannot be written, or the cameras of a database are ambiguous.
        UnsupportedModelError: the format cannot represent the calibration.

    >>> from calibrary.api.conversion import convert
    >>> convert("camera.xml", "camera.yaml", to="opencv_storage").verdict.outcome
    <Fidelity.EXACT: 'exact'>
    """
    reading, output = reading or Reading(), Path(output)
    cameras = read_file(Path(source), reading)
    if reading.camera is not None:
        cameras = [choose(cameras, reading.camera, source=Path(source).name)]
    if not force:
        refuse_implausible(cameras, Path(source).name)
    priors = tuple(item.grade for item in cameras if not item.grade.is_metric)
    if to == DATABASE or (to is None and output.suffix.lower() == ".db"):
        verdict, change, backup = write_into_database(
            cameras, output, into=into, max_error_px=max_error_px, allow_prior=allow_prior
        )
        changed = tuple(row[0] for row in change.after)
        return Conversion(output, DATABASE, verdict, priors, changed, backup)
    if into is not None:
        raise InputError(
            "--into is about the cameras of a COLMAP database, which this is not", source=output.name
        )
    target = to or parsers.format_by_suffix(output, flag="--to").name
    verdict = parsers.write(cameras, output, target, max_error_px=max_error_px, allow_prior=allow_prior)
    return Conversion(output, target, verdict, priors)


def convert_all(
    sources: Sequence[str | Path],
    folder: str | Path,
    *,
    to: str,
    reading: Reading | None = None,
    max_error_px: float | None = None,
    allow_prior: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> tuple[Converted, ...]:
    """Convert many files to one format, each into a file of its own.

    Args:
        sources: files, folders with all files below them, and patterns such as ``rigs/*.yaml``.
        folder: output folder; it is created.
        to: output format.
        reading: as for :func:`convert`.
        max_error_px: as for :func:`calibrary.write`.
        allow_prior: as for :func:`calibrary.write`.
        force: as for :func:`convert`.
        progress: called with (files done, number of files, "files").

    Returns:
        The result for each file; for a file that could not be converted, the reason.

    Raises:
        InputError: the format or a file does not exist, or the folder cannot be created.
    """
    return convert_files(
        ConvertRequest(
            sources=[Path(one) for one in sources],
            folder=Path(folder),
            format=to,
            reading=reading or Reading(),
            max_error_px=max_error_px,
            allow_prior=allow_prior,
            force=force,
        ),
        progress,
    )


def conversion_report(files: Sequence[Converted]) -> ConvertFilesReport:
    """Return the results of many files as a report for machines (schemas/convert-files-1.schema.json)."""
    return ConvertFilesReport(files=tuple(one.report() for one in files))
