"""HEIF and AVIF: the item tables of the ``meta`` box.

ISO/IEC 23008-12 on ISO/IEC 14496-12: ``pitm`` names the primary item, ``iprp`` states its extent (``ispe``),
``iinf`` states which items are EXIF and XMP, ``iloc`` their locations. The size is that of ``ispe``, before
the rotation or mirroring (``irot``, ``imir``) that decoders apply.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery.head import MAX_XMP_BYTES, Head, checked_size
from calibrary.parsers.imagery.source import Block, Source

BRANDS = frozenset(
    {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"mif2", b"msf1", b"avif", b"avis"}
)

MAX_BOXES = 20_000
MAX_META_BYTES = 1024 * 1024
"""Longest ``meta`` box; a phone's image with 48 tiles needs four thousand bytes."""
MAX_EXIF_BYTES = 1024 * 1024
"""Longest EXIF item in several pieces, which must be assembled first."""


class _Box(Struct, frozen=True):
    kind: bytes
    body: bytes

    @property
    def version(self) -> int:
        return self.body[0] if self.body else 0


class _Location(Struct, frozen=True):
    """Location of an item: extents of (offset, length), in the file or in the ``idat`` box."""

    in_idat: bool
    extents: tuple[tuple[int, int], ...]


class _Cursor:
    """Reader of consecutive big-endian fields; raises EOFError past the end."""

    __slots__ = ("data", "offset")

    def __init__(self, data: bytes, offset: int = 0) -> None:
        self.data = data
        self.offset = offset

    def take(self, size: int) -> int:
        """Read an unsigned integer of ``size`` bytes; 0 if ``size`` is 0."""
        end = self.offset + size
        if end > len(self.data):
            raise EOFError("a box ends within one of its fields")
        value = int.from_bytes(self.data[self.offset : end], "big")
        self.offset = end
        return value


def is_heif(head: bytes) -> bool:
    """Whether a file begins with a ``ftyp`` box of a still-image brand, major or compatible."""
    if head[4:8] != b"ftyp":
        return False
    brands = head[8 : min(int.from_bytes(head[:4], "big"), 256)]
    return any(brands[index : index + 4] in BRANDS for index in range(0, len(brands), 4) if index != 4)


def read_heif(source: Source) -> Head:
    """Read size, EXIF block and XMP packet of a HEIF or AVIF still.

    Raises:
        ParseError: it has no item tables, or they state no size of the primary item.
    """
    meta = _meta(source)
    try:
        return _read_items(source, {box.kind: box for box in _boxes(meta, 4)})
    except EOFError as error:
        raise source.broken(f"its meta box is damaged: {error}") from None


def _read_items(source: Source, tables: dict[bytes, _Box]) -> Head:
    primary = _primary(tables)
    size = _extent(tables, primary)
    if size is None:
        raise source.broken("its primary item has no ispe property, so it has no size")
    locations = _locations(tables[b"iloc"]) if b"iloc" in tables else {}
    idat = tables[b"idat"].body if b"idat" in tables else b""
    exif: Block | None = None
    packets: list[bytes] = []
    faults: list[TagFault] = []
    for item, kind in _items(tables):
        if kind == b"Exif" and exif is None:
            exif = _exif_block(source, locations.get(item), idat)
            if exif is None:
                faults.append(
                    TagFault("EXIF", "an item without a usable place in the file", "a readable EXIF block")
                )
        elif kind == b"application/rdf+xml" and not packets:
            packet = _item_bytes(source, locations.get(item), idat, MAX_XMP_BYTES)
            if packet is None:
                faults.append(
                    TagFault("XMP", "an item without a usable place in the file", "a readable packet")
                )
            else:
                packets.append(packet)
    return Head(size=checked_size(source, *size), exif=exif, xmp=tuple(packets), faults=tuple(faults))


def _meta(source: Source) -> bytes:
    """The body of the file's ``meta`` box, at any position among the boxes."""
    offset = 0
    for _ in range(MAX_BOXES):
        header = source.read(offset, 16, ahead=64)
        if len(header) < 8:
            break
        length, kind, skip = int.from_bytes(header[:4], "big"), header[4:8], 8
        if length == 1:
            length, skip = int.from_bytes(header[8:16], "big"), 16
        if length == 0:
            length = source.size - offset
        if length < skip:
            break
        if kind == b"meta":
            if length > MAX_META_BYTES:
                raise source.broken(f"its meta box has {length} bytes; at most {MAX_META_BYTES} are read")
            return source.read(offset + skip, length - skip)
        offset += length
    raise source.broken("the HEIF has no meta box, so it has no size; it is cut off, or it is a video")


def _boxes(data: bytes, offset: int = 0) -> Iterator[_Box]:
    """The boxes inside a box."""
    for _ in range(MAX_BOXES):
        length, kind, skip = (
            int.from_bytes(data[offset : offset + 4], "big"),
            data[offset + 4 : offset + 8],
            8,
        )
        if length == 1:
            length, skip = int.from_bytes(data[offset + 8 : offset + 16], "big"), 16
        if length == 0:
            length = len(data) - offset
        if length < skip or offset + length > len(data):
            return
        yield _Box(kind, data[offset + skip : offset + length])
        offset += length


def _primary(tables: dict[bytes, _Box]) -> int | None:
    box = tables.get(b"pitm")
    return _Cursor(box.body, 4).take(2 if box.version == 0 else 4) if box else None


def _extent(tables: dict[bytes, _Box], primary: int | None) -> ImageSize | None:
    """The ``ispe`` that ``ipma`` associates with the primary item."""
    if b"iprp" not in tables:
        return None
    properties: list[_Box] = []
    tied: set[int] = set()
    for box in _boxes(tables[b"iprp"].body):
        if box.kind == b"ipco":
            properties = list(_boxes(box.body))
        elif box.kind == b"ipma":
            tied |= {index for item, index in _associations(box) if item == primary}
    for index in sorted(tied):
        if 0 < index <= len(properties) and properties[index - 1].kind == b"ispe":
            extent = _Cursor(properties[index - 1].body, 4)
            return extent.take(4), extent.take(4)
    return None


def _associations(box: _Box) -> Iterator[tuple[int, int]]:
    """Yield (item, index of a property from 1)."""
    fields = _Cursor(box.body, 4)
    wide = box.body[3:4] and box.body[3] & 1
    for _ in range(fields.take(4)):
        item = fields.take(2 if box.version == 0 else 4)
        for _ in range(fields.take(1)):
            yield item, fields.take(2) & 0x7FFF if wide else fields.take(1) & 0x7F


def _items(tables: dict[bytes, _Box]) -> Iterator[tuple[int, bytes]]:
    """Yield (item, its type, or the content type of a mime item)."""
    box = tables.get(b"iinf")
    if box is None:
        return
    for entry in _boxes(box.body, 6 if box.version == 0 else 8):
        if entry.kind == b"infe" and entry.version >= 2:
            fields = _Cursor(entry.body, 4)
            item = fields.take(2 if entry.version == 2 else 4)
            start = fields.offset + 2
            kind, names = entry.body[start : start + 4], entry.body[start + 4 :].split(b"\0")
            yield item, names[1] if kind == b"mime" and len(names) > 1 else kind


def _locations(box: _Box) -> dict[int, _Location]:
    fields = _Cursor(box.body, 4)
    sizes = fields.take(2)
    offset_size, length_size, base_size, index_size = (sizes >> shift & 0xF for shift in (12, 8, 4, 0))
    if box.version == 0:
        index_size = 0
    found: dict[int, _Location] = {}
    for _ in range(fields.take(2 if box.version < 2 else 4)):
        item = fields.take(2 if box.version < 2 else 4)
        method = fields.take(2) & 0xF if box.version else 0
        fields.take(2)
        base = fields.take(base_size)
        extents = []
        # Empty extents would let a small box contain any number of them.
        for _ in range(fields.take(2) if offset_size or length_size else 0):
            fields.take(index_size)
            extents.append((base + fields.take(offset_size), fields.take(length_size)))
        if method in {0, 1}:
            found[item] = _Location(method == 1, tuple(extents))
    return found


def _exif_block(source: Source, location: _Location | None, idat: bytes) -> Block | None:
    """The TIFF part of an EXIF item, which begins with the offset of that part."""
    if location and not location.in_idat and len(location.extents) == 1:
        start, length = location.extents[0]
        item = source.block(start, length or None)
    else:
        data = _item_bytes(source, location, idat, MAX_EXIF_BYTES)
        if data is None:
            return None
        item = Block.of(data, source.name)
    begin = 4 + int.from_bytes(item.read(0, 4), "big")
    return Block(item.source, item.start + begin, item.length - begin) if begin < item.length else None


def _item_bytes(source: Source, location: _Location | None, idat: bytes, limit: int) -> bytes | None:
    if location is None or sum(length for _, length in location.extents) > limit:
        return None
    if location.in_idat:
        return b"".join(idat[start : start + length] for start, length in location.extents)
    return b"".join(source.read(start, length) for start, length in location.extents)
