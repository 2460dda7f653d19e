"""Conversion of many calibration files to one format, with a verdict for each."""

from __future__ import annotations

import glob
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError, UnknownFormatError
from calibrary.jobs.convert.report import ConvertedFile
from calibrary.jobs.exchange.reading import choose, read_file
from calibrary.jobs.images.folders import find_files
from calibrary.parsers.discovery import format_named
from calibrary.parsers.format import Format, WriteVerdict
from calibrary.parsers.plausible import refuse_implausible
from calibrary.progress import Progress
from calibrary.provenance import Grade

__all__ = ["ConvertRequest", "Converted", "convert_files"]


class ConvertRequest(Struct, frozen=True, kw_only=True):
    """Arguments of a conversion.

    Attributes:
        sources: files, folders with their sub-folders, and patterns such as ``rigs/*.yaml``.
        folder: output folder; created if needed.
        format: output format.
        reading: what the sources do not state, and which camera of several to convert.
        max_error_px: largest error of a refit; None for 0.05 px.
        allow_prior: whether to write a K that was not measured.
        force: whether to write a K that no camera can have.
    """

    sources: Sequence[Path]
    folder: Path
    format: str
    reading: Reading
    max_error_px: float | None = None
    allow_prior: bool = False
    force: bool = False


class Converted(Struct, frozen=True, kw_only=True):
    """One file to write and the result.

    Attributes:
        source: source file.
        camera: number of the camera in the source, from 1, if each camera gets its own file.
        output: written file; None if it was not written.
        verdict: how exactly it represents the calibration; None if it was not written.
        priors: grades of the calibrations with a K that was not measured.
        error: reason why it was not written.
    """

    source: Path
    camera: int | None = None
    output: Path | None = None
    verdict: WriteVerdict | None = None
    priors: tuple[Grade, ...] = ()
    error: str | None = None

    def report(self) -> ConvertedFile:
        """The result as a record for the JSON report."""
        verdict = self.verdict
        return ConvertedFile(
            source=self.source.name,
            camera=self.camera,
            output=self.output.name if self.output is not None else None,
            verdict=verdict.outcome if verdict is not None else None,
            rms_px=verdict.rms_px if verdict is not None else None,
            max_px=verdict.max_px if verdict is not None else None,
            dropped=verdict.dropped if verdict is not None else (),
            priors=self.priors,
            error=self.error,
        )


def convert_files(request: ConvertRequest, progress: Progress | None = None) -> tuple[Converted, ...]:
    """Convert all sources; if one cannot be converted, the others still are.

    In a folder, images and files of unknown format are skipped.

    Args:
        request: what to convert.
        progress: called with (files done, total, "files").

    Raises:
        InputError: the format is unknown, a source does not exist, or the folder cannot be created.
    """
    record = format_named(request.format)
    if record.write is None:
        raise InputError(f"format {record.name} is read but not written")
    sources = list(_listed(request.sources))
    try:
        request.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}", source=str(request.folder)) from None
    found: list[Converted] = []
    taken: set[Path] = set()
    for done, (path, is_named) in enumerate(sources, start=1):
        found += _converted(path, request, record, taken, is_named=is_named)
        if progress is not None:
            progress(done, len(sources), "files")
    return tuple(found)


def _listed(sources: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """The files, each with whether it was named directly or by a pattern."""
    for one in sources:
        if one.is_dir():
            yield from (
                (path, False) for path in find_files(one, recursive=True) if not parsers.is_image_file(path)
            )
        elif one.exists() or not glob.has_magic(str(one)):
            yield one, True
        else:
            matching = sorted(glob.glob(str(one), recursive=True))  # noqa: PTH207  Path.glob rejects absolute patterns
            if not matching:
                raise InputError("no file matches", source=str(one))
            yield from ((Path(path), True) for path in matching if Path(path).is_file())


def _converted(
    path: Path, request: ConvertRequest, record: Format, taken: set[Path], *, is_named: bool
) -> Iterator[Converted]:
    try:
        cameras = read_file(path, request.reading)
        if request.reading.camera is not None:
            cameras = [choose(cameras, request.reading.camera, source=path.name)]
        if not request.force:
            refuse_implausible(cameras, path.name)
    except UnknownFormatError as error:
        if is_named:
            yield Converted(source=path, error=error.message)
        return
    except CalibraryError as error:
        yield Converted(source=path, error=getattr(error, "message", str(error)))
        return
    together = len(cameras) == 1 or (record.capacity is not None and record.capacity.several_cameras)
    for number, group in enumerate([cameras] if together else [[item] for item in cameras], start=1):
        camera = None if together else number
        output = _free(request.folder, path, record, camera, taken)
        try:
            verdict = parsers.write(
                group, output, record, max_error_px=request.max_error_px, allow_prior=request.allow_prior
            )
        except CalibraryError as error:
            yield Converted(source=path, camera=camera, error=getattr(error, "message", str(error)))
            continue
        taken.add(output)
        yield Converted(source=path, camera=camera, output=output, verdict=verdict, priors=_priors(group))


def _priors(cameras: Sequence[Calibration]) -> tuple[Grade, ...]:
    return tuple(dict.fromkeys(item.grade for item in cameras if not item.grade.is_metric))


def _free(folder: Path, source: Path, record: Format, camera: int | None, taken: set[Path]) -> Path:
    """Output name derived from the source, distinct from all others of this run."""
    suffix, number = record.suffixes[0], "" if camera is None else f"-{camera}"
    names = [f"{source.stem}{number}{suffix}", f"{source.name}{number}{suffix}"]
    names += [f"{source.stem}{number}-{again}{suffix}" for again in range(2, len(taken) + 3)]
    return next(path for name in names if (path := folder / name) not in taken)
