"""Features and verified matches of images by COLMAP, on the CPU, at reduced size.

Matches are verified with a fundamental matrix or a homography and never with K, so a wrong K does not lose any match.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import InputError
from calibrary.extras import SFM, require
from calibrary.progress import Progress
from calibrary.sfm.colmap_process import run_apart

Item = TypeVar("Item")

DATABASE = "database.db"
"""Name of the database in the folder of a :class:`MatchedFlight`."""

IMAGES = "images"
"""Name of the folder beside it with a link to each image."""

MAX_SIDE = 1600
"""Longer side for feature detection, px. Twice the size takes four times the time and memory."""

ENOUGH = 1500
"""Number of features below which an image is searched again at double size, which takes four times as long. Images of
fields have 2200 to 3700 without it; doubling adds the smallest features, most of which FEATURES drops again."""

FEATURES = 3000
"""Number of features of an image: whole octaves are kept, from the largest scale on, until it is reached."""

MEMORY_PER_THREAD = 530 * 2**20
"""Measured memory for feature detection in an image of MAX_SIDE at double size, bytes."""

MEMORY = 1600 * 2**20
"""Memory for all threads, bytes; with the process itself and the decoded images the total stays below 2 GB."""

MATCH_ERROR = 4.0
"""Largest distance from the epipolar line, px at reduced size; more than lens distortion, which F does not model."""

PAIRS_AT_ONCE = 40
"""Number of pairs matched between two progress reports."""


class FlightImage(Struct, frozen=True, kw_only=True):
    """An image of a flight.

    Attributes:
        path: path of the file.
        name: name of the image in reports, unique in the flight.
        size: (width, height) px as stored.
        centre_m: (east, north, up) m of the camera in a local frame; never written to results.
        centre_std_m: standard deviations of centre_m, m.
    """

    path: Path
    name: str
    size: ImageSize
    centre_m: tuple[float, float, float] | None = None
    centre_std_m: tuple[float, float, float] | None = None


class MatchedFlight(Struct, frozen=True, kw_only=True):
    """Features and matches of a flight, in a COLMAP database.

    Attributes:
        folder: the caller's folder, with database.db and images/. Image i of ``images`` has the image_id i + 1 there.
        images: images in input order.
    """

    folder: Path
    images: tuple[FlightImage, ...]

    @property
    def database(self) -> Path:
        """Database with one camera (OPENCV, no prior focal length), keypoints in full-image px, two-view geometries."""
        return self.folder / DATABASE

    @property
    def image_folder(self) -> Path:
        """Folder with the images under their names in the database."""
        return self.folder / IMAGES


class Matches(Struct, frozen=True, kw_only=True):
    """Verified matches of two images.

    Attributes:
        first, second: indices of the images in the flight.
        pixels_first, pixels_second: (N, 2) px, canonical, of the full image.
        by_homography: whether one homography explains them: a flat scene, a rotation, or a duplicate image.
    """

    first: int
    second: int
    pixels_first: FloatArray
    pixels_second: FloatArray
    by_homography: bool


def match(
    images: Sequence[FlightImage],
    *,
    folder: Path,
    start: Intrinsics,
    pairs: Sequence[tuple[int, int]] | None = None,
    max_side: int = MAX_SIDE,
    features: int = FEATURES,
    progress: Progress | None = None,
) -> MatchedFlight:
    """Extract features and match pairs of images, in a separate process.

    Args:
        images: images of one camera and size.
        folder: an empty folder, such as a temporary one; after an interruption its contents are useless.
        start: K of the camera in the database; the matches do not depend on it.
        pairs: indices of ``images``; None for all pairs.
        max_side: longer side for feature detection, px.
        features: number of features per image, see :data:`FEATURES`.
        progress: called with (images done, images in total, "features"), then with "pairs".

    Raises:
        MissingExtraError: pycolmap is not installed.
        InputError: the images are fewer than two, or differ in size.
        CalibrationError: COLMAP cannot read the images.
    """
    require(SFM, "Matching images")
    images = tuple(images)
    if len(images) < 2:
        raise InputError(f"{len(images)} image cannot be matched, expected at least two")
    odd = next((image for image in images if image.size != start.image_size), None)
    if odd is not None:
        (w, h), (w0, h0) = odd.size, start.image_size
        raise InputError(f"is {w}×{h} px, expected {w0}×{h0} like its camera's K", source=odd.name)
    matched = MatchedFlight(folder=folder, images=images)
    names = [f"{place:05d}{image.path.suffix.lower()}" for place, image in enumerate(images)]
    matched.image_folder.mkdir()
    for name, image in zip(names, images, strict=True):
        _link(image.path, matched.image_folder / name)
    wanted = [*combinations(range(len(images)), 2)] if pairs is None else sorted({_ordered(p) for p in pairs})
    run_apart(_match, progress, matched, names, wanted, start, max_side, features)
    return matched


def read_keypoints(matched: MatchedFlight) -> list[FloatArray]:
    """Read the features of each image: (N, 2) px, canonical, of the full image."""
    with closing(sqlite3.connect(matched.database)) as database:
        found = {
            number - 1: np.frombuffer(data, np.float32).reshape(rows, columns)[:, :2].astype(np.float64)
            for number, rows, columns, data in database.execute(
                "SELECT image_id, rows, cols, data FROM keypoints"
            )
            if rows
        }
    return [found.get(place, np.empty((0, 2))) for place in range(len(matched.images))]


def read_matches(matched: MatchedFlight, *, least: int = 15) -> list[Matches]:
    """Read the verified matches of each pair with at least ``least`` of them."""
    keypoints = read_keypoints(matched)
    with closing(sqlite3.connect(matched.database)) as database:
        found = database.execute(
            "SELECT pair_id, rows, data, config FROM two_view_geometries WHERE rows >= ? ORDER BY pair_id",
            (max(least, 1),),
        ).fetchall()
    return [_matches(keypoints, *row) for row in found]


PAIR_BASE = 2147483647
"""COLMAP's pair_id is smaller image_id × this + larger image_id; ``scene/database.h``, kMaxNumImages."""

PLANAR_OR_PANORAMIC = frozenset({4, 5, 6})
"""``geometry/two_view_geometry.h``: PLANAR, PANORAMIC, PLANAR_OR_PANORAMIC."""


def _matches(keypoints: list[FloatArray], pair: int, rows: int, data: bytes, config: int) -> Matches:
    first, second = pair // PAIR_BASE - 1, pair % PAIR_BASE - 1
    points = np.frombuffer(data, np.uint32).reshape(rows, 2).astype(np.int64)
    return Matches(
        first=first,
        second=second,
        pixels_first=keypoints[first][points[:, 0]],
        pixels_second=keypoints[second][points[:, 1]],
        by_homography=config in PLANAR_OR_PANORAMIC,
    )


def _ordered(pair: tuple[int, int]) -> tuple[int, int]:
    return min(pair), max(pair)


def _link(path: Path, name: Path) -> None:
    """Link the image under a name without spaces, as COLMAP's lists require; copies it if links are impossible."""
    for make in (os.symlink, os.link):
        try:
            make(path.resolve(), name)
        except OSError:  # Windows asks for a privilege, a FAT disk knows no links
            continue
        return
    shutil.copyfile(path, name)


def _match(
    report: Progress,
    matched: MatchedFlight,
    names: list[str],
    pairs: list[tuple[int, int]],
    start: Intrinsics,
    max_side: int,
    features: int,
) -> None:
    """Extract and match; runs in the separate process."""
    import pycolmap

    pycolmap.set_random_seed(0)
    for left in matched.folder.glob(f"{DATABASE}*"):
        left.unlink()  # by a process that died
    _begin_database(pycolmap, matched, names, start)
    _find_features(pycolmap, report, matched, names, max_side, features)
    matching, verification, pairing = (
        pycolmap.FeatureMatchingOptions(),
        pycolmap.TwoViewGeometryOptions(),
        pycolmap.ImportedPairingOptions(),
    )
    matching.num_threads = _threads(max_side)
    verification.ransac.max_error = MATCH_ERROR * max(1.0, max(start.image_size) / max_side)
    verification.ransac.random_seed = 0
    pairing.match_list_path = matched.folder / "pairs.txt"
    for some in _parts(pairs, PAIRS_AT_ONCE, report, "pairs"):
        lines = "".join(f"{names[first]} {names[second]}\n" for first, second in some)
        (matched.folder / "pairs.txt").write_text(lines, encoding="utf-8")
        pycolmap.match_image_pairs(
            matched.database, matching, pairing, verification, device=pycolmap.Device.cpu
        )


def _find_features(
    pycolmap: Any, report: Progress, matched: MatchedFlight, names: list[str], max_side: int, features: int
) -> None:
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.max_image_size, extraction.sift.max_num_features = max_side, features
    # A second orientation would repeat the same point and count its noise twice.
    extraction.sift.max_num_orientations = 1

    def find(some: list[str], octave: int) -> None:
        extraction.sift.first_octave, extraction.num_threads = octave, _threads(max_side * 2**-octave)
        pycolmap.extract_features(
            matched.database,
            matched.image_folder,
            image_names=some,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )

    for part in _parts(names, 2 * _threads(max_side), report, "features"):
        find(part, 0)
        if few := _forgotten(matched.database, part, min(ENOUGH, features)):
            find(few, -1)


def _forgotten(database: Path, names: Sequence[str], least: int) -> list[str]:
    """Return the images with fewer than ``least`` features, and delete their features from the database."""
    with closing(sqlite3.connect(database)) as opened:
        known = dict(opened.execute("SELECT image_id, rows FROM keypoints").fetchall())
        few = [name for name in names if known.get(int(Path(name).stem) + 1, 0) < least]
        for table in ("keypoints", "descriptors"):
            opened.executemany(
                f"DELETE FROM {table} WHERE image_id = ?",  # noqa: S608  one of two constants
                [(int(Path(name).stem) + 1,) for name in few],
            )
        opened.commit()
    return few


def _parts(items: Sequence[Item], size: int, report: Progress, what: str) -> Iterator[list[Item]]:
    """Yield the items in parts of ``size`` and report progress after each.

    COLMAP itself reports nothing, and reading its database while it writes may crash it, because it does not survive a
    lock.
    """
    report(0, len(items), what)
    for first in range(0, len(items), size):
        yield list(items[first : first + size])
        report(min(first + size, len(items)), len(items), what)


def _begin_database(pycolmap: Any, matched: MatchedFlight, names: list[str], start: Intrinsics) -> None:
    """Make the database with one camera and the images in order: image_id is the index plus one."""
    with pycolmap.Database.open(matched.database):
        pass  # creates its tables
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "OPENCV"
    reader.camera_params = ",".join(map(repr, (start.fx, start.fy, start.cx, start.cy, 0.0, 0.0, 0.0, 0.0)))
    pycolmap.import_images(
        matched.database, matched.image_folder, pycolmap.CameraMode.SINGLE, image_names=names, options=reader
    )
    with closing(sqlite3.connect(matched.database)) as database:
        # With a prior, COLMAP verifies matches with K and drops those that a wrong K does not explain.
        database.execute("UPDATE cameras SET prior_focal_length = 0")
        database.commit()
        numbers = [number for (number,) in database.execute("SELECT image_id FROM images ORDER BY name")]
    if numbers != [*range(1, len(names) + 1)]:
        unread = ", ".join(matched.images[n].name for n in range(len(names)) if n + 1 not in numbers)
        raise InputError(f"COLMAP cannot read {unread or 'the images'}")


def _threads(side: float) -> int:
    """Return the number of threads for images with this longer side (after doubling), by cores and memory."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(cores, int(MEMORY / (MEMORY_PER_THREAD * (side / (2 * MAX_SIDE)) ** 2))))
