"""Writing of calibrations to bytes, with a verdict measured on the bytes.

The output of a writer is read back before it is returned, and compared with the original: the verdict is a
measurement, not a promise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from calibrary.arrays import np
from calibrary.calibration import Calibration, CameraKey, ImageSize, Quality
from calibrary.errors import InputError, UnsupportedModelError, UsageError
from calibrary.parsers.content import Content
from calibrary.parsers.discovery import format_named, known_formats
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.fit import DEFAULT_MAX_ERROR_PX, EXACT, accepted_with, adapt, compare
from calibrary.parsers.format import (
    FREE_LENS,
    LOST_LENS,
    NOT_UNDERSTOOD,
    STATED,
    UNKNOWN_LENS,
    Fit,
    Format,
    UnknownLens,
    WriteContext,
    WriteVerdict,
)
from calibrary.parsers.on_demand import CamerasOnDemand
from calibrary.parsers.reading import read_content
from calibrary.quality import Covariance

QUALITY = {
    "rms_px": "rms of the reprojection error",
    "points": "number of points",
    "views": "number of views",
    "kappa2": "scatter against the covariance",
    "coverage": "coverage of the frame",
}
"""Fields of a calibration's quality that are single numbers, with their names in words."""


def format_by_suffix(path: str | Path, *, flag: str | None = None) -> Format:
    """The format that is written to a file with this suffix.

    Args:
        path: file name.
        flag: flag that states the format, for the message.

    Raises:
        UsageError: the suffix belongs to no format, or to several.
    """
    suffix = Path(path).suffix.lower()
    fitting = [
        item for item in known_formats().values() if suffix in item.suffixes and (item.write or item.updated)
    ]
    if len(fitting) == 1:
        return fitting[0]
    found = "several formats are" if fitting else "no format is"
    how = f" with {flag}" if flag is not None else ""
    which = (
        f"one of {', '.join(item.name for item in fitting)}"
        if fitting
        else "as 'calibrary formats' lists them"
    )
    raise UsageError(
        f"{found} written as {suffix or 'a file without a suffix'}; say which{how}, {which}",
        source=Path(path).name,
    )


def format_to_write(name: str | None, file: str | Path, *, flag: str | None = None) -> Format:
    """The format with this name, or that of the file's suffix if there is none.

    Args:
        name: of a format or program, as for :func:`~calibrary.parsers.discovery.format_named`.
        file: file name.
        flag: as for :func:`format_by_suffix`.

    Raises:
        InputError: there is no such format, or the suffix does not determine one.
        UnsupportedModelError: its files are read but not written.
    """
    record = format_named(name, file) if name is not None else format_by_suffix(file, flag=flag)
    if record.write is None:
        raise _unwritten(record)
    return record


def _unwritten(record: Format) -> UnsupportedModelError:
    how = "; 'calibrary convert' writes cameras into a file that is there" if record.updated else ""
    return UnsupportedModelError(f"format {record.name} is read but not written{how}")


def encoded(
    calibrations: Sequence[Calibration],
    record: Format,
    *,
    name: str,
    max_error_px: float | None = None,
    allow_prior: bool = False,
    drop_distortion: bool = False,
) -> tuple[bytes, WriteVerdict]:
    """Make the bytes of a file, and the verdict on how exactly they represent the calibrations.

    Args:
        calibrations: one, or several if the format supports it.
        record: the format.
        name: file name; its suffix selects the syntax if the format has several.
        max_error_px: largest error anywhere in the image due to a refit to the format's models.
        allow_prior: whether to write a K that was not measured.
        drop_distortion: whether K alone is written if the format has no place for the distortion, and an unknown
            distortion as none.

    Raises:
        UnsupportedModelError: the format cannot be written, represents the calibration only with a larger
            error, or would lose a distortion.
        InputError: there is nothing to write, or a K was not measured.
    """
    limit = DEFAULT_MAX_ERROR_PX if max_error_px is None else max_error_px
    check_limit(limit)
    if record.write is None or record.capacity is None:
        raise _unwritten(record)
    if isinstance(calibrations, CamerasOnDemand):
        at_once = _encoded_columns(calibrations, record, name)
        if at_once is not None:
            return at_once
    calibrations = list(calibrations)  # a sequence that makes them when asked is asked once
    if not calibrations:
        raise InputError("there is no calibration to write")
    if not allow_prior:
        _refuse_guesses(calibrations)
    if len(calibrations) > 1 and not record.capacity.several_cameras:
        raise UnsupportedModelError(
            f"a {record.name} file contains one camera, not {len(calibrations)}; write one file for each"
        )
    adapted = [
        adapt(item, record.capacity, max_error_px=limit, drop_distortion=drop_distortion)
        for item in calibrations
    ]
    data = record.write(adapted, WriteContext(name=name))
    copies = list(
        _read_back(data, record, name, _one_size(calibrations) if record.needs_image_size else None)
    )
    if len(copies) != len(calibrations):
        raise UnsupportedModelError(
            f"a {record.name} file of these {len(calibrations)} cameras reads back as {len(copies)}, so it cannot "
            "hold them together; write one file for each"
        )
    fits = tuple(compare(original, copy) for original, copy in zip(calibrations, copies, strict=True))
    for fit in fits:
        is_accepted = drop_distortion and not record.capacity.has_lens
        if fit.error_px > limit and not is_accepted:
            raise UnsupportedModelError(
                f"{record.name} cannot hold the calibration within {limit:g} px: what it contains is off by "
                f"rms {fit.rms_px:.3g} px, max {fit.max_px:.3g} px{accepted_with(fit.max_px)}"
            )
    dropped = dict.fromkeys(
        lost
        for original, copy in zip(calibrations, copies, strict=True)
        for lost in _losses(original, copy, record)
    )
    return data, WriteVerdict(fits=fits, dropped=tuple(dropped))


def _encoded_columns(
    cameras: CamerasOnDemand, record: Format, name: str
) -> tuple[bytes, WriteVerdict] | None:
    """As :func:`encoded`, without making each camera; None if the file is not certain to hold all of them exactly."""
    columns, capacity = cameras.columns, record.capacity
    if columns is None or record.write_columns is None or capacity is None or not len(cameras):
        return None
    first, kind = columns.kinds()
    originals = [cameras[place] for place in first.tolist()]
    held = (item.grade.is_metric and adapt(item, capacity, max_error_px=0.0) is item for item in originals)
    data = record.write_columns(columns) if all(held) else None
    if data is None:
        return None
    copies = _read_back(data, record, name)
    if not (isinstance(copies, CamerasOnDemand) and copies.columns and copies.columns.equals(columns)):
        return None
    pairs = [(item, copies[place]) for item, place in zip(originals, first.tolist(), strict=True)]
    farthest = np.maximum(columns.K[:, 2:], columns.sizes - columns.K[:, 2:])
    models = [compare(original, copy).model for original, copy in pairs]
    fits = tuple(
        Fit(model=models[at], radius_px=radius)
        for at, radius in zip(kind.tolist(), map(math.hypot, *farthest.T.tolist()), strict=True)
    )
    dropped = dict.fromkeys(lost for original, copy in pairs for lost in _losses(original, copy, record))
    return data, WriteVerdict(fits=fits, dropped=tuple(dropped))


def _read_back(
    data: bytes, record: Format, name: str, image_size: ImageSize | None = None
) -> Sequence[Calibration]:
    # The size limits are for input files; the output is bounded by its input.
    lifted = max(len(data), MAX_BYTES) + 1
    return read_content(Content(data, name), record=record, image_size=image_size, max_bytes=lifted)


def why_unwritten(error: UnsupportedModelError, written_as: str = "another format") -> str:
    """The sentence of a refusal to write, for a command without the flags of ``convert`` that it may name.

    Args:
        error: the refusal.
        written_as: the format that holds the calibration, and how the command writes it.
    """
    text = str(error)
    return f"{text}: a flag of 'calibrary convert', on a file of {written_as}" if "--" in text else text


def check_limit(max_error_px: float) -> None:
    """Refuse an invalid error limit in px.

    Raises:
        InputError: it is negative, infinite or not a number.
    """
    if not (math.isfinite(max_error_px) and max_error_px >= 0):
        raise InputError(
            f"the largest error accepted is {max_error_px} px; expected a number from 0, as in --max-error-px 0.2"
        )


def _refuse_guesses(calibrations: Sequence[Calibration]) -> None:
    for item in calibrations:
        if not item.grade.is_metric:
            raise InputError(
                f"the K of {item.camera} is a {item.grade.value}, a guess; a calibration file would pass it "
                "off as measured, so none is written unless you say --allow-prior"
            )


def _one_size(calibrations: Sequence[Calibration]) -> ImageSize:
    sizes = {item.intrinsics.image_size for item in calibrations}
    if len(sizes) > 1:
        raise UnsupportedModelError(
            "the format does not hold image sizes, so cameras of several sizes cannot share a file"
        )
    return sizes.pop()


def _losses(original: Calibration, copy: Calibration, record: Format) -> Iterator[str]:
    """Yield the data of the original that the file lacks, in words."""
    if record.needs_image_size:
        yield "image size"
    yield from _lost_lens(original, copy, record)
    for name in CameraKey.__struct_fields__ if original.camera != copy.camera else ():
        value, kept = getattr(original.camera, name), getattr(copy.camera, name)
        if name == "image_size" or value is None or value == kept:
            continue
        if not (isinstance(value, float) and isinstance(kept, float) and _same(value, kept)):
            yield name.replace("_", " ")
    if original.quality != copy.quality:
        yield from _lost_quality(original.quality or Quality(), copy.quality or Quality())
    yield from (
        name
        for name in (STATED if original.provenance != copy.provenance else ())
        if (value := getattr(original.provenance, name)) and value != getattr(copy.provenance, name)
    )
    if copy.grade is not original.grade:
        yield f"grade {original.grade.value} (the file reads as {copy.grade.value})"
    extras = dict(copy.extras)
    for key, value in original.extras:
        if extras.get(key) != value:
            yield LOST_LENS if key == NOT_UNDERSTOOD else key


def _lost_lens(original: Calibration, copy: Calibration, record: Format) -> Iterator[str]:
    if original.distortion is not None and copy.distortion is None:
        yield f"distortion ({original.distortion.model})"
    if original.distortion is None and copy.distortion is not None:
        is_free = record.capacity is not None and record.capacity.unknown_lens is UnknownLens.FREE
        yield FREE_LENS if is_free else UNKNOWN_LENS
    before, after = original.intrinsics, copy.intrinsics
    if getattr(copy.distortion, "b1", 0.0) or getattr(copy.distortion, "b2", 0.0):
        return  # The affine terms of the lens include both.
    least = EXACT * max(*before.image_size, before.fx, before.fy)
    if abs(before.skew) > least and not after.skew:
        yield f"skew of {before.skew:.6g} px"
    if abs(before.fx - before.fy) > least and after.fx == after.fy:
        yield f"the difference of fx and fy, {before.fx - before.fy:.6g} px"


def _lost_quality(before: Quality, after: Quality) -> Iterator[str]:
    for name, words in QUALITY.items():
        value, kept = getattr(before, name), getattr(after, name)
        if value is not None and not (kept is not None and _same(value, kept)):
            yield words
    if not all(key in after.std and _same(value, after.std[key]) for key, value in before.std.items()):
        yield "standard deviations"
    if before.covariance is not None and not _same_covariance(before.covariance, after.covariance):
        yield "covariance"


def _same(before: float, after: float) -> bool:
    """Whether two numbers are equal, except for the last digit, which a conversion of units may change."""
    return math.isclose(before, after, rel_tol=EXACT)


def _same_covariance(before: Covariance, after: Covariance | None) -> bool:
    if after is None or after.names != before.names:
        return False
    spread = np.sqrt(np.diag(before.matrix))
    return bool((np.abs(before.matrix - after.matrix) <= EXACT * np.outer(spread, spread)).all())
