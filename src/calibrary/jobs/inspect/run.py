"""Inspecting files: what each is, by what it was recognised, and what it contains."""

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
    """One file and what came of it.

    Attributes:
        path: the file.
        format: None where it could not be recognised.
        title: of the format.
        reason: what was recognised in it.
        sentences: how its numbers count.
        calibrations: that it contains.
        unsized: those whose image size the file does not state.
        warnings: what to know of them.
        error: why it was not read; None where it was.
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
        """Why a K is that of no camera, for each that is not."""
        found = [item.intrinsics for item in self.calibrations] + [item.intrinsics for item in self.unsized]
        reasons = map(why_implausible, found)
        return tuple(dict.fromkeys(reason for reason in reasons if reason is not None))

    def report(self) -> InspectedFile:
        """For machines."""
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
    """Files, and those of folders with all below them, in their order.

    Args:
        given: files and folders.
        reading: answers to what the files leave open.
        progress: called with (files done, files in all, "files").

    Raises:
        InputError: a folder cannot be read. A file that cannot be read is one of those returned.
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
    """The file with its calibrations, or with what can be said of them without an image size."""
    described = _described(path, reading)
    try:
        return replace(described, calibrations=tuple(reading.read(path)))
    except MissingSizeError as missing:
        try:
            found = reading.read_unsized(path)
        except InputError as error:
            # Such as a sensor that the sizes tried do not fit.
            raise missing if "--image-size" in error.message else error from None
    return replace(
        described,
        calibrations=tuple(item for item in found if isinstance(item, Calibration)),
        unsized=tuple(item for item in found if isinstance(item, UnsizedCalibration)),
    )


def _described(path: Path, reading: Reading) -> Inspected:
    """What the file is and how it counts."""
    if reading.format is None and parsers.is_image_file(path):
        from calibrary.parsers.images import image_evidence  # noqa: PLC0415  which calibration files do not need

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
