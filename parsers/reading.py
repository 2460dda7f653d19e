"""Reading of calibrations from bytes: recognition of the format, and call of its reader."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from msgspec import Struct

from calibrary.calibration import Calibration, ImageSize
from calibrary.dates import iso_date
from calibrary.errors import (
    AmbiguousFormatError,
    InputError,
    ParseError,
    UnknownFormatError,
    UnsupportedModelError,
)
from calibrary.parsers.content import HEAD_BYTES, Content
from calibrary.parsers.discovery import formats_of, known_formats
from calibrary.parsers.files import MAX_BYTES, display_name, read_head, too_long
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure, no_companion
from calibrary.parsers.last_line import read_to_the_end
from calibrary.parsers.on_demand import REACH, CamerasOnDemand
from calibrary.parsers.text import shown
from calibrary.parsers.unclaimed import described
from calibrary.records import replace

__all__ = ["Identity", "identified", "identified_by_head", "read_content", "read_in_place"]


class Identity(Struct, frozen=True):
    """The recognised format of a file.

    Attributes:
        format: the format with the highest certainty.
        sniff: result of its sniffer.
    """

    format: Format
    sniff: Sniff


def identified(content: Content) -> Identity:
    """Recognise the format of a file.

    Raises:
        UnknownFormatError: no format recognises the bytes.
        AmbiguousFormatError: two formats are equally certain; the message names both.
    """
    claims = [
        Identity(record, sniff)
        for record in formats_of(content.syntax)
        if (sniff := record.sniff(content)) is not None
    ]
    if not claims:
        raise UnknownFormatError(described(content), source=content.name)
    strongest = max(claim.sniff.sure for claim in claims)
    best = [claim for claim in claims if claim.sniff.sure == strongest]
    if strongest is Sure.WEAK and len(best) > 1:
        # The content does not decide, so the file name may.
        best = [claim for claim in best if content.suffix in claim.format.suffixes] or best
    if len(best) > 1:
        sentence = " and ".join(f"{claim.format.name} ({claim.sniff.reason})" for claim in best)
        raise AmbiguousFormatError(
            f"it is claimed equally by {sentence}; say which with --format NAME", source=content.name
        )
    return best[0]


def read_content(
    content: Content,
    *,
    record: Format | None = None,
    image_size: ImageSize | None = None,
    size_is_tried: bool = False,
    options: Mapping[str, str] | None = None,
    companion: Callable[[str], bytes | None] = no_companion,
    max_bytes: int = MAX_BYTES,
) -> Sequence[Calibration]:
    """Read all cameras from a file's content.

    Args:
        content: the file.
        record: the format; None to recognise it.
        image_size: (width, height) px, for files that do not state it.
        size_is_tried: whether the file may state another size.
        options: values of the format's options.
        companion: reads other files in the same folder.
        max_bytes: largest file; a value above the default also raises the formats' own limits.

    Raises:
        InputError: as for :func:`calibrary.parsers.read`.
    """
    sure = None
    if record is None:
        identity = identified(content)
        record, sure = identity.format, identity.sniff.sure
    read = record.read
    if read is None:
        raise UnsupportedModelError(f"this is {record.title}: {record.refuses}", source=content.name)
    context = ReadContext(
        name=content.name,
        image_size=image_size,
        size_is_tried=size_is_tried,
        options=_checked(options or {}, record),
        sha256=hashlib.sha256(content.data).hexdigest(),
        companion=companion,
        max_bytes=max_bytes if max_bytes > MAX_BYTES else None,
        json=content.parsed_json,
    )

    with _errors_of(content.name):
        found = (
            read(content.data, context)
            if content.text is None
            else read_to_the_end(read, content.data, context)
        )
        calibrations = _checked_cameras(found, record, content.name)
    if sure is Sure.WEAK:
        note = f"nothing in the file says that it is {record.title}; it was read so because it has the shape"
        calibrations = [replace(item, notes=(*item.notes, note)) for item in calibrations]
    return calibrations


def identified_by_head(path: Path, *, max_bytes: int) -> Identity:
    """Recognise a file too long for memory, if its format can look up single cameras in it.

    Raises:
        ParseError: it is not of such a format.
        InputError: the file cannot be read, or is not a regular file.
    """
    content = Content(read_head(path, HEAD_BYTES), display_name(path))
    for record in known_formats().values():
        if record.read_in_place is not None and (sniff := record.sniff(content)) is not None:
            return Identity(record, sniff)
    raise too_long(content.name, max_bytes)


def read_in_place(
    path: Path,
    record: Format,
    *,
    image_size: ImageSize | None,
    options: Mapping[str, str] | None,
    companion: Callable[[str], bytes | None],
    max_bytes: int,
) -> Sequence[Calibration]:
    """Read all cameras in a file too long for memory; their provenance has no digest.

    Raises:
        ParseError: the format can only read whole files.
        InputError: as for :func:`calibrary.parsers.read`.
    """
    name = display_name(path)
    read = record.read_in_place
    if read is None:
        raise too_long(name, max_bytes)
    context = ReadContext(
        name=name, image_size=image_size, options=_checked(options or {}, record), companion=companion
    )
    with _errors_of(name):
        return _checked_cameras(read(path, context), record, name)


@contextmanager
def _errors_of(name: str) -> Iterator[None]:
    """Make errors on an invalid K or lens errors of the file."""
    try:
        yield
    except InputError as error:
        if error.source is not None:
            raise
        kind = ParseError if type(error) is InputError else type(error)
        raise kind(error.message, source=name, place=error.place) from None


def _checked_cameras(calibrations: Sequence[Calibration], record: Format, name: str) -> Sequence[Calibration]:
    """The cameras of a file with their dates in ISO 8601, after checking that pixels can be computed with them."""
    made = calibrations.made_at_once() if isinstance(calibrations, CamerasOnDemand) else calibrations
    if not calibrations:
        raise ParseError(f"this {record.title} file contains no camera", source=name)
    for item in made:
        _refuse_beyond_reach(item, name)
    return [_dated(item) for item in calibrations] if "date" in record.states else calibrations


def _dated(item: Calibration) -> Calibration:
    """The calibration with its date in ISO 8601; an unreadable date becomes a note."""
    text = item.provenance.date
    if text is None or (iso := iso_date(text)) == text:
        return item
    if iso is None:
        note = f"the file's date, {shown(text)}, is ambiguous or not a date, so the date is unknown"
        item = replace(item, notes=(*item.notes, note))
    return replace(item, provenance=replace(item.provenance, date=iso))


def _refuse_beyond_reach(item: Calibration, name: str) -> None:
    """Refuse numbers that are finite and positive, but unusable for computing pixels.

    Raises:
        ParseError: a length of K exceeds 10⁶ image sides, or a focal length is below 10⁻⁶ of one.
    """
    K = item.intrinsics
    side = max(K.image_size)
    if min(K.fx, K.fy) * REACH < side or max(K.fx, K.fy, abs(K.cx), abs(K.cy), abs(K.skew)) > REACH * side:
        raise ParseError(
            f"its K, with fx {K.fx:g}, fy {K.fy:g}, cx {K.cx:g}, cy {K.cy:g}, skew {K.skew:g} px, is of no camera "
            f"with images of {K.image_size[0]}×{K.image_size[1]} px",
            source=name,
            place=item.provenance.tag,
        )


def _checked(options: Mapping[str, str], record: Format) -> Mapping[str, str]:
    known = {option.name: option for option in record.options}
    for name, value in options.items():
        if name not in known:
            listed = ", ".join(known) or "none"
            raise InputError(f"format {record.name} asks nothing called {name!r}; it knows {listed}")
        if value not in known[name].values:
            raise InputError(f"{name} is {value!r}, expected one of {', '.join(known[name].values)}")
    return options
