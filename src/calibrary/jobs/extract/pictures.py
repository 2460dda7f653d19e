"""Pictures among the images of a flight that no camera took: previews, orthophotos, exports of a viewer."""

from __future__ import annotations

from collections import Counter
from pathlib import PurePosixPath

from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.extract.gather import Gathered, SkippedFile

__all__ = ["set_aside_pictures"]

EXPORTS = frozenset({".png", ".tif", ".tiff"})
"""What programs write maps and previews as; cameras do too, but with their name in it."""


def set_aside_pictures(gathered: Gathered) -> tuple[SkippedFile, ...]:
    """Take out pictures that state nothing of a camera and are of a size that no camera of the flight has.

    An image of the flight that was stripped of its metadata has the size of the others, and stays. So do JPEGs that
    are no smaller than a quarter of the others, or are the majority: that is a flight that was resized and stripped,
    with one image left. Where no image names a camera, nothing is taken out.
    """
    sizes = {metadata.size for metadata in gathered.states if _names_a_camera(metadata)}
    if not sizes:
        return ()
    small = min(width * height for width, height in sizes) / 4
    sizes |= {(height, width) for width, height in sizes}
    strays = [one for one in gathered.states if not _names_a_camera(one) and one.size not in sizes]
    suffixes = Counter(_suffix(name) for one in strays for name in gathered.states[one])
    others = sum(count for suffix, count in suffixes.items() if suffix not in EXPORTS)
    images = sum(len(names) for one, names in gathered.states.items() if _names_a_camera(one))
    found: list[SkippedFile] = []
    for metadata in strays:
        names = gathered.states[metadata]
        width, height = metadata.size
        is_small = width * height < small and others < images
        taken = [name for name in names if is_small or _suffix(name) in EXPORTS]
        why = f"it names no camera, and no camera here has images of {width}×{height}: a preview, or a map"
        found += (SkippedFile(name=name, reason=why) for name in taken)
        left = [name for name in names if name not in set(taken)]
        if left:
            gathered.states[metadata] = left
        else:
            del gathered.states[metadata]
    return tuple(sorted(found, key=lambda one: one.name))


def _names_a_camera(metadata: ImageMetadata) -> bool:
    stated = (metadata.make, metadata.model, metadata.focal_mm, metadata.focal_35mm, metadata.xmp)
    return any(stated)


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower()
