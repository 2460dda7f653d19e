"""Conversion of intrinsics from the image size that a source refers to, to the image size of the file.

A tag describes the full sensor, or the image as the camera wrote it. The file may differ: files are resized, and
camera modes crop. Two conversions are safe: an equal aspect ratio is a scale; an equal width or height with a
smaller other side is a centred 1:1 crop, which is recorded as an assumption. Of an image that is turned by 90°, fx and
fy are exchanged; which way it was turned is not known, so its principal point is taken in the middle. Anything else
would stretch K and is refused. If the image size in EXIF differs from the file's, the conversion goes through it.
"""

from __future__ import annotations

from msgspec import Struct

from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import FrameError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import same_aspect
from calibrary.records import replace

RESIZED = "the image was resized, not cropped"
"""Assumption made when a size in EXIF, or a focal plane, belongs to the same image at another scale."""

TURNED = "which way the image was turned is not stated: the principal point is taken in the middle"

CROP_SLACK_PX = 2
"""Camera modes round the image sides to multiples of the codec's block size."""


class Adapted(Struct, frozen=True, kw_only=True):
    """Intrinsics at the file's image size, and how they were converted.

    Attributes:
        intrinsics: at the file's image size.
        reference_size: the image size they had before.
        steps: the operations, in words; empty if the two sizes are equal.
        assumptions: assumptions that were made.
        is_turned: whether the image is turned by 90°, so that a distortion that is not radial is not the image's.
    """

    intrinsics: Intrinsics
    reference_size: ImageSize
    steps: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    is_turned: bool = False


def adapt(intrinsics: Intrinsics, metadata: ImageMetadata) -> Adapted:
    """Convert intrinsics from their own image size to the file's, if needed through the size stated in EXIF.

    Digital zoom is applied if the camera enlarged the zoomed part back to the full image size.

    Raises:
        FrameError: neither a scale nor a centred 1:1 crop converts one image size to the other.
    """
    file_size, exif_size = metadata.size, metadata.exif_size
    is_resized = exif_size is not None and exif_size != file_size and same_aspect(exif_size, file_size)
    adapted = Adapted(
        intrinsics=intrinsics,
        reference_size=intrinsics.image_size,
        assumptions=(RESIZED,) if is_resized and metadata.whole_frame is not True else (),
    )
    adapted = _zoomed(adapted, metadata)
    try:
        return _step(adapted, file_size)
    except FrameError:
        if exif_size is None or exif_size == file_size or not _leads(exif_size, file_size):
            raise
    return _step(_step(adapted, exif_size), file_size)


def exif_contradiction(metadata: ImageMetadata) -> str | None:
    """Reason why the image size in EXIF cannot belong to this file, or None if it can be converted to the file's."""
    exif_size, size = metadata.exif_size, metadata.size
    if exif_size is None or _leads(exif_size, size):
        return None
    text = f"EXIF states an image size of {_x(exif_size)}, but the file contains {_x(size)} pixels"
    return f"{text}, which is neither that size scaled nor a 1:1 crop of it; provide the original file from the camera"


def files_frame(metadata: ImageMetadata) -> ImageSize:
    """Image size as the camera wrote it: the size in EXIF if it converts to the file's, else the file's own."""
    if metadata.exif_size is not None and _leads(metadata.exif_size, metadata.size):
        return metadata.exif_size
    return metadata.size


def _leads(a: ImageSize, b: ImageSize) -> bool:
    return same_aspect(a, b) or _is_one_to_one_crop(a, b) or same_aspect(a, b[::-1])


def _is_one_to_one_crop(a: ImageSize, b: ImageSize) -> bool:
    """Whether b can be a 1:1 crop of a: rows or columns removed on both sides, pixels unchanged."""
    same_width = abs(a[0] - b[0]) <= CROP_SLACK_PX and b[1] <= a[1] and b[0] <= a[0]
    same_height = abs(a[1] - b[1]) <= CROP_SLACK_PX and b[0] <= a[0] and b[1] <= a[1]
    return same_width or same_height


def _step(adapted: Adapted, target: ImageSize) -> Adapted:
    current = adapted.intrinsics
    source = current.image_size
    if source == target:
        return adapted
    if same_aspect(source, target):
        step = f"scaled {_x(source)} → {_x(target)}"
        return replace(adapted, intrinsics=current.scaled(target), steps=(*adapted.steps, step))
    if _is_one_to_one_crop(source, target):
        box = ((source[0] - target[0]) / 2, (source[1] - target[1]) / 2, *target)
        step = f"cropped {_x(source)} → {_x(target)}"
        return replace(
            adapted,
            intrinsics=current.cropped(box),
            steps=(*adapted.steps, step),
            assumptions=(*adapted.assumptions, "the crop is centred"),
        )
    if same_aspect(source, target[::-1]):
        along = current.scaled(target[::-1])
        turned = Intrinsics(fx=along.fy, fy=along.fx, cx=target[0] / 2, cy=target[1] / 2, image_size=target)
        is_centred = (current.cx, current.cy) == (source[0] / 2, source[1] / 2)
        return replace(
            adapted,
            intrinsics=turned,
            steps=(*adapted.steps, f"turned {_x(source)} → {_x(target)}"),
            assumptions=adapted.assumptions if is_centred else (*adapted.assumptions, TURNED),
            is_turned=True,
        )
    if _is_one_to_one_crop(source, target[::-1]):
        return _step(_step(adapted, target[::-1]), target)
    raise FrameError(
        f"{_x(source)} cannot be converted to {_x(target)} by scaling or a centred 1:1 crop; "
        "register the camera at this size"
    )


def _zoomed(adapted: Adapted, metadata: ImageMetadata) -> Adapted:
    """Apply digital zoom to intrinsics of the unzoomed image.

    If the camera enlarges the zoomed part back to the full image size, the focal length in px is multiplied by the
    zoom; if it writes the part as it is, that is a 1:1 crop.
    """
    zoom = metadata.zoom
    if zoom <= 1.0:
        return adapted
    current = adapted.intrinsics
    width, height = current.image_size
    written = files_frame(metadata)
    if abs(written[0] * zoom / width - 1.0) <= 0.02 and abs(written[1] * zoom / height - 1.0) <= 0.02:
        box = ((width - written[0]) / 2, (height - written[1]) / 2, *written)
        return replace(
            adapted,
            intrinsics=current.cropped(box),
            steps=(
                *adapted.steps,
                f"cropped {_x(current.image_size)} → {_x(written)} by {zoom:g}× digital zoom",
            ),
            assumptions=(*adapted.assumptions, "the crop is centred"),
        )
    enlarged = replace(
        current,
        fx=current.fx * zoom,
        fy=current.fy * zoom,
        cx=width / 2 + (current.cx - width / 2) * zoom,
        cy=height / 2 + (current.cy - height / 2) * zoom,
        skew=current.skew * zoom,
    )
    return replace(
        adapted,
        intrinsics=enlarged,
        steps=(*adapted.steps, f"enlarged {zoom:g}× by digital zoom"),
        assumptions=(
            *adapted.assumptions,
            "digital zoom was enlarged back to the full image size, about its centre",
        ),
    )


def _x(size: ImageSize) -> str:
    return f"{size[0]}×{size[1]}"
