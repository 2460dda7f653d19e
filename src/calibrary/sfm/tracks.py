"""Observations of a flight: points observed in several images, positions of the images, and surveyed points."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import ImageSize
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.nuisances import NONE, NuisancePriors

FEWEST_IMAGES: Final = 3
"""Fewer provide no check of the focal length."""


class Positions(Struct, frozen=True, kw_only=True, eq=False):
    """Positions of the images by a satellite receiver.

    Attributes:
        places: (V, 3) m east, north and up of a nearby point; NaN for images without a position.
        std: (V, 3) standard deviations, m.
    """

    places: FloatArray
    std: FloatArray

    @property
    def known(self) -> BoolArray:
        """(V,) which images state a position."""
        return np.asarray(np.isfinite(self.places).all(axis=1), dtype=np.bool_)


class Control(Struct, frozen=True, kw_only=True, eq=False):
    """Surveyed points of the ground.

    Attributes:
        names: names of the G points.
        point: (G,) their indices in the tracks; all observations of these are marks.
        places: (G, 3) m east, north and up.
        std_m: standard deviation of each coordinate of a place, m.
        mark_px: standard deviation of each coordinate of a mark, px.
        offset_std_m: standard deviation of the common offset of the images' positions from the points' frame, m; inf
            if unknown.
    """

    names: tuple[str, ...]
    point: IntArray
    places: FloatArray
    std_m: float
    mark_px: float
    offset_std_m: float = math.inf


class Tracks(Struct, frozen=True, kw_only=True, eq=False):
    """Observations of points in images.

    Attributes:
        names: names of the V images.
        image_size: (width, height) of all images, px.
        image: (N,) image of each observation.
        point: (N,) point of each observation, ascending.
        pixels: (N, 2) px of the full image, from the outer corner of its first pixel.
        positions: positions of the images; None if no image states any.
        control: surveyed points; None if there are none.
        nuisances: what is known of the flight's nuisances; None keeps all at zero.
    """

    names: tuple[str, ...]
    image_size: ImageSize
    image: IntArray
    point: IntArray
    pixels: FloatArray
    positions: Positions | None = None
    control: Control | None = None
    nuisances: NuisancePriors | None = None

    @property
    def marks(self) -> BoolArray:
        """(N,) which observations are of surveyed points."""
        known = self.control.point if self.control is not None else np.empty(0, dtype=np.intp)
        return np.asarray(np.isin(self.point, known), dtype=np.bool_)

    def shared(self, keep: BoolArray) -> BoolArray:
        """Return (N,) which of the kept observations are of points with at least two of them, or of surveyed points.

        Args:
            keep: (N,) which observations to keep.
        """
        counts = np.bincount(self.point[keep], minlength=int(self.point.max(initial=-1)) + 1)
        return np.asarray(keep & ((counts[self.point] >= 2) | self.marks), dtype=np.bool_)

    def only(self, keep: BoolArray) -> Tracks:
        """Return the kept observations, without those of points that are left with too few.

        Args:
            keep: (N,) which observations to keep.
        """
        rows = self.shared(keep)
        return replace(self, image=self.image[rows], point=self.point[rows], pixels=self.pixels[rows])

    @property
    def used(self) -> BoolArray:
        """(V,) which images have observations."""
        return np.asarray(np.bincount(self.image, minlength=len(self.names)) > 0, dtype=np.bool_)


class Scene(Struct, frozen=True, kw_only=True, eq=False):
    """Parameters of a bundle adjustment.

    Attributes:
        model: lens model.
        parameters: (n,) lens parameters in the model's order.
        rotations: (V, 3, 3) world to camera.
        centres: (V, 3) centres of projection, in the world frame.
        points: (P, 3) points in the world frame.
        nuisances: (4,) in the order of :mod:`calibrary.sfm.nuisances`.
    """

    model: Solvable
    parameters: FloatArray
    rotations: FloatArray
    centres: FloatArray
    points: FloatArray
    nuisances: FloatArray = NONE


def widest(tracks: Tracks, scene: Scene) -> float:
    """Return the largest angle of an observation from the optical axis, rad."""
    away = scene.points[tracks.point] - scene.centres[tracks.image]
    inside = np.einsum("nij,nj->ni", scene.rotations[tracks.image], away)
    return float(np.arctan2(np.hypot(inside[:, 0], inside[:, 1]), inside[:, 2]).max())


class Similarity(Struct, frozen=True, kw_only=True, eq=False):
    """Similarity transformation between two frames.

    Attributes:
        scale: m per unit of the first frame.
        turn: (3, 3) rotation.
        shift: (3,) translation, m.
    """

    scale: float
    turn: FloatArray
    shift: FloatArray

    def of(self, places: FloatArray) -> FloatArray:
        """Transform (N, 3) places to the other frame."""
        return np.asarray(self.scale * places @ self.turn.T + self.shift)

    def moved(self, scene: Scene) -> Scene:
        """Transform a scene to the other frame."""
        return replace(
            scene,
            rotations=scene.rotations @ self.turn.T,
            centres=self.of(scene.centres),
            points=self.of(scene.points),
        )


def similarity(here: FloatArray, there: FloatArray) -> Similarity:
    """Fit the similarity from (N, 3) places to (N, 3) others by least squares; scale 0 if they do not correspond.

    Source: S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991.
    """
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    U, values, Vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    turn = (U * sign) @ Vt
    scale = max(float(values @ sign), 0.0) / max(float((a**2).sum()), 1e-300)
    return Similarity(scale=scale, turn=turn, shift=there.mean(axis=0) - scale * turn @ here.mean(axis=0))


def aligned(scene: Scene, positions: Positions) -> Scene:
    """Transform the scene by the similarity that fits its images to their stated positions.

    Raises:
        CalibrationError: fewer than three images state a position, or the positions contradict the images.
    """
    known = positions.known
    if int(known.sum()) < FEWEST_IMAGES:
        raise CalibrationError(f"{int(known.sum())} images state a position, need {FEWEST_IMAGES}")
    found = similarity(scene.centres[known], positions.places[known])
    if not found.scale > 0:
        raise CalibrationError("the images' positions contradict what the images show")
    return found.moved(scene)


def upward(points: FloatArray, centres: FloatArray) -> FloatArray:
    """Return the (3,) unit normal of the ground's plane, towards the images.

    Args:
        points: (P, 3) points of the ground.
        centres: (V, 3) centres of projection.
    """
    middle = np.median(points, axis=0)
    axis = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    return np.asarray(axis * (1.0 if float(np.median((centres - middle) @ axis)) > 0 else -1.0))


def levelled(scene: Scene) -> Scene:
    """Rotate the scene so that its ground is level with z up; for scenes without positions."""
    up = upward(scene.points, scene.centres)
    across = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    turn = np.stack([across, np.cross(up, across), up])
    return replace(
        scene,
        rotations=scene.rotations @ turn.T,
        centres=scene.centres @ turn.T,
        points=scene.points @ turn.T,
    )


def thinned(tracks: Tracks, most: int, seed: int = 0) -> Tracks:
    """Return at most ``most`` points: half the longest tracks, the others at random so that all images keep some."""
    counts = np.bincount(tracks.point)
    points = np.flatnonzero(counts)
    if len(points) <= most:
        return tracks
    random = np.random.default_rng(seed).random(len(counts))
    # Long tracks connect many images; random numbers spread the choice among tracks of one length over the image.
    order = points[np.lexsort((random[points], -np.minimum(counts[points], 6)))]
    chosen = np.zeros(len(counts), dtype=np.bool_)
    chosen[order[: most // 2]] = True
    chosen[np.random.default_rng(seed + 1).permutation(order[most // 2 :])[: most - most // 2]] = True
    return tracks.only(chosen[tracks.point])
