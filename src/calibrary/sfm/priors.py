"""Priors of the adjustment: stated positions of the images, surveyed points of the ground, and the flight's nuisances.

All are observations with their own standard deviations. Positions and points rarely have the same height system and
not always the same datum (ellipsoidal and levelled heights differ by tens of metres). With surveyed points, a constant
offset of all positions is therefore estimated too, and eliminated like the points. What else stands between an image
and its stated position is in :mod:`calibrary.sfm.nuisances`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.lens_models import Solvable
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.sfm.nuisances import ASPECT_STD, HEIGHT_SCALE, NONE, READOUT, ahead_by_turn, place_by_nuisance
from calibrary.sfm.tracks import FEWEST_IMAGES, Scene, Similarity, Tracks

UP: Final = 2
FOCAL: Final = (0, 1)
"""Index of fx and fy among the parameters of every lens model."""
DENOMINATOR: Final = ("k4", "k5", "k6")
DENOMINATOR_STD: Final = 1.0
"""Of each before the flight. A numerator and a denominator of a rational lens that both grow without end describe the
same lens ever better: without this a search ended wherever its steps ran out, and some flights determined no lens."""
GAUGE: Final = 7
"""Number of parameters of the world frame that images do not determine: position, rotation and scale."""
ANCHORINGS: Final = 2
"""Number of Gauss–Newton steps; the angle is small."""


class Known(Struct, frozen=True, kw_only=True, eq=False):
    """Residuals and weights of what is known of m adjusted nuisances.

    Attributes:
        place_by: (V, 3, m) derivatives of the stated positions by the nuisances.
        place_by_turn: (V, 3, 3) derivatives of the stated positions by the rotations of the images.
        up_by: derivative of a stated height by the height.
        weight: (m,) weights of the nuisances, px per unit.
        off: (m,) known − estimated.
        by_aspect: weight of pixels being square, px; zero without a readout.
        aspect: 1 − fy ÷ fx.
        aspect_by: (2,) derivatives of fy ÷ fx by fx and fy.
        by_lens: (n,) weights of lens parameters that are near zero, px per unit; zero for the others.
        lens: (n,) these parameters.
    """

    place_by: FloatArray
    place_by_turn: FloatArray
    up_by: float
    weight: FloatArray
    off: FloatArray
    by_aspect: float
    aspect: float
    aspect_by: FloatArray
    by_lens: FloatArray
    lens: FloatArray


class Priors(Struct, frozen=True, kw_only=True, eq=False):
    """Residuals and weights of the priors at a scene.

    Attributes:
        by_place: (V, 3) weights of the images' stated positions, px/m; zero without a position.
        off_place: (V, 3) stated − estimated position, m.
        by_point: (P, 3) weights of the surveyed places of points, px/m; zero without a survey.
        off_point: (P, 3) stated − estimated place, m.
        by_offset: weight of the constant offset of all positions being zero, px²/m²; None without such an offset.
        known: what is known of the nuisances.
    """

    by_place: FloatArray
    off_place: FloatArray
    by_point: FloatArray
    off_point: FloatArray
    by_offset: float | None
    known: Known

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
        known = float(((self.known.weight * self.known.off) ** 2).sum())
        square = (self.known.by_aspect * self.known.aspect) ** 2
        square += float(((self.known.by_lens * self.known.lens) ** 2).sum())
        return places + float(((self.by_point * self.off_point) ** 2).sum()) + offset + known + square

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

    def add(self, matrix: FloatArray, right: FloatArray, free: IntArray, columns: IntArray) -> None:
        """Add positions and nuisances to the normal equations, with the positions' constant offset eliminated.

        Args:
            matrix: (D, D) normal matrix, changed in place: g lens parameters, m nuisances, then the images.
            right: (D,) right-hand side, changed in place.
            free: (g,) indices of the adjusted lens parameters.
            columns: (V, 3) columns of each image's position; ignored for images without a stated position.
        """
        known, g = self.known, len(free)
        shared = slice(g, g + len(known.weight))
        rows = np.flatnonzero((self.by_place > 0).any(axis=1))
        # (rows, 3, m + 6) derivatives of a stated position by the nuisances and by its own image's pose, nothing else.
        by = np.zeros((len(rows), 3, shared.stop - g + 6))
        by[..., :-6], by[..., -6:-3] = known.place_by[rows], known.place_by_turn[rows]
        by[..., -3:] = np.diag((1.0, 1.0, known.up_by))
        at = np.concatenate(
            [np.tile(np.arange(g, shared.stop), (len(rows), 1)), columns[rows] - 3, columns[rows]], axis=1
        )
        weight = self.by_place[rows] ** 2
        np.add.at(matrix, (at[:, :, None], at[:, None, :]), np.einsum("rai,ra,raj->rij", by, weight, by))
        np.add.at(right, at, np.einsum("rai,ra->ri", by, weight * self.left_place[rows]))
        if self.by_offset is not None:
            carried = np.zeros((3, len(right)))
            np.add.at(carried, (np.arange(3)[:, None], at[:, None]), (weight[..., None] * by))
            matrix -= carried.T @ (carried / np.maximum(weight.sum(axis=0) + self.by_offset, 1e-300)[:, None])
        at = np.arange(g, shared.stop)
        matrix[at, at] += known.weight**2
        right[at] += known.weight**2 * known.off
        if known.by_aspect > 0 and set(FOCAL) <= set(free.tolist()):
            at = np.flatnonzero(np.isin(free, FOCAL))
            matrix[np.ix_(at, at)] += known.by_aspect**2 * np.outer(*(known.aspect_by,) * 2)
            right[at] += known.by_aspect**2 * known.aspect * known.aspect_by
        at = np.flatnonzero(free < len(known.lens))
        weight = known.by_lens[free[at]] ** 2
        matrix[at, at] += weight
        right[at] -= weight * known.lens[free[at]]


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
        off_place[rows] = tracks.positions.places[rows] - _stated(scene, tracks.positions.places)[rows]
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
        known=_known(tracks, scene, variance),
    )


def _known(tracks: Tracks, scene: Scene, variance: float) -> Known:
    priors, places = tracks.nuisances, tracks.positions.places if tracks.positions is not None else None
    heights = scene.centres[:, UP] - (_middle(places) if places is not None else 0.0)
    place_by, fx, fy = place_by_nuisance(scene.rotations, heights), *scene.parameters[:2]
    active = priors.active if priors is not None and variance > 0 else NONE > 0
    # A turn to the left carries what lies ahead and to the right of an image.
    arm = place_by[..., :HEIGHT_SCALE] @ scene.nuisances[:HEIGHT_SCALE]
    to_left = np.stack([-arm[:, 1], arm[:, 0], np.zeros(len(arm))], axis=1)
    mean, std = (priors.mean, priors.std) if priors is not None else (NONE, NONE)
    denominator = np.isin(scene.model.parameters, DENOMINATOR) & (scene.model is Solvable.RATIONAL)
    return Known(
        place_by=place_by[..., active],
        place_by_turn=to_left[:, :, None] * ahead_by_turn(scene.rotations)[:, None],
        up_by=1.0 + float(scene.nuisances[HEIGHT_SCALE]),
        weight=math.sqrt(variance) / std[active],
        off=(mean - scene.nuisances)[active],
        by_aspect=math.sqrt(variance) / ASPECT_STD if active[READOUT] else 0.0,
        aspect=float(1.0 - fy / fx),
        aspect_by=np.array([-fy / fx**2, 1.0 / fx]),
        by_lens=np.where(denominator, math.sqrt(variance) / DENOMINATOR_STD, 0.0),
        lens=scene.parameters,
    )


def _middle(places: FloatArray) -> float:
    """Return the height at which a wrong scale of heights moves nothing; all may be off by a constant anyway."""
    return float(np.nanmean(places[:, UP]))


def _stated(scene: Scene, places: FloatArray) -> FloatArray:
    """Return (V, 3) the positions that the receiver would state of the scene's images."""
    by = place_by_nuisance(scene.rotations, scene.centres[:, UP] - _middle(places))
    return np.asarray(scene.centres + by @ scene.nuisances)


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
        off = (places - _stated(scene, places))[rows] * weights[rows]
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
