"""Reasons why the images of a flight do not fit together, from their features and matches, with remedies.

Obvious reasons are found before COLMAP's mapping, which tries hundreds of pairs before it fails. Reasons that only this
failure confirms, such as that all images are from one place, are found after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import ImageSize
from calibrary.sfm.engine import Matches
from calibrary.sfm.tracks import FEWEST_IMAGES

__all__ = ["plainly_unfit", "unfit"]

FEW_FEATURES: Final = 50
"""Smallest number of features of an image; ground has thousands, blank, dark or blurred images almost none."""
STILL: Final = 0.01
"""Share of the longer side; matches that move less between all images show one view."""
TURNED: Final = 0.0025
"""Largest residual, as a share of the longer side, if a rotation of the camera explains the matches except for noise
and distortion. Rendered hovering flights have 0.0006, with wind drift of 0.3 m at 80 m 0.0018; vertical images of flat
ground from different places have 0.005."""
FOCALS: Final = np.geomspace(0.4, 3.0, 16)
"""Values of fx / W at which a rotation is tried."""
ENOUGH: Final = 300
"""Number of matches of a pair that are evaluated."""


def plainly_unfit(features: Sequence[int], matches: Sequence[Matches], size: ImageSize) -> str | None:
    """Return why these images cannot determine a camera, if that is obvious without a reconstruction; otherwise None.

    Args:
        features: number of features of each image.
        matches: matches of the pairs.
        size: size of the images, px.
    """
    empty = sum(count < FEW_FEATURES for count in features)
    if len(features) - empty < FEWEST_IMAGES:
        return (
            f"{empty} of {len(features)} images show fewer than {FEW_FEATURES} points that can be found again, as "
            "blank ground, water, sky, darkness and blur do: fly over ground with detail, in more light, in focus"
        )
    together = _largest_group(len(features), matches)
    if together < FEWEST_IMAGES:
        most = f"no more than {together}" if together > 1 else "no two"
        return (
            f"of {len(features)} images {most} show the same points, need {FEWEST_IMAGES}: give images that overlap by "
            "70 %, of ground that stands still, which water and trees in the wind do not"
        )
    if max(_moved(pair) for pair in matches) < STILL * max(size):
        return "the images all show one view: the camera did not move; give images from different places"
    return None


def unfit(images: int, matches: Sequence[Matches], size: ImageSize) -> str:
    """Return why the reconstruction failed.

    Args:
        images: number of images.
        matches: matches of the pairs.
        size: size of the images, px.
    """
    if matches and _only_turned(matches, size):
        return (
            f"{images} images were taken from one place: a turn of the camera explains all that they share, which does "
            "not determine a camera here; give images from different places, as of strips flown over the ground"
        )
    return (
        f"of {images} images no {FEWEST_IMAGES} fit together: they overlap too little, are from nearly one place, or "
        "show too little that stands still; give images that overlap by 70 %, from different places"
    )


def _largest_group(images: int, matches: Sequence[Matches]) -> int:
    """Return the size of the largest group of images connected by matches."""
    group = np.arange(images)
    for pair in matches:
        group[group == group[pair.second]] = group[pair.first]
    return int(np.bincount(group).max())


def _moved(pair: Matches) -> float:
    """Return the median shift of the matches, px."""
    return float(np.median(np.linalg.norm(pair.pixels_first - pair.pixels_second, axis=1)))


def _only_turned(matches: Sequence[Matches], size: ImageSize) -> bool:
    """Return whether for some focal length a rotation of the camera explains nine of ten pairs."""
    middle, side = np.array(size) / 2, max(size)
    some = [np.linspace(0, len(pair.pixels_first) - 1, ENOUGH).astype(int) for pair in matches]
    rays = [
        (pair.pixels_first[rows] - middle, pair.pixels_second[rows] - middle)
        for pair, rows in zip(matches, some, strict=True)
    ]
    off = [[_off_turn(*both, f * side) for both in rays] for f in FOCALS]
    return bool(np.percentile(off, 90, axis=1).min() < TURNED * side)


def _off_turn(one: FloatArray, other: FloatArray, focal: float) -> float:
    """Return the median residual of the matches after the best rotation, px.

    Source: W. Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976.
    """
    a, b = (np.column_stack([points, np.full(len(points), focal)]) for points in (one, other))
    a, b = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (a, b))
    U, _, Vt = np.linalg.svd(b.T @ a)
    turn = (U * (1.0, 1.0, np.linalg.det(U @ Vt))) @ Vt
    return float(np.median(np.linalg.norm(a @ turn.T - b, axis=1))) * focal
