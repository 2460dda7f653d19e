"""PNG files that say nothing about a camera: the stills that people grab from video."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

from calibrary.calibration import ImageSize


def write_png(path: Path, size: ImageSize) -> Path:
    """Write a black 8-bit grey PNG without EXIF and without XMP.

    Returns:
        ``path``; its folder is made.
    """
    width, height = size
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes((1 + width) * height), 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    chunks = ((b"IHDR", header), (b"IDAT", rows), (b"IEND", b""))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks))
    return path


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
