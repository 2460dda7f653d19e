"""A flight of any number of 20-megapixel frames with 60 kB of metadata each, to measure on.

What a reader of metadata meets is as a Phantom 4 RTK writes it, in kind and in size: EXIF with a 30 kB
MakerNote and a thumbnail, an XMP segment filled up to 8 kB, the multi-picture index, a colour profile, the
maker's debug segments; date, position and attitude differ from frame to frame.

What it does not meet is cheap. The scan is one flat grey frame of 78 kB. Behind the end of the image, where
the camera appends its preview, a hole brings the file to its usual length and takes no disk: a program that
reads whole files gets through that part faster than it would.

With several cameras the frames are taken by each in turn; they differ in the model that EXIF names.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterator
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageCms

from calibrary.jobs.demo.flight import farmland
from calibrary.records import replace
from tests.imagery import ExifTags
from tests.imagery.cameras import Shot, phantom_4_rtk
from tests.imagery.jpeg import (
    Segment,
    assemble,
    exif_segment,
    flat_scan,
    icc_segments,
    xmp_segments,
)
from tests.imagery.structure import Field, FieldType, Ifd, encode

SIZE = (5472, 3648)
MAKER_NOTE_BYTES = 31_400
PER_FOLDER = 999
"""What DCF, the rule for cameras' file systems, lets a folder hold."""


def write_corpus(
    out: Path, images: int, *, cameras: int = 1, size: tuple[int, int] = SIZE, file_bytes: int = 8_000_000
) -> list[Path]:
    """Write ``images`` frames, 999 to a folder; those of another size than the camera's are resized, as EXIF tells.

    Returns:
        Their paths, in the order they were taken.
    """
    scan = flat_scan(size)
    paths: list[Path] = []
    for index in range(images):
        path = out / f"{100 + index // PER_FOLDER}MEDIA" / f"DJI_{index % PER_FOLDER + 1:04}.JPG"
        if index % PER_FOLDER == 0:
            path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(assemble(head_segments(index, cameras), scan))
        os.truncate(path, max(file_bytes, path.stat().st_size))
        paths.append(path)
    return paths


def head_segments(index: int, cameras: int = 1) -> Iterator[Segment]:
    """All that stands before the scan of frame ``index``."""
    head = phantom_4_rtk(_shot(index))
    exif = head.exif or ExifTags()
    if cameras > 1:
        exif = replace(exif, model=f"{exif.model}-{index % cameras}")
    yield exif_segment(replace(exif, maker_note=_maker_note(), thumbnail=_thumbnail()))
    if head.xmp is not None:
        yield from xmp_segments(head.xmp)
    yield _multi_picture()
    yield from icc_segments(_colour_profile())
    yield Segment(0xE7, b"DJI-DBG\0" + b"[exposure:000][wb:000][zoom:000][pad:000]".ljust(44, b"\0"))
    yield Segment(0xE7, b"PADDING\0" + bytes(4070))


def _shot(index: int) -> Shot:
    return Shot(
        taken=datetime(2024, 5, 17, 6, 0, 0) + timedelta(seconds=2 * index),
        latitude_deg=46.1 + 1e-4 * (index % 500),
        longitude_deg=7.2 + 1e-4 * (index // 500),
        altitude_m=500 + index % 7 / 10,
        yaw_deg=3.0 if index // 500 % 2 else -177.0,
    )


@cache
def _maker_note() -> bytes:
    """DJI's directory of speeds and attitudes, every value of which fits its entry, and its padding."""
    floats = (Field(tag=tag, type=FieldType.FLOAT, values=(0.5 * tag,)) for tag in range(0x03, 0x0C))
    make = Field(tag=0x01, type=FieldType.ASCII, values="DJI")
    version = Field(tag=0x02, type=FieldType.BYTE, values=(1, 1, 0, 0))
    # The directory stands at the start of the note, without the header of a TIFF.
    return encode([Ifd(fields=(make, version, *floats))])[8:].ljust(MAKER_NOTE_BYTES, b"\0")


@cache
def _thumbnail() -> bytes:
    """160 × 120 with as much texture as a camera's."""
    grain = np.random.default_rng(1).normal(0, 16, (120, 160, 3))
    pixels = np.clip(farmland((160, 120), seed=1) + grain, 0, 255).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=96)
    return stream.getvalue()


@cache
def _multi_picture() -> Segment:
    """CIPA DC-007's index of two pictures: the frame and the preview behind it."""
    # Attribute, length, offset, two dependent pictures: the primary, then a VGA thumbnail in the hole.
    entries = struct.pack("<IIIHHIIIHH", 0x030000, 0, 0, 0, 0, 0x4001_0001, 250_000, 1_000_000, 0, 0)
    fields = (
        Field(tag=0xB000, type=FieldType.UNDEFINED, values=b"0100"),
        Field(tag=0xB001, type=FieldType.LONG, values=(2,)),
        Field(tag=0xB002, type=FieldType.UNDEFINED, values=entries),
        Field(tag=0xB003, type=FieldType.UNDEFINED, values=bytes(66)),
        Field(tag=0xB004, type=FieldType.LONG, values=(1,)),
    )
    return Segment(0xE2, b"MPF\0" + encode([Ifd(fields=fields)]))


@cache
def _colour_profile() -> bytes:
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    # Bytes 24 … 35 are the date the profile was made (ICC.1, 7.2.8): now, which would differ from run to run.
    profile[24:36] = bytes.fromhex("07e80005001100060000") + b"\0\0"
    return bytes(profile)
