"""Bytes to calibrations: which format claims them, and what it reads."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import (
    AmbiguousFormatError,
    InputError,
    ParseError,
    UnknownFormatError,
    UnsupportedModelError,
)
from calibrary.parsers.content import MAX_JSON_BYTES, Content
from calibrary.parsers.discovery import known_formats
from calibrary.parsers.document import parse_json
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure, no_companion

__all__ = ["Identity", "identified", "read_content"]


@dataclass(frozen=True, slots=True)
class Identity:
    """What a file is and why we think so.

    Attributes:
        format: the one format with the strongest claim.
        sniff: its claim.
    """

    format: Format
    sniff: Sniff


def identified(content: Content) -> Identity:
    """The one format whose claim is the strongest.

    Raises:
        UnknownFormatError: nobody claims the bytes.
        AmbiguousFormatError: two claims are equally strong; the message names both.
    """
    claims = [
        Identity(record, sniff)
        for record in known_formats().values()
        if (sniff := record.sniff(content)) is not None
    ]
    if not claims:
        raise UnknownFormatError(_unknown(content), source=content.name)
    strongest = max(claim.sniff.sure for claim in claims)
    best = [claim for claim in claims if claim.sniff.sure == strongest]
    if strongest is Sure.WEAK and len(best) > 1:
        # Nothing in the file speaks for either, so its name may.
        best = [claim for claim in best if content.suffix in claim.format.suffixes] or best
    if len(best) > 1:
        sentence = " and ".join(f"{claim.format.name} ({claim.sniff.why})" for claim in best)
        raise AmbiguousFormatError(
            f"it is claimed equally by {sentence}; say which with format=", source=content.name
        )
    return best[0]


def read_content(
    content: Content,
    *,
    record: Format | None = None,
    image_size: ImageSize | None = None,
    options: Mapping[str, str] | None = None,
    companion: Callable[[str], bytes | None] = no_companion,
) -> list[Calibration]:
    """Every camera in the bytes.

    Args:
        content: the file.
        record: the format to read it as; the one that claims it when None.
        image_size: (width, height) px, for files that do not say it.
        options: answers to the format's questions.
        companion: reader of the files beside it.

    Raises:
        InputError: the kinds :func:`calibrary.parsers.read` lists.
    """
    sure = None
    if record is None:
        identity = identified(content)
        record, sure = identity.format, identity.sniff.sure
    if record.read is None:
        raise UnsupportedModelError(f"this is {record.title}: {record.refuses}", source=content.name)
    context = ReadContext(
        name=content.name,
        image_size=image_size,
        options=_checked(options or {}, record),
        sha256=hashlib.sha256(content.data).hexdigest(),
        companion=companion,
    )
    try:
        calibrations = record.read(content.data, context)
    except InputError as error:
        if error.source is not None:
            raise
        # A number that makes no K or no lens: it is the file that is wrong.
        kind = ParseError if type(error) is InputError else type(error)
        raise kind(error.message, source=content.name, place=error.place) from None
    if not calibrations:
        raise ParseError(f"this {record.title} file holds no camera", source=content.name)
    if sure is Sure.WEAK:
        note = f"nothing in the file says that it is {record.title}; it was read so because it has the shape"
        calibrations = [replace(item, notes=(*item.notes, note)) for item in calibrations]
    return calibrations


def _checked(options: Mapping[str, str], record: Format) -> Mapping[str, str]:
    known = {option.name: option for option in record.options}
    for name, value in options.items():
        if name not in known:
            listed = ", ".join(known) or "none"
            raise InputError(f"format {record.name} asks nothing called {name!r}; it knows {listed}")
        if value not in known[name].values:
            raise InputError(f"{name} is {value!r}, wanted one of {', '.join(known[name].values)}")
    return options


def _unknown(content: Content) -> str:
    message = f"no format claims it; it begins with {content.beginning()}"
    if content.looks_like_json and len(content.data) > MAX_JSON_BYTES:
        message += f", and JSON of over {MAX_JSON_BYTES} bytes is not looked into"
    elif content.looks_like_json and content.json is None:
        try:
            parse_json(content.data, source=content.name)
        except ParseError as error:
            message += f", and {error.message}" + (f" at {error.place}" if error.place else "")
    return f"{message}; if you know what it is, say so with format="
