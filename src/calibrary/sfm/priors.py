"""What is known of the world beside the images: where they were taken, and where points of the ground lie.

Both are observations with a standard deviation of their own. Positions and points are rarely of one height system and
not always of one datum (a receiver's ellipsoidal heights beside levelled ones: tens of metres). So where there are
points, a constant offset of all positions is solved for with the rest, and eliminated as the points are.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.sfm.tracks import FEWEST_IMAGES, Scene, Similarity, Tracks

__all__ = ["GAUGE", "Priors", "anchored", "priors_of"]

GAUGE: Final = 7
"""Numbers of the world that images alone do not determine: where it is, how it is turned, how large it is."""
ANCHORINGS: Final = 2
"""Steps of Gauss and Newton, of an angle that is small."""


class Priors(Struct, frozen=True, kw_only=True, eq=False):
    """What is stated of the world, around a scene.

    Attributes:
        by_place: (V, 3) px ÷ m, the weights of the images' stated positions; zero where none is stated.
        off_place: (V, 3) m stated − solved.
        by_point: (P, 3) px ÷ m, the weights of the points' stated places; zero where none is stated.
        off_point: (P, 3) m stated − solved.
        by_offset: px² ÷ m², the weight of a constant offset of all positions being nought; None where there is none.
    """

    by_place: FloatArray
    off_place: FloatArray
    by_point: FloatArray
    off_point: FloatArray
    by_offset: float | None

    @property
    def offset(self) -> FloatArray:
        """(3,) m by which the positions are off the points' frame."""
        if self.by_offset is None:
            return np.zeros(3)
        weight = self.by_place**2
        total = weight.sum(axis=0) + self.by_offset
        return np.asarray((weight * self.off_place).sum(axis=0) / np.where(total > 0, total, 1.0))

    @property
    def left_place(self) -> FloatArray:
        """(V, 3) m stated − solved, the constant offset taken off."""
        return np.asarray(self.off_place - self.offset)

    @property
    def cost(self) -> float:
        """px²."""
        offset = (self.by_offset or 0.0) * float((self.offset**2).sum())
        places = float(((self.by_place * self.left_place) ** 2).sum())
        return places + float(((self.by_point * self.off_point) ** 2).sum()) + offset

    @property
    def numbers(self) -> int:
        """How many numbers more than before are measured than solved for; the world's seven are none where any is."""
        stated = int((self.by_place > 0).sum()) + int((self.by_point > 0).sum())
        return stated - (3 if self.by_offset == 0.0 else 0) if stated else GAUGE

    def of(self, images: BoolArray, points: BoolArray) -> Priors:
        """Those of some images and points alone.

        Args:
            images: (V,).
            points: (P,).
        """
        return replace(
            self, by_place=self.by_place * images[:, None], by_point=self.by_point * points[:, None]
        )

    def add_places(self, matrix: FloatArray, right: FloatArray, columns: IntArray) -> None:
        """Add the positions to normal equations, their constant offset eliminated.

        Args:
            matrix: (D, D).
            right: (D,).
            columns: (V, 3) where each image's place is; of images without a position anywhere.
        """
        rows = (self.by_place > 0).any(axis=1)
        at, weight = columns[rows], self.by_place[rows] ** 2
        matrix[at, at] += weight
        right[at] += weight * self.left_place[rows]
        if self.by_offset is not None and rows.any():
            total = weight.sum(axis=0) + self.by_offset
            for axis in range(3):
                matrix[np.ix_(at[:, axis], at[:, axis])] -= np.outer(*(weight[:, axis],) * 2) / total[axis]


def priors_of(tracks: Tracks, scene: Scene, variance: float) -> Priors:
    """What is stated of the images and points that are seen.

    Args:
        tracks: the observations.
        scene: where.
        variance: px² that a stated number's own variance counts as; zero leaves all of them out.
    """
    by_place, off_place = np.zeros_like(scene.centres), np.zeros_like(scene.centres)
    by_point, off_point = np.zeros_like(scene.points), np.zeros_like(scene.points)
    control, by_offset = tracks.control, None
    if tracks.positions is not None and variance > 0:
        rows = tracks.positions.known & tracks.used
        by_place[rows] = np.sqrt(variance) / tracks.positions.std[rows]
        off_place[rows] = tracks.positions.places[rows] - scene.centres[rows]
    if control is not None and variance > 0:
        seen = np.isin(control.point, tracks.point)
        by_point[control.point[seen]] = np.sqrt(variance) / control.std_m
        off_point[control.point[seen]] = control.places[seen] - scene.points[control.point[seen]]
        by_offset = variance / control.offset_std_m**2
    return Priors(
        by_place=by_place,
        off_place=off_place,
        by_point=by_point,
        off_point=off_point,
        by_offset=by_offset,
    )


def anchored(scene: Scene, places: FloatArray, weights: FloatArray) -> Scene:
    """The same scene moved, turned and scaled to where its images fit their places best, each by its own weight.

    What the images show stays as it is. The start has to be near, such as :func:`calibrary.sfm.tracks.aligned`.

    Args:
        scene: of V images.
        places: (V, 3) m; anything where the weight is zero.
        weights: (V, 3) the inverse of the standard deviations; zero where none is stated.
    """
    rows = (weights > 0).all(axis=1)
    if int(rows.sum()) < FEWEST_IMAGES or not np.isfinite(scene.centres).all():
        return scene
    for _ in range(ANCHORINGS):
        centres, middle = scene.centres[rows], scene.centres[rows].mean(axis=0)
        off = (places[rows] - centres) * weights[rows]
        by = np.zeros((len(centres), 3, GAUGE))
        by[..., :3] = np.eye(3)
        by[..., 3:6] = np.cross(np.eye(3), (centres - middle)[:, None, :]).transpose(0, 2, 1)
        by[..., 6] = centres - middle
        weighted = (by * weights[rows, :, None]).reshape(-1, GAUGE)
        solved = np.linalg.lstsq(weighted, off.reshape(-1), rcond=None)[0]
        step = np.asarray(solved, dtype=np.float64)
        scale, turn = math.exp(min(max(float(step[6]), -1.0), 1.0)), rotation_matrix(step[3:6])
        shift = middle + step[:3] - scale * turn @ middle
        scene = Similarity(scale=scale, turn=turn, shift=shift).moved(scene)
    return scene
