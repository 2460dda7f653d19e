"""Priors of the adjustment: stated positions of the images and surveyed points of the ground.

Both are observations with their own standard deviations. Positions and points rarely have the same height system and
not always the same datum (ellipsoidal and levelled heights differ by tens of metres). With surveyed points, a constant
offset of all positions is therefore estimated too, and eliminated like the points.
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
"""Number of parameters of the world frame that images do not determine: position, rotation and scale."""
ANCHORINGS: Final = 2
"""Number of Gauss–Newton steps; the angle is small."""


class Priors(Struct, frozen=True, kw_only=True, eq=False):
    """Residuals and weights of the priors at a scene.

    Attributes:
        by_place: (V, 3) weights of the images' stated positions, px/m; zero without a position.
        off_place: (V, 3) stated − estimated position, m.
        by_point: (P, 3) weights of the surveyed places of points, px/m; zero without a survey.
        off_point: (P, 3) stated − estimated place, m.
        by_offset: weight of the constant offset of all positions being zero, px²/m²; None without such an offset.
    """

    by_place: FloatArray
    off_place: FloatArray
    by_point: FloatArray
    off_point: FloatArray
    by_offset: float | None

    @property
    def offset(self) -> FloatArray:
        """(3,) estimated offset of the positions from the points' frame, m."""
        if self.by_offset is None:
            return np.zeros(3)
        weight = self.by_place**2
        total = weight.sum(axis=0) + self.by_offset
        return np.asarray((weight * self.off_place).sum(axis=0) / np.where(total > 0, total, 1.0))

    @property
    def left_place(self) -> FloatArray:
        """(V, 3) stated − estimated position after subtraction of the constant offset, m."""
        return np.asarray(self.off_place - self.offset)

    @property
    def cost(self) -> float:
        """Weighted sum of squares of the priors, px²."""
        offset = (self.by_offset or 0.0) * float((self.offset**2).sum())
        places = float(((self.by_place * self.left_place) ** 2).sum())
        return places + float(((self.by_point * self.off_point) ** 2).sum()) + offset

    @property
    def numbers(self) -> int:
        """Contribution to the degrees of freedom: stated coordinates, minus 3 for a free offset; the gauge if none."""
        stated = int((self.by_place > 0).sum()) + int((self.by_point > 0).sum())
        return stated - (3 if self.by_offset == 0.0 else 0) if stated else GAUGE

    def of(self, images: BoolArray, points: BoolArray) -> Priors:
        """Return the priors of some images and points only.

        Args:
            images: (V,) which images.
            points: (P,) which points.
        """
        return replace(
            self, by_place=self.by_place * images[:, None], by_point=self.by_point * points[:, None]
        )

    def add_places(self, matrix: FloatArray, right: FloatArray, columns: IntArray) -> None:
        """Add the positions to the normal equations, with their constant offset eliminated.

        Args:
            matrix: (D, D) normal matrix, changed in place.
            right: (D,) right-hand side, changed in place.
            columns: (V, 3) columns of each image's position; ignored for images without a stated position.
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
    """Compute the priors of the images and points in the tracks.

    Args:
        tracks: observations.
        scene: parameters at which to evaluate.
        variance: variance of an image coordinate, px², for the weights; zero ignores all priors.
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
    """Move, rotate and scale the scene to the weighted best fit of its images to their places.

    The reprojections do not change. The scene must already be close, as after :func:`calibrary.sfm.tracks.aligned`.

    Args:
        scene: scene with V images.
        places: (V, 3) m; ignored where the weight is zero.
        weights: (V, 3) inverse standard deviations; zero without a stated place.
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
