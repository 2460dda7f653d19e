"""Tracks and a first scene from matched images, by COLMAP's incremental mapping in a separate process.

COLMAP's adjustment is only the start of :mod:`calibrary.sfm.adjust`. It therefore fixes the principal point, which the
first few images cannot determine, and adjusts all images together less often than by default.

If the images do not fit together, the message states why. Obvious reasons are found before the mapping, which tries
hundreds of pairs before it fails. Reasons that only this failure confirms, such as that all images are from one place,
are found after it.
"""

from __future__ import annotations

import math
import sqlite3
import tempfile
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import CalibrationError
from calibrary.progress import Progress
from calibrary.sfm.colmap_process import run_apart
from calibrary.sfm.engine import FlightImage, MatchedFlight, Matches, read_keypoints, read_matches
from calibrary.sfm.tracks import FEWEST_IMAGES, Positions, Scene, Tracks, widest

OPENCV: Final = ("OPENCV", 4, Solvable.K1K2P1P2)
OPENCV_FISHEYE: Final = ("OPENCV_FISHEYE", 5, Solvable.FISHEYE)
"""Name and number of COLMAP's model (``sensor/models.h``), and our model with the same order of the parameters."""
WIDE_RAD: Final = math.radians(50)
"""Angle off the axis beyond which a reconstruction with OPENCV is compared with one with OPENCV_FISHEYE: half the
diagonal of a 24 mm lens is 42°."""
GLOBAL_RATIO: Final = 1.4
"""All images are adjusted together when their number has grown by this factor; COLMAP's default is 1.1."""
LONGEST_S: Final = 1800
MODEL_IMAGES: Final = 3

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


def reconstruct(
    matched: MatchedFlight, *, start: Intrinsics, fisheye: bool = False, progress: Progress | None = None
) -> tuple[Tracks, Scene]:
    """Reconstruct the largest set of images that fit together; returns tracks and a scene to adjust.

    Args:
        matched: result of :func:`calibrary.sfm.engine.match`.
        start: initial K; between 0.7 and 1.5 times the true focal length it makes no difference.
        fisheye: whether the lens is known to be a fisheye; otherwise both models are tried for a wide one.
        progress: called with (images placed, images in total, "placed").

    Raises:
        CalibrationError: fewer than three images fit together; the message states the reason and a remedy.
    """
    features, matches, size = (
        [len(one) for one in read_keypoints(matched)],
        read_matches(matched),
        start.image_size,
    )
    if (why := obvious_reason_unfit(features, matches, size)) is not None:
        raise CalibrationError(why)
    found = run_apart(_map, progress, matched, start, OPENCV_FISHEYE if fisheye else OPENCV)
    if not fisheye and (widest(*found) > WIDE_RAD if found else not _only_turned(matches, size)):
        # A perspective lens follows a few images of a fisheye over flat ground, with a focal length of next to nothing,
        # or none of them.
        with suppress(CalibrationError):
            other = run_apart(_map, progress, matched, start, OPENCV_FISHEYE)
            found = max(found or other, other or found, key=lambda one: len(one[0].point) if one else 0)
    if found is None:
        raise CalibrationError(reason_unfit(len(features), matches, size))
    return found


def positions_of(images: tuple[FlightImage, ...]) -> Positions | None:
    """Return the stated positions of the images; None if there are none."""
    if all(image.centre_m is None for image in images):
        return None
    unknown = (np.nan,) * 3
    return Positions(
        places=np.array([image.centre_m or unknown for image in images], dtype=np.float64),
        std=np.array([image.centre_std_m or unknown for image in images], dtype=np.float64),
    )


def _map(
    report: Progress, matched: MatchedFlight, start: Intrinsics, model: tuple[str, int, Solvable]
) -> tuple[Tracks, Scene] | None:
    """Run the mapping; runs in the separate process."""
    import pycolmap

    pycolmap.set_random_seed(0)
    _begin_camera(matched.database, start, model)
    options = pycolmap.IncrementalPipelineOptions()
    options.extract_colors = False
    options.random_seed = 0
    options.min_model_size = MODEL_IMAGES
    options.max_num_models = 2
    options.max_runtime_seconds = LONGEST_S
    options.ba_global_frames_ratio = options.ba_global_points_ratio = GLOBAL_RATIO
    total, placed = len(matched.images), 0

    def count() -> None:
        nonlocal placed
        placed += 1
        report(min(placed, total), total, "placed")

    report(0, total, "placed")
    with tempfile.TemporaryDirectory(dir=matched.folder) as out:
        models = pycolmap.incremental_mapping(
            matched.database,
            matched.image_folder,
            out,
            options,
            initial_image_pair_callback=count,
            next_image_callback=count,
        )
    largest = max(models.values(), key=lambda one: int(one.num_reg_images()), default=None)
    if largest is None or largest.num_reg_images() < FEWEST_IMAGES:
        return None
    report(total, total, "placed")
    return _tracks(largest, matched, model[2])


def _begin_camera(database: Path, start: Intrinsics, model: tuple[str, int, Solvable]) -> None:
    """Set the model and the initial K of the database's camera."""
    size = len(model[2].parameters)
    values = np.zeros(size)
    values[:4] = start.fx, start.fy, start.cx, start.cy
    with closing(sqlite3.connect(database)) as opened:
        opened.execute(
            "UPDATE cameras SET model = ?, params = ?, prior_focal_length = 1", (model[1], values.tobytes())
        )
        opened.commit()


def _tracks(found: Any, matched: MatchedFlight, model: Solvable) -> tuple[Tracks, Scene]:
    """Convert a pycolmap reconstruction to tracks and a scene; image i has the image_id i + 1."""
    views = len(matched.images)
    rotations, centres = np.tile(np.eye(3), (views, 1, 1)), np.zeros((views, 3))
    keypoints: dict[int, FloatArray] = {}
    for image_id in found.reg_image_ids():
        image = found.image(image_id)
        pose = image.cam_from_world()
        rotations[image_id - 1] = pose.rotation.matrix()
        centres[image_id - 1] = image.projection_center()
        keypoints[image_id - 1] = np.array([point.xy for point in image.points2D])
    rows: list[tuple[int, int]] = []
    pixels, points = [], []
    for number, point in enumerate(found.points3D.values()):
        points.append(point.xyz)
        seen: dict[int, int] = {}
        for element in point.track.elements:
            # If one image has two features of a point, neither is reliable.
            seen[element.image_id - 1] = -1 if element.image_id - 1 in seen else element.point2D_idx
        for image_at, feature in seen.items():
            if feature >= 0:
                rows.append((image_at, number))
                pixels.append(keypoints[image_at][feature])
    pairs = np.array(rows, dtype=np.intp).reshape(-1, 2)
    camera = next(iter(found.cameras.values()))
    tracks = Tracks(
        names=tuple(image.name for image in matched.images),
        image_size=matched.images[0].size,
        image=pairs[:, 0],
        point=pairs[:, 1],
        pixels=np.array(pixels).reshape(-1, 2),
        positions=positions_of(matched.images),
    )
    scene = Scene(
        model=model,
        parameters=np.array(camera.params),
        rotations=rotations,
        centres=centres,
        points=np.array(points).reshape(-1, 3),
    )
    return tracks.only(np.ones(len(pairs), dtype=np.bool_)), scene


def obvious_reason_unfit(features: Sequence[int], matches: Sequence[Matches], size: ImageSize) -> str | None:
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


def reason_unfit(images: int, matches: Sequence[Matches], size: ImageSize) -> str:
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
