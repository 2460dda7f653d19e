"""What is set aside before cameras are judged: pictures that no camera took, and images whose EXIF is another's."""

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
    """Images that no camera is told from, each with its reason.

    Attributes:
        listed: all of them, or the first of very many.
        count: how many there are.
    """

    listed: tuple[SkippedFile, ...] = ()
    count: int = 0


class SortedImages(Struct, frozen=True, kw_only=True):
    """The images of a run by what becomes of them.

    Attributes:
        states: those that are judged, by what they say and by day; the state of the first image first.
        unread: those that cannot be read, or contradict themselves.
        pictures: those that no camera took.
    """

    states: Mapping[ImageMetadata, ByDay]
    unread: Rows
    pictures: Rows


def sort_images(flight: Flight) -> SortedImages:
    """Take out what is not evidence of any camera: an image whose EXIF is of another frame, and pictures."""
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
    """Pictures that state nothing of a camera and are of a size that no camera of the flight has, with the reason.

    An image of the flight that was stripped of its metadata has the size of the others, and stays. So do JPEGs that
    are not smaller than a quarter of the others, or are the majority: that is a flight that was resized and stripped,
    with one image left. Where no image names a camera, nothing is taken out.
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
