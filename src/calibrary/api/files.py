"""Calibration files and images, read into calibrations and written from them."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeAlias

from msgspec.structs import asdict

from calibrary import parsers
from calibrary.calibration import Calibration, Grade, ImageSize
from calibrary.distortion import MODELS
from calibrary.errors import InputError
from calibrary.interop.colmap import COLMAP_LENSES
from calibrary.interop.opencv import OPENCV_LENSES
from calibrary.jobs.convert.database import DATABASE, Into, write_into_database
from calibrary.jobs.convert.report import ConvertFilesReport, ConvertReport
from calibrary.jobs.convert.run import Converted, ConvertRequest, convert_files
from calibrary.jobs.exchange.argument import Reading, choose
from calibrary.jobs.inspect.report import InspectFilesReport, InspectReport
from calibrary.jobs.inspect.run import Inspected, inspect_files
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.fit import DEFAULT_MAX_ERROR_PX, adapt
from calibrary.parsers.format import Capacity, Format, WriteVerdict
from calibrary.parsers.imagery.reader import begins_as_image
from calibrary.parsers.images import decode_image
from calibrary.parsers.listing import listing as format_listing
from calibrary.parsers.plausible import refuse_implausible
from calibrary.progress import Progress
from calibrary.quality import Covariance, Quality
from calibrary.records import replace

__all__ = [
    "MAX_BYTES",
    "Conversion",
    "Converted",
    "Reading",
    "Source",
    "conversion_report",
    "convert",
    "convert_all",
    "format_listing",
    "formats",
    "inspect",
    "inspection_report",
    "read",
    "read_all",
    "refit",
    "write",
]

Source: TypeAlias = str | Path | bytes | BinaryIO
"""A file by its path, its bytes, or the file opened in binary mode."""

K_NAMES = ("fx", "fy", "cx", "cy", "skew")


def read(
    source: Source,
    *,
    camera: int | None = None,
    format: str | None = None,  # noqa: A002  the word of the field, and of numpy, PIL and pandas
    image_size: ImageSize | None = None,
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Calibration:
    """The camera in a calibration file of any format, or in an image's metadata.

    Args:
        source: path, bytes, or a file opened in binary mode.
        camera: which one of a file with several, from 1.
        format: the format's name, where the file itself does not settle it.
        image_size: (width, height) px, for files that do not state it.
        size_from_centre: whether twice the principal point is taken for the size where nothing states it.
        options: answers to what only the file's owner knows, as the format lists them, such as
            ``{"distortion": "fisheye"}``.
        max_bytes: the longest file that is read.

    Raises:
        InputError: it cannot be read, or holds several cameras and none was chosen; also of the kinds that
            :func:`calibrary.parsers.read` lists.

    >>> camera = calibrary.read("camera.xml")
    >>> camera.intrinsics.fx
    3659.5
    >>> calibrary.read("survey/DJI_0001.JPG").grade
    <Grade.CALIBRATED: 'calibrated'>
    """
    found = read_all(
        source,
        format=format,
        image_size=image_size,
        size_from_centre=size_from_centre,
        options=options,
        max_bytes=max_bytes,
    )
    return choose(
        found, camera, source=_name(source), how="camera=N, or take all of them with calibrary.read_all"
    )


def read_all(
    source: Source,
    *,
    format: str | None = None,  # noqa: A002  as in read
    image_size: ImageSize | None = None,
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Sequence[Calibration]:
    """Every camera in a calibration file, in the file's order.

    Args:
        source: as for :func:`read`.
        format: as for :func:`read`.
        image_size: as for :func:`read`.
        size_from_centre: as for :func:`read`.
        options: as for :func:`read`.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: it cannot be read; also of the kinds that :func:`calibrary.parsers.read` lists.

    >>> [camera.camera.sub_camera for camera in calibrary.read_all("stereo.yml")]
    ['left', 'right']
    """
    if isinstance(source, str | Path):
        return parsers.read(
            source,
            format=format,
            image_size=image_size,
            size_from_centre=size_from_centre,
            options=options,
            max_bytes=max_bytes,
        )
    data = source if isinstance(source, bytes) else _content(source, max_bytes)
    if format is None and begins_as_image(data):
        return decode_image(data, _name(source))
    return parsers.decode(
        data,
        name=_name(source),
        format=format,
        image_size=image_size,
        size_from_centre=size_from_centre,
        options=options,
        max_bytes=max_bytes,
    )


def write(
    cameras: Calibration | Sequence[Calibration],
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002  as in read
    max_error_px: float | None = None,
    allow_prior: bool = False,
) -> parsers.WriteVerdict:
    """Write a calibration file, whole or not at all, and say what it holds of what was meant.

    Args:
        cameras: one, or several where the format takes several.
        path: the file to make or replace.
        format: the format's name; by the path's suffix where only one format is written so.
        max_error_px: the largest error, anywhere in the image, that a model which the format lacks may leave;
            0.05 px when not given.
        allow_prior: whether a K that was not measured is written.

    Returns:
        Whether the file holds the cameras exactly or refitted, by how many px it is off, and what it has no
        place for.

    Raises:
        InputError: no format or several are written under such a name, the file cannot be made, or a K is only a guess.
        UnsupportedModelError: the format holds the calibration only with a larger error.

    >>> verdict = calibrary.write(calibrary.read("camera.xml"), "camera.yaml", format="opencv_storage")
    >>> verdict.outcome
    <Fidelity.EXACT: 'exact'>
    >>> calibrary.read("camera.yaml").intrinsics.fx
    3659.5
    """
    chosen = [cameras] if isinstance(cameras, Calibration) else list(cameras)
    return parsers.write(
        chosen,
        path,
        format or parsers.format_by_suffix(path),
        max_error_px=max_error_px,
        allow_prior=allow_prior,
    )


def refit(
    camera: Calibration, model: str = "opencv", *, max_error_px: float = DEFAULT_MAX_ERROR_PX
) -> Calibration:
    """The nearest calibration with a distortion model that another program has.

    Args:
        camera: the original.
        model: "opencv" or "colmap" for the first of their models that is off by at most 0.05 px, else the nearest
            of them; or one model's name.
        max_error_px: how far a projection may be off, anywhere in the image.

    Returns:
        The same K with the new distortion, and without skew where the program has none. Equal maps are
        converted exactly; of the uncertainty, what is known of K alone stays after a fit.

    Raises:
        UnsupportedModelError: no such model is near enough; the message says how far the nearest is off.
        InputError: there is no model of that name.

    >>> camera = calibrary.read("AutoCal.xml")
    >>> camera.distortion.model
    'observed-brown'
    >>> K, dist = calibrary.refit(camera, "opencv").to_opencv()
    >>> dist.shape
    (5,)
    """
    families = {"opencv": OPENCV_LENSES, "colmap": COLMAP_LENSES}
    if model in families:
        capacity = Capacity(models=families[model])
    elif model in MODELS:
        capacity = Capacity(models=(MODELS[model],), skew=True)
    else:
        raise InputError(
            f"no distortion model {model!r:.60}; expected one of {', '.join([*families, *MODELS])}"
        )
    fitted = adapt(camera, capacity, max_error_px=max_error_px)
    if fitted.distortion == camera.distortion or fitted.quality is None:
        return fitted
    return replace(fitted, quality=_of_k_alone(fitted.quality))


@dataclass(frozen=True, slots=True, eq=False)
class Conversion:
    """A file that was written from another.

    Attributes:
        output: the file.
        format: its format's name.
        verdict: how exactly it holds the calibration.
        priors: the grades of those whose K was not measured.
        into: the cameras that were changed, where the file was there and has others.
        backup: the file that puts back what was there.
    """

    output: Path
    format: str
    verdict: WriteVerdict
    priors: tuple[Grade, ...] = ()
    into: tuple[int, ...] = ()
    backup: Path | None = None

    def report(self) -> ConvertReport:
        """For machines (schemas/convert-1.schema.json)."""
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
    """Write the calibrations of a file in another program's format, or into the cameras of a COLMAP database.

    Args:
        source: a file of any format, or an image.
        output: the file to write.
        to: its format; the one that is written under such a name when not given.
        reading: answers to what the source leaves open, and which camera of several; all of them when it says none.
        max_error_px: as of :func:`write`.
        allow_prior: as of :func:`write`.
        force: whether a K that is that of no camera is written.
        into: numbers of the cameras of a COLMAP database, "all", or None for those that it can only be.

    Raises:
        InputError: the source cannot be read, its K is that of no camera, the name fits no format or several, or the
            output cannot be written, or is a database in which it is not clear which cameras are meant.
        UnsupportedModelError: the format does not hold the calibration.

    >>> from calibrary.api.files import convert
    >>> convert("camera.xml", "camera.yaml", to="opencv_storage").verdict.outcome
    <Fidelity.EXACT: 'exact'>
    """
    reading, output = reading or Reading(), Path(output)
    cameras = reading.read(Path(source))
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
    """Write the calibrations of many files in one format, each into a file of its own.

    Args:
        sources: files, folders with all below them, and patterns such as ``rigs/*.yaml``.
        folder: where the files are written; it is made.
        to: their format.
        reading: as of :func:`convert`.
        max_error_px: as of :func:`write`.
        allow_prior: as of :func:`write`.
        force: as of :func:`convert`.
        progress: called with (files done, files in all, "files").

    Returns:
        What came of each; one that could not be converted says why.

    Raises:
        InputError: there is no such format or no such file, or the folder cannot be made.
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
    """What came of many files, for machines (schemas/convert-files-1.schema.json)."""
    return ConvertFilesReport(files=tuple(one.report() for one in files))


def inspect(
    files: Sequence[str | Path], reading: Reading | None = None, progress: Progress | None = None
) -> tuple[Inspected, ...]:
    """What files are, by what each was recognised, and what it says; a file that cannot be read is one of them.

    Args:
        files: files, and folders with all below them.
        reading: answers to what the files leave open.
        progress: called with (files done, files in all, "files").

    Raises:
        InputError: a folder cannot be read.

    >>> from calibrary.api.files import inspect
    >>> [one.format for one in inspect(["camera.xml", "survey/DJI_0001.JPG"])]
    ['agisoft_xml', 'image']
    """
    return inspect_files([Path(one) for one in files], reading or Reading(), progress)


def inspection_report(files: Sequence[Inspected], *, alone: bool) -> InspectReport | InspectFilesReport:
    """What was inspected, for machines; a file that was asked for ``alone`` is not in a list."""
    reports = [one.report() for one in files]
    return InspectReport(**asdict(reports[0])) if alone else InspectFilesReport(files=tuple(reports))


def formats(word: str = "") -> list[Format]:
    """The formats whose name or title holds a word; all of them for none.

    >>> from calibrary.api.files import formats
    >>> [one.name for one in formats("kalibr")]
    ['kalibr', 'kalibr_results']
    """
    wanted = word.casefold()
    return [
        one for one in parsers.formats() if wanted in one.name.casefold() or wanted in one.title.casefold()
    ]


def _content(file: BinaryIO, max_bytes: int) -> bytes:
    if isinstance(file, io.TextIOBase):
        raise InputError("is open as text, open it in binary mode", source=_name(file))
    data = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise InputError(f"is longer than {max_bytes} bytes, raise max_bytes to read it", source=_name(file))
    return data


def _name(source: object) -> str:
    if isinstance(source, str | Path):
        return Path(source).name
    name = getattr(source, "name", None)
    return Path(name).name if isinstance(name, str) else "bytes"


def _of_k_alone(quality: Quality) -> Quality:
    """The uncertainty of a fitted lens's coefficients is not that of the original's."""
    covariance = quality.covariance
    held = tuple(name for name in K_NAMES if covariance is not None and name in covariance.names)
    return replace(
        quality,
        std={name: value for name, value in quality.std.items() if name in K_NAMES},
        covariance=Covariance.from_matrix(held, covariance.of(held))
        if covariance is not None and held
        else None,
    )
