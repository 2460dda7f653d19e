"""Calibration files of many programs: read exactly, and written with a verdict on what was lost.

>>> from calibrary import parsers
>>> [camera] = parsers.read("P4R.xml")                                    # doctest: +SKIP
>>> print(parsers.write([camera], "P4R.yml", "opencv_storage"))           # doctest: +SKIP
exact (0.000 px); dropped: …

Messages name the flags of the command line, which correspond to the functions' arguments (``--image-size`` is
``image_size``, ``--set`` is ``options``, ``--max-size-mib`` in MiB is ``max_bytes``). A file is recognised by its
content, never by its name. :mod:`calibrary.parsers.format` describes what a format is and how to add one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypeAlias

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError, MissingSizeError
from calibrary.parsers.content import MAX_JSON_BYTES, Content
from calibrary.parsers.discovery import format_named, known_formats
from calibrary.parsers.files import (
    MAX_BYTES,
    companions,
    display_name,
    is_image,
    length_of,
    read_head,
    read_regular_file,
)
from calibrary.parsers.format import Format, WriteVerdict, no_companion
from calibrary.parsers.reading import (
    Identity,
    identified,
    identified_by_head,
    read_content,
    read_in_place,
)
from calibrary.parsers.unsized import (
    UnsizedCalibration,
    read_sized_as_images_beside,
    read_sized_by_centre,
    read_without_size,
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
    "is_image_file",
    "read",
    "read_unsized",
    "write",
]

IMAGE_MARK_BYTES = 64
"""Number of first bytes in which an image's signature is searched; longer than any signature."""

NO_IMAGE = (b"<", b"{", b"[", b"%", b"#")
"""First bytes of XML, JSON and YAML, which no image has; for such files the image readers are not loaded."""

PathLike: TypeAlias = str | Path


def formats() -> tuple[Format, ...]:
    """All formats in alphabetical order; the documentation's table is generated from these records."""
    return tuple(known_formats().values())


def identify(path: PathLike, *, max_bytes: int = MAX_BYTES) -> Identity:
    """Identify the format of a file.

    Args:
        path: a regular file.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: the file cannot be read, or is not a regular file.
        ParseError: the file is empty, too long, or a git-LFS pointer.
        UnknownFormatError: no format recognises it.
        AmbiguousFormatError: two formats recognise it equally; the message names both.
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
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Sequence[Calibration]:
    """Read all cameras in a calibration file, in the file's order and in the canonical form.

    An image file (JPEG, TIFF, DNG, HEIF, PNG) gives the calibration from its metadata, as ``extract``
    determines it, but without validation against a policy. If a file does not state its image size, that of
    the images in its folder is used, with a note, provided that they all have one size and the principal
    point is near its centre.

    Args:
        path: a regular file.
        format: name of the format or of its program, if the file cannot be identified by content.
        image_size: (width, height) px, for files that do not state it.
        size_from_centre: whether to assume twice the principal point as an unknown image size.
        options: values of the format's options that only the file's owner knows, such as
            ``{"distortion": "fisheye"}``.
        max_bytes: largest file that is read. A value above the default of 64 MiB also raises the lower limits
            of the formats, which keep a file with few cameras within two seconds and 512 MiB. A database, in
            which single cameras can be looked up, may have any size.

    Raises:
        InputError: the file cannot be read or is not a regular file, or an argument contradicts it.
        MissingSizeError: the image size is needed, but neither the file, the caller nor the images in the
            file's folder state it.
        ParseError: the file is broken.
        UnknownFormatError: no format recognises it.
        AmbiguousFormatError: two formats recognise it equally.
        UnsupportedModelError: its camera has no exact counterpart here, or the file is recognised but is not a
            calibration.
    """
    path = Path(path)
    if format is None and is_image_file(path):
        from calibrary.parsers.images import read_image  # noqa: PLC0415  loads the catalogue

        return read_image(path)
    if length_of(path) > max_bytes:
        record = format_named(format, path) if isinstance(format, str) else format
        return read_in_place(
            path,
            record or identified_by_head(path, max_bytes=max_bytes).format,
            image_size=image_size,
            options=options,
            companion=companions(path, max_bytes=max_bytes),
            max_bytes=max_bytes,
        )
    read_it = _reader(path, format, options, max_bytes)
    try:
        return read_it(image_size=image_size)
    except MissingSizeError:
        if size_from_centre:
            return read_sized_by_centre(read_it)
        found = read_sized_as_images_beside(read_it, path)
        if found is None:
            raise
        return found


def read_unsized(
    path: PathLike,
    *,
    format: str | Format | None = None,  # noqa: A002  as in read
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> list[Calibration | UnsizedCalibration]:
    """Read all cameras in a calibration file that does not state its image size, as far as possible without it.

    Args:
        path: a regular file.
        format: as for :func:`read`.
        options: as for :func:`read`.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: as for :func:`read`.
    """
    return read_without_size(_reader(Path(path), format, options, max_bytes))


def is_image_file(path: Path) -> bool:
    """Whether a file is read as an image: by its content, or by its name if no calibration format recognises it.

    For a file that cannot be opened the name decides; reading it then raises the error.
    """
    try:
        head = read_head(path, IMAGE_MARK_BYTES)
        if head[:1] in NO_IMAGE and not is_image(path):
            return False
        from calibrary.parsers.imagery.reader import begins_as_image  # noqa: PLC0415  as the catalogue above

        if begins_as_image(head):
            return True
        if not is_image(path):
            return False
        identify(path)
    except InputError:
        return is_image(path)
    return False


def decode(
    data: bytes,
    *,
    name: str,
    format: str | Format | None = None,  # noqa: A002  as in read
    image_size: ImageSize | None = None,
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    companion: Callable[[str], bytes | None] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Sequence[Calibration]:
    """Read all cameras from bytes in memory; see :func:`read`.

    Args:
        data: a whole file.
        name: file name, for messages and provenance.
        format: as for :func:`read`.
        image_size: as for :func:`read`.
        size_from_centre: as for :func:`read`.
        options: as for :func:`read`.
        companion: returns the bytes of other files in the same folder, for formats with several files.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: as for :func:`read`.
    """
    read_it = partial(
        read_content,
        _content(data, name, max_bytes),
        record=format_named(format, name) if isinstance(format, str) else format,
        options=options,
        companion=companion or no_companion,
        max_bytes=max_bytes,
    )
    try:
        return read_it(image_size=image_size)
    except MissingSizeError:
        if not size_from_centre:
            raise
        return read_sized_by_centre(read_it)


def write(
    calibrations: Sequence[Calibration],
    path: PathLike,
    format: str | Format,  # noqa: A002  as in read
    *,
    max_error_px: float | None = None,
    allow_prior: bool = False,
    drop_distortion: bool = False,
) -> WriteVerdict:
    """Write a calibration file atomically, and report what was lost.

    The bytes are read back and compared before the file is written; see :class:`WriteVerdict`.

    Args:
        calibrations: one, or several if the format supports it.
        path: file to create or replace; if a format has several syntaxes, the suffix selects one.
        format: name of the format or of the program that reads it.
        max_error_px: largest error anywhere in the image due to a refit to the format's models; None for 0.05
            px.
        allow_prior: whether to write a K that was not measured.
        drop_distortion: whether K alone is written if the format has no place for the distortion, and an unknown
            distortion as none if the format always states one.

    Raises:
        UnsupportedModelError: the format represents the calibration only with a larger error, would lose a distortion,
            or cannot be written.
        InputError: the file cannot be created, or a K was not measured.
    """
    path = Path(path)
    record = format_named(format, path) if isinstance(format, str) else format
    data, verdict = encoded(
        calibrations,
        record,
        name=path.name,
        max_error_px=max_error_px,
        allow_prior=allow_prior,
        drop_distortion=drop_distortion,
    )
    from calibrary.atomic import write_files  # noqa: PLC0415  not needed for reading, and loads logging

    write_files({path: data})
    return verdict


def encode(
    calibrations: Sequence[Calibration],
    format: str | Format,  # noqa: A002  as in read
    *,
    name: str | None = None,
    max_error_px: float | None = None,
    allow_prior: bool = False,
    drop_distortion: bool = False,
) -> tuple[bytes, WriteVerdict]:
    """The bytes that :func:`write` would write, and the verdict.

    Args:
        calibrations: as for :func:`write`.
        format: as for :func:`write`.
        name: file name; None for the format's first suffix.
        max_error_px: as for :func:`write`.
        allow_prior: as for :func:`write`.
        drop_distortion: as for :func:`write`.

    Raises:
        InputError: as for :func:`write`.
    """
    record = format_named(format, name or "") if isinstance(format, str) else format
    return encoded(
        calibrations,
        record,
        name=name or f"camera{record.suffixes[0]}",
        max_error_px=max_error_px,
        allow_prior=allow_prior,
        drop_distortion=drop_distortion,
    )


def _reader(
    path: Path, named: str | Format | None, options: Mapping[str, str] | None, max_bytes: int
) -> partial[Sequence[Calibration]]:
    """Function that reads a file, which is then in memory, with any image size."""
    return partial(
        read_content,
        _content(read_regular_file(path, max_bytes=max_bytes), display_name(path), max_bytes),
        record=format_named(named, path) if isinstance(named, str) else named,
        options=options,
        companion=companions(path, max_bytes=max_bytes),
        max_bytes=max_bytes,
    )


def _content(data: bytes, name: str, max_bytes: int) -> Content:
    return Content(data, name, max_json_bytes=max_bytes if max_bytes > MAX_BYTES else MAX_JSON_BYTES)
