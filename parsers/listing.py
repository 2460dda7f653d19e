"""What ``calibrary formats --json`` prints (schemas/formats-1.schema.json)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, TypeAlias

from calibrary.parsers.format import Format
from calibrary.records import Meta, Record

__all__ = ["FormatListing", "listing"]

Suffix: TypeAlias = Annotated[str, Meta(pattern=r"^\.")]
Values: TypeAlias = Annotated[tuple[str, ...], Meta(min_length=1)]


class ListedFormat(Record):
    """One calibration file format.

    Attributes:
        name: what --format and --to take.
        title: what it is.
        suffixes: the usual ones; a file is recognised by what is in it.
        reads, writes: whether its files are read, written.
        updates: whether cameras are written into a file that is there.
        refuses: why files of the format are never read, and what to do instead.
        needs_image_size: whether the file does not say how large its images are.
        convention: how its numbers count, in sentences.
        options: what --set takes, each with its values.
        reference: where the format is described.
    """

    name: str
    title: str
    suffixes: tuple[Suffix, ...]
    reads: bool
    writes: bool
    updates: bool
    refuses: str | None
    needs_image_size: bool
    convention: tuple[str, ...] | None
    options: Mapping[str, Values]
    reference: str


class FormatListing(Record, tag_field="schema", tag="calibrary/formats-1"):
    """What ``calibrary formats --json`` prints: the calibration files that are read and written.

    Attributes:
        formats: by name.
    """

    formats: tuple[ListedFormat, ...]


def listing(formats: Iterable[Format]) -> FormatListing:
    """Formats as programs read of them."""
    return FormatListing(formats=tuple(map(_listed, formats)))


def _listed(record: Format) -> ListedFormat:
    return ListedFormat(
        name=record.name,
        title=record.title,
        suffixes=tuple(record.suffixes),
        reads=record.read is not None,
        writes=record.write is not None,
        updates=record.updated,
        refuses=record.refuses,
        needs_image_size=record.needs_image_size,
        convention=tuple(record.convention.sentences()) if record.convention is not None else None,
        options={option.name: tuple(option.values) for option in record.options},
        reference=record.reference,
    )
