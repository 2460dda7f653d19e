"""Select the images of a flight for a calibration, and the pairs of them to match.

A few dozen overlapping images determine a lens as well as a thousand, provided that they differ in height, heading and
tilt. The selection therefore finds the place with the most kinds of images around it and takes the nearest of each
kind in turn, no more than two of a spot first: images from one position, of a burst or of passes along one line, show
no depth. If the images state no positions, it takes consecutive images from the middle of the flight.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.parsers.imagery.taken import Fix
from calibrary.records import replace
from calibrary.sfm.engine import FlightImage
from calibrary.sfm.geodesy import LocalFrame

RECEIVER_STD_M: Final = (3.0, 3.0, 5.0)
"""Standard deviations (east, north, up) of a receiver that states none."""
SMALL: Final = 0.6
"""A file smaller than this share of the median contains a blurred or almost empty image, which JPEG compresses well."""
HEIGHT_CLASS: Final = 0.12
"""Images with altitudes that differ by less than this share of the flight's horizontal extent have the same height."""
LEAST_STEP_M: Final = 5.0
OBLIQUE_FROM_DEG: Final = 12.0
NEIGHBOURS: Final = 12
"""Number of images that each image is matched with."""
ALL_PAIRS: Final = 20
"""Up to this number of images all pairs are matched."""
SEEDS: Final = 80
REACH: Final = 2.5
"""Images are near one place up to so many times the distance within which as many were taken as are wanted."""
SEVERAL: Final = 3
"""Number of images that a kind needs to count fully: one alone says little."""
ENOUGH_POINTS: Final = 6
"""Number of surveyed points wanted: three define the frame, the others check them."""


class LocatedImage(Struct, frozen=True, kw_only=True):
    """An image of a flight and its stated position.

    Attributes:
        image: the image; :func:`select_images` fills in its position.
        fix: stated position; None if there is none.
        file_bytes: size of the file in bytes.
    """

    image: FlightImage
    fix: Fix | None
    file_bytes: int


class Selection(Struct, frozen=True, kw_only=True):
    """Selected images and pairs.

    Attributes:
        images: selected images, with their positions in a local frame.
        pairs: pairs to match, as indices of ``images``.
        left_out: number of images that were not needed, and of those that are not sharp.
        how: how they were selected, in words.
        frame: frame of the positions; None if there are none.
    """

    images: tuple[FlightImage, ...]
    pairs: tuple[tuple[int, int], ...]
    left_out: tuple[int, int]
    how: str
    frame: LocalFrame | None = None


def select_images(
    taken: Sequence[LocatedImage], most: int, shown: Mapping[str, frozenset[int]] | None = None
) -> Selection:
    """Select at most ``most`` images that overlap and differ.

    Args:
        taken: images in the order of capture.
        most: largest number of images.
        shown: surveyed points in each image, by its name; images that show many of them are preferred.
    """
    shown = shown or {}
    typical = float(np.median([one.file_bytes for one in taken]))
    sharp = [one for one in taken if one.file_bytes >= SMALL * typical]
    known = [one for one in sharp if one.fix is not None]
    if len(known) < max(3, len(sharp) // 2):
        kept = sharp
        points = [shown.get(one.image.name, frozenset()) for one in kept]
        middle = max(0, (len(kept) - most) // 2)
        first = max(
            range(max(0, len(kept) - most) + 1),
            key=lambda at: (_marks_shown(points[at : at + most]), -abs(at - middle)),
        )
        images = tuple(one.image for one in kept[first : first + most])
        how = "in the order of their names: they state no positions"
        return _chosen(images, _in_order(len(images)), taken, sharp, how)
    stated = geodetic([one.fix for one in known if one.fix is not None])
    frame = LocalFrame.around(stated)
    places = frame.metres(stated)
    kinds = _kinds([one.fix for one in known if one.fix is not None], places)
    points = [shown.get(one.image.name, frozenset()) for one in known]
    rows = images_nearby(places, kinds, most, points) if len(known) > most else [*range(len(known))]
    images = tuple(_placed(known[row], places[row]) for row in rows)
    number = len({kinds[row] for row in rows})
    how = f"by position, of {number} kind{'s' if number > 1 else ''} of height, heading and tilt"
    return replace(_chosen(images, overlapping_pairs(images), taken, sharp, how), frame=frame)


def _chosen(
    images: tuple[FlightImage, ...],
    pairs: tuple[tuple[int, int], ...],
    taken: Sequence[LocatedImage],
    sharp: Sequence[LocatedImage],
    how: str,
) -> Selection:
    blurred = len(taken) - len(sharp)
    return Selection(images=images, pairs=pairs, left_out=(len(sharp) - len(images), blurred), how=how)


def overlapping_pairs(images: Sequence[FlightImage]) -> tuple[tuple[int, int], ...]:
    """Return the pairs to match: each image with its nearest neighbours, or all pairs of a few images."""
    if len(images) <= ALL_PAIRS or any(image.centre_m is None for image in images):
        return _in_order(len(images))
    places = np.array([image.centre_m for image in images])
    apart = np.linalg.norm(places[:, None, :2] - places[:, :2], axis=-1)
    np.fill_diagonal(apart, math.inf)
    nearest = np.argsort(apart, axis=1)[:, :NEIGHBOURS]
    return tuple(sorted({(min(a, b), max(a, b)) for a, row in enumerate(nearest.tolist()) for b in row}))


def _in_order(count: int) -> tuple[tuple[int, int], ...]:
    """Return all pairs or, of many images, each with the next dozen."""
    return tuple(
        pair
        for pair in combinations(range(count), 2)
        if count <= 2 * ALL_PAIRS or pair[1] - pair[0] <= NEIGHBOURS
    )


def geodetic(fixes: Sequence[Fix]) -> FloatArray:
    """(N, 3) longitudes and latitudes, degrees, and heights, m."""
    return np.array([(fix.longitude_deg, fix.latitude_deg, fix.altitude_m) for fix in fixes])


def _kinds(fixes: Sequence[Fix], places: FloatArray) -> list[tuple[int, int, int]]:
    """(height, heading, tilt) class of each image."""
    heights = height_classes(places, LEAST_STEP_M)
    # Without a gimbal's yaw, assume images aligned with the flight direction; opposite strips have one heading.
    ahead = np.gradient(places[:, :2], axis=0) if len(places) > 1 else np.zeros((1, 2))
    found = []
    for fix, height, (east, north) in zip(fixes, heights.tolist(), ahead.tolist(), strict=True):
        yaw = fix.yaw_deg if fix.yaw_deg is not None else math.degrees(math.atan2(east, north))
        turned = int((yaw % 180.0 + 45.0) // 90.0) % 2
        oblique = fix.pitch_deg is not None and abs(fix.pitch_deg + 90.0) > OBLIQUE_FROM_DEG
        # Oblique images are wanted from all four directions.
        found.append((height, int((yaw % 360.0 + 45.0) // 90.0) % 4 if oblique else turned, int(oblique)))
    return found


def height_classes(places: FloatArray, least: float) -> IntArray:
    """Return (N,) the height class of each place.

    Args:
        places: (N, 3) east, north and up.
        least: smallest step between two classes; 0 if the scale is unknown.
    """
    extent = float(np.ptp(places[:, :2], axis=0).max())
    step = max(HEIGHT_CLASS * extent, least) or 1.0
    return np.asarray(np.floor((places[:, 2] - places[:, 2].min()) / step + 0.5), dtype=np.intp)


def images_nearby(
    places: FloatArray,
    kinds: Sequence[tuple[int, int, int]],
    most: int,
    points: Sequence[frozenset[int]] | None = None,
) -> list[int]:
    """Return the rows of the images around the place with images of the most kinds close by.

    Args:
        places: (N, 3) east, north and up, in the order of capture.
        kinds: (height, heading, tilt) class of each image.
        most: largest number of images.
        points: surveyed points in each image; a place with several of them is preferred, and the distance of an image
            with any is halved.
    """
    points = points or [frozenset()] * len(places)
    nearer = np.array([0.5 if one else 1.0 for one in points])
    kind = np.unique(np.array(kinds), axis=0, return_inverse=True)[1].ravel()
    # Two of a spot count alike: where no gimbal states its tilt, a second pass may look elsewhere.
    turn = _turns(places[:, :2], kind, np.argsort(nearer, kind="stable"), most) // 2
    seeds = np.linspace(0, len(places) - 1, min(len(places), SEEDS)).astype(int)
    # Every place could be the best one; a sample of the flight's images comes close to it.
    around = np.linalg.norm(places[seeds, None, :2] - places[:, :2], axis=2) * nearer
    enough = turn <= np.sort(turn)[most - 1]
    reach = REACH * np.sort(around[:, enough], axis=1)[:, most - 1].min()
    found = []
    for apart in around:
        order = np.flatnonzero(enough & (apart <= reach))
        order = order[np.lexsort((apart[order], turn[order], kind[order]))]
        # One of each kind in turn, so that frequent kinds leave room for rare ones.
        rank = np.arange(len(order)) - np.searchsorted(kind[order], kind[order])
        rows = order[np.lexsort((apart[order], rank, turn[order]))][:most]
        several = int(np.minimum(np.bincount(kind[rows]), SEVERAL).sum())
        marks = _marks_shown([points[row] for row in rows.tolist()])
        found.append((-len(rows), -marks, -several, float(apart[rows].max()), sorted(rows.tolist())))
    return min(found)[-1]


def _turns(places: FloatArray, kind: IntArray, order: IntArray, most: int) -> IntArray:
    """(N,) 0 for images that lie apart from others of their kind, 1 for what lies apart among the rest, and so on.

    Apart is half a step of the flight: half of its course was flown in steps of that length or longer, however many
    images were taken from one place. The longest hundredth are not flown over what is photographed. Once there are
    ``most`` images, in two rounds at least, the others have one number.
    """
    steps = np.sort(np.linalg.norm(np.diff(places, axis=0), axis=1))[: -1 - len(places) // 100]
    flown = np.cumsum(steps)
    apart = 0.5 * steps[np.searchsorted(flown, 0.5 * flown[-1])]
    turn = np.full(len(places), len(places))
    for number in range(len(places)):
        near = turn < number
        if number > 1 and int(near.sum()) >= most:
            break
        for row in order.tolist():
            if not near[row]:
                turn[row] = number
                near |= (kind == kind[row]) & (np.linalg.norm(places - places[row], axis=1) <= apart)
    return turn


def _marks_shown(points: Sequence[frozenset[int]]) -> int:
    """Return how many surveyed points at least two of these images show, at most ``ENOUGH_POINTS``."""
    counts = Counter(point for one in points for point in one)
    return min(sum(count >= 2 for count in counts.values()), ENOUGH_POINTS)


def _placed(one: LocatedImage, place: FloatArray) -> FlightImage:
    assert one.fix is not None  # noqa: S101  only those are placed
    east, north, up = place.tolist()
    return replace(one.image, centre_m=(east, north, up), centre_std_m=one.fix.std_m or RECEIVER_STD_M)
