"""Files that do not state their image size: reading without it, and ways to find it.

A reader is run with two arbitrary sizes; results that are equal for both do not depend on the size.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Provenance, Quality
from calibrary.distortion import AnyDistortion
from calibrary.errors import InputError, MissingSizeError
from calibrary.parsers.files import is_image
from calibrary.records import Record, replace


class _ReadAtSize(Protocol):
    """Function that reads a file's cameras; the size is used for cameras without one in the file."""

    def __call__(self, *, image_size: ImageSize, size_is_tried: bool) -> Sequence[Calibration]: ...


TRIED: tuple[ImageSize, ImageSize] = ((2000, 1500), (3200, 2400))
MOST_IMAGES = 200
"""Most images of a folder that are read, evenly spread; each takes some milliseconds."""
FARTHEST = 0.15
"""Largest distance of the principal point from the centre, in image sides, at which a size is credible."""


class UnsizedIntrinsics(Record, tag_field="pixel_origin", tag="corner"):
    """The numbers of K without an image size; null if they depend on the size.

    Attributes:
        fx, fy: focal lengths in px.
        cx, cy: principal point in px from the outer corner of the top-left pixel.
        skew: K[0, 1] in px.
        image_size: null, because the file does not state it.
    """

    fx: float | None
    fy: float | None
    cx: float | None
    cy: float | None
    skew: float | None
    image_size: None = None


class UnsizedCalibration(Record):
    """A calibration from a file that does not state the image size.

    Attributes:
        camera: camera key, as far as the file states it.
        intrinsics: K, as far as it is known without the size.
        distortion: null if unknown, or if it depends on the size.
        grade: origin of the intrinsics.
        quality: as far as the file states it.
        provenance: of the calibration.
        notes: remarks.
    """

    camera: CameraKey
    intrinsics: UnsizedIntrinsics
    distortion: AnyDistortion | None
    grade: Grade
    quality: Quality | None
    provenance: Provenance
    notes: tuple[str, ...]


def read_without_size(read: _ReadAtSize) -> list[Calibration | UnsizedCalibration]:
    """Read all cameras; those with an image size in the file are complete."""
    pairs = zip(*(read(image_size=size, size_is_tried=True) for size in TRIED), strict=True)
    return [one if _is_sized(one, two) else _without_size(one, two) for one, two in pairs]


def read_sized_by_centre(read: _ReadAtSize) -> Sequence[Calibration]:
    """Read all cameras, assuming an image size of twice the principal point.

    Raises:
        MissingSizeError: the file does not state a principal point in px either.
    """
    tried = [read(image_size=size, size_is_tried=True) for size in TRIED]
    found = []
    for index, (one, two) in enumerate(zip(*tried, strict=True)):
        if _is_sized(one, two):
            found.append(one)
            continue
        K, other = one.intrinsics, two.intrinsics
        if (K.cx, K.cy) != (other.cx, other.cy):
            raise MissingSizeError(
                "the principal point depends on the image size, so the size cannot come from it; give it with "
                "--image-size WxH",
                source=one.provenance.source,
            )
        size = max(1, round(2 * K.cx)), max(1, round(2 * K.cy))
        said = f"the image is {size[0]}×{size[1]} px, twice the principal point, as the file does not state its size"
        found.append(_assuming(read(image_size=size, size_is_tried=True)[index], said))
    return found


def read_sized_as_images_beside(read: _ReadAtSize, path: Path) -> Sequence[Calibration] | None:
    """Read all cameras at the size of the images in the file's folder, if these have one size that fits K.

    Returns:
        The cameras; None if there are no images in the folder, or they do not determine the size.
    """
    settled = _size_of_images_beside(path)
    if settled is None:
        return None
    size, words = settled
    try:
        cameras = read(image_size=size, size_is_tried=True)
    except InputError:
        return None
    if any(item.intrinsics.image_size != size or not _is_near_the_middle(item) for item in cameras):
        return None
    said = f"the image size, {size[0]}×{size[1]}, is that of {words}; the file does not state it"
    return [_assuming(item, said) for item in cameras]


def _size_of_images_beside(path: Path) -> tuple[ImageSize, str] | None:
    from calibrary.parsers.imagery import read_metadata  # noqa: PLC0415  not needed for calibration files

    try:
        images = sorted(one for one in path.parent.iterdir() if is_image(one) and one != path)
    except OSError:
        return None
    looked_at = images[:: max(1, -(-len(images) // MOST_IMAGES))]
    sizes = set()
    for one in looked_at:
        try:
            sizes.add(read_metadata(one).size)
        except InputError:
            return None
    if len(sizes) != 1:
        return None
    more = f" and {len(looked_at) - 1} more images" if len(looked_at) > 1 else ""
    return sizes.pop(), f"{looked_at[0].name}{more} beside the file"


def _is_near_the_middle(item: Calibration) -> bool:
    K = item.intrinsics
    width, height = K.image_size
    return abs(K.cx / width - 0.5) <= FARTHEST and abs(K.cy / height - 0.5) <= FARTHEST


def _is_sized(one: Calibration, two: Calibration) -> bool:
    return one.intrinsics.image_size == two.intrinsics.image_size


def _assuming(item: Calibration, said: str) -> Calibration:
    source = item.provenance
    return replace(
        item,
        notes=(*item.notes, said),
        provenance=replace(source, assumptions=(*source.assumptions, said)),
    )


def _without_size(one: Calibration, two: Calibration) -> UnsizedCalibration:
    K, other = one.intrinsics, two.intrinsics
    numbers = {
        name: value if value == getattr(other, name) else None
        for name in ("fx", "fy", "cx", "cy", "skew")
        if (value := getattr(K, name)) is not None
    }
    notes = [note for note in one.notes if note in two.notes]
    notes.append("the file does not state its image size; give it with --image-size WxH")
    varying = [name for name, value in numbers.items() if value is None]
    if one.distortion != two.distortion:
        varying.append("the distortion")
    if varying:
        notes.append(f"{', '.join(varying)} depend on the image size")
    source = one.provenance
    return UnsizedCalibration(
        camera=replace(one.camera, image_size=None),
        intrinsics=UnsizedIntrinsics(**numbers),
        distortion=one.distortion if one.distortion == two.distortion else None,
        grade=one.grade,
        quality=one.quality if one.quality == two.quality else None,
        provenance=replace(
            source,
            assumptions=tuple(text for text in source.assumptions if text in two.provenance.assumptions),
        ),
        notes=tuple(notes),
    )
