"""The image size that a camera wrote, and whether that of the file can have come of it.

Files are resized, and camera modes crop: an equal aspect ratio is a scale, an equal width or height with a smaller
other side a 1:1 crop, and either may be turned by 90°.
"""

from __future__ import annotations

from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import ImageSize, same_aspect

CROP_SLACK_PX = 2
"""Camera modes round the image sides to multiples of the codec's block size."""


def exif_contradiction(metadata: ImageMetadata) -> str | None:
    """Reason why the image size in EXIF cannot belong to this file, or None if it can be converted to the file's."""
    exif_size, size = metadata.exif_size, metadata.size
    if exif_size is None or leads(exif_size, size):
        return None
    text = f"EXIF states an image size of {_x(exif_size)}, but the file contains {_x(size)} pixels"
    return f"{text}, which is neither that size scaled nor a 1:1 crop of it; provide the original file from the camera"


def files_frame(metadata: ImageMetadata) -> ImageSize:
    """Image size as the camera wrote it: the size in EXIF if it converts to the file's, else the file's own."""
    if metadata.exif_size is not None and leads(metadata.exif_size, metadata.size):
        return metadata.exif_size
    return metadata.size


def leads(a: ImageSize, b: ImageSize) -> bool:
    """Whether an image of one size can have become one of another by a scale, a 1:1 crop or a turn."""
    return same_aspect(a, b) or _is_one_to_one_crop(a, b) or same_aspect(a, b[::-1])


def _is_one_to_one_crop(a: ImageSize, b: ImageSize) -> bool:
    """Whether b can be a 1:1 crop of a: rows or columns removed on both sides, pixels unchanged."""
    same_width = abs(a[0] - b[0]) <= CROP_SLACK_PX and b[1] <= a[1] and b[0] <= a[0]
    same_height = abs(a[1] - b[1]) <= CROP_SLACK_PX and b[0] <= a[0] and b[1] <= a[1]
    return same_width or same_height


def _x(size: ImageSize) -> str:
    return f"{size[0]}×{size[1]}"
