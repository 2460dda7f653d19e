"""Comparison of a JPEG with its own thumbnail: a thumbnail that shows more than the image betrays a crop.

Programs that crop or resize an image mostly keep the thumbnail that the camera made. Only images whose size is in doubt
are decoded, which takes some 10 ms, and only those of usual size.
"""

from __future__ import annotations

import io
from typing import Final

from calibrary.arrays import NDArray, np
from calibrary.errors import ParseError
from calibrary.parsers.imagery.directory import Tiff
from calibrary.parsers.imagery.source import Block, Source

MAX_BYTES: Final = 12 * 1024 * 1024
MAX_PIXELS: Final = 64_000_000
MAX_THUMBNAIL_BYTES: Final = 64 * 1024
"""An EXIF block is no longer than a segment."""

SMALLEST_SIDE_PX: Final = 40
FLATTEST: Final = 6.0
"""Standard deviation of the grey values (of 255) below which nothing can be compared."""

SAME: Final = 0.9
"""Correlation from which two pictures are the same one."""
SHARES: Final = np.linspace(0.25, 0.98, 37)
"""Shares of the thumbnail's width that the image is looked for in."""
LARGEST_ASPECT_DIFFERENCE: Final = 0.04
"""Thumbnails have whole pixels, and some are 4:3 with bars of unequal height."""

BAR_MEAN: Final = 24.0
BAR_SPREAD: Final = 10.0
"""A row or column of the bars that fill up a thumbnail to 4:3."""

_OFFSET, _LENGTH = 0x0201, 0x0202
Grey = NDArray[np.float64]


def shows_whole_frame(source: Source, exif: Block) -> bool | None:
    """Whether the thumbnail shows the image and nothing beside it.

    Args:
        source: a JPEG.
        exif: its EXIF block.

    Returns:
        False if it shows more than the image; None if there is no thumbnail, or nothing can be told.
    """
    data = _thumbnail(exif)
    if data is None or source.size > MAX_BYTES:
        return None
    try:
        thumbnail = _without_bars(_decoded(data))
        image = _decoded(source.read(0, source.size), reduced=True)
    except (ImportError, OSError, ValueError, SyntaxError):
        # Without Pillow, or with pixels that cannot be decoded, nothing is known of the frame.
        return None
    return _compared(image, thumbnail)


def _thumbnail(exif: Block) -> bytes | None:
    try:
        tiff = Tiff(exif)
        following = tiff.directory(tiff.first, frozenset()).next_offset
        entries = tiff.directory(following, frozenset({_OFFSET, _LENGTH})).entries
    except ParseError:
        return None
    at, length = (tiff.integers(entries[tag]) if tag in entries else () for tag in (_OFFSET, _LENGTH))
    if len(at) != 1 or len(length) != 1 or length[0] > MAX_THUMBNAIL_BYTES:
        return None
    data = exif.read(at[0], length[0])
    return data if data.startswith(b"\xff\xd8") else None


def _decoded(data: bytes, *, reduced: bool = False) -> Grey:
    from PIL import Image

    with Image.open(io.BytesIO(data), formats=["JPEG"]) as picture:
        if picture.width * picture.height > MAX_PIXELS:
            raise ValueError("too many pixels")
        if reduced:
            picture.draft("L", (320, 320))
        return np.asarray(picture.convert("L"), dtype=np.float64)


def _without_bars(grey: Grey) -> Grey:
    def bars(lines: Grey) -> tuple[int, int]:
        is_bar = (lines.mean(axis=1) < BAR_MEAN) & (lines.std(axis=1) < BAR_SPREAD)
        picture = np.flatnonzero(~is_bar)
        if not len(picture):
            return 0, len(lines)
        first, last = int(picture[0]), int(picture[-1]) + 1
        return (first, last) if abs(first - (len(lines) - last)) <= 3 else (0, len(lines))

    top, bottom = bars(grey)
    left, right = bars(grey.T)
    return grey[top:bottom, left:right]


def _compared(image: Grey, thumbnail: Grey) -> bool | None:
    height, width = thumbnail.shape
    if min(height, width) < SMALLEST_SIDE_PX or min(image.std(), thumbnail.std()) < FLATTEST:
        return None
    aspect = image.shape[1] / image.shape[0]
    whole = _best(thumbnail, _scaled(image, (width, height)))
    sizes = [(round(width * share), round(width * share / aspect)) for share in SHARES]
    part = max((_best(thumbnail, _scaled(image, size)) for size in sizes if size[1] <= height), default=-1.0)
    if part > SAME and part > whole:
        return False
    alike = abs(width / height / aspect - 1.0) <= LARGEST_ASPECT_DIFFERENCE
    return True if whole > SAME and alike else None


def _scaled(grey: Grey, size: tuple[int, int]) -> Grey:
    from PIL import Image

    return np.asarray(
        Image.fromarray(grey.astype(np.float32)).resize(size, Image.Resampling.BOX), dtype=np.float64
    )


def _best(thumbnail: Grey, part: Grey) -> float:
    """The largest correlation of ``part`` with any place in the thumbnail."""
    height, width = part.shape
    rows, columns = thumbnail.shape[0] - height + 1, thumbnail.shape[1] - width + 1
    wave = part - part.mean()
    spectrum = np.fft.rfft2(thumbnail) * np.conj(np.fft.rfft2(wave, thumbnail.shape))
    product = np.fft.irfft2(spectrum, thumbnail.shape)[:rows, :columns]
    count = height * width
    total, square = _sums(thumbnail, height, width), _sums(thumbnail**2, height, width)
    spread = np.sqrt(np.maximum(square - total**2 / count, 1.0) * max(float((wave**2).sum()), 1.0))
    return float((product / spread).max())


def _sums(values: Grey, height: int, width: int) -> Grey:
    """Sums over every window of this size."""
    padded: Grey = np.pad(values, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    return (
        padded[height:, width:]
        - padded[:-height, width:]
        - padded[height:, :-width]
        + padded[:-height, :-width]
    )
