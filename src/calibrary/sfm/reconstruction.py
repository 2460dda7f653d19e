"""A finished reconstruction of another program: its images, poses, points and observations.

Its camera is only the start of our own adjustment. The result depends on the observations, which
:mod:`calibrary.sfm.sigma` assesses like those of our own reconstruction.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import Calibration, SourceFile
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational, exact
from calibrary.errors import CalibrationError, InputError
from calibrary.records import replace
from calibrary.sfm.image_selection import OBLIQUE_FROM_DEG, height_classes, images_nearby
from calibrary.sfm.tracks import FEWEST_IMAGES, Positions, Scene, Tracks, upward

FEWEST_OBSERVATIONS: Final = 20
"""Smallest number of observations of an image; fewer hardly determine its pose."""
PERSPECTIVE_UP_TO_DEG: Final = 60.0


class Reconstruction(Struct, frozen=True, kw_only=True, eq=False):
    """Result of another program.

    Attributes:
        program: name of the program.
        cameras: its cameras, by the names that its images use.
        names: names of the V images in the program.
        camera: (V,) name of each image's camera.
        rotations: (V, 3, 3) world to camera.
        centres: (V, 3) centres of projection.
        points: (P, 3) points.
        image: (N,) image of each observation.
        point: (N,) point of each observation.
        pixels: (N, 2) px from the outer corner of the first pixel.
        positions: positions of the images, as they state them; None if the program does not store them.
        files: files with the observations.
        looked_px: longer side at which the program detects features by default, px.
    """

    program: str
    cameras: Mapping[str, Calibration]
    names: tuple[str, ...]
    camera: tuple[str, ...]
    rotations: FloatArray
    centres: FloatArray
    points: FloatArray
    image: IntArray
    point: IntArray
    pixels: FloatArray
    positions: Positions | None
    files: tuple[SourceFile, ...]
    looked_px: int

    @property
    def plain_names(self) -> tuple[str, ...]:
        """Names of the images, without their folders if unique without."""
        plain = [PurePosixPath(name.replace("\\", "/")).name for name in self.names]
        counts = Counter(plain)
        return tuple(
            short if counts[short] == 1 else name for short, name in zip(plain, self.names, strict=True)
        )

    def of_camera(self, name: str) -> BoolArray:
        """Return (V,) which images are of the camera ``name``."""
        return np.array([one == name for one in self.camera], dtype=np.bool_)


def scene_of(
    model: Reconstruction, taken: BoolArray, most: int, shown: Mapping[str, frozenset[int]] | None = None
) -> tuple[Tracks, Scene, Calibration]:
    """Select images of one camera; return their tracks, a scene to adjust, and the camera as the program states it.

    Args:
        model: result of another program.
        taken: (V,) which images are of the camera.
        most: largest number of images, selected by :func:`calibrary.sfm.image_selection.images_nearby`.
        shown: surveyed points in each image, by its plain name.

    Raises:
        CalibrationError: fewer than three images have enough observations.
        InputError: the images differ in size.
    """
    rows = taken & _telling(model, taken)
    if int(rows.sum()) > most:
        rows = _chosen(model, rows, most, shown or {})
        rows &= _telling(model, rows)
    images = np.flatnonzero(rows)
    if len(images) < FEWEST_IMAGES:
        raise CalibrationError(
            f"{len(images)} images of this camera show {FEWEST_OBSERVATIONS} points and more that others show too, "
            f"need {FEWEST_IMAGES}"
        )
    usual = Counter(model.camera[at] for at in images.tolist()).most_common(1)[0][0]
    stated = model.cameras[usual]
    sizes = {model.cameras[model.camera[at]].intrinsics.image_size for at in images.tolist()}
    if len(sizes) > 1:
        listed = ", ".join("{}×{}".format(*size) for size in sorted(sizes))
        raise InputError(f"the images are of several sizes: {listed} px; expected those of one camera")
    number = np.full(len(model.names), -1)
    number[images] = np.arange(len(images))
    seen = _once(model) & rows[model.image]
    points, point = np.unique(model.point[seen], return_inverse=True)
    order = np.argsort(point, kind="stable")
    positions = model.positions
    names = model.plain_names
    tracks = Tracks(
        names=tuple(names[at] for at in images.tolist()),
        image_size=stated.intrinsics.image_size,
        image=number[model.image[seen]][order],
        point=point[order],
        pixels=model.pixels[seen][order],
        positions=replace(positions, places=positions.places[images], std=positions.std[images])
        if positions is not None
        else None,
    )
    kind, parameters = _lens(stated)
    scene = Scene(
        model=kind,
        parameters=parameters,
        rotations=model.rotations[images],
        centres=model.centres[images],
        points=model.points[points],
    )
    return tracks.only(np.ones(len(order), dtype=np.bool_)), scene, stated


def _once(model: Reconstruction) -> BoolArray:
    """Return (N,) which observations are the only one of their point in their image; of two, neither is reliable."""
    pair = model.image.astype(np.int64) * (len(model.points) + 1) + model.point
    _, inverse, counts = np.unique(pair, return_inverse=True, return_counts=True)
    return np.asarray(counts[inverse] == 1, dtype=np.bool_)


def _telling(model: Reconstruction, rows: BoolArray) -> BoolArray:
    """Return (V,) which images of ``rows`` share enough points with others of them."""
    seen = rows[model.image]
    counts = np.bincount(model.point[seen], minlength=len(model.points))
    shared = seen & (counts[model.point] >= 2)
    enough = np.bincount(model.image[shared], minlength=len(rows)) >= FEWEST_OBSERVATIONS
    return np.asarray(rows & enough, dtype=np.bool_)


def _chosen(
    model: Reconstruction, rows: BoolArray, most: int, shown: Mapping[str, frozenset[int]]
) -> BoolArray:
    """Select ``most`` images of different height, heading and tilt around one place; returns (V,) which."""
    # By name they are in the order of capture, which a program need not keep.
    images = np.array(sorted(np.flatnonzero(rows).tolist(), key=model.names.__getitem__))
    turns, centres = model.rotations[images], model.centres[images]
    up = upward(model.points[np.unique(model.point[rows[model.image]])], centres)
    east = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 1.0, 0.0))
    east /= np.linalg.norm(east)
    places = centres @ np.stack([east, np.cross(up, east), up], axis=1)
    oblique = np.degrees(np.arccos(np.clip(-turns[:, 2] @ up, -1.0, 1.0))) > OBLIQUE_FROM_DEG
    yaw = np.degrees(np.arctan2(turns[:, 0] @ np.cross(up, east), turns[:, 0] @ east))
    quarter = np.floor((yaw + 45.0) / 90.0).astype(int)
    heading = np.where(oblique, quarter % 4, quarter % 2)
    kinds = zip(
        height_classes(places, 0.0).tolist(), heading.tolist(), oblique.astype(int).tolist(), strict=True
    )
    kept = np.zeros_like(rows)
    points = [shown.get(model.plain_names[at], frozenset()) for at in images.tolist()]
    kept[images[images_nearby(places, [*kinds], most, points)]] = True
    return kept


def _lens(stated: Calibration) -> tuple[Solvable, FloatArray]:
    """Convert the camera to a model that can be adjusted, as a start; other lenses start without distortion."""
    K, lens = stated.intrinsics, stated.distortion or NoDistortion()
    plain = replace(K, skew=0.0)
    for model, kind in (
        (Solvable.BROWN, BrownConrady),
        (Solvable.RATIONAL, Rational),
        (Solvable.FISHEYE, KannalaBrandt),
    ):
        same = exact(lens, kind)
        if same is not None:
            return model, model.values(plain, same)
    reach = math.hypot(K.cx / K.fx, K.cy / K.fy)
    wide = math.degrees(math.atan(reach)) > PERSPECTIVE_UP_TO_DEG
    model = Solvable.FISHEYE if wide else Solvable.BROWN
    return model, model.values(plain, None)
