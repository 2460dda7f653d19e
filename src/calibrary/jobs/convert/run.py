"""Conversion of calibration files to other formats, one file or many, or into a COLMAP database."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from calibrary import parsers
from calibrary.admission import admission, refuse_implausible
from calibrary.arguments import Reading
from calibrary.atomic import write_files
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, InputError, UnknownFormatError, UsageError
from calibrary.interop.colmap_database import (
    DatabaseChange,
    DatabaseRows,
    change_of,
    read_database,
    write_database,
)
from calibrary.jobs.files import choose, read_file
from calibrary.jobs.images.folders import files_in
from calibrary.parsers.discovery import format_named
from calibrary.parsers.format import Fidelity, Format, WriteVerdict, in_words
from calibrary.parsers.writing import format_to_write
from calibrary.progress import Progress
from calibrary.provenance import Grade
from calibrary.records import Record, replace


class ConvertedFile(Record):
    """One file that was written, or could not be.

    Attributes:
        source: name of the source file.
        camera: number of the camera in the source, from 1, if each camera gets its own file.
        output: name of the written file; None if it was not written.
        format: its format.
        verdict: how exactly it represents the calibration; None if it was not written, as the numbers below.
        rms_px: RMS difference of the projections, for the worst camera.
        max_px: largest difference of the projections.
        radius_px: distance from the principal point up to which the difference was measured; None for the whole image.
        lost_px: how far the distortion that the file lacks moves pixels, at most.
        dropped: what the format cannot represent.
        unlikely: why the K is hardly a camera's; None if nothing speaks against it.
        priors: grades of the calibrations with a K that was not measured.
        into: the changed cameras, if the output is an existing file with several cameras.
        backup: name of the file that restores the previous content.
        error: reason why it was not written; None if it was.
    """

    source: str
    format: str
    camera: int | None = None
    output: str | None = None
    verdict: Fidelity | None = None
    rms_px: float | None = None
    max_px: float | None = None
    radius_px: float | None = None
    lost_px: float | None = None
    dropped: tuple[str, ...] = ()
    unlikely: str | None = None
    priors: tuple[Grade, ...] = ()
    into: tuple[int, ...] = ()
    backup: str | None = None
    error: str | None = None

    def __str__(self) -> str:
        if self.verdict is None:
            return f"refused: {self.error}"
        told = in_words(
            self.verdict,
            self.rms_px or 0.0,
            self.max_px or 0.0,
            self.radius_px,
            self.dropped,
            self.lost_px or 0.0,
        )
        return told if self.unlikely is None else f"{told}, of a K that is unlikely: {self.unlikely}"


class ConvertReport(Record, tag_field="schema", tag="calibrary/convert-2"):
    """All converted files, and those that could not be converted.

    Attributes:
        files: in reading order.
    """

    files: tuple[ConvertedFile, ...]

    @property
    def is_good(self) -> bool:
        """Whether there is a file and every file was written."""
        return bool(self.files) and all(one.error is None for one in self.files)

    @property
    def is_likely(self) -> bool:
        """Whether every K that was written is likely a camera's."""
        return all(one.unlikely is None for one in self.files)


def convert_one(
    source: Path,
    output: Path,
    reading: Reading,
    *,
    to: str | None,
    into: Into,
    encode: Encode,
    reframed: Reframe,
    force: bool,
) -> ConvertReport:
    """Convert one file; ``encode`` and ``reframed`` are the caller's, the rest is as of the job."""
    cameras = _cameras(source, reading, reframed, force=force)
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
    reframed: Reframe,
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
            cameras = _cameras(path, reading, reframed, force=force)
        except CalibraryError as error:
            if is_named or not isinstance(error, UnknownFormatError):
                found.append(ConvertedFile(source=path.name, format=record.name, error=_message(error)))
        else:
            found += _converted(path, cameras, folder, record, encode, taken)
        if progress is not None:
            progress(done, len(listed), "files")
    return ConvertReport(files=tuple(found))


def _cameras(path: Path, reading: Reading, reframed: Reframe, *, force: bool) -> Sequence[Calibration]:
    cameras = read_file(path, reading)
    if reading.camera is not None:
        cameras = [choose(cameras, reading.camera, source=path.name)]
    if not force:
        refuse_implausible(cameras, path.name)
    return [reframed(camera) for camera in cameras]


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
        unlikely=next((one.message for one in map(admission, cameras) if one is not None), None),
        priors=tuple(dict.fromkeys(item.grade for item in cameras if not item.grade.is_metric)),
    )


def _free(folder: Path, source: Path, record: Format, camera: int | None, taken: set[Path]) -> Path:
    """Output name derived from the source, distinct from all others of this run."""
    suffix, number = record.suffixes[0], "" if camera is None else f"-{camera}"
    names = [f"{source.stem}{number}{suffix}", f"{source.name}{number}{suffix}"]
    names += [f"{source.stem}{number}-{again}{suffix}" for again in range(2, len(taken) + 3)]
    return next(path for name in names if (path := folder / name) not in taken)


DATABASE: Final = "colmap_database"
FILE_FORMAT: Final = "colmap_binary"
"""Format with the same camera models as the database; used to measure how exactly they represent a calibration."""
MODEL: Final = "colmap/model"
LISTED: Final = 12

Encode: TypeAlias = Callable[..., tuple[bytes, WriteVerdict]]
Reframe: TypeAlias = Callable[[Calibration], Calibration]
Into = Sequence[int] | str | None
"""Camera numbers in the database, "all", or None to choose them if the choice is unambiguous."""


def write_into_database(
    calibrations: Sequence[Calibration],
    path: Path,
    *,
    into: Into = None,
    encode: Encode = parsers.encode,
) -> tuple[WriteVerdict, DatabaseChange, Path]:
    """Replace models and parameters of cameras in a database; the images keep their cameras.

    Args:
        calibrations: one for all chosen cameras, or one for each.
        path: of the database, which contains images.
        into: the chosen cameras.
        encode: :func:`calibrary.parsers.encode` on the caller's terms; the focal length of a K that was not measured is
            marked as unknown.

    Returns:
        How exactly COLMAP represents the calibrations, the change, and the SQL file next to the database that
        restores the old rows.

    Raises:
        InputError: the database does not exist or is locked, the choice of cameras is ambiguous, an image size
            differs, or a K was not measured.
        UnsupportedModelError: no COLMAP model is close enough.
    """
    stored = read_database(path)
    data, verdict = encode(calibrations, FILE_FORMAT)
    copies = parsers.decode(data, name=path.name, format=FILE_FORMAT)
    held = [item.to_colmap(dict(item.extras).get(MODEL)) for item in copies]
    known = all(item.grade.is_metric for item in calibrations)
    numbers = _numbers(calibrations, stored, into, path)
    change = change_of(path, stored, {number: held[index] for number, index in numbers.items()}, known=known)
    backup = _free_backup(path)
    write_files({backup: change.restore})
    try:
        write_database(change)
    except InputError:
        backup.unlink(missing_ok=True)
        raise
    return verdict, change, backup


def _numbers(
    calibrations: Sequence[Calibration], stored: DatabaseRows, into: Into, path: Path
) -> Mapping[int, int]:
    """Index of the calibration for each camera number of the database."""
    if isinstance(into, str):
        chosen: Sequence[int] | None = tuple(stored.cameras)
    else:
        chosen = into
    if chosen is not None:
        if len(calibrations) == 1:
            return dict.fromkeys(chosen, 0)
        if len(chosen) != len(calibrations):
            raise InputError(
                f"there are {len(calibrations)} calibrations for {len(chosen)} cameras; choose one with --camera N",
                source=str(path),
            )
        return {number: index for index, number in enumerate(chosen)}
    own = [_own_number(item) for item in calibrations]
    if len(own) > 1 and all(number in stored.cameras for number in own):
        return {number: index for index, number in enumerate(own) if number is not None}
    found: dict[int, int] = {}
    for index, item in enumerate(calibrations):
        size = item.intrinsics.image_size
        fitting = [number for number, row in stored.cameras.items() if row[2:4] == size]
        if len(fitting) != 1 or fitting[0] in found:
            raise InputError(_which(item, fitting, stored), source=str(path))
        found[fitting[0]] = index
    return found


def _own_number(item: Calibration) -> int | None:
    """The number of a camera in a COLMAP file with several cameras."""
    number = item.camera.sub_camera or ""
    return int(number) if number.isdecimal() and item.provenance.tag == f"camera {number}" else None


def _which(item: Calibration, fitting: Sequence[int], stored: DatabaseRows) -> str:
    width, height = item.intrinsics.image_size
    if not fitting:
        sizes = ", ".join(dict.fromkeys(f"{row[2]}×{row[3]}" for row in stored.cameras.values())) or "none"
        return f"none of its cameras has images of {width}×{height}, as the calibration; it has {sizes}"
    listed = ", ".join(map(str, fitting[:LISTED])) + (", …" if len(fitting) > LISTED else "")
    return (
        f"{len(fitting)} of its cameras ({listed}) have images of {width}×{height}; say which get this K with "
        "--into N,N,…, or --into all where one camera took all images"
    )


def _free_backup(path: Path) -> Path:
    """An unused file name for the SQL that restores the old rows."""
    names = (f"{path.name}.before{number}.sql" for number in ("", *(f"-{n}" for n in range(2, 10_000))))
    return next(place for name in names if not (place := path.with_name(name)).exists())
