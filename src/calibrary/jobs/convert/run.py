"""Conversion of calibration files to other formats, one file or many, or into a COLMAP database."""

from __future__ import annotations

import glob
from collections.abc import Iterator, Sequence
from pathlib import Path

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.atomic import write_files
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError, UnknownFormatError, UsageError
from calibrary.jobs.convert.database import DATABASE, Encode, Into, write_into_database
from calibrary.jobs.convert.report import ConvertedFile, ConvertReport
from calibrary.jobs.files import choose, read_file
from calibrary.jobs.images.folders import files_in
from calibrary.parsers.discovery import format_named
from calibrary.parsers.format import Format, WriteVerdict
from calibrary.parsers.plausible import refuse_implausible
from calibrary.parsers.writing import format_to_write
from calibrary.progress import Progress
from calibrary.records import replace

__all__ = ["convert_files", "convert_one"]


def convert_one(
    source: Path,
    output: Path,
    reading: Reading,
    *,
    to: str | None,
    into: Into,
    encode: Encode,
    force: bool,
) -> ConvertReport:
    """Convert one file; ``encode`` is on the caller's terms, the rest as of :func:`calibrary.jobs.convert.convert`."""
    cameras = _cameras(source, reading, force=force)
    record = format_named(to, output) if to is not None else parsers.format_by_suffix(output, flag="--to")
    if record.name == DATABASE:
        verdict, change, backup = write_into_database(cameras, output, into=into, encode=encode)
        changed = tuple(row[0] for row in change.after)
        found = _written(source, output, DATABASE, verdict, cameras)
        return ConvertReport(files=(replace(found, into=changed, backup=backup.name),))
    if into is not None:
        raise UsageError(
            "--into is about the cameras of a COLMAP database, which this is not", source=output.name
        )
    data, verdict = encode(cameras, record, name=output.name)
    write_files({output: data})
    return ConvertReport(files=(_written(source, output, record.name, verdict, cameras),))


def convert_files(
    sources: Sequence[Path],
    folder: Path,
    reading: Reading,
    *,
    to: str,
    encode: Encode,
    force: bool,
    progress: Progress | None,
) -> ConvertReport:
    """Convert all sources; if one cannot be converted, the others still are. Arguments as of the job.

    In a folder, images and files of unknown format are skipped.

    Raises:
        InputError: the format is unknown, a source does not exist, or the folder cannot be created.
    """
    record = format_to_write(to, "")
    listed = list(_files_of(sources))
    if not listed:
        raise InputError(
            "there are only images; give the image whose K you want, or run 'calibrary extract' on the folder",
            source=str(sources[0]),
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}", source=str(folder)) from None
    found: list[ConvertedFile] = []
    taken: set[Path] = set()
    for done, (path, is_named) in enumerate(listed, start=1):
        try:
            cameras = _cameras(path, reading, force=force)
        except CalibraryError as error:
            if is_named or not isinstance(error, UnknownFormatError):
                found.append(ConvertedFile(source=path.name, format=record.name, error=_message(error)))
        else:
            found += _converted(path, cameras, folder, record, encode, taken)
        if progress is not None:
            progress(done, len(listed), "files")
    return ConvertReport(files=tuple(found))


def _cameras(path: Path, reading: Reading, *, force: bool) -> Sequence[Calibration]:
    cameras = read_file(path, reading)
    if reading.camera is not None:
        cameras = [choose(cameras, reading.camera, source=path.name)]
    if not force:
        refuse_implausible(cameras, path.name)
    return cameras


def _message(error: CalibraryError) -> str:
    return str(getattr(error, "message", error))


def _files_of(sources: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """The files, each with whether it was named directly or by a pattern."""
    for one in sources:
        if one.is_dir():
            yield from ((path, False) for path in files_in(one) if not parsers.is_image_file(path))
        elif one.exists() or not glob.has_magic(str(one)):
            yield one, True
        else:
            matching = sorted(glob.glob(str(one), recursive=True))  # noqa: PTH207  Path.glob rejects absolute patterns
            if not matching:
                raise InputError("no file matches", source=str(one))
            yield from ((Path(path), True) for path in matching if Path(path).is_file())


def _converted(
    path: Path,
    cameras: Sequence[Calibration],
    folder: Path,
    record: Format,
    encode: Encode,
    taken: set[Path],
) -> Iterator[ConvertedFile]:
    together = len(cameras) == 1 or (record.capacity is not None and record.capacity.several_cameras)
    for number, group in enumerate([cameras] if together else [[item] for item in cameras], start=1):
        camera = None if together else number
        output = _free(folder, path, record, camera, taken)
        try:
            data, verdict = encode(group, record, name=output.name)
            write_files({output: data})
        except CalibraryError as error:
            yield ConvertedFile(source=path.name, camera=camera, format=record.name, error=_message(error))
            continue
        taken.add(output)
        yield replace(_written(path, output, record.name, verdict, group), camera=camera)


def _written(
    source: Path, output: Path, form: str, verdict: WriteVerdict, cameras: Sequence[Calibration]
) -> ConvertedFile:
    return ConvertedFile(
        source=source.name,
        output=output.name,
        format=form,
        verdict=verdict.outcome,
        rms_px=verdict.rms_px,
        max_px=verdict.max_px,
        radius_px=verdict.compared_px,
        lost_px=verdict.lost_px,
        dropped=verdict.dropped,
        priors=tuple(dict.fromkeys(item.grade for item in cameras if not item.grade.is_metric)),
    )


def _free(folder: Path, source: Path, record: Format, camera: int | None, taken: set[Path]) -> Path:
    """Output name derived from the source, distinct from all others of this run."""
    suffix, number = record.suffixes[0], "" if camera is None else f"-{camera}"
    names = [f"{source.stem}{number}{suffix}", f"{source.name}{number}{suffix}"]
    names += [f"{source.stem}{number}-{again}{suffix}" for again in range(2, len(taken) + 3)]
    return next(path for name in names if (path := folder / name) not in taken)
