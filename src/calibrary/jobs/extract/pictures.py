"""Images skipped before validation: pictures not taken by a camera, and images with the EXIF of another image."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.images.accumulator import ByDay, Flight, Names
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.images.observation import Seen, names_a_camera, path_order
from calibrary.records import replace

__all__ = ["Rows", "SortedImages", "sort_images"]


class Rows(Struct, frozen=True):
    """Images from which no camera is identified, with the reasons.

    Attributes:
        listed: all images, or only the first if there are very many.
        count: number of images.
    """

    listed: tuple[SkippedFile, ...] = ()
    count: int = 0


class SortedImages(Struct, frozen=True, kw_only=True):
    """The images of a run by category.

    Attributes:
        states: images to evaluate, by metadata and date; the state of the first image first.
        unread: images that cannot be read or contradict themselves.
        pictures: pictures not taken by a camera.
    """

    states: Mapping[ImageMetadata, ByDay]
    unread: Rows
    pictures: Rows


def sort_images(flight: Flight) -> SortedImages:
    """Separate the images that are not evidence of a camera: images with EXIF of another image size, and pictures."""
    whys = {seen: why for seen in flight.seen if (why := exif_contradiction(seen.metadata)) is not None}
    unread = [
        SkippedFile(name=name, reason=why) for seen, why in whys.items() for name in flight.seen[seen].listed
    ]
    left = {seen: names for seen, names in flight.seen.items() if seen not in whys}
    pictures = _pictures(left)
    shown = [
        SkippedFile(name=name, reason=why) for seen, why in pictures.items() for name in left[seen].listed
    ]
    judged = {seen: names for seen, names in left.items() if seen not in pictures}
    return SortedImages(
        states=replace(flight, seen=judged).by_day,
        unread=_rows([*flight.unread, *unread], flight.unread_count + _count(flight, whys)),
        pictures=_rows(shown, _count(flight, pictures)),
    )


def _pictures(seen: Mapping[Seen, Names]) -> dict[Seen, str]:
    """Pictures without camera metadata and with an image size that no camera of the flight has, with the reason.

    An image of the flight without metadata has the size of the others and is kept. JPEGs that are at least a
    quarter of the size of the others, or the majority, are kept as well: they are a flight that was resized
    and lost its metadata, with one original left. If no image names a camera, nothing is removed.
    """
    named = [one for one in seen if names_a_camera(one.metadata)]
    sizes = {one.metadata.size for one in named}
    if not sizes:
        return {}
    small = min(width * height for width, height in sizes) / 4
    sizes |= {(height, width) for width, height in sizes}
    strays = [one for one in seen if not names_a_camera(one.metadata) and one.metadata.size not in sizes]
    others = sum(seen[one].count for one in strays if not one.is_export)
    few = others < sum(seen[one].count for one in named)
    found: dict[Seen, str] = {}
    for one in strays:
        width, height = one.metadata.size
        if one.is_export or (few and width * height < small):
            found[one] = (
                f"it names no camera, and no camera here has images of {width}×{height}: a preview, or a map"
            )
    return found


def _count(flight: Flight, some: Mapping[Seen, str]) -> int:
    return sum(flight.seen[seen].count for seen in some)


def _rows(rows: list[SkippedFile], count: int) -> Rows:
    return Rows(tuple(sorted(rows, key=lambda row: (path_order(row.name), row.reason))), count)
