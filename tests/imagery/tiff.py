"""TIFF files with EXIF and XMP where cameras and GDAL put them.

A TIFF's EXIF is not a block of its own: its tags stand in the image's first directory and the Exif directory
hangs from there; XMP is tag 700. GDAL keeps what it knows in tag 42112, an XML list that also holds the EXIF
of the JPEG a file was made from.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import ImageSize
from calibrary.errors import InputError
from calibrary.records import replace
from tests.imagery.exif import ExifTags
from tests.imagery.structure import ByteOrder, Chunks, Field, FieldType, Ifd, encode
from tests.imagery.xmp import XmpPacket, escaped

_XMP_TAG, _GDAL_METADATA_TAG = 0x02BC, 0xA480
_TILE = 256
_STRIP_BYTES = 65_536


@dataclass(frozen=True, slots=True, kw_only=True)
class TiffPage:
    """One uncompressed image of a TIFF file.

    Attributes:
        size: (width, height) px.
        bits: per sample, 8 or 16.
        tiled: in tiles of 256 × 256 instead of strips.
        reduced: marked as a smaller copy of another page (an overview).
        pixels: (H, W) grey or (H, W, 3) RGB, uint8 or uint16 as ``bits`` says; black where there are none.
    """

    size: ImageSize
    bits: int = 8
    tiled: bool = False
    reduced: bool = False
    pixels: NDArray[np.uint8] | NDArray[np.uint16] | None = None

    def __post_init__(self) -> None:
        if self.bits not in {8, 16} or min(self.size) < 1:
            raise InputError(
                f"a page of {self.size} px and {self.bits} bits, expected 8 or 16 bits and a size"
            )
        pixels = self.pixels
        if pixels is not None and (pixels.shape[1::-1] != self.size or pixels.itemsize * 8 != self.bits):
            raise InputError(
                f"pixels of shape {pixels.shape} and type {pixels.dtype}, "
                f"expected {self.bits} bits and {self.size[0]}×{self.size[1]}"
            )

    @property
    def samples(self) -> int:
        """Per pixel: 1 for grey, 3 for RGB."""
        return 3 if self.pixels is not None and self.pixels.ndim == 3 else 1


def encode_tiff(
    pages: Sequence[TiffPage],
    *,
    exif: ExifTags | None = None,
    xmp: XmpPacket | bytes | None = None,
    gdal_metadata: tuple[tuple[str, str], ...] = (),
    chunks_first: bool = False,
) -> bytes:
    """A TIFF file; EXIF, XMP and GDAL's list belong to its first page.

    Args:
        pages: the image and what follows it: overviews, further pages.
        exif: tags; their byte order is the file's.
        xmp: a packet, or its bytes as they shall stand there.
        gdal_metadata: (name, text) of the items of GDAL's list.
        chunks_first: put each directory behind its pixels, as MicaSense cameras do.

    Raises:
        InputError: there is no page, or ``exif`` has a thumbnail (in a TIFF that would be a page).
    """
    if not pages:
        raise InputError("no page, expected at least one")
    exif = ExifTags() if exif is None else exif
    if exif.thumbnail is not None:
        raise InputError("a thumbnail in a TIFF is a page of its own; give it as a page")
    first, *others = (_ifd(page, exif.byte_order) for page in pages)
    (described,) = exif.directories()
    fields = (*first.fields, *described.fields, *_packets(xmp, gdal_metadata))
    first = replace(first, fields=fields, children=described.children)
    return encode([first, *others], exif.byte_order, chunks_first=chunks_first)


def write_tiff(
    path: Path,
    size: ImageSize,
    *,
    exif: ExifTags | None = None,
    xmp: XmpPacket | bytes | None = None,
    bits: int = 8,
    tiled: bool = False,
    pages: tuple[ImageSize, ...] = (),
    gdal_metadata: tuple[tuple[str, str], ...] = (),
) -> Path:
    """Write a black TIFF of ``size``, with further pages of the sizes ``pages``.

    All strips (or tiles) of a page are one and the same few kilobytes, so a 20-megapixel file takes no longer
    than a small one. For pixels of one's own there is :func:`encode_tiff`.

    Returns:
        ``path``; its folder is made.
    """
    images = [TiffPage(size=side, bits=bits, tiled=tiled) for side in (size, *pages)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode_tiff(images, exif=exif, xmp=xmp, gdal_metadata=gdal_metadata))
    return path


def _packets(xmp: XmpPacket | bytes | None, gdal_metadata: tuple[tuple[str, str], ...]) -> Iterator[Field]:
    if xmp is not None:
        packet = xmp if isinstance(xmp, bytes) else xmp.encode()
        yield Field(tag=_XMP_TAG, type=FieldType.BYTE, values=packet)
    if gdal_metadata:
        items = "".join(
            f'  <Item name="{escaped(name)}">{escaped(text)}</Item>\n' for name, text in gdal_metadata
        )
        listed = f"<GDALMetadata>\n{items}</GDALMetadata>\n"
        yield Field(tag=_GDAL_METADATA_TAG, type=FieldType.ASCII, values=listed)


def _ifd(page: TiffPage, order: ByteOrder) -> Ifd:
    """The fields that TIFF 6.0, sections 4, 6 and 15, ask of an image, with its strips or tiles."""
    samples = page.samples
    width, height = page.size
    row_bytes = width * samples * page.bits // 8
    rows_per_strip = min(height, max(1, _STRIP_BYTES // row_bytes))
    shorts = {
        0x0102: (page.bits,) * samples,  # BitsPerSample
        0x0103: (1,),  # Compression: none
        0x0106: (2 if samples == 3 else 1,),  # PhotometricInterpretation: RGB or BlackIsZero
        0x0115: (samples,),  # SamplesPerPixel
        0x011C: (1,),  # PlanarConfiguration: chunky
    }
    longs = {0x00FE: int(page.reduced), 0x0100: width, 0x0101: height}  # NewSubfileType, width, length
    longs |= {0x0142: _TILE, 0x0143: _TILE} if page.tiled else {0x0116: rows_per_strip}
    fields = (
        *(Field(tag=tag, type=FieldType.SHORT, values=values) for tag, values in shorts.items()),
        *(Field(tag=tag, type=FieldType.LONG, values=(value,)) for tag, value in longs.items()),
    )
    if page.tiled:
        return Ifd(
            fields=fields, chunks=Chunks(offsets_tag=0x0144, counts_tag=0x0145, chunks=_tiles(page, order))
        )
    strips = _strips(page, order, rows_per_strip)
    return Ifd(fields=fields, chunks=Chunks(offsets_tag=0x0111, counts_tag=0x0117, chunks=strips))


def _strips(page: TiffPage, order: ByteOrder, rows: int) -> tuple[bytes, ...]:
    width, height = page.size
    if page.pixels is not None:
        pixels = _ordered(page.pixels, order)
        return tuple(pixels[top : top + rows].tobytes() for top in range(0, height, rows))
    row_bytes = width * page.bits // 8
    whole, rest = divmod(height, rows)
    last = (bytes(rest * row_bytes),) if rest else ()
    return (bytes(rows * row_bytes),) * whole + last


def _tiles(page: TiffPage, order: ByteOrder) -> tuple[bytes, ...]:
    width, height = page.size
    across, down = -(-width // _TILE), -(-height // _TILE)
    if page.pixels is None:
        return (bytes(_TILE * _TILE * page.bits // 8),) * (across * down)
    depth = [(0, 0)] * (page.pixels.ndim - 2)
    margins = [(0, down * _TILE - height), (0, across * _TILE - width), *depth]
    pixels = np.pad(_ordered(page.pixels, order), margins)
    corners = ((top * _TILE, left * _TILE) for top in range(down) for left in range(across))
    return tuple(pixels[top : top + _TILE, left : left + _TILE].tobytes() for top, left in corners)


def _ordered(
    pixels: NDArray[np.uint8] | NDArray[np.uint16], order: ByteOrder
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    return pixels if pixels.itemsize == 1 else pixels.astype(f"{order.value}u2")
