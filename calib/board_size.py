"""Number of corners of a checkerboard, found by trial."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from typing import Final

import numpy as np

from calibrary.calib.board import LARGEST, Board
from calibrary.calib.detectors.checkerboard import find_whole
from calibrary.calib.detectors.refinement import reduced
from calibrary.calib.found import Found
from calibrary.calib.frames import Gray
from calibrary.errors import CalibrationError

__all__ = ["find_board_size"]

SIDES: Final = (1280, 800)
"""Longer side in px of the copies in which lattices are grown; one that ends at a blurred corner may not in
another."""

MOST_IMAGES = 40
SURE = 3
SMALLEST = 3


def find_board_size(images: Iterable[Gray]) -> tuple[int, int]:
    """Return (columns, rows) of inner corners of the checkerboard in the images, with columns ≥ rows.

    A detector that grows a lattice from any piece of board proposes sizes. Each is then searched for like a given
    size, which recognises a part of a larger board by the squares beyond it. The result is the first size that three
    images agree on, with at most one that disagrees.

    Args:
        images: images of one board, (H, W) each; one is enough, several are safer. Only as many as needed are read.

    Raises:
        CalibrationError: no size fits, or two sizes fit equally well.
    """
    fits: Counter[tuple[int, int]] = Counter()
    count = 0
    for image in islice(images, MOST_IMAGES):
        count += 1
        leading = [size for size, _ in fits.most_common(1)]
        # Sizes found in earlier images are tried first, and the first size that fits an image is taken.
        size = next((size for size in chain(leading, _proposed(image)) if _fits(image, size)), None)
        fits.update([size] if size is not None else [])
        (first, ahead), (_, behind) = (*fits.most_common(2), ((0, 0), 0), ((0, 0), 0))[:2]
        if ahead >= SURE and behind <= 1:
            return first
    best = max(fits.values(), default=0)
    winners = [size for size, votes in fits.items() if votes == best]
    if not winners:
        raise CalibrationError(
            f"no checkerboard found in {count} frames by trying sizes; name its inner corners, such as "
            "checkerboard:11x8"
        )
    if len(winners) > 1:
        sizes = " and ".join(f"{columns}×{rows}" for columns, rows in winners)
        raise CalibrationError(
            f"checkerboards of {sizes} inner corners fit {best} of {count} frames each; name the right one"
        )
    return winners[0]


def _proposed(image: Gray) -> Iterator[tuple[int, int]]:
    """Yield the sizes of the lattices grown in one image."""
    import cv2

    seen = set()
    for side in SIDES:
        small, _ = reduced(image, side)
        for flags in (0, cv2.CALIB_CB_NORMALIZE_IMAGE):
            found, _, meta = cv2.findChessboardCornersSBWithMeta(
                small, (SMALLEST, SMALLEST), flags | cv2.CALIB_CB_LARGER
            )
            shape = np.shape(meta)
            if found and len(shape) >= 2 and min(shape[:2]) >= SMALLEST and max(shape[:2]) <= LARGEST:
                seen.add((max(shape[:2]), min(shape[:2])))
        if max(image.shape) <= side:
            break
    yield from sorted(seen)


def _fits(image: Gray, size: tuple[int, int]) -> bool:
    return isinstance(find_whole(image, Board(columns=size[0], rows=size[1], square_mm=None)), Found)
