"""Calibration files of every program a fleet meets, read exactly and written with a verdict.

>>> from calibrary import parsers
>>> [camera] = parsers.read("P4R.xml")                                    # doctest: +SKIP
>>> print(parsers.write([camera], "P4R.yml", "opencv_storage"))           # doctest: +SKIP
exact; dropped: opencv_storage has no place for …

Messages name the flags of the command line; the functions' arguments are the same words (``--image-size`` is
``image_size``, ``--set`` is ``options``, ``--max-size`` in MiB is ``max_bytes``). A file is recognised by what is
in it, never by its name. :mod:`calibrary.parsers.format` says what a format
is and how to add one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

from calibrary.atomic import write_files
from calibrary.calibration import Calibration, ImageSize
from calibrary.parsers.content import MAX_JSON_BYTES, Content
from calibrary.parsers.discovery import format_named, known_formats
from calibrary.parsers.files import MAX_BYTES, companions, display_name, length_of, read_regular_file
from calibrary.parsers.format import Format, WriteVerdict, no_companion
from calibrary.parsers.image_names import is_image
from calibrary.parsers.reading import (
    Identity,
    identified,
    identified_by_head,
    read_content,
    read_in_place,
)
from calibrary.parsers.writing import encoded, format_by_suffix

__all__ = [
    "Format",
    "Identity",
    "WriteVerdict",
    "decode",
    "encode",
    "format_by_suffix",
    "formats",
    "identify",
    "read",
    "write",
]

PathLike: TypeAlias = str | Path


def formats() -> tuple[Format, ...]:
    """All formats, in alphabetical order: the table of the documentation is printed from these records."""
    return tuple(known_formats().values())


def identify(path: PathLike, *, max_bytes: int = MAX_BYTES) -> Identity:
    """What a file is and why we think so.

    Args:
        path: a regular file.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: it cannot be read, or is not a regular file.
        ParseError: it is empty, too long, or a git-LFS pointer.
        UnknownFormatError: no format claims it.
        AmbiguousFormatError: two claim it equally; the message names both.
    """
    path = Path(path)
    if length_of(path) > max_bytes:
        return identified_by_head(path, max_bytes=max_bytes)
    return identified(_content(read_regular_file(path, max_bytes=max_bytes), display_name(path), max_bytes))


def read(
    path: PathLike,
    *,
    format: str | Format | None = None,  # noqa: A002  the word of the field, and of numpy, PIL and pandas
    image_size: ImageSize | None = None,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> list[Calibration]:
    """Every camera in a calibration file, in the file's order, in the canonical form.

    An image file (JPEG, TIFF, DNG, HEIF, PNG) gives the calibration that its metadata yields, as the ingest
    gate would take it, without a policy's judgement.

    Args:
        path: a regular file.
        format: its name, where the file itself does not settle it.
        image_size: (width, height) px, for files that do not say it.
        options: answers to what only the file's owner knows, as listed by the format, such as
            ``{"distortion": "fisheye"}``.
        max_bytes: longest file that is taken in. One beyond the default of 64 MiB also lifts the lower limits of
            the formats, which keep any file within two seconds and 512 MiB. A database, whose cameras can be
            looked up, may be of any length.

    Raises:
        InputError: it cannot be read or is not a regular file, or an argument contradicts it.
        MissingTagError: the image size is needed and neither the file nor the caller says it.
        ParseError: it is broken.
        UnknownFormatError: no format claims it.
        AmbiguousFormatError: two formats claim it equally.
        UnsupportedModelError: its camera has no exact counterpart here, or the file is recognised but is no
            calibration.
    """
    path = Path(path)
    if format is None and is_image(path):
        from calibrary.parsers.images import read_image  # noqa: PLC0415  loads the catalogue, which files do not need

        return read_image(path)
    beside = companions(path, max_bytes=max_bytes)
    if length_of(path) > max_bytes:
        record = format_named(format) if isinstance(format, str) else format
        return read_in_place(
            path,
            record or identified_by_head(path, max_bytes=max_bytes).format,
            image_size=image_size,
            options=options,
            companion=beside,
            max_bytes=max_bytes,
        )
    return decode(
        read_regular_file(path, max_bytes=max_bytes),
        name=display_name(path),
        format=format,
        image_size=image_size,
        options=options,
        companion=beside,
        max_bytes=max_bytes,
    )


def decode(
    data: bytes,
    *,
    name: str,
    format: str | Format | None = None,  # noqa: A002  as in read
    image_size: ImageSize | None = None,
    options: Mapping[str, str] | None = None,
    companion: Callable[[str], bytes | None] | None = None,
    max_bytes: int = MAX_BYTES,
) -> list[Calibration]:
    """Every camera in bytes that are already in memory; see :func:`read`.

    Args:
        data: a whole file.
        name: the file's name, for messages and provenance.
        format: as for :func:`read`.
        image_size: as for :func:`read`.
        options: as for :func:`read`.
        companion: gives the bytes of the files beside it, for formats that come in several.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: the kinds that :func:`read` lists.
    """
    record = format_named(format) if isinstance(format, str) else format
    return read_content(
        _content(data, name, max_bytes),
        record=record,
        image_size=image_size,
        options=options,
        companion=companion or no_companion,
        max_bytes=max_bytes,
    )


def write(
    calibrations: Sequence[Calibration],
    path: PathLike,
    format: str | Format,  # noqa: A002  as in read
    *,
    max_error_px: float | None = None,
) -> WriteVerdict:
    """Write a calibration file, whole or not at all, and report what was lost.

    The bytes are read back and compared before the file is made; see :class:`WriteVerdict`.

    Args:
        calibrations: one, or several where the format takes several.
        path: the file to make or replace; where a format has several syntaxes its suffix chooses.
        format: the format's name.
        max_error_px: the largest error, anywhere in the image, that may come from models the format lacks;
            0.05 px when not given.

    Raises:
        UnsupportedModelError: the format represents the calibration only with a larger error, or is not written.
        InputError: the file cannot be made, or a K is only a guess.
    """
    path = Path(path)
    data, verdict = encode(calibrations, format, name=path.name, max_error_px=max_error_px)
    write_files({path: data})
    return verdict


def encode(
    calibrations: Sequence[Calibration],
    format: str | Format,  # noqa: A002  as in read
    *,
    name: str | None = None,
    max_error_px: float | None = None,
) -> tuple[bytes, WriteVerdict]:
    """What :func:`write` would write, and its verdict.

    Args:
        calibrations: as for :func:`write`.
        format: as for :func:`write`.
        name: the file's name; the format's first suffix decides when it is not given.
        max_error_px: as for :func:`write`.

    Raises:
        InputError: the kinds that :func:`write` lists.
    """
    record = format_named(format) if isinstance(format, str) else format
    return encoded(
        calibrations, record, name=name or f"camera{record.suffixes[0]}", max_error_px=max_error_px
    )


def _content(data: bytes, name: str, max_bytes: int) -> Content:
    return Content(data, name, max_json_bytes=max_bytes if max_bytes > MAX_BYTES else MAX_JSON_BYTES)
