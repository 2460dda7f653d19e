"""Inspection of files: format, how it was recognised, and content."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError, MissingSizeError
from calibrary.jobs.exchange.reading import Reading
from calibrary.jobs.images.folders import find_files
from calibrary.jobs.inspect.report import InspectedFile
from calibrary.parsers.discovery import format_named
from calibrary.parsers.plausible import why_implausible
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.progress import Progress
from calibrary.records import replace

__all__ = ["Inspected", "inspect_files"]


class Inspected(Struct, frozen=True, kw_only=True):
    """Result of inspecting one file.

    Attributes:
        path: of the file.
        format: name of the format; None if it was not recognised.
        title: of the format.
        reason: content by which the format was recognised.
        sentences: conventions of its numbers.
        calibrations: calibrations in the file.
        unsized: calibrations without an image size.
        warnings: on the calibrations.
        error: reason why the file was not read; None if it was.
    """

    path: Path
    format: str | None = None
    title: str | None = None
    reason: str | None = None
    sentences: tuple[str, ...] = ()
    calibrations: tuple[Calibration, ...] = ()
    unsized: tuple[UnsizedCalibration, ...] = ()
    warnings: tuple[str, ...] = ()
    error: str | None = None

    @property
    def implausible(self) -> tuple[str, ...]:
        """Reason for each K that no camera can have."""
        found = [item.intrinsics for item in self.calibrations] + [item.intrinsics for item in self.unsized]
        reasons = map(why_implausible, found)
        return tuple(dict.fromkeys(reason for reason in reasons if reason is not None))

    def report(self) -> InspectedFile:
        """The result as a record for the JSON report."""
        return InspectedFile(
            file=self.path.name,
            format=self.format,
            why=self.reason,
            conventions=self.sentences,
            calibrations=self.calibrations,
            unsized=self.unsized,
            implausible=self.implausible,
            warnings=self.warnings,
            error=self.error,
        )


def inspect_files(
    given: Sequence[Path], reading: Reading, progress: Progress | None = None
) -> tuple[Inspected, ...]:
    """Inspect files, and all files in folders and their sub-folders, in order.

    Args:
        given: files and folders.
        reading: what the files do not state.
        progress: called with (files done, total, "files").

    Raises:
        InputError: a folder cannot be read. An unreadable file is returned with its error instead.
    """
    paths = [path for one in given for path in (find_files(one, recursive=True) if one.is_dir() else [one])]
    return tuple(_inspected(paths, reading, progress))


def _inspected(paths: Sequence[Path], reading: Reading, progress: Progress | None) -> Iterator[Inspected]:
    for done, path in enumerate(paths, start=1):
        try:
            yield _read(path, reading)
        except CalibraryError as error:
            yield Inspected(path=path, error=str(error))
        if progress is not None:
            progress(done, len(paths), "files")


def _read(path: Path, reading: Reading) -> Inspected:
    """Read the calibrations of a file, if necessary without an image size."""
    described = _described(path, reading)
    try:
        return replace(described, calibrations=tuple(reading.read(path)))
    except MissingSizeError as missing:
        try:
            found = reading.read_unsized(path)
        except InputError as error:
            # For example a sensor size that does not fit the image sizes that were tried.
            raise missing if "--image-size" in error.message else error from None
    return replace(
        described,
        calibrations=tuple(item for item in found if isinstance(item, Calibration)),
        unsized=tuple(item for item in found if isinstance(item, UnsizedCalibration)),
    )


def _described(path: Path, reading: Reading) -> Inspected:
    """Identify the format and conventions of a file."""
    if reading.format is None and parsers.is_image_file(path):
        from calibrary.parsers.images import image_evidence  # noqa: PLC0415  not needed for calibration files

        evidence = image_evidence(path)
        warnings = [f"{dropped.tag} is not believed: {dropped.reason}" for dropped in evidence.dropped]
        warnings += [f"{c.other.tag} disagrees by {c.difference:+.1%}: {c.cause}" for c in evidence.conflicts]
        return Inspected(path=path, format="image", title="an image's metadata", warnings=tuple(warnings))
    if reading.format is not None:
        record, reason = format_named(reading.format), "you said so"
    else:
        identity = parsers.identify(path, max_bytes=reading.max_bytes)
        record, reason = identity.format, identity.sniff.reason
    sentences = record.convention.sentences() if record.convention is not None else ()
    return Inspected(
        path=path, format=record.name, title=record.title, reason=reason, sentences=tuple(sentences)
    )
