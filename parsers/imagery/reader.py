"""Reading of an image file into :class:`~calibrary.evidence.metadata.ImageMetadata`."""

from __future__ import annotations

import os
from functools import lru_cache
from typing import NamedTuple

from calibrary.calibration import ImageSize
from calibrary.evidence.metadata import Encoding, ImageMetadata, TagFault
from calibrary.image_size import same_aspect
from calibrary.known_camera import hash_serial
from calibrary.parsers.imagery import heif, jpeg, png, tiff
from calibrary.parsers.imagery.exif import (
    NO_EXIF,
    ExifFields,
    ExifValues,
    GdalMetadata,
    decode,
    mirrored_exif,
    read_block,
    read_gdal_metadata,
)
from calibrary.parsers.imagery.facts import ExifFacts, exif_facts
from calibrary.parsers.imagery.head import Head
from calibrary.parsers.imagery.source import Source, open_source
from calibrary.parsers.imagery.thumbnail import shows_whole_frame
from calibrary.parsers.imagery.xmp import SerialRank, XmpFacts, XmpWords, read_xmp, xmp_facts
from calibrary.records import replace

_PLACEHOLDERS = {
    b"version https://git-lfs.github.com/spec/": "Git LFS pointer; run `git lfs pull`",
    b"/annex/objects/": "git-annex pointer; run `git annex get`",
}
_NO_GDAL = GdalMetadata()
_WRONG_MAKE = "camera"
"""Autel's XL715 writes EXIF Make "Camera" and its real name into XMP."""


def read_metadata(path: str | os.PathLike[str]) -> ImageMetadata:
    """Read the camera metadata from an image file's header.

    Pixels are decoded only of a JPEG that is smaller than EXIF states, to compare it with its thumbnail.

    Reads JPEG, TIFF, BigTIFF, DNG, PNG, HEIF and AVIF, recognised by content. A broken tag becomes a fault in
    the record; a broken tag, EXIF or XMP block does not affect the rest.

    Args:
        path: a regular file.

    Raises:
        InputError: the file cannot be opened or read.
        ParseError: the file is empty, not an image, or truncated before its size.
    """
    with open_source(path) as source:
        return read_source(source)


def read_source(source: Source, *, pixels: bool = True) -> ImageMetadata:
    """As :func:`read_metadata`, for an open file; ``source.bytes_read`` then states the number of bytes read.

    Args:
        source: the open file.
        pixels: whether the pixels are compared with the thumbnail where :func:`may_be_cropped`.

    Raises:
        ParseError: the file is empty, not an image, or truncated before its size.
    """
    found = _recognise(source)
    head = found.head
    gdal = read_gdal_metadata(head.gdal_metadata, source.name) if head.gdal_metadata else _NO_GDAL
    packets = head.xmp or gdal.xmp
    words = read_xmp(packets, source.name) if packets else XmpWords()
    metadata = _understood(
        _Said(
            size=head.size,
            fields=found.exif,
            has_block=found.has_exif,
            faults=head.faults,
            gdal=gdal,
            words=words,
            turned=heif.is_heif(source.head),
            encoding=head.encoding,
        )
    )
    if head.exif is None or not pixels or not may_be_cropped(metadata):
        return metadata
    return replace(metadata, whole_frame=shows_whole_frame(source, head.exif))


def may_be_cropped(metadata: ImageMetadata) -> bool:
    """Whether it is a JPEG that was resized, or cropped to the same proportions, which its thumbnail may tell."""
    size = metadata.size
    stated = (metadata.exif_size, metadata.related_size, metadata.main_size)
    larger = any(other is not None and other[0] > size[0] and same_aspect(other, size) for other in stated)
    return larger and metadata.has_thumbnail and metadata.encoding is not None


def begins_as_image(head: bytes) -> bool:
    """Whether a file that begins with these bytes is an image that :func:`read_source` recognises."""
    return head.startswith((jpeg.SIGNATURE, *tiff.SIGNATURES, png.SIGNATURE)) or heif.is_heif(head)


class _Found(NamedTuple):
    head: Head
    exif: ExifFields
    has_exif: bool


def _recognise(source: Source) -> _Found:
    """Recognise the container by its first bytes, and read it."""
    start = source.head
    if start.startswith(jpeg.SIGNATURE):
        return _with_exif(jpeg.read_jpeg(source))
    if start.startswith(tiff.SIGNATURES):
        found = tiff.read_tiff(source)
        return _Found(found.head, found.exif, found.has_exif)
    if start.startswith(png.SIGNATURE):
        return _with_exif(png.read_png(source))
    if heif.is_heif(start):
        return _with_exif(heif.read_heif(source))
    if not source.size:
        raise source.broken("the file is empty; copy it from the card again")
    for prefix, meaning in _PLACEHOLDERS.items():
        if start.startswith(prefix):
            raise source.broken(f"this is a {meaning}")
    raise source.broken(f"this is not a JPEG, TIFF, DNG, PNG or HEIF image: it begins with {start[:8]!r}")


def _with_exif(head: Head) -> _Found:
    if head.exif is None:
        return _Found(head, NO_EXIF, has_exif=False)
    exif = read_block(head.exif)
    return _Found(
        replace(head, faults=head.faults + exif.faults) if exif.faults else head, exif, has_exif=True
    )


class _Said(NamedTuple):
    """Unparsed camera metadata from an image's header.

    Attributes:
        size: (width, height) px, as stated by the container.
        fields: of EXIF.
        has_block: whether the file has an EXIF block.
        faults: of the container and of EXIF.
        gdal: metadata in a GeoTIFF's text.
        words: of XMP.
        turned: whether the container states the size before a rotation that EXIF's size includes.
        encoding: of a JPEG.
    """

    size: ImageSize
    fields: ExifFields
    has_block: bool
    faults: tuple[TagFault, ...]
    gdal: GdalMetadata
    words: XmpWords
    turned: bool
    encoding: Encoding | None


# Cached: images of one camera have equal input here, because dates and positions are not included. A fleet that
# flies simultaneously has some dozen cameras.
@lru_cache(maxsize=64)
def _understood(said: _Said) -> ImageMetadata:
    xmp = xmp_facts(said.words)
    # The directories have precedence; the text supplies what they lack.
    values: ExifValues = {**dict(said.gdal.values), **decode(said.fields)}
    has_exif = said.has_block or bool(said.gdal.values)
    if not has_exif:
        values = {**mirrored_exif(xmp.properties), **values}
    exif = exif_facts(values, said.faults + said.gdal.faults)
    if said.turned and exif.exif_size == said.size[::-1]:
        # Portrait images of phones: EXIF states the size after the rotation (irot), the item table the size before.
        exif = replace(exif, exif_size=said.size)
    return _merged(said, exif, xmp, has_exif=has_exif)


def _merged(said: _Said, exif: ExifFacts, xmp: XmpFacts, *, has_exif: bool) -> ImageMetadata:
    make = exif.make
    if make is None or (make.casefold() == _WRONG_MAKE and xmp.make):
        make = xmp.make
    return ImageMetadata(
        size=said.size,
        exif_size=exif.exif_size,
        related_size=said.fields.related_size,
        main_size=said.fields.main_size,
        orientation=exif.orientation,
        make=make,
        model=exif.model or xmp.model,
        software=exif.software or xmp.software,
        lens=exif.lens,
        focal_mm=exif.focal_mm,
        focal_35mm=exif.focal_35mm,
        digital_zoom=exif.digital_zoom,
        focal_plane_resolution=exif.focal_plane_resolution,
        focal_plane_unit=exif.focal_plane_unit,
        serial=_serial(make, exif, xmp),
        xmp=tuple(xmp.properties.values()),
        faults=exif.faults + tuple(xmp.faults),
        has_exif=has_exif,
        has_maker_note=said.fields.has_maker_note,
        has_thumbnail=said.fields.has_thumbnail,
        byte_order=said.fields.byte_order if said.has_block else None,
        encoding=said.encoding,
        exif_in_text=has_exif and not said.has_block,
    )


def _serial(make: str | None, exif: ExifFacts, xmp: XmpFacts) -> str | None:
    """Hash of the serial number that is most closely associated with the camera."""
    written = {SerialRank.LENS: exif.lens_serial, SerialRank.BODY: exif.body_serial}
    known = xmp.serials | {rank: serial for rank, serial in written.items() if serial is not None}
    return hash_serial(make, known[max(known)]) if known else None
