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

from msgspec import Struct

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError, MissingSizeError
from calibrary.parsers.content import MAX_JSON_BYTES, Content
from calibrary.parsers.discovery import format_named, known_formats
from calibrary.parsers.files import (
    MAX_BYTES,
    companions,
    display_name,
    length_of,
    read_head,
    read_regular_file,
)
from calibrary.parsers.format import Format, WriteVerdict, no_companion
from calibrary.parsers.image_names import is_image
from calibrary.parsers.reading import (
    Identity,
    identified,
    identified_by_head,
    read_content,
    read_in_place,
)
from calibrary.parsers.unsized import (
    UnsizedCalibration,
    read_sized_as_beside,
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
"""More than any image's signature."""

NO_IMAGE = (b"<", b"{", b"[", b"%", b"#")
"""Bytes that no image begins with, but XML, JSON and YAML do: for them the readers of images need not be loaded."""

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
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Sequence[Calibration]:
    """Every camera in a calibration file, in the file's order, in the canonical form.

    An image file (JPEG, TIFF, DNG, HEIF, PNG) gives the calibration that its metadata yields, as the ingest
    gate would take it, without a policy's judgement. A file that does not state its image size takes that of the
    images in its folder, with a note, where they all have one size and the principal point is near its middle.

    Args:
        path: a regular file.
        format: its name, where the file itself does not settle it.
        image_size: (width, height) px, for files that do not say it.
        size_from_centre: whether twice the principal point is taken for the size where nothing states it.
        options: answers to what only the file's owner knows, as listed by the format, such as
            ``{"distortion": "fisheye"}``.
        max_bytes: longest file that is taken in. One beyond the default of 64 MiB also lifts the lower limits of
            the formats, which keep a file of few cameras within two seconds and 512 MiB. A database, whose cameras
            can be looked up, may be of any length.

    Raises:
        InputError: it cannot be read or is not a regular file, or an argument contradicts it.
        MissingSizeError: the image size is needed, and neither the file nor the caller says it, nor are there
            images beside the file that do.
        ParseError: it is broken.
        UnknownFormatError: no format claims it.
        AmbiguousFormatError: two formats claim it equally.
        UnsupportedModelError: its camera has no exact counterpart here, or the file is recognised but is no
            calibration.
    """
    path = Path(path)
    if format is None and is_image_file(path):
        from calibrary.parsers.images import read_image  # noqa: PLC0415  loads the catalogue, which files do not need

        return read_image(path)
    if length_of(path) > max_bytes:
        record = format_named(format) if isinstance(format, str) else format
        return read_in_place(
            path,
            record or identified_by_head(path, max_bytes=max_bytes).format,
            image_size=image_size,
            options=options,
            companion=companions(path, max_bytes=max_bytes),
            max_bytes=max_bytes,
        )
    file = _File.opened(path, format, options, max_bytes)
    try:
        return file.read(image_size)
    except MissingSizeError:
        if size_from_centre:
            return read_sized_by_centre(file.read_trying)
        found = read_sized_as_beside(file.read_trying, path)
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
    """Every camera in a calibration file that does not state its image size: what can be said without it.

    Args:
        path: a regular file.
        format: as for :func:`read`.
        options: as for :func:`read`.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: the kinds that :func:`read` lists.
    """
    return read_without_size(_File.opened(Path(path), format, options, max_bytes).read_trying)


def is_image_file(path: Path) -> bool:
    """Whether a file is read as an image: by its content; by its name alone where no calibration format claims it.

    Of a file that cannot be opened the name decides, and reading it says why.
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
    """Every camera in bytes that are already in memory; see :func:`read`.

    Args:
        data: a whole file.
        name: the file's name, for messages and provenance.
        format: as for :func:`read`.
        image_size: as for :func:`read`.
        size_from_centre: as for :func:`read`.
        options: as for :func:`read`.
        companion: gives the bytes of the files beside it, for formats that come in several.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: the kinds that :func:`read` lists.
    """
    record = format_named(format) if isinstance(format, str) else format
    file = _File(_content(data, name, max_bytes), record, options, companion or no_companion, max_bytes)
    try:
        return file.read(image_size)
    except MissingSizeError:
        if not size_from_centre:
            raise
        return read_sized_by_centre(file.read_trying)


def write(
    calibrations: Sequence[Calibration],
    path: PathLike,
    format: str | Format,  # noqa: A002  as in read
    *,
    max_error_px: float | None = None,
    allow_prior: bool = False,
) -> WriteVerdict:
    """Write a calibration file, whole or not at all, and report what was lost.

    The bytes are read back and compared before the file is made; see :class:`WriteVerdict`.

    Args:
        calibrations: one, or several where the format takes several.
        path: the file to make or replace; where a format has several syntaxes its suffix chooses.
        format: the format's name.
        max_error_px: the largest error, anywhere in the image, that may come from models the format lacks;
            0.05 px when not given.
        allow_prior: whether a K that was not measured is written.

    Raises:
        UnsupportedModelError: the format represents the calibration only with a larger error, or is not written.
        InputError: the file cannot be made, or a K is only a guess.
    """
    path = Path(path)
    data, verdict = encode(
        calibrations, format, name=path.name, max_error_px=max_error_px, allow_prior=allow_prior
    )
    from calibrary.atomic import write_files  # noqa: PLC0415  which reading does not need, and it loads logging

    write_files({path: data})
    return verdict


def encode(
    calibrations: Sequence[Calibration],
    format: str | Format,  # noqa: A002  as in read
    *,
    name: str | None = None,
    max_error_px: float | None = None,
    allow_prior: bool = False,
) -> tuple[bytes, WriteVerdict]:
    """What :func:`write` would write, and its verdict.

    Args:
        calibrations: as for :func:`write`.
        format: as for :func:`write`.
        name: the file's name; the format's first suffix decides when it is not given.
        max_error_px: as for :func:`write`.
        allow_prior: as for :func:`write`.

    Raises:
        InputError: the kinds that :func:`write` lists.
    """
    record = format_named(format) if isinstance(format, str) else format
    return encoded(
        calibrations,
        record,
        name=name or f"camera{record.suffixes[0]}",
        max_error_px=max_error_px,
        allow_prior=allow_prior,
    )


class _File(Struct, frozen=True):
    """A calibration file in memory, to be read at one image size or another."""

    content: Content
    format: Format | None
    options: Mapping[str, str] | None
    companion: Callable[[str], bytes | None]
    max_bytes: int

    @classmethod
    def opened(
        cls, path: Path, named: str | Format | None, options: Mapping[str, str] | None, max_bytes: int
    ) -> _File:
        return cls(
            _content(read_regular_file(path, max_bytes=max_bytes), display_name(path), max_bytes),
            format_named(named) if isinstance(named, str) else named,
            options,
            companions(path, max_bytes=max_bytes),
            max_bytes,
        )

    def read(self, image_size: ImageSize | None, *, size_is_tried: bool = False) -> Sequence[Calibration]:
        return read_content(
            self.content,
            record=self.format,
            image_size=image_size,
            size_is_tried=size_is_tried,
            options=self.options,
            companion=self.companion,
            max_bytes=self.max_bytes,
        )

    def read_trying(self, size: ImageSize) -> Sequence[Calibration]:
        return self.read(size, size_is_tried=True)


def _content(data: bytes, name: str, max_bytes: int) -> Content:
    return Content(data, name, max_json_bytes=max_bytes if max_bytes > MAX_BYTES else MAX_JSON_BYTES)
