"""Inspection of files: format, how it was recognised, and content."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError, MissingSizeError
from calibrary.jobs.exchange.reading import read_file, read_unsized
from calibrary.jobs.images.folders import find_files
from calibrary.jobs.inspect.report import InspectedFile, InspectedTag
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
        tags: EXIF tags of an image; None if they were not requested.
        tags_left_out: number of tags left out.
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
    tags: tuple[InspectedTag, ...] | None = None
    tags_left_out: int = 0

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
            tags=self.tags,
            tags_left_out=self.tags_left_out,
        )


def inspect_files(
    given: Sequence[Path], reading: Reading, progress: Progress | None = None, *, tags: bool = False
) -> tuple[Inspected, ...]:
    """Inspect files, and all files in folders and their sub-folders, in order.

    Args:
        given: files and folders.
        reading: what the files do not state.
        progress: called with (files done, total, "files").
        tags: whether to list the EXIF tags of images instead; other files in folders are then ignored.

    Raises:
        InputError: a folder cannot be read. An unreadable file is returned with its error instead.
    """
    paths: list[Path] = []
    for one in given:
        within = find_files(one, recursive=True) if one.is_dir() else [one]
        paths += [path for path in within if not tags or path == one or parsers.is_image_file(path)]
    return tuple(_inspected(paths, _tags_of if tags else partial(_read, reading=reading), progress))


def _inspected(
    paths: Sequence[Path], read: Callable[[Path], Inspected], progress: Progress | None
) -> Iterator[Inspected]:
    for done, path in enumerate(paths, start=1):
        try:
            yield read(path)
        except CalibraryError as error:
            yield Inspected(path=path, error=str(error))
        if progress is not None:
            progress(done, len(paths), "files")


def _tags_of(path: Path) -> Inspected:
    from calibrary.parsers.imagery.tags import list_tags  # noqa: PLC0415  as in _described

    found, left_out = list_tags(path)
    tags = tuple(InspectedTag(name=name, value=value) for name, value in found.items())
    return Inspected(
        path=path, format="image", title="an image's EXIF tags", tags=tags, tags_left_out=left_out
    )


def _read(path: Path, reading: Reading) -> Inspected:
    """Read the calibrations of a file, if necessary without an image size."""
    described = _described(path, reading)
    try:
        return replace(described, calibrations=tuple(read_file(path, reading)))
    except MissingSizeError as missing:
        try:
            found = read_unsized(path, reading)
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
