"""JSON document of ``calibrary formats --json`` (schemas/formats-1.schema.json)."""

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
        name: name for --format and --to.
        title: common name.
        suffixes: usual suffixes; a file is recognised by its content.
        reads, writes: whether its files can be read and written.
        updates: whether cameras are written into an existing file.
        refuses: why files of the format are never read, and what to do instead.
        needs_image_size: whether files do not state the image size.
        convention: conventions of its numbers, in sentences.
        options: options for --set, with their values.
        reference: address of its description.
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
    """Output of ``calibrary formats --json``: the calibration file formats that can be read or written.

    Attributes:
        formats: sorted by name.
    """

    formats: tuple[ListedFormat, ...]


def listing(formats: Iterable[Format]) -> FormatListing:
    """Make the listing of formats."""
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
