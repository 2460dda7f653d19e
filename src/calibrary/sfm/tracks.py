"""What the images of a flight share: points that were seen in several of them, and where the images were taken."""

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

__all__ = [
    "FEWEST_IMAGES",
    "Control",
    "Positions",
    "Scene",
    "Similarity",
    "Tracks",
    "aligned",
    "levelled",
    "similarity",
    "thinned",
    "upward",
]

FEWEST_IMAGES: Final = 3
"""Fewer leave nothing to check a focal length by."""


class Positions(Struct, frozen=True, kw_only=True, eq=False):
    """Where the images were taken, as a satellite receiver says it.

    Attributes:
        places: (V, 3) m east, north and up of a point nearby; NaN where an image states none.
        std: (V, 3) m.
    """

    places: FloatArray
    std: FloatArray

    @property
    def known(self) -> BoolArray:
        """(V,) which images state one."""
        return np.asarray(np.isfinite(self.places).all(axis=1), dtype=np.bool_)


class Control(Struct, frozen=True, kw_only=True, eq=False):
    """Points of the ground whose places were surveyed.

    Attributes:
        names: of the G points.
        point: (G,) which points of the tracks they are; all observations of these are marks.
        places: (G, 3) m east, north and up.
        std_m: of each coordinate of a place.
        mark_px: standard deviation of each coordinate of a mark.
        offset_std_m: how well the images' positions are in the points' frame, but for errors of each; inf where
            nothing is known of that.
    """

    names: tuple[str, ...]
    point: IntArray
    places: FloatArray
    std_m: float
    mark_px: float
    offset_std_m: float = math.inf


class Tracks(Struct, frozen=True, kw_only=True, eq=False):
    """Points by the images they were seen in.

    Attributes:
        names: of the V images.
        image_size: (width, height) px, of every one.
        image: (N,) which image.
        point: (N,) which point, ascending.
        pixels: (N, 2) px of the full image, from the outer corner of its first pixel.
        positions: None where no image states any.
        control: None where no point was surveyed.
    """

    names: tuple[str, ...]
    image_size: ImageSize
    image: IntArray
    point: IntArray
    pixels: FloatArray
    positions: Positions | None = None
    control: Control | None = None

    @property
    def marks(self) -> BoolArray:
        """(N,) which observations are of surveyed points."""
        known = self.control.point if self.control is not None else np.empty(0, dtype=np.intp)
        return np.asarray(np.isin(self.point, known), dtype=np.bool_)

    def shared(self, keep: BoolArray) -> BoolArray:
        """(N,) which of these observations are of points that two of them show; of a surveyed one is enough.

        Args:
            keep: (N,).
        """
        counts = np.bincount(self.point[keep], minlength=int(self.point.max(initial=-1)) + 1)
        return np.asarray(keep & ((counts[self.point] >= 2) | self.marks), dtype=np.bool_)

    def only(self, keep: BoolArray) -> Tracks:
        """Some of the observations, without those of points that are left with too few.

        Args:
            keep: (N,).
        """
        rows = self.shared(keep)
        return replace(self, image=self.image[rows], point=self.point[rows], pixels=self.pixels[rows])

    @property
    def used(self) -> BoolArray:
        """(V,) which images see anything."""
        return np.asarray(np.bincount(self.image, minlength=len(self.names)) > 0, dtype=np.bool_)


class Scene(Struct, frozen=True, kw_only=True, eq=False):
    """What a bundle adjustment solves for.

    Attributes:
        model: of the lens.
        parameters: (n,) in the model's order.
        rotations: (V, 3, 3) world to camera.
        centres: (V, 3) of projection, in the world.
        points: (P, 3) in the world.
    """

    model: Solvable
    parameters: FloatArray
    rotations: FloatArray
    centres: FloatArray
    points: FloatArray


class Similarity(Struct, frozen=True, kw_only=True, eq=False):
    """From one frame to another.

    Attributes:
        scale: m for a unit.
        turn: (3, 3).
        shift: (3,) m.
    """

    scale: float
    turn: FloatArray
    shift: FloatArray

    def of(self, places: FloatArray) -> FloatArray:
        """(N, 3) places in the other frame."""
        return np.asarray(self.scale * places @ self.turn.T + self.shift)

    def moved(self, scene: Scene) -> Scene:
        """The scene in the other frame."""
        return replace(
            scene,
            rotations=scene.rotations @ self.turn.T,
            centres=self.of(scene.centres),
            points=self.of(scene.points),
        )


def similarity(here: FloatArray, there: FloatArray) -> Similarity:
    """The one by which (N, 3) places come nearest to (N, 3) others; its scale is 0 where they have none in common.

    Source: S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991.
    """
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    U, values, Vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    turn = (U * sign) @ Vt
    scale = max(float(values @ sign), 0.0) / max(float((a**2).sum()), 1e-300)
    return Similarity(scale=scale, turn=turn, shift=there.mean(axis=0) - scale * turn @ here.mean(axis=0))


def aligned(scene: Scene, positions: Positions) -> Scene:
    """The same scene moved, turned and scaled so that its images are where they say.

    Raises:
        CalibrationError: fewer than three images say where they were taken.
    """
    known = positions.known
    if int(known.sum()) < FEWEST_IMAGES:
        raise CalibrationError(f"{int(known.sum())} images state a position, need {FEWEST_IMAGES}")
    found = similarity(scene.centres[known], positions.places[known])
    if not found.scale > 0:
        raise CalibrationError("the images' positions contradict what the images show")
    return found.moved(scene)


def upward(points: FloatArray, centres: FloatArray) -> FloatArray:
    """(3,) unit vector across the ground's own plane, to the side of the images.

    Args:
        points: (P, 3).
        centres: (V, 3) of projection.
    """
    middle = np.median(points, axis=0)
    axis = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    return np.asarray(axis * (1.0 if float(np.median((centres - middle) @ axis)) > 0 else -1.0))


def levelled(scene: Scene) -> Scene:
    """The same scene turned so that its ground is level, z up, where no position says how it lies."""
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
    """At most so many points: those that most images see, and of these at random, so that no image is left without."""
    counts = np.bincount(tracks.point)
    points = np.flatnonzero(counts)
    if len(points) <= most:
        return tracks
    random = np.random.default_rng(seed).random(len(counts))
    # A long track ties many images; random numbers spread the choice among tracks of one length over the frame.
    order = points[np.lexsort((random[points], -np.minimum(counts[points], 6)))]
    chosen = np.zeros(len(counts), dtype=np.bool_)
    chosen[order[: most // 2]] = True
    chosen[np.random.default_rng(seed + 1).permutation(order[most // 2 :])[: most - most // 2]] = True
    return tracks.only(chosen[tracks.point])
