"""PNG: reading chunk by chunk to the end.

PNG 3rd edition: IHDR for the size, eXIf for EXIF, an iTXt with keyword ``XML:com.adobe.xmp`` for XMP. Both
may follow the image data, which are skipped.
"""

from __future__ import annotations

import zlib

from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery.head import MAX_XMP_BYTES, Head, checked_size
from calibrary.parsers.imagery.source import Block, Source

SIGNATURE = b"\x89PNG\r\n\x1a\n"
XMP_KEYWORD = b"XML:com.adobe.xmp\0"

MAX_CHUNKS = 100_000
"""Most chunks; a 100-megapixel image in chunks of 8 KiB has about forty thousand."""
_PROBE = 32


def read_png(source: Source) -> Head:
    """Read size, EXIF block and XMP packet of a PNG.

    Raises:
        ParseError: it does not begin with its header chunk.
    """
    header = source.read(len(SIGNATURE), 16)
    if len(header) < 16 or header[4:8] != b"IHDR":
        raise source.broken("the PNG does not begin with an IHDR chunk, so it has no size")
    size = checked_size(source, int.from_bytes(header[8:12], "big"), int.from_bytes(header[12:16], "big"))
    exif: Block | None = None
    packets: list[bytes] = []
    faults: list[TagFault] = []
    offset = len(SIGNATURE)
    for _ in range(MAX_CHUNKS):
        chunk = source.read(offset, 8, ahead=_PROBE)
        length, kind = int.from_bytes(chunk[:4], "big"), chunk[4:]
        start = offset + 8
        if len(chunk) < 8 or kind == b"IEND":
            break
        if kind == b"eXIf" and exif is None:
            exif = source.block(start, length)
        elif (
            kind == b"iTXt"
            and source.read(start, len(XMP_KEYWORD), ahead=_PROBE) == XMP_KEYWORD
            and not packets
        ):
            packet = _international_text(source, start + len(XMP_KEYWORD), length - len(XMP_KEYWORD))
            if isinstance(packet, TagFault):
                faults.append(packet)
            else:
                packets.append(packet)
        offset = start + length + 4
    return Head(size=size, exif=exif, xmp=tuple(packets), faults=tuple(faults))


def _international_text(source: Source, start: int, length: int) -> bytes | TagFault:
    """The text of an iTXt chunk; after the keyword follow flag, method, language, translated keyword, text."""
    if length > MAX_XMP_BYTES:
        return TagFault("XMP", f"{length} bytes", f"at most {MAX_XMP_BYTES} bytes")
    data = source.read(start, max(length, 0))
    flag, rest = data[:1], data[2:]
    text = rest.partition(b"\0")[2].partition(b"\0")[2]
    if flag != b"\1":
        return text
    inflater = zlib.decompressobj()
    try:
        inflated = inflater.decompress(text, MAX_XMP_BYTES)
    except zlib.error:
        return TagFault("XMP", "compressed text that cannot be inflated", "a zlib stream")
    if inflater.unconsumed_tail:
        return TagFault(
            "XMP", f"more than {MAX_XMP_BYTES} bytes when inflated", f"at most {MAX_XMP_BYTES} bytes"
        )
    return inflated
